"""The shapes in a file of CVAT: "CVAT for video 1.1", a track for each object, or "CVAT for images 1.1".

<annotations>
  <meta><task><original_size><width>, <height>        or <job> in place of <task>; in newer files beside it
  <track id="0" label="robot">
    <box frame="0" keyframe="1" outside="0" xtl="411.8" ytl="200.5" xbr="498.0" ybr="301.5">
      <attribute name="looks_at">cup
  <image id="0" name="left/00001.jpg" width height>
    <box label="robot" xtl ytl xbr ybr>

A track is written at every frame; ``keyframe`` are those that a person set, and between them a box without rotation
moves linearly. Frames of tracks are those of the film, from 0, or places of images in the task. Coordinates begin at
the corner of a pixel: the middle of the first one is 0.5.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from itertools import accumulate
from pathlib import Path
from xml.etree.ElementTree import Element

from harness.files.io import read_bytes
from harness.files.parsing import parse_xml
from harness.labels.drawn_shapes import Place
from harness.labels.formats.exchange import Exchange, Imported, ReadOnly
from harness.labels.formats.shapes import Shape, ShapeFile, ShapeTrack, imported, one_size, tracks_of, turned_box
from vfoa.errors import VfoaError, listed

LEFT_OUT = ("skeleton", "cuboid", "tag")
"""What has no box of its own."""


class Cvat(ReadOnly):
    """Reads the shapes of the manifest's names, and the looks of subjects; others are left out, with a note."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read them, as :func:`harness.labels.formats.shapes.imported` says."""
        return imported(_read(path), exchange, path)


def _read(path: Path) -> ShapeFile:
    """Read a file.

    Raises
    ------
    VfoaError
        If it is no such file, or of several tasks, or a shape's number is missing or is none: file, track or image,
        found, expected.
    """
    data = read_bytes(path)
    if data.startswith(b"PK"):
        raise VfoaError(f"{path}: a ZIP archive; expected the annotations.xml in it: unpack it first")
    root = parse_xml(data, path)
    if root.tag != "annotations" or root.find("meta") is None:
        raise VfoaError(
            f"{path}: found <{root.tag}>; expected <annotations> with <meta>, as CVAT exports it "
            "(CVAT for video 1.1, CVAT for images 1.1)"
        )
    tasks = [task.findtext("name", "?") for task in root.iterfind("meta/project/tasks/task")]
    if len(tasks) > 1:  # whose frames CVAT counts through
        raise VfoaError(
            f"{path}: an export of a project with the tasks {listed(tasks, 8)}; expected that of one task (Export task "
            "dataset), the clip's"
        )
    images = [_text(image, "name", str(path)) for image in root.iter("image")]
    if twice := [name for name, count in Counter(images).items() if count > 1]:
        raise VfoaError(f"{path}: image {twice[0]} occurs {images.count(twice[0])} times; expected it once")
    tracks = [*_tracks(root, path), *tracks_of(_of_images(root, path))]
    left_out = sum(1 for tag in LEFT_OUT for _ in root.iter(tag)) - sum(1 for _ in root.iterfind("image/tag"))
    words = f"skeletons, cuboids and tags: {left_out}" if left_out else ""
    is_film = any(mode.text == "interpolation" for mode in root.iter("mode"))
    return ShapeFile(tracks=tracks, images=images, size_px=_size(root, path), is_film=is_film, left_out=words)


def _tracks(root: Element, path: Path) -> Iterator[ShapeTrack]:
    for element in root.iter("track"):
        label, number = (_text(element, name, str(path)) for name in ("label", "id"))
        where = f"{path}: track {number}"
        shapes = [
            _shape(
                shape,
                int(_number(shape, "frame", where)),
                f"{where}, frame {shape.get('frame')}",
                is_key=shape.get("keyframe", "1") == "1",
            )
            for shape in element
            if shape.tag in _PLACES
        ]
        yield ShapeTrack(label=label, number=number, shapes=shapes)


def _of_images(root: Element, path: Path) -> Iterator[tuple[str, str, Shape]]:
    """The shapes of images, which have no number, and their tags, which have no place."""
    for image in root.iter("image"):
        where = f"{path}: image {image.get('name')}"
        for element in image:
            if element.tag in (*_PLACES, "tag"):
                shape = _shape(element, _text(image, "name", where), where, is_key=True)
                yield _text(element, "label", where), "", shape


