"""Downloads of clips: MPI Sintel's archives, and files of public repositories, one by one at one commit.

``idiap_vfoa`` is a measured conversation, ``vr_objects`` are people in virtual rooms, ``opencv_stereo`` are pairs of a
calibration board and the man who holds it.
"""

from __future__ import annotations

import lzma
import shutil
import zipfile
import zlib
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from harness.files.digests import file_digest
from harness.files.download import download
from harness.files.folders import folders
from harness.files.tables import read_columns
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
    path = next(path for folder in folders("datasets") if (path := folder / f"{source}.csv").is_file())
    columns = ("path", "bytes", "sha256")
    table = read_columns(path, columns, columns)
    rows = zip(table.cells["path"], table.cells["sha256"], table.integers_or_none("bytes"), strict=True)
    return [RemoteFile(*row) for row in rows]


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
            download(home + file.name, path, checksum=file.sha256)
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


HOME = "https://files.is.tue.mpg.de/jwulff/sintel/"

ARCHIVES = {
    "stereo": "MPI-Sintel-stereo-training-20150305.zip",
    "depth": "MPI-Sintel-depth-training-20150305.zip",
    "segmentation": "MPI-Sintel-segmentation-training-20150219.zip",
}
"""Part -> file. A clip needs stereo (the images) and depth (which holds the cameras); segmentation is optional."""


def fetch_sintel(
    root: Path,
    parts: tuple[str, ...] = tuple(ARCHIVES),
    *,
    home: str = HOME,
    progress: Callable[[int, int | None], None] | None = None,
) -> None:
    """Download archives and unpack them into ``root``; an archive is removed after it is unpacked.

    No checksum of them is published. An interrupted download continues where it stopped, and the checksums inside the
    archive show whether its parts belong together.

    Raises
    ------
    VfoaError
        If a download fails, the disk is too small, or an archive is damaged.
    """
    for part in parts:
        archive = root / ARCHIVES[part]
        if not archive.is_file():
            download(home + archive.name, archive, checksum=None, resume=True, progress=progress)
        unpack(archive, root)
        archive.unlink()


def unpack(archive: Path, root: Path) -> None:
    """Unpack an archive, after checking the free space on the disk; names that lead out of ``root`` end inside it.

    Raises
    ------
    VfoaError
        If it is damaged (then it is removed, so that the next fetch begins anew), or the disk is too small.
    """
    try:
        with zipfile.ZipFile(archive) as file:
            members = [member for member in file.infolist() if not member.is_dir()]
            _check_room(archive, root, sum(member.file_size for member in members))
            file.extractall(root, members)
    except (zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, RuntimeError) as error:  # RuntimeError: encrypted
        archive.unlink()
        raise VfoaError(f"{archive}: damaged and removed: {error}; expected a complete zip (try again)") from None
    except OSError as error:
        raise VfoaError(f"{archive}: cannot be unpacked: {error.strerror or error}") from None


def _check_room(archive: Path, root: Path, needed: int) -> None:
    free = shutil.disk_usage(root).free
    if needed > free:
        raise VfoaError(f"{root}: {free / 1e9:.1f} GB free; expected {needed / 1e9:.1f} GB to unpack {archive.name}")
