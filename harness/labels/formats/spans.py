"""Labels of other programs as spans of time, and the frames of the clip that they hold."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from harness.labels.formats.exchange import MS, SAME_RATE, Exchange, Imported, rounded_ms
from harness.labels.labels import Label, LabelRange, Labels, Timeline
from harness.labels.rows import check_sequence
from vfoa.errors import VfoaError, counted


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """A label from ``start_ms`` up to ``end_ms``, in the other program's time; ``where`` is its place in the file."""

    start_ms: int
    end_ms: int
    subject: str
    label: Label
    where: str


def from_spans(spans: Iterable[Span], exchange: Exchange, path: object, *, shown: Timeline | None = None) -> Imported:
    """Return labels from spans: a span covers the frames shown from its start on and before its end.

    ``shown`` are the clip's frames at the times of the spans, to the millisecond. Default: :attr:`Exchange.shown`.

    Raises
    ------
    VfoaError
        If a frame lies in two spans of a subject, or a span ends before it begins.
    """
    rows, inside, outside = list[tuple[str, LabelRange]](), list[Span](), list[str]()
    timeline = shown or exchange.shown
    for span in sorted(spans, key=lambda span: (span.start_ms, span.end_ms)):
        if span.end_ms < span.start_ms:
            raise VfoaError(f"{span.where}: ends at {span.end_ms / 1000:g} s, before it begins")
        if covered := timeline.between(span.start_ms * MS, span.end_ms * MS):
            first, last = covered
            inside.append(span)
            row = LabelRange(first_frame=first, last_frame=last, subject=span.subject, label=span.label)
            rows.append((span.where, row))
        else:
            outside.append(span.where)
    exchange.names.check(path)  # labels of an unknown name may overlap with others, which is not what is wrong
    check_sequence(rows, exchange.timeline, allow_gaps=True)
    imported = exchange.labels((row for _, row in rows), path)
    imported = replace(imported, notes=(*_on_rate(timeline, exchange, path), *imported.notes))
    return without(outside, _with_cut(inside, timeline, imported, path), path)


def _on_rate(shown: Timeline, exchange: Exchange, path: object) -> Iterator[str]:
    """A note if the rate of the other program makes the clip longer or shorter than it is."""
    if exchange.fps is None or exchange.rate_hz is None or len(exchange.frames) < 2:
        return
    of_film, own = ((times[-1] - times[0]) / 1e9 for times in (shown.times_ns, exchange.timeline.times_ns))
    if abs(of_film / own - 1) > SAME_RATE or abs(of_film - own) > _NOTED_SHIFT_S:
        yield (
            f"{path}: --fps {exchange.fps:g}: read as labels of a film that shows every frame of the clip, in "
            f"{of_film:.1f} s; by its own times the clip lasts {own:.1f} s. Labels at the clip's own times, or of "
            "another camera's film: leave out --fps, and give seconds (a table's start and end)."
        )


_NOTED_SHIFT_S = 0.2
"""Time by which labels at the end of a clip are off, if the rate is not that of the film, above which a note says so.

A rate of 30 for 29.97 is as wrong after 200 s.
"""
_NOTED_NS = 1_000_000_000
"""Time by which a label lasts beyond the clip above which a note says so."""


def _with_cut(spans: Sequence[Span], timeline: Timeline, imported: Imported, path: object) -> Imported:
    """Labels with a note on those of these spans, which hold frames of the clip, that last beyond it."""
    if not spans:
        return imported
    begin_ns, end_ns = timeline.span_ns(timeline.frames[0], timeline.frames[-1])
    beyond = [(max(begin_ns - span.start_ms * MS, span.end_ms * MS - end_ns), span.where) for span in spans]
    cut = [(most_ns, where) for most_ns, where in beyond if most_ns > _NOTED_NS]
    if not cut:
        return imported
    most_s, first = max(most_ns for most_ns, _ in cut) / 1e9, cut[0][1]
    note = f"{path}: cut: {counted(len(cut), 'label')} beyond the clip by up to {most_s:.1f} s, the first at {first}."
    return replace(imported, notes=(*imported.notes, note))


def without(outside: Sequence[str], imported: Imported, path: object) -> Imported:
    """Labels with a note on those that hold no frame of the clip, by their places in the file."""
    if not outside:
        return imported
    note = f"{path}: left out: {counted(len(outside), 'label')} without a frame of the clip, the first at {outside[0]}."
    return Imported(labels=imported.labels, notes=(*imported.notes, note))


def to_spans(labels: Labels, exchange: Exchange) -> Iterator[tuple[int, int, LabelRange]]:
    """Yield start, end (ms) and range of all labels: each ends when the next frame of the clip is shown.

    Raises
    ------
    VfoaError
        If the first frame would be shown before time 0.
    """
    shown = exchange.shown
    if shown.times_ns and shown.times_ns[0] < 0:
        raise VfoaError(
            f"--offset: the clip's first frame would be at {shown.times_ns[0] / 1e9:g} s; expected 0 or later"
        )
    for row in labels.ranges:
        if exchange.positions(row):
            start, end = map(rounded_ms, shown.span_ns(row.first_frame, row.last_frame))
            yield start, max(end, start + 1), row
