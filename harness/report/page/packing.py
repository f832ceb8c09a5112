"""Packing of the page's data and script: packs of compact text, and JavaScript modules as one script.

A pack is zlib data in base64. ``store.js`` decodes it when the page shows it. Modules are bundled, because a page that
is opened from disk cannot load any.
"""

from __future__ import annotations

import base64
import json
import re
import zlib
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import numpy as np

_IMPORT = re.compile(r'^import (\{[^}]*\}) from "\./(\w+)\.js";$', re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?(?:const|function) (\w+))", re.MULTILINE)


def pack(content: bytes) -> str:
    """Compress bytes to text for a page; the same bytes give the same text.

    The timelines of an hour take 15 times as long at the highest level, and are a tenth smaller.
    """
    return base64.b64encode(zlib.compress(content)).decode()


def pack_json(value: object) -> str:
    """A value of plain types as a pack of its JSON."""
    return pack(json.dumps(value, separators=(",", ":"), ensure_ascii=False).encode())


def runs(values: Iterable[int]) -> list[int]:
    """Run-length code: each value and its number of repetitions, ``[value, count, value, count, ...]``."""
    array = np.fromiter(values, dtype=np.int64)
    begins = np.flatnonzero(np.diff(array, prepend=array[:1] - 1))
    lengths = np.diff(begins, append=len(array))
    return np.stack([array[begins], lengths], axis=1).ravel().tolist()


def steps(numbers: Iterable[int]) -> list[int]:
    """Increasing numbers as the first one and the run-length code of the differences."""
    numbers = list(numbers)
    if not numbers:
        return []
    return [numbers[0], *runs(after - before for before, after in pairwise(numbers))]


def bundle(entry: Path) -> str:
    """Join a module and everything that it imports, each module once and before its importers.

    A module imports names from ``./NAME.js`` and exports constants and functions. Each becomes a function of its own
    that returns its exports, so that two modules may use one name for different things.
    """
    texts: dict[str, str] = {}
    _add(entry.parent, entry.stem, texts, set())
    return '"use strict";\n(() => {\n' + "\n".join(texts.values()) + "})();\n"


def _add(folder: Path, name: str, texts: dict[str, str], begun: set[str]) -> None:
    begun.add(name)
    source = (folder / f"{name}.js").read_text(encoding="utf-8")
    for _, needed in _IMPORT.findall(source):
        if needed not in begun:
            _add(folder, needed, texts, begun)
    exports = ", ".join(found for _, found in _EXPORT.findall(source))
    body = _EXPORT.sub(r"\1", _IMPORT.sub(r"const \1 = module_\2;", source))
    texts[name] = f"const module_{name} = (() => {{\n{body}return {{ {exports} }};\n}})();\n"
