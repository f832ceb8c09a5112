"""Configuration files: TOML in, a model out, and one line that says what is wrong with a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from harness.bounded_parsing import parse_toml
from harness.files import read_text
from vfoa.validation import parse

__all__ = ["parse", "read_toml"]


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises
    ------
    VfoaError
        If there is no such file, or it is not TOML; the message names the line.
    """
    return parse_toml(read_text(path), path)
