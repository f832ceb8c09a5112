"""CVAT, "for video 1.1": a track per subject, a shape per frame, the target in an attribute.

    <track id="0" label="girl" source="manual">
      <box frame="0" keyframe="1" outside="0" occluded="0" xtl="10" ytl="20" xbr="60" ybr="80" z_order="0">
        <attribute name="target">bird</attribute>      also: note, u_px, v_px, state
      </box>

The subject is the track's attribute ``subject``, or else its label; other tracks are left out. A label holds from its
shape to the next one's. As CVAT 2 exports it (github.com/cvat-ai/cvat, ``cvat/apps/dataset_manager/formats/cvat.py``,
MIT; read, not used): frames count from 0 in the source, a track ends with a shape that is outside, and
``annotations.xml`` comes in a ZIP.
"""

from __future__ import annotations

import io
import re
import xml.etree.ElementTree as ElementTree
import zipfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from harness.files.io import atomic_write, read_bytes
from harness.files.parsing import parse_xml, read_member
from harness.labels.bodies import Box
from harness.labels.formats.exchange import Exchange, Imported, one_line
from harness.labels.labels import IGNORED, Label, LabelRange, Labels, ranges_of
from harness.labels.rows import SUGGESTED, parse_point
from vfoa.errors import VfoaError

_UNDEFINED = "__undefined__"
"""CVAT's own value for an attribute that was not set."""
_MEMBER = "annotations.xml"
_FRAME = re.compile(r"[0-9]{1,18}")
_ATTRIBUTES = ("target", "note", "u_px", "v_px", "state")


class CvatVideo:
    """Reads any shape that has a frame; writes head boxes if they are known, else the whole image."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read the tracks of subjects; those of other labels are left out and counted."""
        root = read_tracks(path)
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
        root = ElementTree.Element("annotations")
        ElementTree.SubElement(root, "version").text = "1.1"
        _write_task(root, path.stem, labels, exchange)
        whole = 0
        for number, subject in enumerate(labels.subjects):
            track = ElementTree.SubElement(root, "track", id=str(number), label=subject, source="manual")
            whole += _write_track(track, subject, labels, exchange)
        ElementTree.indent(root)
        text = ElementTree.tostring(root, encoding="unicode")
        atomic_write(path, f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n')
        said = f"{whole} boxes are the whole image: the subject's head is not known there (--run RUN has heads)."
        return (said,) if whole else ()


def read_tracks(path: Path) -> ElementTree.Element:
    """Return the root of a file "for video 1.1", or of the one in a ZIP.

    Raises
    ------
    VfoaError
        If it has no tracks, or tracks of several tasks.
    """
    root = parse_xml(_content(path), path)
    if root.tag != "annotations" or root.find("image") is not None or root.find("track") is None:
        raise VfoaError(f"{path}: found <{root.tag}> without tracks; expected CVAT for video 1.1")
    tasks = sorted({track.get("task_id", "") for track in root.iter("track")})
    if len(tasks) > 1:
        raise VfoaError(f"{path}: found the tasks {', '.join(tasks)} of a project; expected the export of one task")
    return root


def _content(path: Path) -> bytes:
    content = read_bytes(path)
    if not zipfile.is_zipfile(io.BytesIO(content)):
        return content
    return read_member(content, _MEMBER, path, "CVAT's exports")


def _subject(track: ElementTree.Element, exchange: Exchange) -> str:
    """Our name of the track's attribute ``subject``, or of its label."""
    named = next(filter(None, (_attributes(shape).get("subject", "") for shape in track)), "")
    return exchange.names.translate(named or track.get("label", ""))


def _attributes(shape: ElementTree.Element) -> dict[str, str]:
    return {each.get("name", ""): one_line(each.text) for each in shape.iter("attribute")}


def _labelled(
    track: ElementTree.Element, subject: str, exchange: Exchange, where: str
) -> Iterator[tuple[int, int, Label]]:
    """Yield CVAT's first and last frame of every label of a track; a shape that is ``outside`` ends one."""
    shapes: list[tuple[int, ElementTree.Element]] = []
    for shape in track:
        number = shape.get("frame", "")
        if not _FRAME.fullmatch(number):
            raise VfoaError(f"{where}: <{shape.tag}> has the frame {number[:40]!r}; expected a number")
        shapes.append((int(number), shape))
    shapes.sort(key=lambda each: each[0])
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


def _write_task(root: ElementTree.Element, name: str, labels: Labels, exchange: Exchange) -> None:
    task = ElementTree.SubElement(ElementTree.SubElement(root, "meta"), "task")
    values = {"name": name, "size": str(len(exchange.frames)), "mode": "interpolation"}
    for key, value in values.items():
        ElementTree.SubElement(task, key).text = value
    listed = ElementTree.SubElement(task, "labels")
    for subject in labels.subjects:
        label = ElementTree.SubElement(listed, "label")
        ElementTree.SubElement(label, "name").text = subject
        attributes = ElementTree.SubElement(label, "attributes")
        for each in _ATTRIBUTES:
            attribute = ElementTree.SubElement(attributes, "attribute")
            described = {"name": each, "mutable": "True", "input_type": "text", "default_value": "", "values": ""}
            for key, value in described.items():
                ElementTree.SubElement(attribute, key).text = value


def _write_track(track: ElementTree.Element, subject: str, labels: Labels, exchange: Exchange) -> int:
    """Write a subject's shapes; return how many of them are the whole image."""
    whole = 0
    before: Label | None = None
    last_head: Box | None = None
    for position, frame in enumerate(exchange.frames):
        label = labels.at(frame, subject)
        if label is None and before is None:
            continue
        head = exchange.head_box(frame, subject)
        whole += head is None and label is not None
        # A shape that ends a label is at the head's last place: CVAT does not show it.
        box = head or (last_head if label is None else None) or exchange.image_box
        last_head = head or last_head
        shape = _write_box(track, position + exchange.first_number, box, is_key=label != before, is_out=label is None)
        _write_attributes(shape, label or before)
        before = label
    return whole


def _write_box(track: ElementTree.Element, frame: int, box: Box, *, is_key: bool, is_out: bool) -> ElementTree.Element:
    corners = {key: f"{value:.2f}" for key, value in zip(("xtl", "ytl", "xbr", "ybr"), box, strict=True)}
    flags = {"frame": str(frame), "keyframe": str(int(is_key)), "outside": str(int(is_out)), "occluded": "0"}
    return ElementTree.SubElement(track, "box", {**flags, **corners, "z_order": "0"})


def _write_attributes(shape: ElementTree.Element, label: Label | None) -> None:
    if label is None:
        return
    u, v = ("", "") if label.point_px is None else (repr(each) for each in label.point_px)
    values = (label.target, label.note, u, v, SUGGESTED if label.is_suggested else "")
    for name, value in zip(_ATTRIBUTES, values, strict=True):
        ElementTree.SubElement(shape, "attribute", name=name).text = value
