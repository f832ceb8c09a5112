"""Clips of motion capture: people whose heads wear a rigid body, and other rigid bodies as objects.

Where the eyes and the face are in a body's own axes is in no file: it follows from how the body was made.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, field_validator

from harness.files.dialects import check_width, is_missing
from harness.files.digests import file_digest
from harness.files.safe_names import check_name, composed, composed_keys
from harness.sources import given_root
from harness.sources.measured.clip import (
    Extents,
    FramesOfMeasurements,
    MeasuredFrame,
    MeasuredSettings,
    Metres,
)
from vfoa.errors import VfoaError, check_known, listed, reported_as
from vfoa.geometry import rotation_of, unit
from vfoa.settings import Settings
from vfoa.types import Box3D, Float, HeadPose

Up = Literal["y", "z"]
_UNIT_TOLERANCE = 0.01
_LATEST_S = 2**63 / 1e9
_LEFT_FROM_ROOM: Mapping[Up, Float] = {
    "y": np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]),
    "z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
}
"""The rotation from the room's axes, which are right-handed, into axes whose y is down, by the axis that is up."""


class WornBody(Settings):
    """A rigid body, or a bone of a skeleton, that moves with somebody's head.

    ``body`` is its name in the file; without it, it has the person's. Of several names, each frame has the first body
    that is known there: some trackers give a face a new name each time they find it. In its own axes, ``forward`` is
    where the face points, and ``eyes_m`` the point between the eyes, from the body's origin.
    """

    body: str | tuple[str, ...] | None = None
    forward: Metres = (0.0, 0.0, 1.0)
    eyes_m: Metres = (0.0, 0.0, 0.0)

    @field_validator("forward")
    @classmethod
    def _check_forward(cls, forward: Metres) -> Metres:
        if not any(forward):
            raise ValueError(f"found {[*forward]}; expected a direction")
        return forward

    @field_validator("body")
    @classmethod
    def _compose(cls, body: str | tuple[str, ...] | None) -> str | tuple[str, ...] | None:
        return tuple(map(composed, body)) if isinstance(body, tuple) else body and composed(body)

    def names(self, person: str) -> tuple[str, ...]:
        """Return the names of the bodies that a person wears."""
        return (self.body,) if isinstance(self.body, str) else self.body or (person,)


class MotionCaptureSettings(MeasuredSettings):
    """The file under the manifest's root, and who wears which body; all other rigid bodies are objects.

    ``sizes_m`` are the extents of objects along their own axes, about their origins. ``up`` is the axis of the room
    that points up. ``every`` takes each n-th frame of the file: its cameras are faster than looks.
    """

    file: str = Field(min_length=1)
    heads: dict[str, WornBody] = Field(default_factory=dict)
    sizes_m: dict[str, Extents] = Field(default_factory=dict)
    up: Up
    every: int = Field(default=1, ge=1)

    @field_validator("heads", "sizes_m")
    @classmethod
    def _compose_names_of_bodies(cls, values: dict[str, Any]) -> dict[str, Any]:
        return composed_keys(values)


@dataclass(frozen=True, slots=True, kw_only=True)
class Poses:
    """A body in N frames, NaN where it was lost: rotations (N, 3, 3) from its axes to the room's, places (N, 3), m."""

    rotations: Float
    places_m: Float


@dataclass(frozen=True, slots=True, kw_only=True)
class Take:
    """A file's frames: numbers (N,), times (N,) ns, and the poses of each body by name; ``bones`` are some of these.

    ``faces`` are others, whose origin is between the eyes.
    ``digest`` is that of what was read, if it is not one file; ``notes`` are for the reader of a table.
    """

    numbers: Sequence[int]
    times_ns: Sequence[int]
    poses: Mapping[str, Poses]
    bones: frozenset[str] = frozenset()
    faces: frozenset[str] = frozenset()
    digest: str | None = None
    notes: tuple[str, ...] = ()


