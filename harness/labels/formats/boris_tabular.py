"""BORIS, "tabular events": a row for the START and one for the STOP of each behaviour; the behaviour is the target.

Both layouts are read: that of BORIS up to 7 (a block about the observation, then the header, START or STOP in
``Status``), which is also written, and that of 8 and 9 (the header first, START or STOP in ``Behavior type``). CSV or
TSV.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from pathlib import Path

from harness.files.io import atomic_write
from harness.labels.formats.boris_events import Observation
from harness.labels.formats.exchange import Exchange, Imported, left_out, one_line
from harness.labels.formats.spans import Span, from_spans, to_spans
from harness.labels.formats.tables import milliseconds
from harness.labels.labels import Label, Labels
from vfoa.errors import VfoaError

_COLUMNS = (
    *("Time", "Media file path", "Total length", "FPS", "Subject", "Behavior", "Behavioral category", "Comment"),
    "Status",
)


class BorisTabular:
    """State events in pairs. Point events have no length and are left out, with a note."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read the events of one observation."""
        observation = Observation(path=path, required=("Time", "Subject", "Behavior"), wanted=exchange.observation)
        found = from_spans(_pairs(observation, exchange), exchange, path)
        return Imported(labels=found.labels, notes=(*found.notes, *observation.notes(exchange)))

    def write(self, path: Path, labels: Labels, exchange: Exchange) -> tuple[str, ...]:
        """Write a START and a STOP for each range; image points are left out."""
        events: list[tuple[int, int, tuple[str, ...]]] = []
        spans = list(to_spans(labels, exchange))
        total = f"{max((end for _, end, _ in spans), default=0) / 1000:.3f}"
        rate = exchange.fps or exchange.clip.rate_hz or 0.0
        for start, end, row in spans:
            for order, time, status in ((1, start, "START"), (0, end, "STOP")):  # at equal times, ends come first
                words = (row.subject, row.label.target, "", row.label.note if status == "START" else "", status)
                events.append((time, order, (f"{time / 1000:.3f}", "", total, f"{rate:.3f}", *words)))
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerows([("Observation id", path.stem), (), ("Time offset (s)", "0.0"), (), _COLUMNS])
        writer.writerows(cells for _, _, cells in sorted(events))
        atomic_write(path, text.getvalue())
        return tuple(left_out(labels, "BORIS", notes=True))


def _pairs(observation: Observation, exchange: Exchange) -> Iterator[Span]:
    """The spans between each START and its STOP."""
    path = observation.path
    begun: dict[tuple[str, str], tuple[int, int, str]] = {}
    for line, status, row in observation.states():
        where = f"{path}:{line}"
        key = row["Subject"], row["Behavior"]
        if status == "START":
            if key in begun:
                raise VfoaError(
                    f"{where}: {key[1]!r} of {key[0]!r} starts again; expected its STOP after line {begun[key][0]}"
                )
            begun[key] = line, milliseconds(row, "Time", where), one_line(row.get("Comment"))
        elif status == "STOP":
            if key not in begun:
                raise VfoaError(f"{where}: {key[1]!r} of {key[0]!r} stops; expected its START before")
            first, start, note = begun.pop(key)
            subject = exchange.subject(key[0], f"{path}:{first}")
            label = Label(target=exchange.target(key[1], subject, f"{path}:{first}"), note=note)
            end = milliseconds(row, "Time", where)
            yield Span(start_ms=start, end_ms=end, subject=subject, label=label, where=f"{path}:{first}")
        else:
            raise VfoaError(f"{where}: found the status {status!r}; expected START, STOP or POINT")
    for (subject, behaviour), (line, *_) in begun.items():
        raise VfoaError(f"{path}:{line}: {behaviour!r} of {subject!r} starts and never stops")
