"""Common parts of BORIS's tables of events: one observation, its time offset, and contents that labels cannot hold.

The columns are those of BORIS's own export (github.com/olivierfriard/BORIS, ``boris/export_observation.py`` and
``boris/export_events.py``, GPL; read, not used) and of the files that its tests compare with.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from harness.labels.formats.exchange import Exchange
from harness.labels.formats.tables import read_table, rows_of
from harness.labels.timeline import parse_seconds
from vfoa.errors import VfoaError, did_you_mean

NO_FOCAL_SUBJECT = "No focal subject"
"""BORIS's name for the subject of events without one; the tabular export leaves the cell empty."""
_ID, _OFFSET, _MODIFIER = "Observation id", "Time offset (s)", "Modifier"


@dataclass(slots=True, kw_only=True)
class Observation:
    """The events of a table, and a record of contents that labels cannot hold.

    ``wanted`` is the observation to read, if the table has several.
    """

    path: Path
    required: Sequence[str]
    wanted: str | None = None
    _points: list[int] = field(default_factory=list)
    _modified: list[int] = field(default_factory=list)
    _offset: str = ""

    def states(self) -> Iterator[tuple[int, str, dict[str, str]]]:
        """Yield line, START, STOP or STATE, and cells by column of every row of a state event.

        Raises
        ------
        VfoaError
            If the table has no such columns, or events of several observations of which none is chosen.
        """
        self._offset = self._offset_above_the_header()
        rows = list(read_table(self.path, self.required))
        names = dict.fromkeys(found for _, row in rows if (found := row.get(_ID)))
        chosen = choose_observation(names, self.wanted, self.path) if names else None
        for line, row in rows:
            if chosen is not None and row.get(_ID) != chosen:
                continue
            self._offset = row.get(_OFFSET) or self._offset
            kind = row.get("Status") or row.get("Behavior type", "")
            if kind == "POINT":
                self._points.append(line)
                continue
            if any(value for column, value in row.items() if column.startswith(_MODIFIER)):
                self._modified.append(line)
            yield line, kind, {**row, "Subject": row["Subject"] or NO_FOCAL_SUBJECT}

    def notes(self, exchange: Exchange) -> tuple[str, ...]:
        """Notes on contents that were left out, and on a time offset that the import does not use."""
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
        """The offset from a line of its own, as in BORIS up to 7."""
        for _, cells in rows_of(self.path):
            if set(self.required) <= set(cells):
                break
            if cells[0] == _OFFSET and len(cells) > 1:
                return cells[1]
        return ""


def choose_observation(names: Collection[str], wanted: str | None, path: Path) -> str:
    """Return the wanted observation, or the only one.

    Raises
    ------
    VfoaError
        If there are several and none is wanted, or the wanted one does not exist.
    """
    if wanted is not None:
        if wanted not in names:
            raise VfoaError(f"{path}: --observation: no {wanted!r}; {did_you_mean(wanted, names)}")
        return wanted
    if len(names) > 1:
        listed = ", ".join(map(repr, names))
        raise VfoaError(f"{path}: found the observations {listed}; expected --observation NAME")
    return next(iter(names))
