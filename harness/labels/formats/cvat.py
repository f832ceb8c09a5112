"""Boxes and points of CVAT's tracks ("for video 1.1") as what is drawn on a clip.

    <track label="robot"> <box frame="0" keyframe="1" outside="0" xtl="10" ytl="20" xbr="60" ybr="80"/> ... </track>
    <track label="lamp">  <points frame="0" keyframe="1" outside="0" points="611.5,88.5"/> ... </track>

A track is of the target or subject that its label names; a subject's box is the head, or the whole person if its
attribute ``kind`` is ``box``. Only key frames are read and written, and every shape that comes or goes: both programs
move boxes linearly in between, CVAT by position in the clip. CVAT counts pixels from the upper left corner of the
image, so that its numbers are greater by half a pixel. As CVAT 2 exports it (github.com/cvat-ai/cvat, MIT; read, not
used: ``cvat/apps/dataset_manager/formats/cvat.py``), a track ends with a shape that is outside, and ``annotations.xml``
comes in a ZIP.
"""

from __future__ import annotations

import io
import math
import re
import zipfile
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from harness.files.io import atomic_write, read_bytes
from harness.files.parsing import parse_xml, read_member
from harness.labels.drawn import BOX, Drawn, KeyFrame, Kind, Place, Track, check_kind, check_place, drawn_of
from harness.labels.formats.exchange import Exchange
from vfoa.errors import VfoaError

_MEMBER = "annotations.xml"
_FRAME = re.compile(r"[0-9]{1,18}")
_CORNERS = ("xtl", "ytl", "xbr", "ybr")
_HALF_PX = 0.5
_KIND = "kind"


def read_cvat_drawn(path: Path, exchange: Exchange) -> tuple[Drawn, tuple[str, ...]]:
    """Read the tracks of a clip's targets and subjects; the notes count those of other labels, which are left out.

    Raises
    ------
    VfoaError
        If the file cannot be read, no track is of this clip, a shape is neither a box nor one point, or two tracks of
        one name overlap in time.
    """
    keys: dict[tuple[str, Kind], list[KeyFrame]] = {}
    others = Counter[str]()
    for element in _read_tracks(path).iter("track"):
        where, label = f"{path}: track {element.get('id')!r}", element.get("label", "")
        name = exchange.names.translate(label)
        if name not in exchange.targets and name not in exchange.subjects:
            others[label] += 1
            continue
        for kind, found in _tracks(element, name, exchange, where).items():
            check_kind(name, kind, exchange.subjects, [each for other, each in keys if other == name], where)
            own = _within(Track(name=name, kind=kind, keys=tuple(found)), exchange)
            keys[name, kind] = _joined(keys.get((name, kind), []), own, name, where)
    unused = exchange.names.check(path)
    drawn = drawn_of({key: found for key, found in keys.items() if not all(each.outside for each in found)})
    if not drawn.tracks:
        raise VfoaError(
            f"{path}: no track is labelled with a target or a subject of this clip; found "
            f"{', '.join(map(repr, others)) or 'none'}; expected {', '.join([*exchange.targets, *exchange.subjects])} "
            "(--rename LABEL=OURS)"
        )
    counts = ", ".join(f"{count} of {label!r}" for label, count in sorted(others.items()))
    notes = (f"{path}: tracks of other labels are left out: {counts}.",) if others else ()
    return drawn, (*unused, *notes)


def _read_tracks(path: Path) -> Element:
    """The root of a file "for video 1.1", or of the one in a ZIP: of one task, with tracks."""
    content = read_bytes(path)
    if zipfile.is_zipfile(io.BytesIO(content)):
        content = read_member(content, _MEMBER, path, "CVAT's exports")
    root = parse_xml(content, path)
    if root.tag != "annotations" or root.find("image") is not None or root.find("track") is None:
        raise VfoaError(f"{path}: found <{root.tag}> without tracks; expected CVAT for video 1.1")
    tasks = sorted({track.get("task_id", "") for track in root.iter("track")})
    if len(tasks) > 1:
        raise VfoaError(f"{path}: found the tasks {', '.join(tasks)} of a project; expected the export of one task")
    return root


def _tracks(element: Element, name: str, exchange: Exchange, where: str) -> dict[Kind, list[KeyFrame]]:
    """The key frames of a track, numbered as in CVAT; a subject's box is a head."""
    found: dict[Kind, list[KeyFrame]] = {}
    was_outside: bool | None = None
    for shape in sorted(element, key=lambda each: _frame(each, where)):
        frame, outside = _frame(shape, where), shape.get("outside") == "1"
        if shape.get("keyframe") == "0" and outside == was_outside:
            continue
        was_outside = outside
        kind, place = _place(shape, f"{where}, frame {frame}")
        if kind == "box" and name in exchange.subjects:
            kind = "box" if shape.findtext(f"attribute[@name='{_KIND}']") == "box" else "head"
        keys = found.setdefault(kind, [])
        if keys and keys[-1].frame == frame:
            raise VfoaError(f"{where}: frame {frame}: found two shapes; expected one")
        keys.append(KeyFrame(frame=frame, place=check_place(kind, place, f"{where}, frame {frame}"), outside=outside))
    return found


