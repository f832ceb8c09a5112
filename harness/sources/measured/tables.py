"""Measurements from a pair of CSV tables, which every tracker can write.

``people.csv``: a row for each frame and person; a frame in which nobody was seen has one row with a blank person::

    frame,time_ns,person,x_m,y_m,z_m
    [,head_x,head_y,head_z][,head_sigma_deg]        direction of the head, a unit vector, and its claimed error
    [,gaze_x,gaze_y,gaze_z][,gaze_sigma_deg]        direction of the gaze, likewise

``objects.csv``, optional: the other targets; a blank frame means every frame::

    frame,object,x_m,y_m,z_m[,category][,size_x_m,size_y_m,size_z_m][,qx,qy,qz,qw]

Camera frame: x right, y down, z forward, metres; any frame with such axes will do. ``x_m, y_m, z_m`` of a person is the
point between the eyes, of an object its middle. ``size_*_m`` is the whole extent along the object's own axes, which the
unit quaternion rotates into the camera's; without a size the object is a point. An object with a person's name is the
box of that person; a person without one gets a box around the head, and none if the object's place is blank. ``sigma``
is the claimed error per tangent direction (``*_sigma_rad`` keeps the exact value). ``time_s`` may replace ``time_ns``.
A blank cell is an unknown value. The dialects of other programs are read (:mod:`harness.files.dialects`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from harness.files.dialects import is_missing
from harness.files.digests import digest_files
from harness.files.groups import grouped
from harness.files.tables import TableColumns, read_columns, read_header, write_rows
from harness.sources import Recognised, given_root
from harness.sources.measured.clip import (
    FramesOfMeasurements,
    MeasuredFrame,
    MeasuredObject,
    MeasuredSettings,
    PlacedObject,
    SeenPerson,
)
from vfoa.errors import VfoaError, located
from vfoa.geometry import rotation_of
from vfoa.measured import PERSON
from vfoa.types import Box3D, Float, Gaze, HeadPose

POSITION = ("x_m", "y_m", "z_m")
SIZE = ("size_x_m", "size_y_m", "size_z_m")
QUATERNION = ("qx", "qy", "qz", "qw")
TIMES = ("time_ns", "time_s")
CUES = ("head", "gaze")
PEOPLE_COLUMNS = (
    *("frame", *TIMES, "person", *POSITION),
    *(f"{cue}_{column}" for cue in CUES for column in ("x", "y", "z", "sigma_deg", "sigma_rad")),
)
OBJECT_COLUMNS = ("frame", "object", *POSITION, "category", *SIZE, *QUATERNION)
_PEOPLE_REQUIRED = ("frame", "person", *POSITION)
_SUFFIXES = (".csv", ".tsv", ".txt")
_WORKBOOKS = (".xlsx", ".xls", ".ods")
_UNIT_TOLERANCE = 0.01
_HALF_TURN_RAD = 3.15
"""Rounded up: people write 3.14, 3.142 and 3.1416."""
_SMALL_SIGMA_DEG = math.radians(30)
"""No model of faces claims an error this small; one of up to 30 degrees is, in radians."""


class MeasuredTablesSettings(MeasuredSettings):
    """The tables under the manifest's root. Without ``objects_file``, only static objects are used.

    ``gaze``: whether the gaze in the table is a cue, or the ``truth`` of an eye tracker, which only the stages
    ``truth`` and ``simulated`` see.
    """

    people_file: str = Field(default="people.csv", min_length=1)
    objects_file: str | None = Field(default=None, min_length=1)
    gaze: Literal["cue", "truth"] = "cue"


class MeasuredTables(FramesOfMeasurements):
    """A clip from two tables."""

    Settings = MeasuredTablesSettings

    def __init__(self, settings: MeasuredTablesSettings, root: Path | None) -> None:
        folder = given_root(root)
        people = folder / settings.people_file
        objects = None if settings.objects_file is None else folder / settings.objects_file
        table = read_columns(people, PEOPLE_COLUMNS, _PEOPLE_REQUIRED)
        times, present = _times_and_people(table, settings)
        everyone = {name for of_frame in present.values() for name in of_frame}
        fixed, moving, rows_of = _objects(objects, settings, times, everyone)
        super().__init__(
            {
                frame: MeasuredFrame(
                    time_ns=time_ns, people=tuple(present[frame].values()), objects=tuple(moving.get(frame, ()))
                )
                for frame, time_ns in times.items()
            },
            (*settings.fixed_objects(), *fixed),
            settings,
            str(people),
            digest_files([("people", people), *([("objects", objects)] if objects else [])]),
        )
        for name in (*everyone, *settings.objects, *(each.name for each in fixed)):
            rows_of.pop(name, None)  # in frames without a row there is the head of a person, or a fixed object
        seen = grouped((name, frame) for frame, of_frame in present.items() for name in of_frame)
        self.doubts = (
            *_unit_notes(table, CUES if settings.gaze == "cue" else CUES[:1]),
            *_sparse_notes(people, seen, self.frames, _FEWEST_SEEN),
            *(_sparse_notes(objects, rows_of, self.frames, 1) if objects else ()),
        )

    @classmethod
    def recognise(cls, path: Path, given: Mapping[str, Any]) -> tuple[Recognised, ...]:
        """Recognise a folder with ``people`` (and ``objects``) tables, or the table of the people itself.

        Raises
        ------
        VfoaError
            If a table that is named ``people`` cannot be read, or lacks the columns of one.
        """
        folder = path if path.is_dir() else path.parent
        people = path if path.is_file() else _table_in(folder, "people")
        if people is None or (people.suffix.lower() not in _SUFFIXES and people.stem != "people"):
            return ()
        if not {"frame", "person"} <= {name.lower() for name in read_header(people)}:
            if people.stem == "people":  # reading names what is wrong with it
                read_columns(people, PEOPLE_COLUMNS, _PEOPLE_REQUIRED)
            return ()
        source, layout = {"people_file": people.name}, f"measurements of people in {people.name}"
        if objects := _table_in(folder, "objects"):
            source, layout = source | {"objects_file": objects.name}, f"{layout}, objects in {objects.name}"
        return (Recognised(root=folder, source=source, layout=layout, name=folder.name, calibration="not needed"),)


def _table_in(folder: Path, name: str) -> Path | None:
    """The table of that name in a folder, whatever program wrote it; CSV before others."""
    paths = (folder / f"{name}{suffix}" for suffix in (*_SUFFIXES, *_WORKBOOKS))
    return next((path for path in paths if path.is_file()), None)


def _times_and_people(
    table: TableColumns, settings: MeasuredTablesSettings
) -> tuple[dict[int, int], dict[int, dict[str, SeenPerson]]]:
    """The time of each frame, ns, and its people by name, both by frame number."""
    rows = _PersonRows.read(table, is_gaze_truth=settings.gaze == "truth")
    times: dict[int, int] = {}
    people: dict[int, dict[str, SeenPerson]] = {}
    frames: list[int] = table.integers("frame").tolist()
    named = zip(frames, rows.names, strict=True)
    table.refuse_repeated(None if name is None else f"frame {frame}, person {name!r}" for frame, name in named)
    for row, (frame, time_ns, name) in enumerate(zip(frames, _times_ns(table), rows.names, strict=True)):
        if times.setdefault(frame, time_ns) != time_ns:
            raise VfoaError(f"{table.where(row)}: frame {frame}: found two times; expected one for all of its rows")
        of_frame = people.setdefault(frame, {})
        if name is not None:
            of_frame[name] = _PersonOfRow(name, rows, row)
    return times, people


def _times_ns(table: TableColumns) -> list[int]:
    """The time of each row, nanoseconds."""
    times = list[int]()
    for row, (stamp, seconds) in enumerate(
        zip(table.integers_or_none("time_ns"), _known(table.numbers("time_s")), strict=True)
    ):
        if (stamp is None) == (seconds is None):
            found = "both" if stamp is not None else "no time"
            raise VfoaError(f"{table.where(row)}: found {found}; expected time_ns or time_s")
        times.append(round(1e9 * seconds) if seconds is not None else stamp or 0)
    return times


def _known(numbers: Float) -> list[float | None]:
    """The numbers (n,), None in place of NaN."""
    return [None if math.isnan(number) else number for number in numbers.tolist()]


def _names(table: TableColumns, column: str) -> list[str | None]:
    """The name in each row; None in a row that measures nothing.

    Raises
    ------
    VfoaError
        If measurements have no name, or a word such as ``nan`` in its place.
    """
    names = list[str | None]()
    measurements = [cells for key, cells in table.cells.items() if key not in {column, "frame", *TIMES}]
    for row, name in enumerate(table.cells[column]):
        if is_missing(name) and not all(is_missing(cells[row]) for cells in measurements):
            found = repr(name) if name else "nothing"
            raise VfoaError(f"{table.where(row)}: {column}: found {found} beside measurements; expected a name")
        names.append(None if is_missing(name) else name)
    return names


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _PersonRows:
    """The people of a table by row, NaN where a value is unknown: eyes (n, 3), and of each cue unit vectors (n, 3).

    ``sigmas_rad`` (n,) are the claimed errors of the cues.
    """

    names: Sequence[str | None]
    eyes_m: Float
    directions: Mapping[str, Float]
    sigmas_rad: Mapping[str, Float]
    is_gaze_truth: bool

    @classmethod
    def read(cls, table: TableColumns, *, is_gaze_truth: bool) -> _PersonRows:
        """Read and check the rows."""
        return cls(
            names=_names(table, "person"),
            eyes_m=table.vectors(POSITION),
            directions={cue: _directions(table, cue) for cue in CUES},
            sigmas_rad={cue: _sigmas_rad(table, cue) for cue in CUES},
            is_gaze_truth=is_gaze_truth,
        )


def _directions(table: TableColumns, cue: str) -> Float:
    """The unit vector (n, 3) of each row, NaN where there is none."""
    columns = [f"{cue}_{axis}" for axis in "xyz"]
    directions = table.vectors(columns)
    lengths = np.linalg.norm(directions, axis=1)
    table.refuse_first(
        np.abs(lengths - 1) > _UNIT_TOLERANCE,
        lambda row: f"{', '.join(columns)}: expected a unit vector, found one of length {lengths[row]:.4g}",
    )
    return directions


def _sigmas_rad(table: TableColumns, cue: str) -> Float:
    """The claimed error (n,) of each row, radians."""
    degrees, radians = _angles(table, f"{cue}_sigma_deg", 180), _angles(table, f"{cue}_sigma_rad", _HALF_TURN_RAD)
    table.refuse_first(
        ~np.isnan(degrees) & ~np.isnan(radians),
        lambda row: f"{cue}_sigma: found degrees and radians; expected one of them",
    )
    return np.where(np.isnan(radians), degrees * (math.pi / 180), radians)


def _angles(table: TableColumns, column: str, most: float) -> Float:
    """The angle (n,) of each row, at most half a turn, ``most`` in its unit; NaN where there is none."""
    angles = table.numbers(column)
    table.refuse_first(
        (angles < 0) | (angles > most),
        lambda row: f"{column}: expected an angle of 0 to {most:.4g}, found {angles[row]:g}",
    )
    return angles


def _unit_notes(table: TableColumns, cues: Sequence[str]) -> tuple[str, ...]:
    """A note for each column of claimed errors of cues that are probably not in degrees, or that are all 0."""
    columns = (f"{cue}_sigma_{unit}" for cue in cues for unit in ("deg", "rad"))
    known = {column: numbers[~np.isnan(numbers)] for column in columns if (numbers := table.numbers(column)).size}
    most = {column: float(numbers.max()) for column, numbers in known.items() if numbers.size}
    said = {
        column: "found 0 alone, which claims exact directions; expected their errors, or blank cells if not known"
        if angle == 0
        else f"found at most {angle:.3g}; expected degrees (radians?)"
        for column, angle in most.items()
        if angle == 0 or (column.endswith("_deg") and angle < _SMALL_SIGMA_DEG)
    }
    return tuple(f"{table.path.name}: {column}: {what}" for column, what in said.items())


def _sparse_notes(
    path: Path, rows_of: Mapping[str, Sequence[int]], frames: Sequence[int], fewest: int
) -> Iterator[str]:
    """Yield a note for each name that has rows in single frames alone: it is not there in all those in between.

    ``rows_of`` are the frames of its rows; ``fewest`` rows are needed for a note.
    """
    for name, numbers in rows_of.items():
        places = np.unique(np.searchsorted(frames, numbers))
        if len(frames) >= _FEWEST_FRAMES and len(places) >= fewest and (np.diff(places) > 1).all():
            yield (
                f"{path.name}: {name}: has a row in {len(places)} of {len(frames)} frames, never in two that follow "
                "each other, and is not there in the others; expected a row in each frame (an object that rests: one "
                "row with a blank frame)"
            )


_FEWEST_FRAMES, _FEWEST_SEEN = 3, 3
"""Frames of a clip, and rows of a person, from which rows in single frames are noted: a tracker may see a face once."""


@dataclass(frozen=True, slots=True, eq=False)
class _PersonOfRow:
    """The person of a row, whose values are made when they are asked for, as those of :class:`_ObjectOfRow`."""

    name: str
    table: _PersonRows
    row: int

    @property
    def eyes_m(self) -> Float | None:
        return _vector(self.table.eyes_m[self.row])

    @property
    def head_pose(self) -> HeadPose | None:
        direction = self._direction("head")
        return None if direction is None else HeadPose(direction=direction, sigma_rad=self._sigma_rad("head"))

    @property
    def gaze(self) -> Gaze | None:
        direction = None if self.table.is_gaze_truth else self._direction("gaze")
        return None if direction is None else Gaze(direction=direction, sigma_rad=self._sigma_rad("gaze"))

    @property
    def true_gaze(self) -> Float | None:
        return self._direction("gaze") if self.table.is_gaze_truth else None

    @property
    def true_target(self) -> str | None:
        return None

    def _direction(self, cue: str) -> Float | None:
        return _vector(self.table.directions[cue][self.row])

    def _sigma_rad(self, cue: str) -> float | None:
        sigma_rad = float(self.table.sigmas_rad[cue][self.row])
        return None if math.isnan(sigma_rad) else sigma_rad


def _vector(vector: Float) -> Float | None:
    return None if math.isnan(vector[0]) else vector


def _objects(
    path: Path | None, settings: MeasuredTablesSettings, times: Mapping[int, int], people: Collection[str]
) -> tuple[list[PlacedObject], dict[int, list[PlacedObject]], dict[str, list[int]]]:
    """The objects that are in every frame, those of single frames by frame number, and the frames of these by name."""
    if path is None:
        return [], {}, {}
    table = read_columns(path, OBJECT_COLUMNS, ("frame", "object", *POSITION))
    rows = _ObjectRows.read(table, settings, people)
    fixed, moving = list[PlacedObject](), dict[int, list[PlacedObject]]()
    frames = table.integers_or_none("frame")
    where = ("" if frame is None else f"frame {frame}, " for frame in frames)
    table.refuse_repeated(f"{place}object {name!r}" for place, name in zip(where, rows.names, strict=True))
    for row, (frame, name) in enumerate(zip(frames, rows.names, strict=True)):
        if frame is not None and frame not in times:
            raise VfoaError(f"{table.where(row)}: frame {frame}: not in the table of people")
        if frame is None:  # the same box in every frame
            fixed.append(MeasuredObject(name=name, category=rows.categories[row], box=rows.box(row)))
        else:
            moving.setdefault(frame, []).append(_ObjectOfRow(rows, row))
    rows_of = grouped((name, frame) for name, frame in zip(rows.names, frames, strict=True) if frame is not None)
    return fixed, moving, rows_of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _ObjectRows:
    """The objects of a table by row. ``geometry`` (n, 10) are places, sizes and quaternions, NaN where unknown."""

    names: Sequence[str]
    categories: Sequence[str]
    geometry: Float
    settings: MeasuredTablesSettings

    @classmethod
    def read(cls, table: TableColumns, settings: MeasuredTablesSettings, people: Collection[str]) -> _ObjectRows:
        """Read the rows. Those of people without a place are their boxes, which are unknown."""
        names, places, sizes = _names(table, "object"), table.vectors(POSITION), table.vectors(SIZE)
        unplaced = np.isnan(places[:, 0]).tolist()
        for row, (name, is_unplaced) in enumerate(zip(names, unplaced, strict=True)):
            if not name or (is_unplaced and name not in people):
                missing = "x_m" if name else "object"
                raise VfoaError(f"{table.where(row)}: {missing}: found nothing; expected a name and a place")
        known = [name for name in names if name is not None]
        given = zip(known, table.cells.get("category", known), unplaced, strict=True)
        rows = cls(
            names=known,
            categories=[
                PERSON if is_unplaced else name if is_missing(category) else category
                for name, category, is_unplaced in given
            ],
            geometry=np.hstack([places, sizes, _quaternions(table)]),
            settings=settings,
        )
        for row in np.flatnonzero((sizes <= 0).any(axis=1) & ~np.isnan(places[:, 0]))[:1]:
            with located(table.where(int(row))):
                rows.box(int(row))
        return rows

    def box(self, row: int) -> Box3D | None:
        """The box of a row; None for a person's that is unknown."""
        center, size, quaternion = (
            None if np.isnan(part[0]) else part for part in np.split(self.geometry[row], (3, 6))
        )
        rotation = None if quaternion is None else rotation_of(quaternion)
        return None if center is None else self.settings.box(center, size, rotation)


