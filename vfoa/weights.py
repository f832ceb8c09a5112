"""Locations of model files on this machine."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import platformdirs

from vfoa.errors import VfoaError
from vfoa.settings import Settings

_LFS_POINTER = b"version https://git-lfs"


def platform_cache() -> Path:
    """The folder of this program in the platform's cache directory.

    Raises
    ------
    VfoaError
        If the user has no home directory, such as a user whom the system of a container does not know.
    """
    folder = Path()
    with suppress(RuntimeError):
        folder = Path(platformdirs.user_cache_dir("vfoa"))
    if not folder.is_absolute():  # early versions leave the sign for the home as it is
        raise VfoaError("no home directory for the cache; set HOME or XDG_CACHE_HOME to a folder")
    return folder


def cache_directory() -> Path:
    """Folder of fetched weights, in the platform's cache directory. Raises as :func:`platform_cache`."""
    return platform_cache() / "models"


def directories() -> list[Path]:
    """Folders searched for weights, in order: ``$VFOA_MODELS``, then the platform's cache directory.

    Raises as :func:`platform_cache`, if the first is not set.
    """
    if not (named := os.environ.get("VFOA_MODELS")):
        return [cache_directory()]
    folders = [Path(named)]
    with suppress(VfoaError):
        folders.append(cache_directory())
    return folders


def locate(weights: str) -> Path:
    """Return the path of a weights file: itself if it is an existing file, else from the first folder that has it.

    Raises
    ------
    VfoaError
        If no folder has it.
    """
    candidates = [Path(weights).expanduser(), *(folder / weights for folder in directories())]
    for path in candidates:
        if path.is_file():
            return path
    folders = ", ".join(str(folder) for folder in directories())
    raise VfoaError(
        f"{weights}: no such model file; expected a path, or a name in one of: {folders} "
        "(VFOA_MODELS, and the folder of `vfoa models fetch`)"
    )


def check_located(files: Iterable[str]) -> None:
    """Check that every weights file is on this machine.

    Raises
    ------
    VfoaError
        If some are not; the message names all of them.
    """
    absent = []
    for file in dict.fromkeys(files):
        try:
            locate(file)
        except VfoaError:
            absent.append(file)
    if absent:
        folders = ", ".join(map(str, directories()))
        raise VfoaError(
            f"no such model files: {', '.join(absent)}; expected in one of: {folders} (`vfoa models list` shows the "
            "models of these files, `vfoa models fetch MODEL` fetches one)"
        )


def weights_of(settings: Settings) -> Iterator[str]:
    """Names of the weights files that a stage with these settings opens.

    They are the values of the keys ``weights`` and ``*_weights``, one name or several. A stage that does not open all
    of them under all settings has the property ``used_weights`` instead.
    """
    used = getattr(settings, "used_weights", None)
    yield from _named(settings.model_dump()) if used is None else used


def _named(settings: Mapping[str, Any]) -> Iterator[str]:
    for key, value in settings.items():
        if key == "weights" or key.endswith("_weights"):
            yield from [value] if isinstance(value, str) else (value or ())


def is_lfs_pointer(path: Path) -> bool:
    """Whether a file is a Git LFS pointer, in place of a large file that was not fetched."""
    with path.open("rb") as file:
        return file.read(len(_LFS_POINTER)) == _LFS_POINTER
