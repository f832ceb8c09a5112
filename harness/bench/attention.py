"""Time of attention: the cones compared with the plain loop of :mod:`harness.bench.plain`, and every method."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from timeit import Timer

import numpy as np

from harness.bench.plain import plain_attention
from harness.report.formats import Table
from vfoa.attention import AttentionSettings, pay_attention
from vfoa.bayes import BayesSettings
from vfoa.logit import LogitSettings
from vfoa.methods import MethodSettings, open_method
from vfoa.nearest import NearestSettings
from vfoa.types import Box3D, Gaze, Head, HeadPose, HeadView, Instance, Person, Scene, Subject, Target

FRAME_NS = 40_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class AttentionTiming:
    """One row: milliseconds per frame of both implementations (the best of several rounds)."""

    rays_per_subject: int
    boxes: int
    subjects: int
    vectorised_ms: float
    plain_ms: float

    @property
    def times_faster(self) -> float:
        """Time of the plain loop over that of the vectorised code."""
        return self.plain_ms / self.vectorised_ms


def time_attention(*, cones_cm: tuple[float, ...], boxes: int, subjects: int, rounds: int = 15) -> AttentionTiming:
    """Time both implementations on one seeded frame with all of its subjects, for cones of 40 surface rays per cue."""
    settings = AttentionSettings(cones_cm=cones_cm, n_rays=40, axis_ray=False)
    people, targets = seeded_frame(boxes=boxes, subjects=subjects)

    def best_ms(way: Callable[[Subject, tuple[Target, ...], AttentionSettings], object], frames: int) -> float:
        frame = Timer(lambda: [way(subject, targets, settings) for subject in people])
        return 1e3 * min(frame.repeat(rounds, frames)) / frames

    return AttentionTiming(
        rays_per_subject=2 * 40 * len(cones_cm),
        boxes=boxes,
        subjects=subjects,
        vectorised_ms=best_ms(pay_attention, frames=5),
        plain_ms=best_ms(plain_attention, frames=1),
    )


METHODS: dict[str, MethodSettings] = {
    "cones, one": AttentionSettings(cones_cm=(10.0,)),
    "cones, two": AttentionSettings(cones_cm=(10.0, 25.0)),
    "nearest": NearestSettings(method="nearest"),
    "logit, forward": LogitSettings(method="logit"),
    "bayes, forward": BayesSettings(method="bayes", surface="box"),
}
"""The settings of every row."""

SIZES = ((6, 1), (6, 4), (20, 3))
"""Boxes and subjects of a frame."""


def time_methods(*, rounds: int = 40, frames: int = 2) -> dict[str, tuple[float, ...]]:
    """CPU milliseconds per person and frame of every method, for each of the sizes; the best of several rounds."""
    ms_by_method: dict[str, tuple[float, ...]] = {}
    for name, settings in METHODS.items():
        ms_by_method[name] = tuple(_ms_per_person(settings, *size, rounds, frames) for size in SIZES)
    return ms_by_method


def _ms_per_person(settings: MethodSettings, boxes: int, subjects: int, rounds: int, frames: int) -> float:
    people, targets = seeded_frame(boxes=boxes, subjects=subjects)
    times_ns = iter(range(0, (rounds * frames + 1) * FRAME_NS, FRAME_NS))
    method = open_method(settings)
    states = tuple(method.start() for _ in people)

    def attend() -> None:
        nonlocal states
        scene = Scene(index=0, time_ns=next(times_ns), targets=targets, people=tuple(each.person for each in people))
        _, states = method.attend(people, scene, states)

    attend()
    timer = Timer(attend, timer=time.process_time)
    return 1e3 * min(timer.repeat(rounds, frames)) / frames / subjects


def methods_table(ms_by_method: dict[str, tuple[float, ...]]) -> Table:
    """One row per method, one column per size."""
    return Table(
        title="Attention by method, CPU ms per person and frame",
        columns=("method", *(f"{boxes} boxes, {subjects} people" for boxes, subjects in SIZES)),
        rows=tuple((name, *(f"{ms:.2f}" for ms in row)) for name, row in ms_by_method.items()),
        words=1,
        notes=("Every frame follows the ones before it. One thread; the best of several rounds.",),
    )


def seeded_frame(*, boxes: int, subjects: int) -> tuple[tuple[Subject, ...], tuple[Target, ...]]:
    """The people and objects of a room, the same in every call."""
    rng = np.random.default_rng(0)
    targets = tuple(_target(number, rng) for number in range(1, boxes + 1))
    return tuple(_subject(number, rng) for number in range(1, subjects + 1)), targets


def _target(number: int, rng: np.random.Generator) -> Target:
    """An object somewhere in a room of 4 x 2 x 3 m."""
    box = Box3D(
        center_m=rng.uniform((-2, -1, 1), (2, 1, 4)), half_size_m=rng.uniform(0.05, 0.4, 3), left_from_box=np.eye(3)
    )
    thing = Instance(id=number, label="thing", category_id=1, is_thing=True, score=1.0)
    return Target(instance=thing, box_px=np.zeros(4), points_left=np.zeros((0, 3), np.float32), box=box)


def _subject(number: int, rng: np.random.Generator) -> Subject:
    """A person behind the objects, who faces them; gaze and head differ."""
    gaze = Gaze(direction=rng.normal((0, 0, 1), 0.3))
    head_pose = HeadPose(direction=rng.normal((0, 0, 1), 0.3))
    view = HeadView(head=Head(box_px=np.array([0.0, 0, 1, 1]), score=1.0), head_pose=head_pose, gaze=gaze)
    person = Person(view=view, instance_id=None, eye_origin_left=rng.uniform((-1, -0.5, 0), (1, 0.5, 0)))
    return Subject(track_id=number, person=person, gaze=gaze, head_pose=head_pose)
