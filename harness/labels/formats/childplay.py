"""ChildPlay (Tafasca et al., ICCV 2023): a CSV per clip, a row per person and frame, frames from 1.

clip,frame,person_id,bbox_x,bbox_y,bbox_width,bbox_height,gaze_class,gaze_x,gaze_y,is_child

Pixels. ``inside_visible`` has a point; ``outside_frame`` is ``none``; every other class becomes ``ignore`` with the
class as note. These are gaze_shift, inside_occluded, inside_uncertain and eyes_closed in the data set's README, and in
its files also inside_ambiguous, uncertain and not_annotated. An ``inside_visible`` without a point (-1, -1) is ignored,
too.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from pathlib import Path

from harness.files.io import atomic_write
from harness.labels.formats.exchange import Exchange, Imported, left_out
from harness.labels.formats.gaze_points import GazePoint, Shown, from_points, point_of, to_points
from harness.labels.formats.tables import read_table
from harness.labels.labels import IGNORED, NOWHERE, Label, Labels
from vfoa.errors import VfoaError

_COLUMNS = (
    *("clip", "frame", "person_id", "bbox_x", "bbox_y", "bbox_width", "bbox_height"),
    *("gaze_class", "gaze_x", "gaze_y", "is_child"),
)
_VISIBLE, _OUTSIDE, _NOT_ANNOTATED = "inside_visible", "outside_frame", "not_annotated"
_NO_POINT = (-1.0, -1.0)
_POINTLESS = "inside_visible without a point"
_CLASS = re.compile(r"[a-z]+(_[a-z]+)*")


class ChildPlay:
    """Reads and writes one clip's file. A person's name is in ``person_id``."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read points and name the objects at them."""
        return from_points(_rows(path, exchange), exchange, path)

    def write(self, path: Path, labels: Labels, exchange: Exchange) -> tuple[str, ...]:
        """Write one file; the names of targets are lost."""
        shown, said = to_points(labels, exchange)
        numbers = {frame: place for place, frame in enumerate(exchange.frames, start=1 + exchange.first_number)}
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(_COLUMNS)
        for each in sorted(shown, key=lambda each: (each.frame, each.subject)):
            u0, v0, u1, v1 = each.head_px
            u, v = each.point_px or _NO_POINT
            box = (f"{value:.2f}" for value in (u0, v0, u1 - u0, v1 - v0))
            point = (f"{value:.2f}" for value in (u, v))
            writer.writerow([path.stem, numbers[each.frame], each.subject, *box, _class(each), *point, 0])
        atomic_write(path, text.getvalue())
        said.append(
            "Names of targets are left out: ChildPlay holds points. is_child is 0 throughout: labels do not tell."
        )
        kept = Labels(row for row in labels.ranges if not _is_class(row.label))
        return (*said, *left_out(kept, "ChildPlay", points=True))


def _is_class(label: Label) -> bool:
    return label.target == IGNORED and _CLASS.fullmatch(label.note) is not None


def _class(each: Shown) -> str:
    if each.label.target == IGNORED:
        return each.label.note if _is_class(each.label) else _NOT_ANNOTATED
    return _OUTSIDE if each.label.target == NOWHERE else _VISIBLE


def _rows(path: Path, exchange: Exchange) -> Iterator[GazePoint]:
    clips: set[str] = set()
    for line, row in read_table(path, [name for name in _COLUMNS if name != "is_child"]):
        where = f"{path}:{line}"
        clips.add(row["clip"])
        if len(clips) > 1:
            raise VfoaError(f"{where}: found the clips {', '.join(map(repr, sorted(clips)))}; expected one clip a file")
        try:
            position = int(row["frame"]) - 1 - exchange.first_number
        except (ValueError, KeyError):
            raise VfoaError(f"{where}: frame: found {row.get('frame')!r}; expected a number") from None
        known, inside = row["gaze_class"], 0 <= position < len(exchange.frames)
        point = point_of((row["gaze_x"], row["gaze_y"]), where) if known == _VISIBLE else None
        why = None if known in (_VISIBLE, _OUTSIDE) else "" if known == _NOT_ANNOTATED else known
        if point == _NO_POINT:
            point, why = None, _POINTLESS
        yield GazePoint(
            frame=exchange.frames[position] if inside else None,
            subject=exchange.subject(row["person_id"], where),
            point_px=point,
            where=where,
            why=why,
        )
