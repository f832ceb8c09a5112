"""Praat's TextGrid: labels in tiers of intervals (Boersma and Weenink, Praat's manual, "TextGrid file formats").

Of its text forms, the long one writes the name of each value beside it, and the short one leaves it out. A reader takes
what stands free, as Praat does: texts in quotes, numbers, and the flag that says whether there are tiers.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import TypeVar

from harness.files.dialects import table_text
from harness.files.io import read_bytes
from harness.labels.formats.exchange import Exchange, Imported, ReadOnly, one_line
from harness.labels.formats.tiers import Annotation, from_tiers
from vfoa.errors import VfoaError

_FREE = re.compile(
    r'"(?P<text>(?:[^"]|"")*+)"'
    r"|(?P<flag><exists>|<absent>)(?!\S)"
    r"|(?P<number>[+-]?[0-9]++(?:\.[0-9]++)?(?:[eE][+-]?[0-9]++)?)(?!\S)"
    r"|![^\n]*+|\S+"
)
"""A text, a flag or a number that stands free; or a comment or another word, which is no value."""

_EXPECTED = "a TextGrid that Praat saved as a text file"
_LARGEST = 1e9

_Kind = TypeVar("_Kind", str, bool, float)


class Praat(ReadOnly):
    """Reads interval tiers named after subjects; tiers of points and of others are left out, with a note."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read a TextGrid. Its time 0 is the beginning of the film, unless ``exchange`` has an offset."""
        tiers, points = _tiers(path)
        sizes = {tier: len(annotations) for tier, annotations in tiers.items()}
        imported = from_tiers(sizes, lambda tier: tiers.get(tier, ()), exchange, path)
        notes = (f"{path}: tier {tier!r} has points, not intervals, and is left out." for tier in points)
        return Imported(labels=imported.labels, notes=(*imported.notes, *notes))


class _Values:
    """The free values of a text, in order, each asked for as what it has to be."""

    def __init__(self, path: Path, text: str) -> None:
        self._path, self._values, self._line = path, _values(text), 1

    def _next(self, kind: type[_Kind], expected: str) -> _Kind:
        self._line, value = next(self._values, (self._line, None))
        if not isinstance(value, kind):
            found = "the end of the file" if value is None else repr(value)[:40]
            raise VfoaError(f"{self._path}:{self._line}: found {found}; expected {expected}")
        return value

    def text(self, expected: str) -> str:
        return self._next(str, expected)

    def flag(self) -> bool:
        return self._next(bool, "<exists> or <absent>")

    def number(self, expected: str) -> float:
        if abs(number := self._next(float, expected)) > _LARGEST:
            raise VfoaError(f"{self._path}:{self._line}: found {number:g}; expected {expected}")
        return number

    def count(self, expected: str) -> int:
        number = self.number(expected)
        if number < 0 or not number.is_integer():
            raise VfoaError(f"{self._path}:{self._line}: found {number:g}; expected {expected}")
        return int(number)


def _values(text: str) -> Iterator[tuple[int, str | float | bool]]:
    """Line and value: a text, a number, or whether something exists."""
    line, at = 1, 0
    for found in _FREE.finditer(text):
        line, at = line + text.count("\n", at, found.start()), found.start()
        if found["text"] is not None:
            yield line, found["text"].replace('""', '"')
        elif found["number"]:
            yield line, float(found["number"])
        elif found["flag"]:
            yield line, found["flag"] == "<exists>"


def _tiers(path: Path) -> tuple[dict[str, list[Annotation]], list[str]]:
    """The intervals with a text of each interval tier, and the names of the tiers of points."""
    if read_bytes(path).startswith(b"ooBinaryFile"):
        raise VfoaError(f"{path}: a binary file of Praat; expected {_EXPECTED}")
    values = _Values(path, table_text(path))
    head = [values.text(_EXPECTED), values.text(_EXPECTED)]
    if not head[0].startswith("ooTextFile") or not head[1].startswith("TextGrid"):
        raise VfoaError(f"{path}: found {' '.join(head)[:60]!r}; expected {_EXPECTED}")
    for _ in range(2):
        values.number("the times of the TextGrid")
    tiers, points = defaultdict[str, list[Annotation]](list), list[str]()
    for _ in range(values.count("the number of tiers") if values.flag() else 0):
        kind, name = values.text("IntervalTier or TextTier"), values.text("the name of a tier")
        if kind not in ("IntervalTier", "TextTier"):
            raise VfoaError(f"{path}: tier {name!r}: found {kind[:40]!r}; expected IntervalTier or TextTier")
        for _ in range(2):
            values.number("the times of a tier")
        has_intervals = kind == "IntervalTier"
        intervals = tiers[name] if has_intervals else []
        for _ in range(values.count("the number of intervals or points")):
            times = [values.number("a time, seconds") for _ in range(2 if has_intervals else 1)]
            value = one_line(values.text("the text of an interval or point"))
            if value:
                intervals.append((round(1000 * times[0]), round(1000 * times[-1]), value))
        if not has_intervals:
            points.append(name)
    return dict(tiers), points
