"""The Observer XT (Noldus): the event log that it exports as text, a row for each start and stop of a state.

Columns are found by their names: subject, behaviour, its modifiers, the type of the event, and the time since the
observation began, in seconds with decimals (``Time_Relative_sf``). A state begins with its modifiers, and ends with the
next stop of the same behaviour and subject. The names are those of public logs and of scripts that read them; the
targets are identified as in BORIS's projects.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.files.dialects import check_width, is_missing, number_hint, plain_name, table_rows
from harness.labels.formats.boris import from_project
from harness.labels.formats.exchange import Exchange, Imported, ReadOnly
from vfoa.errors import VfoaError, counted

_COLUMNS: Mapping[str, tuple[str, ...]] = {
    "time": ("time_relative_sf", "relative_time_seconds"),
    "behaviour": ("behavior", "behaviour"),
    "type": ("event_type",),
    "subject": ("subject",),
    "observation": ("observation", "observation_name"),
    "comment": ("comment",),
}
_NEEDED = ("time", "behaviour", "type")
_START, _STOP, _POINTS = "state start", "state stop", ("state point", "point")
_TIME = re.compile(r"-?[0-9]{1,9}(?:[.,][0-9]{1,9})?")


class Observer(ReadOnly):
    """Reads the states of one observation; points have no length and are left out, with a note."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read an event log. Without a column of subjects, states are those of the clip's only one."""
        rows = _rows(path)
        only = next(iter(exchange.subjects)) if len(exchange.subjects) == 1 else ""
        points = sum(row.kind in _POINTS for row in rows)
        imported = from_project(_project([row for row in rows if row.kind not in _POINTS], only), exchange, path)
        notes = [f"{path}: left out: {counted(points, 'point')} without a length."] if points else []
        return Imported(labels=imported.labels, notes=(*imported.notes, *notes))


@dataclass(frozen=True, slots=True, kw_only=True)
class _LoggedEvent:
    """A row of the log, with a modifier for each column, "" for none; ``subject`` is None without such a column."""

    where: str
    time_s: float
    kind: str
    observation: str
    subject: str | None
    behaviour: str
    modifiers: tuple[str, ...]
    comment: str


def _rows(path: Path) -> list[_LoggedEvent]:
    """The events. The rows of the beginning and end of an observation, which have no type, are none."""
    (line, header), *rows = table_rows(path) or [(1, [])]
    plain = [plain_name(name) for name in header]
    columns = {name: plain.index(each) for name, known in _COLUMNS.items() for each in known if each in plain}
    if missing := [_COLUMNS[name][0] for name in _NEEDED if name not in columns]:
        raise VfoaError(
            f"{path}:{line}: found {', '.join(header)[:120]}; expected an event log that The Observer XT exported as "
            f"text; there is no {', '.join(missing)}"
        )
    modifiers = [place for place, name in enumerate(plain) if re.fullmatch(r"modifier_[0-9]+", name)]
    events = []
    for number, cells in rows:
        where = f"{path}:{number}"
        check_width(cells, header, where)
        row = {name: cells[place] for name, place in columns.items()}
        kind = row["type"].lower()
        if kind not in ("", _START, _STOP, *_POINTS):
            found = f"{header[columns['type']]}: found {row['type']!r}"
            raise VfoaError(f"{where}: {found}; expected State start, State stop, State point or Point")
        if kind:
            events.append(
                _LoggedEvent(
                    where=where,
                    time_s=_seconds(row["time"], f"{where}: {header[columns['time']]}"),
                    kind=kind,
                    observation=row.get("observation", ""),
                    subject=row.get("subject"),
                    behaviour=row["behaviour"],
                    modifiers=tuple("" if is_missing(cells[place]) else cells[place] for place in modifiers),
                    comment=row.get("comment", ""),
                )
            )
    return events


def _seconds(cell: str, where: str) -> float:
    if not _TIME.fullmatch(cell):
        raise VfoaError(f"{where}: found {cell[:40]!r}{number_hint(cell)}; expected seconds")
    return float(cell.replace(",", "."))


def _project(states: Sequence[_LoggedEvent], only: str) -> dict[str, Any]:
    """Starts and stops as a project of BORIS, in which both have the modifiers of the start."""
    observations = defaultdict[str, dict[str, Any]](lambda: {"events": []})
    begun: dict[tuple[str, str, str], _LoggedEvent] = {}
    for row in states:
        subject = only if row.subject is None else row.subject
        key = row.observation, subject, row.behaviour
        if (row.kind == _STOP) != (key in begun):
            what = "stops, and did not start" if row.kind == _STOP else "starts a second time without a stop"
            raise VfoaError(f"{row.where}: {row.behaviour!r} of {subject!r} {what}")
        start = begun.pop(key) if row.kind == _STOP else begun.setdefault(key, row)
        event = [row.time_s, subject, row.behaviour, start.modifiers, start.comment]
        observations[row.observation]["events"].append(event)
    return {"observations": dict(observations)}
