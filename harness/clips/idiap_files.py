"""The measured conversation of idiap/vfoa, downloaded file by file from its repository at one commit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from harness.download import download
from harness.files import file_digest

COMMIT = "c42697ebd848dc4871a5aaf480e2bbc40effc2c6"
HOME = f"https://raw.githubusercontent.com/idiap/vfoa/{COMMIT}/tests/"
LICENCE = "BSD 3-Clause, Idiap Research Institute"


@dataclass(frozen=True, slots=True)
class RemoteFile:
    """A file of the repository and the sha256 of its content."""

    name: str
    sha256: str


HEADS = RemoteFile("test_runVfoaModule_data.csv", "d28156d9210bf5c792f79800c451bbaab822dc58c583aa9906272a149883ccf7")
LABELS = RemoteFile("test_runVfoaModule_gt.npz", "ad6333e72c00c965d3f17b23aced1bc9eb50434cb72da9e61d7f416d3afeb096")


def fetch_idiap_file(
    root: Path,
    file: RemoteFile,
    *,
    home: str = HOME,
    progress: Callable[[int, int | None], None] | None = None,
) -> Path:
    """Download one file into ``root``; an existing one with the right checksum is not downloaded again.

    Raises
    ------
    VfoaError
        If the download fails, or its content is not that of the commit.
    """
    path = root / file.name
    if not path.is_file() or file_digest(path) != file.sha256:
        download(home + file.name, path, sha256=file.sha256, progress=progress)
    return path
