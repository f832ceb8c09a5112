"""Data folders: those of the working directory first, then those of the package."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from harness.files.io import stands

Kind = Literal["datasets", "annotations", "experiments"]

_PACKAGE = Path(__file__).parent.parent
_SUFFIX: dict[Kind, str] = {"datasets": ".toml", "annotations": ".csv", "experiments": ".toml"}


def folders(kind: Kind) -> list[Path]:
    """Every folder that may hold files of this kind, in search order; some may not exist."""
    if kind == "experiments":
        return [Path.cwd() / kind, _PACKAGE / kind]
    found = [Path.cwd() / kind, _PACKAGE / "_data" / kind]
    # Beside an installed package, "datasets" would belong to something else; beside a checkout it is ours.
    if (_PACKAGE.parent / "pyproject.toml").is_file():
        found.append(_PACKAGE.parent / kind)
    return found


def came_with_program(manifest: Path) -> bool:
    """Whether a manifest is the program's own, of an installed package or a checkout: nothing is written there.

    In the checkout itself, its data can be changed.
    """
    own, *of_program = (folder.resolve() for folder in folders("datasets"))
    folder = manifest.resolve().parent
    return folder != own and folder in of_program


def find(kind: Kind, name: str) -> Path | None:
    """The file of this kind called ``name`` (without its suffix), or None."""
    candidates = (folder / f"{name}{_SUFFIX[kind]}" for folder in folders(kind))
    return next((path for path in candidates if stands(path)), None)


def names(kind: Kind) -> dict[str, Path]:
    """All files of this kind by name, sorted; if two folders have the same name, the one that :func:`find` returns."""
    found: dict[str, Path] = {}
    for folder in reversed(folders(kind)):
        found.update((path.stem, path) for path in folder.glob(f"*{_SUFFIX[kind]}") if stands(path))
    return dict(sorted(found.items()))
