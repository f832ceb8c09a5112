"""Formats of times: convert spans in milliseconds to ranges of frames and back."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from harness.labels.formats.exchange import Exchange, Imported
from harness.labels.labels import Label, LabelRange, Labels
from vfoa.errors import VfoaError


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """A label from ``start_ms`` up to ``end_ms``, in the other program's time; ``where`` is its place in the file."""

    start_ms: int
    end_ms: int
    subject: str
    label: Label
    where: str


def from_spans(spans: Iterable[Span], exchange: Exchange, path: object) -> Imported:
    """Return labels from spans: a span covers the frames shown from its start on and before its end.

    Raises
    ------
    VfoaError
        If a frame lies in two spans of a subject, or a span ends before it begins.
    """
    rows: list[LabelRange] = []
    outside: list[Span] = []
    last: dict[str, tuple[int, Span]] = {}
    for span in sorted(spans, key=lambda each: (each.start_ms, each.end_ms)):
        if span.end_ms < span.start_ms:
            raise VfoaError(f"{span.where}: ends at {span.end_ms / 1000:g} s, before it begins")
        low, high = (bisect_left(exchange.times_ms, each) for each in (span.start_ms, span.end_ms))
        if low >= high:
            outside.append(span)
            continue
        before, other = last.get(span.subject, (-1, span))
        if low <= before:
            raise VfoaError(
                f"{span.where}: {span.subject!r} has two labels in frame {exchange.frames[low]}: overlaps with "
                f"{other.where}"
            )
        last[span.subject] = high - 1, span
        first, final = exchange.frames[low], exchange.frames[high - 1]
        rows.append(LabelRange(first_frame=first, last_frame=final, subject=span.subject, label=span.label))
    found = exchange.labels(rows, path)
    if not outside:
        return found
    said = f"{path}: {len(outside)} labels hold no frame of the clip and are left out, the first at {outside[0].where}."
    return Imported(labels=found.labels, notes=(*found.notes, said))


def to_spans(labels: Labels, exchange: Exchange) -> Iterator[tuple[int, int, LabelRange]]:
    """Yield start, end (ms) and range of all labels: each ends when the next frame of the clip is shown.

    Raises
    ------
    VfoaError
        If the first frame would be shown before time 0.
    """
    times = exchange.times_ms
    if times and times[0] < 0:
        raise VfoaError(f"--offset: the clip's first frame would be at {times[0] / 1000:g} s; expected 0 or later")
    for row in labels.ranges:
        positions = exchange.positions(row)
        if positions:
            after = positions[-1] + 1
            end = times[after] if after < len(times) else times[-1] + exchange.step_ms
            yield times[positions[0]], end, row
