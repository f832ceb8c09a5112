"""CVAT, "for video 1.1": labels as attributes of a subject's track, and what is drawn as the boxes of tracks.

    <track id="0" label="girl" source="manual">
      <box frame="0" keyframe="1" outside="0" occluded="0" xtl="10" ytl="20" xbr="60" ybr="80" z_order="0">
        <attribute name="target">bird</attribute>      also: note, u_px, v_px, state
      </box>
    <track label="lamp">  <points frame="0" keyframe="1" outside="0" points="611.5,88.5"/> ... </track>

Labels: the subject is the track's attribute ``subject``, or else its label; other tracks are left out. A label holds
from its shape to the next one's. As CVAT 2 exports it (github.com/cvat-ai/cvat, MIT; read, not used:
``cvat/apps/dataset_manager/formats/cvat.py``): frames count from 0 in the source, a track ends with a shape that is
outside, and ``annotations.xml`` comes in a ZIP.

Drawn: a track is of the target or subject that its label names; a subject's box is the head, or the whole person if its
attribute ``kind`` is ``box``. Only key frames are read and written, and every shape that comes or goes: both programs
move boxes linearly in between, CVAT by position in the clip. CVAT counts pixels from the upper left corner of the
image, so that its numbers are greater by half a pixel.
"""

from __future__ import annotations

import io
import math
import re
import zipfile
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from harness.files.io import atomic_write, read_bytes
from harness.files.parsing import parse_xml, read_member
from harness.labels.drawn import BOX, Drawn, KeyFrame, Kind, Place, Track, check_kind, check_place, drawn_of
from harness.labels.formats.exchange import Box, Exchange, Imported, one_line
from harness.labels.labels import IGNORED, Label, LabelRange, Labels, ranges_of
from harness.labels.rows import SUGGESTED, parse_point
from vfoa.errors import VfoaError

_UNDEFINED = "__undefined__"
"""CVAT's own value for an attribute that was not set."""
_MEMBER = "annotations.xml"
_FRAME = re.compile(r"[0-9]{1,18}")
_CORNERS = ("xtl", "ytl", "xbr", "ybr")
_HALF_PX = 0.5
_KIND = "kind"
_ATTRIBUTES = ("target", "note", "u_px", "v_px", "state")


class CvatVideo:
    """Reads any shape that has a frame; writes head boxes if they are known, else the whole image."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read the tracks of subjects; those of other labels are left out and counted."""
        root = _read_tracks(path)
        by_subject: dict[str, dict[int, Label]] = {}
        outside, others = 0, Counter[str]()
        for track in root.iter("track"):
            where = f"{path}: track {track.get('id')!r}"
            subject = _subject(track, exchange)
            if subject not in exchange.subjects:
                others[track.get("label", "")] += 1
                continue
            labels = by_subject.setdefault(subject, {})
            for first, last, label in _labelled(track, subject, exchange, where):
                low, high = first - exchange.first_number, last - exchange.first_number
                inside = range(max(low, 0), min(high + 1, len(exchange.frames)))
                outside += high + 1 - low - len(inside)
                if (double := next((each for each in inside if each in labels), None)) is not None:
                    frame = double + exchange.first_number
                    raise VfoaError(f"{where}: {subject!r} has two labels in frame {frame} of CVAT")
                labels.update(dict.fromkeys(inside, label))
        if not by_subject:
            raise VfoaError(
                f"{path}: no track is labelled with a subject; found {', '.join(map(repr, others))}; "
                f"expected {', '.join(map(repr, exchange.subjects))} (--rename LABEL=OURS)"
            )
        rows = [row for subject, labels in by_subject.items() for row in _rows(subject, labels, exchange)]
        found = exchange.labels(rows, path)
        said = [f"{path}: {outside} labels are outside of the clip's frames and are left out."] if outside else []
        if others:
            counts = ", ".join(f"{count} of {label!r}" for label, count in sorted(others.items()))
            said.append(f"{path}: tracks that are no subject's are left out: {counts}.")
        return Imported(labels=found.labels, notes=(*found.notes, *said))

    def write(self, path: Path, labels: Labels, exchange: Exchange) -> tuple[str, ...]:
        """Write a shape for every frame; only the boundary between two equal ranges is lost."""
        root = _document(path, labels.subjects, exchange, _ATTRIBUTES)
        whole = 0
        for number, subject in enumerate(labels.subjects):
            track = SubElement(root, "track", id=str(number), label=subject, source="manual")
            whole += _write_track(track, subject, labels, exchange)
        _write_document(path, root)
        said = f"{whole} boxes are the whole image: the subject's head is not known there (--run RUN has heads)."
        return (said,) if whole else ()


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


def _subject(track: Element, exchange: Exchange) -> str:
    """Our name of the track's attribute ``subject``, or of its label."""
    named = next(filter(None, (_attributes(shape).get("subject", "") for shape in track)), "")
    return exchange.names.translate(named or track.get("label", ""))


def _labelled(track: Element, subject: str, exchange: Exchange, where: str) -> Iterator[tuple[int, int, Label]]:
    """Yield CVAT's first and last frame of every label of a track; a shape that is ``outside`` ends one."""
    shapes = sorted(((_frame(shape, where), shape) for shape in track), key=lambda each: each[0])
    ends = [frame - 1 for frame, _ in shapes[1:]] + [frame for frame, _ in shapes[-1:]]
    for (frame, shape), last in zip(shapes, ends, strict=True):
        if shape.get("outside") != "1" and last >= frame:
            yield frame, last, _label(_attributes(shape), subject, exchange, f"{where}, frame {frame}")


