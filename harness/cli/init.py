"""``vfoa init``: a working directory to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def init(folder: Annotated[Path, typer.Argument(metavar="DIR", help="Made where it is missing.")]) -> None:
    """Make a working directory with the three data folders; what is there already stays."""
    from vfoa.errors import VfoaError

    for name in ("datasets", "annotations", "experiments"):
        try:
            (folder / name).mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            raise VfoaError(f"{folder / name}: a file is in the way; expected a folder") from None
        typer.echo(str(folder / name))
