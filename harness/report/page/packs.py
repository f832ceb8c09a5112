"""Compact text for the large parts of the page's data, which the page decodes when it shows them.

A pack is zlib data in base64. ``store.js`` is the other end.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Iterable
from itertools import groupby, pairwise


def pack(content: bytes) -> str:
    """Bytes as text for a page; the same text for the same bytes."""
    return base64.b64encode(zlib.compress(content, 9)).decode()


def pack_json(value: object) -> str:
    """A value of plain types as a pack of its JSON."""
    return pack(json.dumps(value, separators=(",", ":"), ensure_ascii=False).encode())


def runs(values: Iterable[int]) -> list[int]:
    """Run-length code: each value and how often it follows itself, ``[value, count, value, count, ...]``."""
    return [number for value, same in groupby(values) for number in (value, sum(1 for _ in same))]


def steps(numbers: Iterable[int]) -> list[int]:
    """Increasing numbers as the first one and the run-length code of the differences."""
    numbers = list(numbers)
    if not numbers:
        return []
    return [numbers[0], *runs(after - before for before, after in pairwise(numbers))]