def _label(found: dict[str, str], subject: str, exchange: Exchange, where: str) -> Label:
    name = exchange.attribute
    if name not in found:
        listed = ", ".join(found) or "none"
        raise VfoaError(f"{where}: no attribute {name!r}; found {listed} (--attribute NAME holds the target)")
    target = IGNORED if found[name] in (_UNDEFINED, "") else exchange.target(found[name], subject, where)
    point_px = parse_point((found.get("u_px", ""), found.get("v_px", "")), where)
    state = found.get("state") == SUGGESTED
    return Label(target=target, note=found.get("note", ""), point_px=point_px, is_suggested=state)


def _rows(subject: str, labels: dict[int, Label], exchange: Exchange) -> Iterator[LabelRange]:
    return ranges_of(subject, ((frame, labels.get(position)) for position, frame in enumerate(exchange.frames)))


def _write_track(track: Element, subject: str, labels: Labels, exchange: Exchange) -> int:
    """Write a subject's shapes; return how many of them are the whole image."""
    whole = 0
    before: Label | None = None
    last_head: Box | None = None
    for position, frame in enumerate(exchange.frames):
        label = labels.at(frame, subject)
        if label is None and before is None:
            continue
        head = exchange.heads(frame, subject) if exchange.heads else None
        whole += head is None and label is not None
        # A shape that ends a label is at the head's last place: CVAT does not show it.
        box = head or (last_head if label is None else None) or exchange.image_box
        last_head = head or last_head
        number = position + exchange.first_number
        shape = _write_shape(track, number, box, is_key=label != before, is_outside=label is None)
        _write_attributes(shape, label or before)
        before = label
    return whole


def _write_attributes(shape: Element, label: Label | None) -> None:
    if label is None:
        return
    u, v = ("", "") if label.point_px is None else (repr(each) for each in label.point_px)
    values = (label.target, label.note, u, v, SUGGESTED if label.is_suggested else "")
    for name, value in zip(_ATTRIBUTES, values, strict=True):
        SubElement(shape, "attribute", name=name).text = value


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportedDrawn:
    """The shapes drawn in CVAT, and a note for everything that was left out."""

    drawn: Drawn
    notes: tuple[str, ...] = ()


def read_cvat_drawn(path: Path, exchange: Exchange) -> ImportedDrawn:
    """Read the tracks of a clip's targets and subjects; those of other labels are left out and counted.

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
    return ImportedDrawn(drawn=drawn, notes=(*unused, *notes))


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
        if kind == "box" and name in exchange.subjects and _attributes(shape).get(_KIND) != "box":
            kind = "head"
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
    root = _document(path, drawn.names, exchange)
    for number, track in enumerate(drawn.tracks):
        element = SubElement(root, "track", id=str(number), label=track.name, source="manual")
        for key in _keys(track, exchange.frames):
            frame = exchange.frames.index(key.frame) + exchange.first_number
            place = [each + _HALF_PX for each in key.place]
            shape = _write_shape(element, frame, place, is_key=True, is_outside=key.outside)
            if track.kind == "box" and track.name in exchange.subjects:
                SubElement(shape, "attribute", name=_KIND).text = "box"
    _write_document(path, root)
    people = [each.name for each in drawn.tracks if each.kind == "box" and each.name in exchange.subjects]
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


def _frame(shape: Element, where: str) -> int:
    number = shape.get("frame", "")
    if not _FRAME.fullmatch(number):
        raise VfoaError(f"{where}: <{shape.tag}> has the frame {number[:40]!r}; expected a number")
    return int(number)


def _attributes(shape: Element) -> dict[str, str]:
    return {each.get("name", ""): one_line(each.text) for each in shape.iter("attribute")}


def _document(path: Path, names: Iterable[str], exchange: Exchange, attributes: Sequence[str] = ()) -> Element:
    """A document of one task, with these labels and their attributes, and no track yet."""
    root = Element("annotations")
    SubElement(root, "version").text = "1.1"
    task = SubElement(SubElement(root, "meta"), "task")
    _add_texts(task, {"name": path.stem, "size": str(len(exchange.frames)), "mode": "interpolation"})
    listed = SubElement(task, "labels")
    for name in names:
        label = SubElement(listed, "label")
        SubElement(label, "name").text = name
        described = SubElement(label, "attributes") if attributes else label
        for each in attributes:
            values = {"name": each, "mutable": "True", "input_type": "text", "default_value": "", "values": ""}
            _add_texts(SubElement(described, "attribute"), values)
    return root


def _add_texts(element: Element, texts: dict[str, str]) -> None:
    for tag, text in texts.items():
        SubElement(element, tag).text = text


def _write_shape(track: Element, frame: int, place: Sequence[float], *, is_key: bool, is_outside: bool) -> Element:
    """Add a box (4 numbers), or a point (2 numbers)."""
    flags = {"frame": str(frame), "keyframe": str(int(is_key)), "outside": str(int(is_outside)), "occluded": "0"}
    numbers = [f"{each:.2f}" for each in place]
    if len(numbers) == 2:
        return SubElement(track, "points", {**flags, "z_order": "0", "points": ",".join(numbers)})
    return SubElement(track, "box", {**flags, **dict(zip(_CORNERS, numbers, strict=True)), "z_order": "0"})


def _write_document(path: Path, root: Element) -> None:
    indent(root)
    text = tostring(root, encoding="unicode")
    atomic_write(path, f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n')