@dataclass(frozen=True, slots=True, eq=False)
class _ObjectOfRow:
    """The object of a row, whose box is made when it is asked for: a long table has more than a process needs."""

    table: _ObjectRows
    row: int

    @property
    def name(self) -> str:
        return self.table.names[self.row]

    @property
    def category(self) -> str:
        return self.table.categories[self.row]

    @property
    def box(self) -> Box3D | None:
        return self.table.box(self.row)


def _quaternions(table: TableColumns) -> Float:
    """The unit quaternion (n, 4) of each row, NaN without one."""
    quaternions = table.vectors(QUATERNION)
    table.refuse_first(
        np.abs(np.linalg.norm(quaternions, axis=1) - 1) > _UNIT_TOLERANCE,
        lambda row: f"{', '.join(QUATERNION)}: expected a unit quaternion, found {quaternions[row]}",
    )
    return quaternions


_CUE = ("head_x", "head_y", "head_z", "head_sigma_rad", "gaze_x", "gaze_y", "gaze_z", "gaze_sigma_rad")
_PEOPLE = ("frame", "time_ns", "person", *POSITION, *_CUE)
_OBJECTS = ("frame", "object", "category", *POSITION, *SIZE, *QUATERNION)

Cells = list[object]


def write_measured(folder: Path, frames: Mapping[int, MeasuredFrame]) -> None:
    """Write ``people.csv`` and ``objects.csv``. Reading them gives the same bits, except for rotated boxes.

    A true gaze is written in place of a measured one: it is read with ``gaze = "truth"``.
    """
    numbered = sorted(frames.items())
    people = [row for number, frame in numbered for row in _people_cells(number, frame)]
    objects = [
        _object_cells(number, measured_object) for number, frame in numbered for measured_object in frame.objects
    ]
    write_rows(folder / "people.csv", _PEOPLE, people)
    write_rows(folder / "objects.csv", _OBJECTS, objects)


