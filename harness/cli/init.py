"""``vfoa init``: a working directory to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.terminal import say

_FOLDERS = {
    "datasets": "clips, a .toml each, as `vfoa clips add PATH` writes them",
    "annotations": "who looks at what, a .csv for each clip (`vfoa annotate CLIP`)",
    "experiments": "clips under configurations, a .toml each, for `vfoa run NAME`",
}


def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Directory; it is made if it does not exist.")],
) -> None:
    """Make a working directory with the three data folders; existing files stay."""
    from vfoa.errors import VfoaError

    for name, use in _FOLDERS.items():
        try:
            (folder / name).mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            raise VfoaError(f"{folder / name}: found a file; expected a folder") from None
        say(f"{folder / name}: {use}")
    inside = "" if folder.resolve() == Path.cwd() else f"cd {folder} && "
    say(f"next: {inside}vfoa clips add PATH")