class MotionCaptureClip(FramesOfMeasurements, ABC):
    """A clip without images from a take; a subclass reads the files of one program."""

    def __init__(self, settings: MotionCaptureSettings, root: Path | None) -> None:
        path = given_root(root) / settings.file
        take = self._take(path, settings)
        worn = _worn(settings, take, path)
        of_people = {name: _first_known([take.poses[body] for body in bodies]) for name, bodies in worn.items()}
        not_things = take.bones.union(*worn.values())
        things = {name: poses for name, poses in take.poses.items() if name not in not_things}
        for name in settings.sizes_m:
            check_known(name, things, f"{path}: sizes_m: no rigid body")
        self._forward = {name: unit(head.forward) for name, head in settings.heads.items()}
        heads, objects = (
            {name: _in_camera_axes(poses, settings.up) for name, poses in moving.items()}
            for moving in (of_people, things)
        )
        self._rotations = {name: dict(zip(take.numbers, turns, strict=True)) for name, (turns, _) in heads.items()}
        frames = {
            number: MeasuredFrame(
                time_ns=time_ns,
                people=tuple(
                    _TrackedPerson(name, settings.heads[name], rotations[place], places_m[place])
                    for name, (rotations, places_m) in heads.items()
                ),
                objects=tuple(
                    _TrackedObject(name, settings, rotations[place], places_m[place])
                    for name, (rotations, places_m) in objects.items()
                ),
            )
            for place, (number, time_ns) in enumerate(zip(take.numbers, take.times_ns, strict=True))
        }
        super().__init__(frames, settings.fixed_objects(), settings, str(path), take.digest or file_digest(path))
        lost = _lost({**of_people, **things}, len(take.numbers))
        self.notes = (*take.notes, *lost, *_notes_on_eyes(settings, worn, take))

    def forward(self, person: str) -> Float:
        """Return where the face points in the axes of the body that a person wears, a unit vector (3,)."""
        return self._forward[person]

    def left_from_body(self, person: str, number: int) -> Float:
        """Return the rotation (3, 3) from these axes into the clip's in one frame; NaN where the body was lost."""
        return self._rotations[person][number]

    def _take(self, path: Path, settings: MotionCaptureSettings) -> Take:
        """Read a file as the settings say."""
        return self.read(path, settings.every)

    @staticmethod
    @abstractmethod
    def read(path: Path, every: int) -> Take:
        """Read each n-th frame of a file; raises a :class:`VfoaError` for the first mistake."""


def read_cells(
    rows: Iterator[tuple[int, list[str]]], header: Sequence[str], columns: Sequence[int], every: int, path: Path
) -> tuple[list[int], Float]:
    """The line of each n-th row, and the numbers (N, C) of some columns; NaN for a blank.

    Raises
    ------
    VfoaError
        If a row is not as long as the header, or a cell is no finite number.
    """
    lines, values = [], []
    for line, cells in islice(rows, 0, None, every):
        check_width(cells, header, f"{path}:{line}")
        try:
            values.append([_number(cells[place]) for place in columns])
        except ValueError as error:
            raise VfoaError(f"{path}:{line}: {error}; expected a number") from None
        lines.append(line)
    numbers = np.array(values, dtype=np.float64).reshape(len(lines), len(columns))
    for row in np.flatnonzero(np.isinf(numbers).any(axis=1))[:1]:
        raise VfoaError(f"{path}:{lines[row]}: found an infinite number; expected finite ones")
    return lines, numbers


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        if is_missing(cell):
            return np.nan
        raise


def check_body(name: str, known: Container[str], where: str, program: str) -> None:
    """Raise a :class:`VfoaError` if a body's name is no valid one, or another body has it."""
    with reported_as(where):
        check_name(name)
    if name in known:
        raise VfoaError(f"{where}: two bodies have the name {name!r}; expected one: rename one in {program}")


def frame_numbers(values: Float, lines: Sequence[int], path: Path) -> list[int]:
    """Numbers of frames from a column (N,); a :class:`VfoaError` says where they are not whole, or do not ascend."""
    for row in np.flatnonzero(values != np.floor(values))[:1]:  # a blank, too
        raise VfoaError(f"{path}:{lines[row]}: Frame: expected a whole number")
    for row in np.flatnonzero(np.diff(values) <= 0)[:1]:
        found = f"found {values[row + 1]:.0f} after {values[row]:.0f}"
        raise VfoaError(f"{path}:{lines[row + 1]}: Frame: {found}; expected ascending numbers")
    return [int(value) for value in values.tolist()]


def frames_per_second(cell: str, where: str, instead: str = "") -> float:
    """A rate from a cell; a :class:`VfoaError`, which ends with ``instead``, if it is none."""
    if not re.fullmatch(r"[0-9]+(\.[0-9]+)?", cell) or float(cell) == 0:
        raise VfoaError(f"{where}: found {cell[:40]!r}; expected a number of frames per second{instead}")
    return float(cell)


def nanoseconds(times_s: Float, lines: Sequence[int], path: Path) -> list[int]:
    """Times (N,) s as whole nanoseconds; a :class:`VfoaError` says where one is blank, or is no time."""
    for row in np.flatnonzero(~(np.abs(times_s) < _LATEST_S))[:1]:
        found = "nothing" if np.isnan(times_s[row]) else f"{times_s[row]:g}"
        raise VfoaError(f"{path}:{lines[row]}: Time: found {found}; expected seconds")
    return [round(1e9 * time_s) for time_s in times_s.tolist()]


def poses_of(names: Collection[str], cells: Float, unit_m: float, lines: Sequence[int], path: Path) -> dict[str, Poses]:
    """The poses of each body from its quaternions x, y, z, w and its places (N, 7), which are beside each other.

    NaN or zeros are those of a body that was lost. A :class:`VfoaError` says where a quaternion is not of length 1.
    """
    of_bodies = zip(names, np.split(cells, len(names), axis=1), strict=True)
    return {
        name: poses_in(of_body, unit_m, lambda row, name=name: f"{path}:{lines[row]}: {name}")  # type: ignore[misc]
        for name, of_body in of_bodies
    }


