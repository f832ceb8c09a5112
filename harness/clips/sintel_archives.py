"""MPI Sintel's official archives: downloaded and unpacked into one place."""

from __future__ import annotations

import lzma
import shutil
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path, PurePosixPath

from harness.files.download import download
from vfoa.errors import VfoaError

HOME = "https://files.is.tue.mpg.de/jwulff/sintel/"

_ZIP = b"PK\x03\x04"
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
        If a download fails, the disk is too small, or an archive is damaged or would write outside ``root``.
    """
    for part in parts:
        archive = root / ARCHIVES[part]
        if not archive.is_file():
            download(home + archive.name, archive, sha256=None, begins=_ZIP, resume=True, progress=progress)
        unpack(archive, root)
        archive.unlink()


def unpack(archive: Path, root: Path) -> None:
    """Unpack an archive, after checking every name in it and the free space on the disk.

    Raises
    ------
    VfoaError
        If it is damaged (then it is removed, so that the next fetch begins anew), a name leads out of ``root``, or
        the disk is too small.
    """
    try:
        with zipfile.ZipFile(archive) as file:
            members = [member for member in file.infolist() if not member.is_dir()]
            for member in members:
                _check_name(archive, member)
            _check_room(archive, root, sum(member.file_size for member in members))
            file.extractall(root, members)
    except (zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, RuntimeError) as error:  # RuntimeError: encrypted
        archive.unlink()
        raise VfoaError(f"{archive}: damaged and removed: {error}; expected a complete zip (try again)") from None
    except OSError as error:
        raise VfoaError(f"{archive}: cannot be unpacked: {error.strerror or error}") from None


def _check_name(archive: Path, member: zipfile.ZipInfo) -> None:
    path = PurePosixPath(member.filename.replace("\\", "/"))
    is_link = (member.external_attr >> 16) & 0o170000 == 0o120000
    if not path.parts or path.is_absolute() or ".." in path.parts or ":" in path.parts[0] or is_link:
        raise VfoaError(f"{archive}: holds {member.filename!r}; expected only files inside the archive's own folder")


def _check_room(archive: Path, root: Path, needed: int) -> None:
    free = shutil.disk_usage(root).free
    if needed > free:
        raise VfoaError(f"{root}: {free / 1e9:.1f} GB free; expected {needed / 1e9:.1f} GB to unpack {archive.name}")
