"""Shapes of other programs (CVAT, COCO) as a clip's drawn shapes; and looks, an attribute of people's shapes.

An object is known by its track (``cup#3``, track 3 with the label ``cup``, where that is renamed), by an attribute
``name``, or by its label. A person's shape is a head if its label is ``head`` or ``face``, or the person's name and one
of these words (``anna_head``). An attribute of a person's shapes, such as ``looks_at``
(:data:`~harness.labels.formats.table_columns.COLUMNS`), has the target in each frame. Shapes whose label is, or is
renamed to, ``SUBJECT:TARGET`` are looks, and are not drawn.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from harness.files.dialects import plain_name
from harness.labels.drawn_shapes import Drawn, KeyFrame, Kind, Place, check_kind, check_place, drawn_of
from harness.labels.formats.exchange import Exchange, Imported
from harness.labels.formats.table_columns import COLUMNS
from harness.labels.labels import NOWHERE, Label, ranges_of
from vfoa.errors import VfoaError, check_known, counted

_NAMES = ("name", *COLUMNS["subject"])
"""Attributes that have the name of an object."""
_HEAD = re.compile(r"(?:(?P<person>.+)[ _:.-])?(?:head|face)", re.IGNORECASE)
_UNSET = ("", "__undefined__")
"""What CVAT writes for an attribute that nobody has set."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """A shape in one frame, by its place in the task's film, or in one image, by its name.

    ``place`` are the pixels of its box, or of its only point, in pixels as in :mod:`harness.labels.drawn_shapes`; none
    of a tag of the whole image.
    ``is_needed``: it is not known from those before and after it.
    """

    at: int | str
    place: Place
    is_needed: bool
    is_outside: bool
    attributes: Mapping[str, str]
    where: str


def turned_box(u0: float, v0: float, u1: float, v1: float, degrees: float) -> Place:
    """The extent of a box that is turned about its middle, as CVAT turns boxes."""
    turn, half_u, half_v = math.radians(degrees), (u1 - u0) / 2, (v1 - v0) / 2
    across = half_u * abs(math.cos(turn)) + half_v * abs(math.sin(turn))
    down = half_u * abs(math.sin(turn)) + half_v * abs(math.cos(turn))
    u, v = (u0 + u1) / 2, (v0 + v1) / 2
    return (u - across, v - down, u + across, v + down)


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapeTrack:
    """The shapes of one object; ``number`` is empty for one that is known by its label and attributes alone."""

    label: str
    number: str
    shapes: list[Shape]


def tracks_of(shapes: Iterable[tuple[str, str, Shape]]) -> list[ShapeTrack]:
    """Shapes with their labels and numbers as tracks: one for each number, or for each label and name without one."""
    tracks: dict[tuple[str, str], ShapeTrack] = {}
    for label, number, shape in shapes:
        track = ShapeTrack(label=label, number=number, shapes=[])
        tracks.setdefault((label, f"#{number}" if number else name_in(shape.attributes)), track).shapes.append(shape)
    return list(tracks.values())


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapeFile:
    """The tracks of a file, and the size (width, height) of its images, where it is known.

    ``images`` are those that it lists, also without a shape, by name; none if its shapes have places in a film.
    ``is_film``: they are known to be those of a film. ``left_out`` says what has no box: "2 skeletons"; empty if there
    is nothing.
    """

    tracks: list[ShapeTrack]
    images: Sequence[str]
    size_px: tuple[int, int] | None
    is_film: bool = False
    left_out: str = ""

    def ats(self) -> Collection[int | str]:
        """The frames, or images, that the file says something of."""
        return dict.fromkeys([*self.images, *(shape.at for track in self.tracks for shape in track.shapes)])


def one_size(sizes_px: Iterable[tuple[int, int]], path: Path) -> tuple[int, int] | None:
    """Return the size of a file's images, (width, height); None if it states none.

    Raises
    ------
    VfoaError
        If they differ.
    """
    sizes = sorted({*sizes_px})
    if len(sizes) > 1:
        listed = ", ".join(f"{width} x {height}" for width, height in sizes)
        raise VfoaError(f"{path}: found images of the sizes {listed}; expected those of one clip")
    return next(iter(sizes), None)


def imported(file: ShapeFile, exchange: Exchange, path: Path) -> Imported:
    """The shapes of the manifest's names, and the looks of subjects; others are left out, with a note.

    ``exchange.modifier`` is the attribute that has the targets, of several.
    """
    frames, of_images = _frames(file, exchange, path)
    said = [(track, _look(track, exchange)) for track in file.tracks]
    of_looks = [_OfLooks(track, *look) for track, look in said if look is not None]
    named = _named([track for track, look in said if look is None], exchange, path, is_needed=not of_looks)
    looks = _looks(named, of_looks, frames, exchange, path)
    rows = [
        row
        for subject, labels in looks.items()
        for row in ranges_of(subject, ((frame, labels.get(frame)) for frame in exchange.frames))
    ]
    drawn, of_labels = _drawn(named, frames, file, exchange), exchange.labels(rows, path)
    known = [*(each.track for each in named), *(each.track for each in of_looks)]
    notes = (*of_images, *of_labels.notes, *_notes(file, known, frames, path))
    return Imported(labels=of_labels.labels, drawn=drawn, size_px=file.size_px, notes=notes)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Named:
    """A track with the manifest's name of its object."""

    track: ShapeTrack
    name: str
    kind: Kind


