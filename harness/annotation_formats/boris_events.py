"""What BORIS's tables of events have in common: one observation, its time offset, and what a label has no place for.

The columns are those of BORIS's own export (github.com/olivierfriard/BORIS, ``boris/export_observation.py`` and
``boris/export_events.py``, GPL; read, not used) and of the files that its tests compare with.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from harness.annotation_formats.exchange import Exchange
from harness.annotation_formats.tables import csv_rows, read_table
from harness.annotations.timeline import parse_seconds
from vfoa.errors import VfoaError

NO_FOCAL_SUBJECT = "No focal subject"
"""What BORIS calls the subject of events that were coded without one; the tabular export leaves the cell empty."""
_ID, _OFFSET, _MODIFIER = "Observation id", "Time offset (s)", "Modifier"


@dataclass(slots=True, kw_only=True)
class Observation:
    """The events of a table, and what is met on the way that labels cannot hold."""

    path: Path
    required: Sequence[str]
    _points: list[int] = field(default_factory=list)
    _modified: list[int] = field(default_factory=list)
    _offset: str = ""

    def states(self) -> Iterator[tuple[int, str, dict[str, str]]]:
        """Line, START, STOP or STATE, and cells by column of every row of an event that lasts.

        Raises
        ------
        VfoaError
            If the table has no such columns, or events of several observations, whose times have nothing in common.
        """
        self._offset = self._offset_above_the_header()
        name: str | None = None
        for line, row in read_table(self.path, self.required):
            found = row.get(_ID, "")
            if name is not None and found != name:
                raise VfoaError(
                    f"{self.path}:{line}: {_ID}: found {found!r} after {name!r}; expected one observation a file"
                )
            name, self._offset = found, row.get(_OFFSET) or self._offset
            kind = row.get("Status") or row.get("Behavior type", "")
            if kind == "POINT":
                self._points.append(line)
                continue
            if any(value for column, value in row.items() if column.startswith(_MODIFIER)):
                self._modified.append(line)
            yield line, kind, {**row, "Subject": row["Subject"] or NO_FOCAL_SUBJECT}

    def notes(self, exchange: Exchange) -> tuple[str, ...]:
        """Sentences on what was left out, and on a time offset that the import was not told of."""
        said = []
        if self._points:
            said.append(
                f"{len(self._points)} point events have no length and are left out, line {self._points[0]} first."
            )
        if self._modified:
            said.append(f"modifiers in {len(self._modified)} rows are left out, line {self._modified[0]} first.")
        if self._offset and parse_seconds(self._offset) != 0 and exchange.offset == 0:
            said.append(
                f"the observation's time offset is {self._offset} s, which BORIS adds to all times; "
                f"--offset {self._offset} takes it off."
            )
        return tuple(f"{self.path}: {each}" for each in said)

    def _offset_above_the_header(self) -> str:
        """As BORIS up to 7 has it: a line of its own."""
        for _, cells in csv_rows(self.path):
            if set(self.required) <= set(cells):
                break
            if cells[0] == _OFFSET and len(cells) > 1:
                return cells[1]
        return ""
