"""Shapes that a person drew on a clip's left images: boxes, points and heads at key frames, and in between.

# vfoa drawn 1
frame,name,kind,u0_px,v0_px,u1_px,v1_px,outside
1,robot,box,412.5,200,498,301.5,
40,robot,box,430,196,520,300,
61,robot,box,560,190,640,280,1
1,lamp,point,611,88,,,
1,anna,head,120,64,171,130,

A track holds the key frames of one name and one kind. Between two key frames each coordinate changes linearly with the
frame number; after the last one it stays. The shape is absent before its first key frame, and from a key frame that is
``outside`` until the next one. Coordinates are pixels of the left image, whole numbers at pixels' centres.
``annotations/README.md`` explains the file to people who draw.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal, get_args

from harness.files.io import atomic_write
from harness.files.tables import LARGEST, TableColumns, format_rows, found, read_columns
from harness.labels.rows import check_text
from vfoa.errors import VfoaError, check_known

VERSION_LINE = "# vfoa drawn 1"
BOX = ("u0_px", "v0_px", "u1_px", "v1_px")
COLUMNS = ("frame", "name", "kind", *BOX, "outside")

Kind = Literal["box", "point", "head"]
KINDS: tuple[Kind, ...] = get_args(Kind)
Place = tuple[float, ...]
"""u0, v0, u1, v1 of a box or a head, u, v of a point, in pixels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KeyFrame:
    """The place of a shape in one frame; ``outside``: it is gone from this frame on."""

    frame: int
    place: Place
    outside: bool = False


