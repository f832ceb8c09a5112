"""The location of this repository, and copies of its clips."""

from __future__ import annotations

import shutil
from pathlib import Path

REPOSITORY = Path(__file__).parent.parent


def copy_clip(name: str, folder: Path) -> None:
    """Copy the manifest and the labels of a clip of the repository into a folder that has neither yet."""
    for kind, suffix in (("datasets", "toml"), ("annotations", "csv")):
        (folder / kind).mkdir()
        shutil.copy(REPOSITORY / kind / f"{name}.{suffix}", folder / kind)
