"""Formats of gaze points, which store where in the image somebody looks: conversion to names of targets and back."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

from harness.labels.bodies import Box, Point
from harness.labels.formats.exchange import Exchange, Imported
from harness.labels.labels import IGNORED, NOWHERE, Label, LabelRange, Labels, ranges_of
from harness.labels.rows import parse_point
from vfoa.errors import VfoaError

UNNAMED = "looks at nothing that has a name"
"""The note of an ``ignore`` for a point on which no subject and no target of the manifest was found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GazePoint:
    """One person in one frame: looks at a point, out of the image (``point_px`` None), or is not judged (``why``).

    ``frame`` is None for one that the clip does not have.
    """

    frame: int | None
    subject: str
    point_px: Point | None
    where: str
    why: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """One label in one frame, with the head's box and, if the label is a target, a point on it."""

    frame: int
    subject: str
    label: Label
    head_px: Box
    point_px: Point | None


def from_points(points: Iterable[GazePoint], exchange: Exchange, path: object) -> Imported:
    """Return labels from points: the target is the object at the point; outside the image is ``none``.

    A range keeps its image point if that is the same in all its frames.

    Raises
    ------
    VfoaError
        If a subject has two points in a frame.
    """
    by_subject: dict[str, dict[int, Label]] = {}
    known, counts = set(exchange.frames), Counter[str]()
    for each in points:
        labels = by_subject.setdefault(each.subject, {})
        if each.frame is None or each.frame not in known:
            counts["labels are outside of the clip's frames and are left out"] += 1
            continue
        if each.frame in labels:
            raise VfoaError(f"{each.where}: {each.subject!r} has two labels in frame {each.frame}")
        labels[each.frame] = label = _label(each, each.frame, exchange)
        if label.note == UNNAMED:
            counts["points lie on nothing that has a name and are ignored (--target NAME names them)"] += 1
    rows = [row for subject, labels in by_subject.items() for row in _rows(subject, labels, exchange)]
    found = exchange.labels(rows, path)
    said = [f"{path}: {count} {words}." for words, count in sorted(counts.items())]
    return Imported(labels=found.labels, notes=(*found.notes, *said))


def point_of(cells: Sequence[str], where: str) -> Point:
    """Parse a gaze point from its two cells; :class:`VfoaError` if they hold none."""
    point = parse_point(cells, where)
    if point is None:
        raise VfoaError(f"{where}: no gaze point; expected two numbers")
    return point


def to_points(labels: Labels, exchange: Exchange) -> tuple[list[Shown], list[str]]:
    """Return every label of every frame with a known head, by subject and frame, and notes on what was left out.

    Raises
    ------
    VfoaError
        If no head is known in any frame.
    """
    shown, counts = [], Counter[str]()
    for subject in labels.subjects:
        for frame in exchange.frames:
            label = labels.at(frame, subject)
            if label is None:
                continue
            head = exchange.head_box(frame, subject)
            point = _point(frame, label, exchange)
            if head is None:
                counts["labels are left out: the head's place in the frame is not known"] += 1
            elif point is None and label.target not in (NOWHERE, IGNORED):
                counts["labels are left out: the target's place in the frame is not known"] += 1
            else:
                shown.append(Shown(frame=frame, subject=subject, label=label, head_px=head, point_px=point))
    if not shown:
        raise VfoaError("this format needs heads and targets in the image, and none are known; expected --run RUN")
    return shown, [f"{count} {words}." for words, count in sorted(counts.items())]


def _label(each: GazePoint, frame: int, exchange: Exchange) -> Label:
    if each.why is not None:
        return Label(target=IGNORED, note=each.why)
    if each.point_px is None:
        return Label(target=NOWHERE)
    found = exchange.bodies.target_at(frame, each.point_px, each.subject) if exchange.bodies else None
    if found is None or found not in {*exchange.targets, *exchange.subjects}:
        found = exchange.unnamed
    if found is None:
        return Label(target=IGNORED, note=UNNAMED)
    return Label(target=exchange.target(found, each.subject, each.where), point_px=each.point_px)


def _rows(subject: str, labels: dict[int, Label], exchange: Exchange) -> Iterator[LabelRange]:
    bare = {frame: replace(label, point_px=None) for frame, label in labels.items()}
    for row in ranges_of(subject, ((frame, bare.get(frame)) for frame in exchange.frames)):
        inside = (labels[exchange.frames[position]].point_px for position in exchange.positions(row))
        points = [point for point, _ in groupby(inside)]
        yield replace(row, label=replace(row.label, point_px=points[0])) if len(points) == 1 else row


def _point(frame: int, label: Label, exchange: Exchange) -> Point | None:
    if label.target in (NOWHERE, IGNORED):
        return None
    if label.point_px is not None:
        return label.point_px
    return exchange.bodies.point_of(frame, label.target) if exchange.bodies else None
