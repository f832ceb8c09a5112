"""Which names may stand in tables, in spreadsheets and on terminals."""

from __future__ import annotations

import re

_FORMULA = ("=", "+", "-", "@")
"""A spreadsheet takes a cell that begins so for a formula, and runs it."""
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
"""Control characters: a terminal obeys some of them (ESC), and text turns round at others."""

_NUMBER = re.compile(r"[+-][0-9.][0-9.,]*([eE][+-]?[0-9]+)?( .*)?$")
"""A number as tables have it, perhaps with its unit or interval behind it."""


def check_name(name: str) -> str:
    """The name, if it may be used: called wherever names are defined or come from another program.

    Raises
    ------
    ValueError
        If it is empty, holds a control character, or begins as a formula does.
    """
    if not name.strip() or not name.isprintable() or name.startswith(_FORMULA):
        raise ValueError(f"found the name {name!r}; expected text that does not begin with {' '.join(_FORMULA)}")
    return name


def shown(text: str) -> str:
    """Text of unknown origin for a terminal: control characters as Python writes them."""
    return _CONTROL.sub(lambda sign: "\n" if sign[0] == "\n" else ascii(sign[0])[1:-1], text)


def plain_cell(text: str) -> str:
    """Text of unknown origin as a cell of a table: a spreadsheet takes it for text, whatever it begins with."""
    safe = text if text.isprintable() else shown(text)
    if safe.startswith(_FORMULA) and safe not in _FORMULA and not _NUMBER.match(safe):
        return f"'{safe}"
    return safe
