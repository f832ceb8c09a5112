"""BORIS's tables of events, in CSV, TSV or XLSX; the behaviour is the target.

Tabular events have a row for the START and one for the STOP of each behaviour: up to BORIS 7 below a block about the
observation, in the column ``Status``, in 8 and 9 in ``Behavior type``. Aggregated events have a row from start to stop.
Columns are found by name, because they differ between versions. They are those of BORIS's own export
(github.com/olivierfriard/BORIS, ``boris/export_observation.py`` and ``boris/export_events.py``, GPL; read, not used)
and of the files that its tests compare with.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

from harness.labels.formats.exchange import Exchange, Imported, Span, from_spans, one_line
from harness.labels.formats.tables import milliseconds, read_table, rows_of
from harness.labels.labels import Label
from harness.labels.timeline import parse_seconds
from vfoa.errors import VfoaError, did_you_mean

NO_FOCAL_SUBJECT = "No focal subject"
"""BORIS's name for the subject of events without one; the tabular export leaves the cell empty."""
_ID, _OFFSET, _MODIFIER = "Observation id", "Time offset (s)", "Modifier"
_TABULAR = ("Time", "Subject", "Behavior")
_AGGREGATED = ("Subject", "Behavior", "Start (s)", "Stop (s)")

_Row = tuple[int, dict[str, str]]
"""A line, and its cells by column."""


def read_events(path: Path, exchange: Exchange) -> Imported:
    """Read the state events of one observation, with notes on what labels cannot hold.

    Raises
    ------
    VfoaError
        If the table has no such columns, events of several observations of which none is chosen, or an event that
        does not stop.
    """
    lines = list(rows_of(path))
    is_aggregated = any(set(_AGGREGATED) <= set(cells) for _, cells in lines)
    rows = list(read_table(lines, _AGGREGATED if is_aggregated else _TABULAR, path))
    if names := dict.fromkeys(name for _, row in rows if (name := row.get(_ID))):
        chosen = choose_observation(names, exchange.observation, path)
        rows = [(line, row) for line, row in rows if row.get(_ID) == chosen]
    states = [(line, row) for line, row in rows if _status(row) != "POINT"]
    imported = from_spans((_durations if is_aggregated else _pairs)(states, exchange, path), exchange, path)
    notes = list(imported.notes)
    if points := [line for line, row in rows if _status(row) == "POINT"]:
        notes.append(f"{path}: {len(points)} point events have no length and are left out, line {points[0]} first.")
    if modified := [line for line, row in states if any(row[name] for name in row if name.startswith(_MODIFIER))]:
        notes.append(f"{path}: modifiers in {len(modified)} rows are left out, line {modified[0]} first.")
    above = (cells[1] for _, cells in lines if cells[0] == _OFFSET and len(cells) > 1)  # up to BORIS 7
    offset = next((row[_OFFSET] for _, row in reversed(rows) if row.get(_OFFSET)), None) or next(above, "")
    if offset and parse_seconds(offset) != 0 and exchange.offset == 0:
        notes.append(
            f"{path}: the observation's time offset is {offset} s, which BORIS adds to all times; "
            f"--offset {offset} takes it off."
        )
    return Imported(labels=imported.labels, notes=tuple(notes))


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


def _status(row: dict[str, str]) -> str:
    """START, STOP, STATE or POINT."""
    return row.get("Status") or row.get("Behavior type", "")


def _durations(rows: Iterable[_Row], exchange: Exchange, path: Path) -> Iterator[Span]:
    """The spans of aggregated events."""
    for line, row in rows:
        comments = (one_line(row.get(column)) for column in ("Comment start", "Comment stop"))
        start_ms, end_ms = (milliseconds(row, column, f"{path}:{line}") for column in ("Start (s)", "Stop (s)"))
        yield _span(row, start_ms, end_ms, "; ".join(filter(None, comments)), exchange, f"{path}:{line}")


def _pairs(rows: Iterable[_Row], exchange: Exchange, path: Path) -> Iterator[Span]:
    """The spans between each START and its STOP."""
    begun: dict[tuple[str, str], tuple[int, int, str]] = {}
    for line, row in rows:
        where = f"{path}:{line}"
        subject, behaviour = key = row["Subject"] or NO_FOCAL_SUBJECT, row["Behavior"]
        status = _status(row)
        if status == "START":
            if key in begun:
                first = begun[key][0]
                raise VfoaError(
                    f"{where}: {behaviour!r} of {subject!r} starts again; expected its STOP after line {first}"
                )
            begun[key] = line, milliseconds(row, "Time", where), one_line(row.get("Comment"))
        elif status == "STOP":
            if key not in begun:
                raise VfoaError(f"{where}: {behaviour!r} of {subject!r} stops; expected its START before")
            first, start_ms, note = begun.pop(key)
            yield _span(row, start_ms, milliseconds(row, "Time", where), note, exchange, f"{path}:{first}")
        else:
            raise VfoaError(f"{where}: found the status {status!r}; expected START, STOP or POINT")
    for (subject, behaviour), (line, *_) in begun.items():
        raise VfoaError(f"{path}:{line}: {behaviour!r} of {subject!r} starts and never stops")


def _span(row: dict[str, str], start_ms: int, end_ms: int, note: str, exchange: Exchange, where: str) -> Span:
    subject = exchange.subject(row["Subject"] or NO_FOCAL_SUBJECT, where)
    label = Label(target=exchange.target(row["Behavior"], subject, where), note=note)
    return Span(start_ms=start_ms, end_ms=end_ms, subject=subject, label=label, where=where)
