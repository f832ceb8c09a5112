"""Clips that are files of somebody's repository, downloaded one by one at one commit.

``idiap_vfoa`` is a measured conversation, ``vr_objects`` are people in virtual rooms, ``opencv_stereo`` are pairs of a
calibration board and the man who holds it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from harness.files.digests import file_digest
from harness.files.download import download
from harness.files.folders import folders
from harness.files.tables import read_rows
from vfoa.errors import VfoaError

IDIAP_COMMIT = "c42697ebd848dc4871a5aaf480e2bbc40effc2c6"
IDIAP_HOME = f"https://raw.githubusercontent.com/idiap/vfoa/{IDIAP_COMMIT}/tests/"
IDIAP_LICENCE = "BSD 3-Clause, Idiap Research Institute"
VR_COMMIT = "fe12e11c52e759d0e8fa071cbdd34e90e375a7f8"
VR_HOME = f"https://raw.githubusercontent.com/ischtz/jov2023-vr-objects/{VR_COMMIT}/data/"
VR_LICENCE = "MIT; cite Schuetz, Baltaretu and Fiehler, Journal of Vision 24(7):10, 2024"
OPENCV_HOME = "https://raw.githubusercontent.com/opencv/opencv/4.10.0/samples/data/"
OPENCV_LICENCE = "Apache-2.0, OpenCV"
_AT_ONCE = 8


@dataclass(frozen=True, slots=True)
class RemoteFile:
    """A file below the repository's folder, the sha256 of its content, and its size if it is known."""

    name: str
    sha256: str
    n_bytes: int | None = None


HEADS = RemoteFile("test_runVfoaModule_data.csv", "d28156d9210bf5c792f79800c451bbaab822dc58c583aa9906272a149883ccf7")
LABELS = RemoteFile("test_runVfoaModule_gt.npz", "ad6333e72c00c965d3f17b23aced1bc9eb50434cb72da9e61d7f416d3afeb096")


def listed_files(source: str) -> list[RemoteFile]:
    """The files of a source, as ``datasets/SOURCE.csv`` lists them."""
    table = next(path for folder in folders("datasets") if (path := folder / f"{source}.csv").is_file())
    columns = ("path", "bytes", "sha256")
    return [
        RemoteFile(row.cells["path"], row.cells["sha256"], row.integer("bytes"))
        for row in read_rows(table, columns, columns)
    ]


def fetch_files(
    root: Path,
    files: Sequence[RemoteFile],
    home: str,
    progress: Callable[[int, int | None], None] = lambda done, total: None,
) -> None:
    """Download files into ``root``; those that are there with the right checksum are not downloaded again.

    ``progress`` is called with the bytes of the complete files, and those of all files if they are known.

    Raises
    ------
    VfoaError
        If a download fails, or a content is not that of the commit. What is complete stays.
    """
    sizes = [file.n_bytes for file in files]
    total = None if None in sizes else sum(size or 0 for size in sizes)

    def fetch(file: RemoteFile) -> int:
        path = root / file.name
        if not path.is_file() or file_digest(path) != file.sha256:
            download(home + file.name, path, sha256=file.sha256)
        return path.stat().st_size

    done = 0
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        try:
            for size in pool.map(fetch, files):
                done += size
                progress(done, total)
        except VfoaError:
            pool.shutdown(cancel_futures=True)
            raise