def _place(shape: Element, where: str) -> tuple[Kind, Place]:
    if shape.tag == "box":
        return "box", tuple(_pixels(shape.get(corner, ""), where) for corner in _CORNERS)
    points = shape.get("points", "").split(";")
    if shape.tag != "points" or len(points) != 1:
        raise VfoaError(f"{where}: found <{shape.tag}> of {len(points)} points; expected a box, or one point")
    place = tuple(_pixels(each, where) for each in points[0].split(","))
    return "point", check_place("point", place, where)


def _pixels(text: str, where: str) -> float:
    try:
        value = float(text) - _HALF_PX
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise VfoaError(f"{where}: found {text[:40]!r}; expected a number of pixels for {', '.join(BOX)}")
    return value


def _within(track: Track, exchange: Exchange) -> list[KeyFrame]:
    """The key frames in the clip's own numbers; a track that extends beyond the clip is cut."""
    first, last = exchange.first_number, exchange.first_number + len(exchange.frames) - 1
    numbers = {each.frame: each.outside for each in track.keys if first <= each.frame <= last}
    frames = [each.frame for each in track.keys]
    if frames[0] > last:
        return []
    for end, is_beyond in ((first, frames[0] < first), (last, frames[-1] > last)):
        if is_beyond:
            numbers.setdefault(end, track.at(end) is None)
    return [
        KeyFrame(frame=exchange.frames[number - first], place=track.place_at(number), outside=outside)
        for number, outside in sorted(numbers.items())
    ]


def _joined(one: list[KeyFrame], other: list[KeyFrame], name: str, where: str) -> list[KeyFrame]:
    """Join the key frames of two tracks of one name; the earlier must end before the later begins."""
    if not one or not other:
        return one or other
    before, after = sorted((one, other), key=lambda each: (each[0].frame, each[-1].frame))
    end = before[-1]
    if end.frame > after[0].frame or not end.outside:
        raise VfoaError(
            f"{where}: {name!r} has two tracks in frame {after[0].frame} of the clip; expected one at a time"
        )
    return [*(before[:-1] if end.frame == after[0].frame else before), *after]


def write_cvat_drawn(path: Path, drawn: Drawn, exchange: Exchange) -> tuple[str, ...]:
    """Write a track for each of what is drawn; the answer says what CVAT has to be told first."""
    root = Element("annotations")
    SubElement(root, "version").text = "1.1"
    task = SubElement(SubElement(root, "meta"), "task")
    for tag, value in {"name": path.stem, "size": str(len(exchange.frames)), "mode": "interpolation"}.items():
        SubElement(task, tag).text = value
    listed = SubElement(task, "labels")
    for name in drawn.names:
        SubElement(SubElement(listed, "label"), "name").text = name
    people = [each.name for each in drawn.tracks if each.kind == "box" and each.name in exchange.subjects]
    for number, track in enumerate(drawn.tracks):
        element = SubElement(root, "track", id=str(number), label=track.name, source="manual")
        for key in _keys(track, exchange.frames):
            shape = _write_shape(element, track.kind, key, exchange)
            if track.kind == "box" and track.name in people:
                SubElement(shape, "attribute", name=_KIND).text = "box"
    indent(root)
    atomic_write(path, f'<?xml version="1.0" encoding="utf-8"?>\n{tostring(root, encoding="unicode")}\n')
    said = f"whole people are told from heads by a text attribute {_KIND!r}: give it to {', '.join(people)} in CVAT."
    return (said,) if people else ()


def _keys(track: Track, frames: Sequence[int]) -> list[KeyFrame]:
    """The key frames, and all frames between two of them where frames are missing: CVAT knows positions only."""
    found = list(track.keys)
    for before, after in pairwise(track.keys):
        between = frames[frames.index(before.frame) + 1 : frames.index(after.frame)]
        if len(between) != after.frame - before.frame - 1 and not before.outside:
            found += [KeyFrame(frame=frame, place=track.place_at(frame)) for frame in between]
    return sorted(found, key=lambda each: each.frame)


def _write_shape(track: Element, kind: Kind, key: KeyFrame, exchange: Exchange) -> Element:
    frame = exchange.frames.index(key.frame) + exchange.first_number
    flags = {"frame": str(frame), "keyframe": "1", "outside": str(int(key.outside)), "occluded": "0", "z_order": "0"}
    values = [f"{each + _HALF_PX:.2f}" for each in key.place]
    if kind == "point":
        return SubElement(track, "points", {**flags, "points": ",".join(values)})
    return SubElement(track, "box", {**flags, **dict(zip(_CORNERS, values, strict=True))})


def _frame(shape: Element, where: str) -> int:
    number = shape.get("frame", "")
    if not _FRAME.fullmatch(number):
        raise VfoaError(f"{where}: <{shape.tag}> has the frame {number[:40]!r}; expected a number")
    return int(number)