class _OfLooks(NamedTuple):
    """A track whose shapes are looks of one subject at one target, wherever they are drawn."""

    track: ShapeTrack
    subject: str
    target: str


def _look(track: ShapeTrack, exchange: Exchange) -> tuple[str, str] | None:
    """Subject and target of a track whose label is ``SUBJECT:TARGET`` by our name for it; None of any other."""
    found = exchange.looks_of(f"{track.label}#{track.number}", track.label)
    return None if found and _HEAD.fullmatch(":".join(found)) else found


def name_in(attributes: Mapping[str, str]) -> str:
    """The name in the attributes; empty without one."""
    named = (value for key, value in attributes.items() if plain_name(key) in _NAMES and value not in _UNSET)
    return next(named, "")


_OF_A_FILM = re.compile(r"frame_(\d{6})(?:\.png)?", re.IGNORECASE)
"""The name that CVAT gives to a picture of a film, by its place in it, from 0."""


def _frames(file: ShapeFile, exchange: Exchange, path: Path) -> tuple[Mapping[int | str, int], list[str]]:
    """The clip's frame of each frame of a task, or of each image by its name; those outside are not in it. Notes."""
    places = _places(file, exchange)
    if file.images and not places:
        for option, value in (("--fps", exchange.fps), ("--offset", exchange.offset)):
            if value is not None:
                raise VfoaError(f"{path}: {option}: its images are known by the numbers in their names; leave it out")
        known, (of_images, notes) = {*exchange.frames}, exchange.frames_of_images(file.images, str(path))
        return {name: frame for name, frame in of_images.items() if frame in known}, notes
    rate_hz = exchange.fps or exchange.rate_hz
    if exchange.offset and rate_hz is None:
        raise VfoaError(f"{path}: --offset: the clip's frame rate is not known; expected --fps RATE, too")
    first = exchange.frames[0] if exchange.films else 0
    if exchange.offset is not None:
        first = round(exchange.offset * (rate_hz or 0.0))
    frames: dict[int | str, int] = {first + n: frame for n, frame in zip(exchange.places, exchange.frames, strict=True)}
    return {name: frames[at] for name, at in places.items() if at in frames} if places else frames, []


def _places(file: ShapeFile, exchange: Exchange) -> dict[str, int]:
    """The place in a film of each image; none if they are not pictures of one, or may be the clip's own files."""
    named = [(name, _OF_A_FILM.fullmatch(name)) for name in file.images]
    places = {name: int(match[1]) for name, match in named if match}
    is_own = exchange.offset is None and {*places.values()} <= {*exchange.frames}
    is_film = file.is_film or (0 in places.values() and not is_own)
    return places if is_film and len(places) == len(named) else {}


def _named(tracks: list[ShapeTrack], exchange: Exchange, path: Path, *, is_needed: bool) -> list[_Named]:
    """The tracks of the manifest's names.

    Raises
    ------
    VfoaError
        If there are tracks, and none of them is known, although one ``is_needed``.
    """
    named = [found for track in tracks if (found := _known(track, exchange)) is not None]
    if tracks and not named and is_needed:
        listed = ", ".join(dict.fromkeys(_described(track) for track in tracks))
        expected = ", ".join([*exchange.targets, *exchange.subjects]) or "names in the clip's manifest"
        raise VfoaError(
            f"{path}: found shapes of {listed[:200]}; expected some of {expected}, as label or in an attribute name "
            "(--rename THEIRS=OURS; if they are looks: --rename THEIRS=SUBJECT:TARGET)"
        )
    return named


def _known(track: ShapeTrack, exchange: Exchange) -> _Named | None:
    of_head = _HEAD.fullmatch(track.label)
    in_attributes = next((name for shape in track.shapes if (name := name_in(shape.attributes))), "")
    person = (of_head["person"] or "") if of_head else ""
    for spelling in filter(None, (f"{track.label}#{track.number}", in_attributes, track.label, person)):
        name = exchange.names.translate(spelling)
        is_placed = any(shape.place for shape in track.shapes)
        if name in exchange.subjects or (is_placed and name in exchange.targets):
            is_point = any(len(shape.place) == 2 for shape in track.shapes)
            is_head = of_head is not None and name in exchange.subjects
            return _Named(track=track, name=name, kind="head" if is_head else "point" if is_point else "box")
    return None


def _described(track: ShapeTrack) -> str:
    return f"{track.label}#{track.number}" if track.number else track.label


