"""Where model files stand on this machine."""

from __future__ import annotations

import os
from pathlib import Path

import platformdirs

from vfoa.errors import VfoaError

_LFS_POINTER = b"version https://git-lfs"


def cache_directory() -> Path:
    """Where fetched weights are kept: in the cache directory of the platform."""
    return Path(platformdirs.user_cache_dir("vfoa")) / "models"


def directories() -> list[Path]:
    """The folders searched for weights, in order: ``$VFOA_MODELS``, then the cache directory of the platform."""
    named = os.environ.get("VFOA_MODELS")
    return [Path(named), cache_directory()] if named else [cache_directory()]


def locate(weights: str) -> Path:
    """Return the path of a weights file: itself if it names an existing file, else the first folder that holds it.

    Raises
    ------
    VfoaError
        If no folder holds it.
    """
    candidates = [Path(weights).expanduser(), *(folder / weights for folder in directories())]
    for path in candidates:
        if path.is_file():
            return path
    folders = ", ".join(str(folder) for folder in directories())
    raise VfoaError(
        f"{weights}: no such model file; expected a path, or a name in one of: {folders} "
        "(VFOA_MODELS, and what `vfoa models fetch` fills)"
    )


def is_lfs_pointer(path: Path) -> bool:
    """Whether a file is what Git LFS leaves in the place of a large one that was not fetched."""
    with path.open("rb") as file:
        return file.read(len(_LFS_POINTER)) == _LFS_POINTER
