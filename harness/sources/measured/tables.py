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
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from harness.files.dialects import is_missing
from harness.files.digests import digest_files
from harness.files.tables import TableRow, read_header, read_rows, write_rows
from harness.sources import Recognised
from harness.sources.measured.clip import (
    FramesOfMeasurements,
    MeasuredFrame,
    MeasuredObject,
    MeasuredPerson,
    MeasuredSettings,
)
from vfoa.errors import VfoaError, located
from vfoa.measured import PERSON
from vfoa.types import Float, Gaze, HeadPose

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
        folder = root if root is not None else Path.cwd()
        people = folder / settings.people_file
        objects = None if settings.objects_file is None else folder / settings.objects_file
        times, present = _times_and_people(people, settings)
        everyone = {name for of_frame in present.values() for name in of_frame}
        fixed, moving = _objects(objects, settings, times, everyone)
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
                read_rows(people, PEOPLE_COLUMNS, _PEOPLE_REQUIRED)
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
    path: Path, settings: MeasuredTablesSettings
) -> tuple[dict[int, int], dict[int, dict[str, MeasuredPerson]]]:
    """The time of each frame, ns, and its people by name, both by frame number."""
    times: dict[int, int] = {}
    people: dict[int, dict[str, MeasuredPerson]] = {}
    for row in read_rows(path, PEOPLE_COLUMNS, _PEOPLE_REQUIRED):
        frame, time_ns, name = row.integer("frame"), _time_ns(row), _name(row, "person")
        if frame is None:
            raise VfoaError(f"{row.where}: frame: expected a whole number, found nothing")
        if times.setdefault(frame, time_ns) != time_ns:
            raise VfoaError(f"{row.where}: frame {frame}: found two times; expected one for all of its rows")
        of_frame = people.setdefault(frame, {})
        if name in of_frame:
            raise VfoaError(f"{row.where}: frame {frame}, person {name!r}: occurs twice")
        if name is not None:
            of_frame[name] = _person(row, name, settings)
    return times, people


def _time_ns(row: TableRow) -> int:
    stamp, seconds = row.integer("time_ns"), row.number("time_s")
    if (stamp is None) == (seconds is None):
        raise VfoaError(f"{row.where}: found {'both' if stamp is not None else 'no time'}; expected time_ns or time_s")
    return round(1e9 * seconds) if seconds is not None else stamp or 0


def _name(row: TableRow, column: str) -> str | None:
    """The name in a row; None in a row that measures nothing.

    Raises
    ------
    VfoaError
        If measurements have no name, or a word such as ``nan`` in its place.
    """
    name = row.cells.get(column, "")
    if not is_missing(name):
        return name
    if all(is_missing(cell) for key, cell in row.cells.items() if key not in {column, "frame", *TIMES}):
        return None
    raise VfoaError(
        f"{row.where}: {column}: found {repr(name) if name else 'nothing'} beside measurements; expected a name"
    )


def _person(row: TableRow, name: str, settings: MeasuredTablesSettings) -> MeasuredPerson:
    head, gaze = (_direction(row, cue) for cue in CUES)
    true_gaze = gaze if settings.gaze == "truth" else None
    return MeasuredPerson(
        name=name,
        eyes_m=row.numbers(POSITION),
        head_pose=None if head is None else HeadPose(direction=head, sigma_rad=_sigma(row, "head")),
        gaze=None if gaze is None or true_gaze is not None else Gaze(direction=gaze, sigma_rad=_sigma(row, "gaze")),
        true_gaze=true_gaze,
    )


def _direction(row: TableRow, cue: str) -> Float | None:
    columns = [f"{cue}_{axis}" for axis in "xyz"]
    direction = row.numbers(columns)
    if direction is not None and abs((length := math.hypot(*direction)) - 1) > _UNIT_TOLERANCE:
        raise VfoaError(f"{row.where}: {', '.join(columns)}: expected a unit vector, found one of length {length:.4g}")
    return direction


def _sigma(row: TableRow, cue: str) -> float | None:
    degrees, radians = row.number(f"{cue}_sigma_deg"), row.number(f"{cue}_sigma_rad")
    if degrees is not None and radians is not None:
        raise VfoaError(f"{row.where}: {cue}_sigma: found degrees and radians; expected one of them")
    sigma = math.radians(degrees) if degrees is not None else radians
    if sigma is not None and sigma < 0:
        raise VfoaError(f"{row.where}: {cue}_sigma: expected an angle of at least 0, found {sigma:g} rad")
    return sigma


def _objects(
    path: Path | None, settings: MeasuredTablesSettings, times: Mapping[int, int], people: Collection[str]
) -> tuple[list[MeasuredObject], dict[int, list[MeasuredObject]]]:
    """The objects that are in every frame, and those of single frames by frame."""
    fixed, moving = list[MeasuredObject](), dict[int, list[MeasuredObject]]()
    seen: dict[tuple[int | None, str], str] = {}
    known: dict[tuple[str | None, ...], MeasuredObject] = {}  # most objects rest: their rows differ in the frame alone
    for row in [] if path is None else read_rows(path, OBJECT_COLUMNS, ("frame", "object", *POSITION)):
        frame, cells = row.integer("frame"), tuple(map(row.cells.get, OBJECT_COLUMNS[1:]))
        if (measured_object := known.get(cells)) is None:
            measured_object = known[cells] = _object(row, settings, people)
        if frame is not None and frame not in times:
            raise VfoaError(f"{row.where}: frame {frame}: not in the table of people")
        if before := seen.get((frame, measured_object.name)):
            raise VfoaError(f"{row.where}: object {measured_object.name!r}: occurs twice, first at {before}")
        seen[frame, measured_object.name] = row.where
        (fixed if frame is None else moving.setdefault(frame, [])).append(measured_object)
    return fixed, moving


def _object(row: TableRow, settings: MeasuredTablesSettings, people: Collection[str]) -> MeasuredObject:
    name, center = _name(row, "object"), row.numbers(POSITION)
    if name and center is None and name in people:
        return MeasuredObject(name=name, category=PERSON, box=None)
    if not name or center is None:
        raise VfoaError(f"{row.where}: {'x_m' if name else 'object'}: found nothing; expected a name and a place")
    size, quaternion = row.numbers(SIZE), row.numbers(QUATERNION)
    if quaternion is not None and abs(math.hypot(*quaternion) - 1) > _UNIT_TOLERANCE:
        raise VfoaError(f"{row.where}: {', '.join(QUATERNION)}: expected a unit quaternion, found {quaternion}")
    rotation = None
    if quaternion is not None:
        from scipy.spatial.transform import Rotation  # not above: it takes as long as all other imports of a run

        rotation = np.asarray(Rotation.from_quat(quaternion).as_matrix())
    with located(row.where):
        box = settings.box(center, size, rotation)
    category = row.cells.get("category", "")
    return MeasuredObject(name=name, category=name if is_missing(category) else category, box=box)


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


def _object_cells(number: int, measured_object: MeasuredObject) -> Cells:
    box, named = measured_object.box, [number, measured_object.name, measured_object.category]
    if box is None:
        return [*named, *[None] * 10]
    quaternion: Cells = [None] * 4
    if not np.array_equal(box.left_from_box, np.eye(3)):
        from scipy.spatial.transform import Rotation  # not above: as in _object

        quaternion = Rotation.from_matrix(box.left_from_box).as_quat().tolist()
    return [*named, *_vector_cells(box.center_m), *_vector_cells(2 * box.half_size_m), *quaternion]


def _vector_cells(vector: Float | None) -> Cells:
    return [None] * 3 if vector is None else list(vector.tolist())
