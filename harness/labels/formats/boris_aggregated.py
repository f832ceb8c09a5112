"""BORIS, "aggregated events": a row for each behaviour from start to stop; the behaviour is the target. CSV or TSV.

Columns are found by name, because the other columns differ between BORIS 7 to 9. The layout of 7 is written.
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

REQUIRED = ("Subject", "Behavior", "Start (s)", "Stop (s)")
_COLUMNS = (
    *("Observation id", "Observation date", "Description", "Media file", "Total length", "FPS", "Subject", "Behavior"),
    *("Behavioral category", "Modifiers", "Behavior type", "Start (s)", "Stop (s)", "Duration (s)"),
    *("Comment start", "Comment stop"),
)


class BorisAggregated:
    """State events. Point events have no length and are left out, with a note."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read the events of one observation."""
        observation = Observation(path=path, required=REQUIRED, wanted=exchange.observation)
        found = from_spans(_spans(observation, exchange), exchange, path)
        return Imported(labels=found.labels, notes=(*found.notes, *observation.notes(exchange)))

    def write(self, path: Path, labels: Labels, exchange: Exchange) -> tuple[str, ...]:
        """Write a row for each range; image points are left out."""
        spans = list(to_spans(labels, exchange))
        total = f"{max((end for _, end, _ in spans), default=0) / 1000:.3f}"
        rate = f"{exchange.fps or exchange.clip.rate_hz or 0.0:.3f}"
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(_COLUMNS)
        for start, end, row in spans:
            times = (f"{each / 1000:.3f}" for each in (start, end, end - start))
            words = (row.subject, row.label.target, "", "", "STATE")
            writer.writerow([path.stem, "", "", "", total, rate, *words, *times, row.label.note, ""])
        atomic_write(path, text.getvalue())
        return tuple(left_out(labels, "BORIS", notes=True))


def _spans(observation: Observation, exchange: Exchange) -> Iterator[Span]:
    for line, _, row in observation.states():
        where = f"{observation.path}:{line}"
        subject = exchange.subject(row["Subject"], where)
        comments = (one_line(row.get(column)) for column in ("Comment start", "Comment stop"))
        yield Span(
            start_ms=milliseconds(row, "Start (s)", where),
            end_ms=milliseconds(row, "Stop (s)", where),
            subject=subject,
            label=Label(
                target=exchange.target(row["Behavior"], subject, where),
                note="; ".join(each for each in comments if each),
            ),
            where=where,
        )