def poses_in(cells: Float, unit_m: float, where: Callable[[int], str]) -> Poses:
    """The poses of one body as in :func:`poses_of`; ``where`` a row is opens its message."""
    with np.errstate(over="ignore", invalid="ignore"):  # great numbers, and bits of a NaN that signals
        lengths = np.linalg.norm(cells[:, :4], axis=1)
    is_known = ~np.isnan(cells).any(axis=1) & (lengths > 0)
    for row in np.flatnonzero(is_known & (np.abs(lengths - 1) > _UNIT_TOLERANCE))[:1]:
        raise VfoaError(f"{where(int(row))}: found a quaternion of length {lengths[row]:.3g}; expected 1")
    rotations, places_m = np.full((len(cells), 3, 3), np.nan), np.full((len(cells), 3), np.nan)
    if is_known.any():
        rotations[is_known] = rotation_of(cells[is_known, :4])
        places_m[is_known] = unit_m * cells[is_known, 4:]
    return Poses(rotations=rotations, places_m=places_m)


def check_heads(settings: MotionCaptureSettings, bodies: Collection[str], where: str) -> None:
    """Raise a :class:`VfoaError` that names the bodies if nobody wears one."""
    if not settings.heads:
        raise VfoaError(
            f"{where}: heads: found none; expected who wears which rigid body on the head, of: {listed([*bodies])}; "
            "say --set 'heads={anna={body=\"NAME\"}}'"
        )


def _worn(settings: MotionCaptureSettings, take: Take, path: Path) -> dict[str, tuple[str, ...]]:
    """The bodies that each person wears, by the person's name."""
    check_heads(settings, take.poses, str(path))
    worn = {name: head.names(name) for name, head in settings.heads.items()}
    for name, body in ((name, body) for name, bodies in worn.items() for body in bodies):
        check_known(body, take.poses.keys(), f"{path}: heads: no rigid body")
        if (wearer := next(each for each in worn if body in worn[each])) != name:
            raise VfoaError(f"{path}: heads: {wearer} and {name} both wear {body!r}; expected a body for each")
    return worn


def _first_known(bodies: Sequence[Poses]) -> Poses:
    """In each frame, the pose of the first body that was not lost there."""
    first, *others = bodies
    rotations, places_m = first.rotations, first.places_m
    for other in others:
        is_lost = np.isnan(places_m[:, :1])
        rotations = np.where(is_lost[..., np.newaxis], other.rotations, rotations)
        places_m = np.where(is_lost, other.places_m, places_m)
    return Poses(rotations=rotations, places_m=places_m)


@dataclass(frozen=True, slots=True)
class _TrackedPerson:
    """A :class:`~harness.sources.measured.clip.SeenPerson` whose head is a body."""

    name: str
    head: WornBody
    rotation: Float
    place_m: Float
    gaze: None = None
    true_gaze: None = None
    true_target: None = None

    @property
    def eyes_m(self) -> Float | None:
        """The point between the eyes (3,)."""
        return None if np.isnan(self.place_m[0]) else self.place_m + self.rotation @ self.head.eyes_m

    @property
    def head_pose(self) -> HeadPose | None:
        """The direction of the face."""
        return None if np.isnan(self.place_m[0]) else HeadPose(direction=unit(self.rotation @ self.head.forward))


@dataclass(frozen=True, slots=True)
class _TrackedObject:
    """A :class:`~harness.sources.measured.clip.PlacedObject` that is a body; its name is its category."""

    name: str
    settings: MotionCaptureSettings
    rotation: Float
    place_m: Float

    @property
    def category(self) -> str:
        """The name."""
        return self.name

    @property
    def box(self) -> Box3D | None:
        """The box about the body's origin; a cube along the camera's axes if its size is not set."""
        if np.isnan(self.place_m[0]):
            return None
        size_m = self.settings.sizes_m.get(self.name)
        return self.settings.box(self.place_m, size_m, None if size_m is None else self.rotation)


def _in_camera_axes(poses: Poses, up: Up) -> tuple[Float, Float]:
    """Rotations (N, 3, 3) and places (N, 3) in axes whose y is down."""
    return _LEFT_FROM_ROOM[up] @ poses.rotations, poses.places_m @ _LEFT_FROM_ROOM[up].T


def _lost(moving: Mapping[str, Poses], frames: int) -> Iterator[str]:
    """A note for each name whose body was lost at times."""
    for name, poses in moving.items():
        if lost := int(np.isnan(poses.places_m).any(axis=1).sum()):
            yield f"{name}: not tracked in {lost} of {frames} frames"


def _notes_on_eyes(settings: MotionCaptureSettings, worn: Mapping[str, tuple[str, ...]], take: Take) -> Iterator[str]:
    """A note on people whose eyes are taken to be at the origin of their body, because ``eyes_m`` was not set."""
    heads = settings.heads.items()
    if names := [name for name, head in heads if not any(head.eyes_m) and not take.faces.issuperset(worn[name])]:
        yield (
            f"the eyes of {listed(names)} are taken to be at the origin of the rigid body, which is in the middle of "
            "its markers if it was not moved: say heads.NAME.eyes_m in [source]"
        )