def _looks(
    named: Sequence[_Named],
    of_looks: Sequence[_OfLooks],
    frames: Mapping[int | str, int],
    exchange: Exchange,
    path: Path,
) -> dict[str, dict[int, Label]]:
    """The label of each subject in each frame, of those whose shapes have an attribute of targets, or are looks."""
    of_people = [(each, shape) for each in named if each.name in exchange.subjects for shape in each.track.shapes]
    attribute = _attribute({key for _, shape in of_people for key in shape.attributes}, exchange, path)
    said = [(each.name, shape.attributes.get(attribute, ""), attribute, shape) for each, shape in of_people]
    said += [(each.subject, each.target, "label", shape) for each in of_looks for shape in each.track.shapes]
    looks = defaultdict[str, dict[int, Label]](dict)
    for subject, value, kind, shape in said:
        frame = frames.get(shape.at)
        if shape.is_outside or value in _UNSET or frame is None:
            continue
        if exchange.names.leaves_out(subject, value, is_ours=True):
            continue
        target = NOWHERE if value.lower() == NOWHERE else exchange.target(value, subject, shape.where)
        label = looks[subject].setdefault(frame, Label(target=target))
        if label.target != target:
            where = f"{shape.where}: {kind}"
            raise VfoaError(f"{where}: found {target!r}; expected {label.target!r}, which another shape has")
    return looks


def _attribute(present: set[str], exchange: Exchange, path: Path) -> str:
    """The attribute that has the targets; empty if there is none."""
    if exchange.modifier is not None:
        check_known(exchange.modifier, sorted(present), f"{path}: --modifier: no")
        return exchange.modifier
    found = sorted(name for name in present if plain_name(name) in COLUMNS["target"])
    if len(found) > 1:
        raise VfoaError(
            f"{path}: found the attributes {', '.join(found)}; expected --modifier NAME, the one that has the targets"
        )
    return found[0] if found else ""


def _drawn(named: list[_Named], frames: Mapping[int | str, int], file: ShapeFile, exchange: Exchange) -> Drawn:
    """The shapes as key frames. A name is outside in frames that the file has, and in which it has no shape.

    Raises
    ------
    VfoaError
        If two shapes of one name and kind are in a frame, a name has a box and a point, or a box has no inside.
    """
    listed = sorted({frames[at] for at in file.ats() if at in frames})
    visible = _visible(named, frames, exchange)
    return drawn_of({key: _key_frames(shapes, listed) for key, shapes in visible.items()})


_Visible = dict[int, tuple[ShapeTrack, Shape]]
"""A shape by the clip's frame, with its track."""


def _visible(
    named: list[_Named], frames: Mapping[int | str, int], exchange: Exchange
) -> dict[tuple[str, Kind], _Visible]:
    visible = defaultdict[tuple[str, Kind], _Visible](dict)
    for each in named:
        shown = [shape for shape in each.track.shapes if shape.place and not shape.is_outside and shape.at in frames]
        if shown:
            kinds = [kind for name, kind in visible if name == each.name]
            check_kind(each.name, each.kind, exchange.subjects, kinds, shown[0].where)
        for shape in shown:
            check_place(each.kind, shape.place, shape.where)
            _, other = visible[each.name, each.kind].setdefault(frames[shape.at], (each.track, shape))
            if other is not shape:
                renamed = f", or --rename '{_described(each.track)}=OURS'" if each.track.number else ""
                raise VfoaError(
                    f"{shape.where}: a second {each.kind} of {each.name!r} (the other: {other.where}); expected one: "
                    f"an attribute name{renamed}"
                )
    return visible


def _key_frames(visible: _Visible, listed: Sequence[int]) -> Iterator[KeyFrame]:
    """The key frames of one name and kind: those of its tracks, the ends of its stretches, and where it is gone.

    A task moves its shapes by places, drawn shapes move by frame numbers: where numbers are left out, every shape is
    a key frame.
    """
    for before, frame, after in zip([-1, *listed], listed, [*listed[1:], -1], strict=False):
        if frame in visible:
            track, shape = visible[frame]
            is_even = frame - before == after - frame
            is_within = all(visible.get(near, (None,))[0] is track for near in (before, after))
            if shape.is_needed or not (is_even and is_within):
                yield KeyFrame(frame=frame, place=shape.place)
        elif before in visible:
            yield KeyFrame(frame=frame, place=visible[before][1].place, outside=True)


def _notes(file: ShapeFile, read: Sequence[ShapeTrack], frames: Mapping[int | str, int], path: Path) -> Iterator[str]:
    """What is left out."""
    known = {id(track) for track in read}
    if unknown := dict.fromkeys(_described(track) for track in file.tracks if id(track) not in known):
        yield f"{path}: no subject or target, left out: {', '.join(unknown)}."
    if outside := sum(at not in frames for at in file.ats()):
        yield f"{path}: left out: {counted(outside, 'frame')} outside the clip."
    if file.left_out:
        yield f"{path}: left out: {file.left_out}."
