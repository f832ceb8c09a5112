"""Base class of all clips of measurements: numbered frames, each made into a scene.

People and objects are numbered from 1 in the order in which they are first named, people first: these are the
``instance`` ids of a manifest. Everyone is a target for the others, by a box around the head.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Protocol

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, field_validator

from harness.files.safe_names import composed_keys
from harness.files.tables import LARGEST
from harness.sources import PersonTruth, Recognised, Truth, check_number
from harness.sources.media.frame_times import usual_step_ns
from vfoa.errors import VfoaError, reported_as
from vfoa.measured import HEAD_SIZE_M, PERSON, POINT_SIZE_M, box_of, target_of
from vfoa.settings import Settings
from vfoa.types import Box3D, Cues, Float, Gaze, HeadPose, Person, Scene, Target

Length = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Metres = tuple[Length, Length, Length]
Extent = Annotated[float, Field(gt=0, le=LARGEST)]
Extents = tuple[Extent, Extent, Extent]


class FixedObject(Settings):
    """A static object: its middle, its extent along the camera's axes, and its category.

    Without ``size_m`` it is a point; without ``category`` its name is its category.
    """

    center_m: Metres
    size_m: Extents | None = None
    category: str | None = None


class MeasuredSettings(Settings):
    """Settings of every measured clip.

    ``objects`` are the static ones, by name. A point is looked at as a cube with sides of ``point_size_m``.
    ``head_size_m`` is the extent of the box around a head, along the camera's axes; the default is that of an adult.
    """

    objects: dict[str, FixedObject] = Field(default_factory=dict)
    point_size_m: float = Field(default=POINT_SIZE_M, gt=0)
    head_size_m: Extents = HEAD_SIZE_M

    @field_validator("objects")
    @classmethod
    def _compose_names(cls, objects: dict[str, FixedObject]) -> dict[str, FixedObject]:
        return composed_keys(objects)

    def fixed_objects(self) -> tuple[MeasuredObject, ...]:
        """The static objects."""
        return tuple(
            MeasuredObject(
                name=name,
                category=fixed_object.category or name,
                box=self.box(fixed_object.center_m, fixed_object.size_m),
            )
            for name, fixed_object in self.objects.items()
        )

    def box(self, center_m: ArrayLike, size_m: ArrayLike | None, left_from_box: Float | None = None) -> Box3D:
        """Return the box with this middle (3,), extent (3,) and rotation (3, 3); without an extent, a point's box.

        Raises
        ------
        VfoaError
            If the extent is not positive.
        """
        with reported_as("size"):
            return box_of(center_m, np.full(3, self.point_size_m) if size_m is None else size_m, left_from_box)


class SeenPerson(Protocol):
    """One person in one frame; None: not measured. Configurations do not see the ground truth, ``true_*``."""

    @property
    def name(self) -> str:
        """The same in all frames."""

    @property
    def eyes_m(self) -> Float | None:
        """The point between the eyes (3,)."""

    @property
    def head_pose(self) -> HeadPose | None:
        """The direction of the head."""

    @property
    def gaze(self) -> Gaze | None:
        """The direction of the gaze."""

    @property
    def true_gaze(self) -> Float | None:
        """The true unit vector (3,) of the gaze."""

    @property
    def true_target(self) -> str | None:
        """The name of what the person looks at."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredPerson:
    """A :class:`SeenPerson` with its values."""

    name: str
    eyes_m: Float | None
    head_pose: HeadPose | None = None
    gaze: Gaze | None = None
    true_gaze: Float | None = None
    true_target: str | None = None