@dataclass(frozen=True, kw_only=True)
class KeyedShape:
    """The key frames of one name and kind: at least one, their frames ascend."""

    name: str
    kind: Kind
    keys: tuple[KeyFrame, ...]

    @cached_property
    def _frames(self) -> list[int]:
        return [key.frame for key in self.keys]

    def at(self, frame: int) -> Place | None:
        """The place in a frame; None if it is not visible."""
        position = bisect_right(self._frames, frame) - 1
        if position < 0 or self.keys[position].outside:
            return None
        return self.place_at(frame)

    def place_at(self, frame: int) -> Place:
        """The place in a frame, also while outside; before the first key frame, that key frame's place."""
        position = max(bisect_right(self._frames, frame) - 1, 0)
        here = self.keys[position]
        if frame <= here.frame or position + 1 == len(self.keys):
            return here.place
        after = self.keys[position + 1]
        share = (frame - here.frame) / (after.frame - here.frame)
        return tuple((1 - share) * a + share * b for a, b in zip(here.place, after.place, strict=True))


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """All shapes drawn on a clip: at most one track of each name and kind, in the order of the file."""

    tracks: tuple[KeyedShape, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all drawn shapes, each once."""
        return tuple(dict.fromkeys(track.name for track in self.tracks))

    @property
    def counts(self) -> str:
        """The number of key frames of each shape, in words."""
        return ", ".join(f"{track.name} ({track.kind}) {len(track.keys)}" for track in self.tracks) or "nothing"

    def at(self, frame: int) -> list[tuple[KeyedShape, Place]]:
        """The tracks that are visible in a frame, each with its place there."""
        return [(track, place) for track in self.tracks if (place := track.at(frame)) is not None]


def size_of(kind: Kind) -> int:
    """Number of coordinates of a shape of this kind."""
    return 2 if kind == "point" else 4


def drawn_of(rows: Mapping[tuple[str, Kind], Iterable[KeyFrame]]) -> Drawn:
    """Make tracks by name, then kind, each sorted by frame; those without key frames are left out."""
    tracks = (
        KeyedShape(name=name, kind=kind, keys=tuple(sorted(keys, key=lambda key: key.frame)))
        for (name, kind), keys in sorted((key, list(key_frames)) for key, key_frames in rows.items())
        if keys
    )
    return Drawn(tracks=tuple(tracks))


def read_drawn(
    path: Path, *, frames: Sequence[int] | None, subjects: Collection[str], targets: Collection[str]
) -> Drawn:
    """Read the shapes drawn on a clip.

    Parameters
    ----------
    frames
        The clip's frame numbers, ascending; None if the clip cannot be opened: then they are not checked.
    subjects, targets
        The manifest's names. A subject has a head, and a box if others look at the whole person.

    Raises
    ------
    VfoaError
        With file and line: another version or column, a cell that is not a number; then, in the order of the rows, an
        unknown name or kind, a kind that the name cannot have, a frame that the clip does not have, a repeated key
        frame, or a box without an inside.
    """
    known = None if frames is None else frozenset(frames)
    keys: dict[tuple[str, Kind], dict[int, KeyFrame]] = {}
    table = read_columns(path, COLUMNS, COLUMNS, version=VERSION_LINE)
    places = zip(*(table.numbers(column).tolist() for column in BOX), strict=True)
    rows = zip(table.cells["name"], table.cells["kind"], table.integers("frame").tolist(), places, strict=True)
    for row, (name, word, frame, place) in enumerate(rows):
        where = table.where(row)
        check_known(name, [*targets, *subjects], f"{where}: name: no subject or target")
        kind = _kind(word, where)
        check_kind(name, kind, subjects, [drawn_kind for other, drawn_kind in keys if other == name], where)
        key = KeyFrame(frame=frame, place=_place(table, row, kind, place), outside=_is_outside(table, row))
        if known is not None and frames is not None and frame not in known:
            raise VfoaError(f"{where}: frame {frame}: not in the clip; its frames: {frames[0]} to {frames[-1]}")
        if keys.setdefault((name, kind), {}).setdefault(frame, key) is not key:
            raise VfoaError(f"{where}: the {kind} of {name!r} has a key frame {frame} already; expected one")
    return drawn_of({key: key_frames.values() for key, key_frames in keys.items()})


def write_drawn(path: Path, drawn: Drawn) -> None:
    """Write the shapes drawn on a clip atomically, in the form of :func:`format_drawn`."""
    atomic_write(path, format_drawn(drawn))


def format_drawn(drawn: Drawn) -> str:
    """Return a file's text: rows by name, kind and frame, LF. Reading and writing it again gives the same bytes."""
    for track in drawn.tracks:
        check_text((track.name,), "drawn")
    rows = [
        (key.frame, track.name, track.kind, *_cells(key.place), "1" if key.outside else "")
        for track in drawn.tracks
        for key in track.keys
    ]
    return f"{VERSION_LINE}\n{format_rows(COLUMNS, rows)}"


def check_place(kind: Kind, place: Sequence[float], where: str) -> Place:
    """Return the coordinates of a place; raise :class:`VfoaError` if one is too large or a box has no inside."""
    if len(place) != size_of(kind) or not all(abs(coordinate) <= LARGEST for coordinate in place):
        expected = "u, v" if kind == "point" else "u0, v0, u1, v1"
        raise VfoaError(f"{where}: found {list(place)}; expected {expected} for a {kind}, at most {LARGEST:g}")
    if kind != "point" and not (place[0] < place[2] and place[1] < place[3]):
        raise VfoaError(f"{where}: found the {kind} {_listed(place)}; expected u0 < u1 and v0 < v1")
    return tuple(float(coordinate) for coordinate in place)


def check_kind(name: str, kind: Kind, subjects: Collection[str], others: Collection[Kind], where: str) -> None:
    """Reject a head of a name that is not a subject, and a name that is drawn both as a box and as a point."""
    if kind == "head" and name not in subjects:
        raise VfoaError(f"{where}: {name!r} is not a subject; expected box or point for a target")
    if other := next((drawn_kind for drawn_kind in others if {drawn_kind, kind} == {"box", "point"}), None):
        raise VfoaError(f"{where}: {name!r} is already drawn as a {other}; expected either a box or a point for a name")


def _kind(word: str, where: str) -> Kind:
    kind = next((kind for kind in KINDS if kind == word), None)
    if kind is None:
        raise VfoaError(f"{where}: kind: found {word!r}; expected {', '.join(KINDS)}")
    return kind


def _place(table: TableColumns, row: int, kind: Kind, coordinates: Sequence[float]) -> Place:
    """The coordinates that a shape of this kind has; the others must be blank (NaN)."""
    size = size_of(kind)
    for position, (column, coordinate) in enumerate(zip(BOX, coordinates, strict=True)):
        if math.isnan(coordinate) == (position < size):
            expected = f"all of {', '.join(BOX[:size])}" if position < size else f"nothing for a {kind}"
            raise VfoaError(f"{table.where(row)}: {column}: {found(table.cells[column][row])}; expected {expected}")
    return check_place(kind, coordinates[:size], table.where(row))


def _is_outside(table: TableColumns, row: int) -> bool:
    cell = table.cells["outside"][row]
    if cell not in ("", "0", "1"):
        raise VfoaError(f"{table.where(row)}: outside: found {cell!r}; expected 1, or nothing")
    return cell == "1"


def _cells(place: Place) -> list[str]:
    return [repr(float(coordinate)).removesuffix(".0") for coordinate in place] + [""] * (len(BOX) - len(place))


def _listed(place: Sequence[float]) -> str:
    return ", ".join(f"{coordinate:g}" for coordinate in place)
