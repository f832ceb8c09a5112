"""Text of unknown origin: names that are safe in tables, text that is safe on terminals, in spreadsheets and shells."""

from __future__ import annotations

import re
import shlex
import unicodedata
from collections.abc import Mapping
from pathlib import PurePath
from typing import TypeVar

Value = TypeVar("Value")

_FORMULA = ("=", "+", "-", "@")
"""A spreadsheet executes a cell that begins with one of these as a formula."""
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
"""Control characters: a terminal obeys some of them (ESC), and some reverse the direction of text."""

_NUMBER = re.compile(r"[+-][0-9.][0-9.,]*([eE][+-]?[0-9]+)?( .*)?$")
"""A number in the form of a table, perhaps followed by its unit or interval."""


def check_name(name: str) -> str:
    """Return a valid name; called wherever names are defined or come from another program.

    Raises
    ------
    ValueError
        If it is empty, holds a control character, or begins like a formula.
    """
    if not name.strip() or not name.isprintable() or name.startswith(_FORMULA):
        raise ValueError(
            f"found the name {name!r}; expected text, not blank, that begins with none of {' '.join(_FORMULA)}"
        )
    return name


def composed(text: str) -> str:
    """Text with each accent in its letter (Unicode's form NFC), in which equal names are equal.

    macOS writes file names, and programs on it names taken from them, with accents as signs of their own (NFD).
    """
    return text if text.isascii() else unicodedata.normalize("NFC", text)


def composed_keys(values: Mapping[str, Value]) -> dict[str, Value]:
    """Values by name, each name :func:`composed`.

    Raises
    ------
    ValueError
        If a name occurs in both forms.
    """
    if twice := [name for name in values if name != composed(name) and composed(name) in values]:
        raise ValueError(f"found the name {twice[0]!r} twice, with accents in two forms of Unicode; expected one")
    return {composed(name): value for name, value in values.items()}


def shown(text: str) -> str:
    """Text of unknown origin for a terminal: control characters are escaped as in Python."""
    return _CONTROL.sub(lambda sign: "\n" if sign[0] == "\n" else ascii(sign[0])[1:-1], text)


def shell_command(*words: object) -> str:
    """A command to copy into a shell: signs of the shell are quoted, and no path reads as an option."""
    return shlex.join(
        f"./{word}" if isinstance(word, PurePath) and str(word).startswith("-") else str(word) for word in words
    )


def vfoa_command(*words: object) -> str:
    """A command of vfoa to copy into a shell; see :func:`shell_command`."""
    return shell_command("vfoa", *words)


def plain_cell(text: str) -> str:
    """Text of unknown origin as a cell of a table, escaped so that a spreadsheet does not run it as a formula."""
    safe = text if text.isprintable() else shown(text)
    if safe.startswith(_FORMULA) and safe not in _FORMULA and not _NUMBER.match(safe):
        return f"'{safe}"
    return safe