class PlacedObject(Protocol):
    """One object in one frame. If it has a person's name, it is the box of that person; None: the person has no box."""

    @property
    def name(self) -> str:
        """The same in all frames."""

    @property
    def category(self) -> str:
        """The same in all frames."""

    @property
    def box(self) -> Box3D | None:
        """Where it is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredObject:
    """A :class:`PlacedObject` with its box."""

    name: str
    category: str
    box: Box3D | None


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredFrame:
    """All measurements at one time."""

    time_ns: int
    people: tuple[SeenPerson, ...]
    objects: tuple[PlacedObject, ...] = ()


def recognised_files(
    path: Path, is_read: Callable[[Path], bool], what: str, pattern: str = "*.csv"
) -> tuple[Recognised, ...]:
    """Recognise a file that is a clip by itself, or the files of a folder; ``what`` they hold begins their layout."""
    files = sorted(path.glob(pattern)) if path.is_dir() else [path]
    return tuple(
        Recognised(
            root=file.parent,
            source={"file": file.name},
            layout=f"{what} in {file.name}",
            name=file.stem,
            calibration="not needed",
        )
        for file in files
        if is_read(file)
    )


class FramesOfMeasurements:
    """A clip (:class:`harness.sources.MeasuredClip`) of measurements in memory; adapters fill it.

    ``where`` opens messages: the file or folder that was read. ``fixed`` objects are in every frame that has no object
    of that name itself. ``people`` and ``objects`` are ids by name, from 1, people first and the manifest's objects
    last, so that other ids do not change; ``categories`` are those of all of them. ``measurements`` are by frame.

    Raises
    ------
    VfoaError
        If there is no frame, times do not ascend, or an object has two categories.
    """

    notes: tuple[str, ...] = ()

    def __init__(
        self,
        frames: Mapping[int, MeasuredFrame],
        fixed: Sequence[PlacedObject],
        settings: MeasuredSettings,
        where: str,
        content: str,
    ) -> None:
        self.measurements = dict(sorted(frames.items()))
        self.frames = tuple(self.measurements)
        self._fixed, self._settings, self._where = tuple(fixed), settings, where
        self._content = content
        if not self.frames:
            raise VfoaError(f"{where}: no frames; expected at least one row")
        for (_, before), (number, after) in itertools.pairwise(self.measurements.items()):
            if after.time_ns <= before.time_ns:
                raise VfoaError(f"{where}: frame {number}: its time is not after that of the frame before it")
        names = dict.fromkeys(person.name for frame in self.measurements.values() for person in frame.people)
        self.people = {name: number for number, name in enumerate(names, start=1)}
        self.categories = dict.fromkeys(self.people, PERSON)
        moving = itertools.chain.from_iterable(frame.objects for frame in self.measurements.values())
        for name, category in ((target.name, target.category) for target in (*self._fixed, *moving)):
            known = self.categories.setdefault(name, category)
            if known != category and name not in self.people:
                raise VfoaError(f"{where}: object {name!r}: found categories {known!r} and {category!r}; expected one")
        object_names = [name for name in self.categories if name not in self.people]
        object_names.sort(key=lambda name: name in settings.objects)
        self.objects = {name: number for number, name in enumerate(object_names, start=len(self.people) + 1)}

    @cached_property
    def rate_hz(self) -> float | None:
        """One over the usual time step, Hz; None for a single frame."""
        step_ns = usual_step_ns(frame.time_ns for frame in self.measurements.values())
        return None if step_ns is None else 1e9 / step_ns

    def time_ns(self, number: int) -> int:
        """Time of a frame, nanoseconds."""
        return self._frame(number).time_ns

    def farthest(self) -> tuple[str, int, float] | None:
        """Return whose eyes or middle are ever farthest from the origin: name, frame, metres; None without a place."""
        places = list(self._places())
        if not places:
            return None
        distances_m = np.linalg.norm([place for _, _, place in places], axis=1)
        name, number, _ = places[first := int(np.argmax(distances_m))]
        return name, number, float(distances_m[first])

    def _places(self) -> Iterator[tuple[str, int, Float]]:
        """Every known place (3,) of eyes or of an object's middle, with its name and frame."""
        for each in self._fixed:
            if each.box is not None:
                yield each.name, self.frames[0], each.box.center_m
        for number, frame in self.measurements.items():
            for person in frame.people:
                if (eyes_m := person.eyes_m) is not None:
                    yield person.name, number, eyes_m
            for each in frame.objects:
                if (box := each.box) is not None:
                    yield each.name, number, box.center_m

    def scene(self, number: int) -> Scene:
        """Return the measurements of one frame as a scene."""
        frame = self._frame(number)
        moving = {each.name: self._target(each.name, each.box) for each in frame.objects}
        targets = {**self._fixed_targets, **moving}
        for person in frame.people:  # others look at the person's own box if the source has one, else at the head
            if person.name not in targets:
                head = None if person.eyes_m is None else self._settings.box(person.eyes_m, self._settings.head_size_m)
                targets[person.name] = self._target(person.name, head)
        return Scene(
            index=number,
            time_ns=frame.time_ns,
            targets=tuple(sorted(targets.values(), key=lambda target: target.instance.id)),
            people=tuple(
                Person(
                    view=Cues(head_pose=person.head_pose, gaze=person.gaze),
                    instance_id=self.people[person.name],
                    eye_origin_left=person.eyes_m,
                )
                for person in frame.people
            ),
        )

    @cached_property
    def _fixed_targets(self) -> dict[str, Target]:
        """The same in all frames, by name."""
        return {each.name: self._target(each.name, each.box) for each in self._fixed}

    @cached_property
    def _kinds(self) -> dict[str, int]:
        """The number of each category."""
        return {kind: number for number, kind in enumerate(dict.fromkeys([PERSON, *self.categories.values()]))}

    def _target(self, name: str, box: Box3D | None) -> Target:
        number = self.people[name] if name in self.people else self.objects[name]
        category = self.categories[name]
        return target_of(number, category, self._kinds[category], box, name)

    def truth(self, number: int) -> Truth:
        """Return the true gaze and target of people, where a source knows them; their heads are as measured."""
        measured_people = self._frame(number).people
        if not self._knows_truth:
            return Truth()
        people = (
            PersonTruth(
                name=person.name,
                instance_id=self.people[person.name],
                head_box_px=np.full(4, np.nan),
                eye_origin_left=person.eyes_m,
                head_direction=None if person.head_pose is None else person.head_pose.direction,
                gaze_direction=person.true_gaze,
                target=person.true_target,
            )
            for person in measured_people
        )
        return Truth(people=tuple(people))

    @cached_property
    def _knows_truth(self) -> bool:
        people = (person for frame in self.measurements.values() for person in frame.people)
        return any(person.true_gaze is not None or person.true_target is not None for person in people)

    def digest(self) -> str:
        """Digest of the files' content and the settings."""
        return hashlib.sha256(f"{self._content} {self._settings.model_dump_json()}".encode()).hexdigest()

    def _frame(self, number: int) -> MeasuredFrame:
        check_number(number, self.frames, self._where)
        return self.measurements[number]
