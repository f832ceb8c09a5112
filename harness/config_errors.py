"""Configuration files: TOML in, a model out, and one line that says what is wrong with a file."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from harness.files import read_text
from vfoa.errors import VfoaError
from vfoa.validation import parse

__all__ = ["parse", "read_toml"]


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises
    ------
    VfoaError
        If there is no such file, or it is not TOML; the message names the line.
    """
    try:
        return tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as error:
        raise VfoaError(f"{path}: not TOML: {error}") from None