def _people_cells(number: int, frame: MeasuredFrame) -> Iterator[Cells]:
    for person in frame.people:
        yield [
            *(number, frame.time_ns, person.name, *_vector_cells(person.eyes_m)),
            *(*_direction_cells(person.head_pose), *_direction_cells(person.gaze, person.true_gaze)),
        ]
    if not frame.people:
        yield [number, frame.time_ns, *[None] * (len(_PEOPLE) - 2)]


def _direction_cells(cue: HeadPose | Gaze | None, truth: Float | None = None) -> Cells:
    return [*_vector_cells(truth), None] if cue is None else [*_vector_cells(cue.direction), cue.sigma_rad]


def _object_cells(number: int, measured_object: PlacedObject) -> Cells:
    box, named = measured_object.box, [number, measured_object.name, measured_object.category]
    if box is None:
        return [*named, *[None] * 10]
    quaternion: Cells = [None] * 4
    if not np.array_equal(box.left_from_box, np.eye(3)):
        from scipy.spatial.transform import Rotation  # not above: as in rotation_of

        quaternion = Rotation.from_matrix(box.left_from_box).as_quat().tolist()
    return [*named, *_vector_cells(box.center_m), *_vector_cells(2 * box.half_size_m), *quaternion]


def _vector_cells(vector: Float | None) -> Cells:
    return [None] * 3 if vector is None else list(vector.tolist())
