"""Convert values to TOML text, and parse values from the command line."""

from __future__ import annotations

import json
import math
import re
from typing import Any

from harness.bounded_parsing import parse_toml
from vfoa.errors import VfoaError

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def toml_key(key: str) -> str:
    """One part of a key, in quotes if it needs them."""
    return key if _BARE_KEY.fullmatch(key) else _text(key)


def toml_value(value: Any) -> str:
    """A JSON value as TOML text; a null in a table is left out, since TOML has no null.

    Raises
    ------
    VfoaError
        If a text is not Unicode: a file's name of other bytes.
    """
    if isinstance(value, dict):
        pairs = (f"{toml_key(key)} = {toml_value(each)}" for key, each in value.items() if each is not None)
        return "{ " + ", ".join(pairs) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return json.dumps(value)


def _text(text: str) -> str:
    """Text in JSON's quotes, which are valid TOML except for one control character."""
    if not text.isascii():
        try:
            text.encode()
        except UnicodeEncodeError:
            raise VfoaError(f"{text!a}: not UTF-8; expected a name that is") from None
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def parse_assignment(text: str, example: str, option: str = "--set") -> tuple[str, Any]:
    """Parse ``KEY=VALUE`` of an option: the value is TOML if it is valid TOML, else a string.

    Raises
    ------
    VfoaError
        If there is no equals sign; the message shows the example.
    """
    key, equals, value = text.partition("=")
    if not equals:
        raise VfoaError(f"{option} {text}: expected KEY=VALUE, such as {example}")
    try:
        return key.strip(), parse_toml(f"value = {value}", option)["value"]
    except VfoaError:
        return key.strip(), value.strip()