def _shape(element: Element, at: int | str, where: str, *, is_key: bool) -> Shape:
    """A shape; each one of images is a key frame, whatever its ``keyframe``, which Datumaro writes there, too."""
    corners = _PLACES[element.tag](element, where) if element.tag in _PLACES else ()
    place = tuple(round(coordinate - 0.5, 2) for coordinate in corners)
    is_linear = len(place) == 2 or (element.tag == "box" and not _number(element, "rotation", where, "0"))
    return Shape(
        at=at,
        place=place,
        is_needed=is_key or not is_linear,
        is_outside=element.get("outside") == "1",
        attributes={each.get("name", ""): (each.text or "").strip() for each in element.iter("attribute")},
        where=where,
    )


def _box(element: Element, where: str) -> Place:
    u0, v0, u1, v1 = (_number(element, name, where) for name in ("xtl", "ytl", "xbr", "ybr"))
    return turned_box(u0, v0, u1, v1, _number(element, "rotation", where, "0"))


def _ellipse(element: Element, where: str) -> Place:
    u, v, half_u, half_v = (_number(element, name, where) for name in ("cx", "cy", "rx", "ry"))
    turn = math.radians(_number(element, "rotation", where, "0"))
    across = math.hypot(half_u * math.cos(turn), half_v * math.sin(turn))
    down = math.hypot(half_u * math.sin(turn), half_v * math.cos(turn))
    return (u - across, v - down, u + across, v + down)


def _mask(element: Element, where: str) -> Place:
    """The extent of its pixels, which may be less than the rectangle that is written.

    ``rle`` has the lengths of runs of pixels in the rectangle, row by row: outside, inside, and so on.
    """
    sides = [_number(element, name, where) for name in ("left", "top", "width", "height")]
    runs = [_parsed(text, "rle", where) for text in _text(element, "rle", where).split(",")]
    (left, top, width, height), lengths = map(int, sides), [*map(int, runs)]
    ends = [0, *accumulate(lengths)]
    inside = [(first, end - 1) for first, end in zip(ends[1::2], ends[2::2], strict=False) if first < end]
    is_whole = all(number.is_integer() for number in (*sides, *runs))
    if not (is_whole and inside and min(lengths) >= 0 and 0 < ends[-1] <= width * height):
        found = f"{element.get('rle', '')[:40]!r} in {sides[2]:g} x {sides[3]:g}"
        raise VfoaError(f"{where}: rle: found {found}; expected the pixels of a mask, in whole numbers")
    rows = [place // width for place in (inside[0][0], inside[-1][1])]
    wraps = any(first // width < last // width for first, last in inside)
    columns = [0, width - 1] if wraps else [place % width for run in inside for place in run]
    return (left + min(columns), top + rows[0], left + max(columns) + 1, top + rows[1] + 1)


def _points(element: Element, where: str) -> Place:
    """The only point, or the box of several."""
    pairs = [pair.split(",") for pair in _text(element, "points", where).split(";")]
    if any(len(pair) != 2 for pair in pairs):
        raise VfoaError(f"{where}: points: found {element.get('points', '')[:40]!r}; expected x,y;x,y")
    across, down = ([_parsed(text, "points", where) for text in column] for column in zip(*pairs, strict=True))
    return (across[0], down[0]) if len(pairs) == 1 else (min(across), min(down), max(across), max(down))


_PLACES: Mapping[str, Callable[[Element, str], Place]] = {
    "box": _box,
    "ellipse": _ellipse,
    "mask": _mask,
    "points": _points,
    "polygon": _points,
    "polyline": _points,
}
"""How the place of each kind of shape is read."""


def _size(root: Element, path: Path) -> tuple[int, int] | None:
    """Width and height of the film, or of all images."""
    sides = [(image.get("width", ""), image.get("height", "")) for image in root.iter("image")]
    sides += [(size.findtext("width", ""), size.findtext("height", "")) for size in root.iter("original_size")]
    where = str(path)
    pairs = ((int(_parsed(w, "width", where)), int(_parsed(h, "height", where))) for w, h in dict.fromkeys(sides))
    return one_size(pairs, path)


def _text(element: Element, name: str, where: str) -> str:
    if (text := element.get(name)) is None:
        raise VfoaError(f"{where}: a <{element.tag}> without {name}; expected it, as CVAT writes it")
    return text


def _number(element: Element, name: str, where: str, otherwise: str | None = None) -> float:
    text = _text(element, name, where) if otherwise is None else element.get(name, otherwise)
    return _parsed(text, name, where)


def _parsed(text: str, name: str, where: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not abs(number) < 1e9:
        raise VfoaError(f"{where}: {name}: found {text[:40]!r}; expected a number")
    return number
