"""Time of attention: cones compared with the plain loop of :mod:`harness.bench.plain`, and every method over scenes."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from timeit import Timer

import numpy as np

from harness.bench.plain import plain_attention
from harness.clips.manifest import ClipManifest
from harness.pipeline.configuration import Configuration
from harness.pipeline.drawn_stage import DrawnClip
from harness.pipeline.perception import Perception, SharedFrame, pose_frames
from harness.report.formats import Table
from harness.run.attend import FRAMES_AT_ONCE
from harness.sources import MeasuredClip
from vfoa.bayes import BayesSettings
from vfoa.cones import ConesSettings, pay_attention
from vfoa.errors import VfoaError
from vfoa.logit import LogitSettings
from vfoa.methods import MethodSettings
from vfoa.nearest import NearestSettings
from vfoa.pipeline import Attending, AttendSettings
from vfoa.tracking import Tracked
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


def time_attention(*, cones_cm: tuple[float, ...], boxes: int, subjects: int) -> AttentionTiming:
    """Time both implementations on one seeded frame with all of its subjects, for cones of 40 surface rays per cue."""
    settings = ConesSettings(cones_cm=cones_cm, n_rays=40, axis_ray=False)
    people, targets = seeded_frame(boxes=boxes, subjects=subjects)

    def best_ms(way: Callable[[Subject, tuple[Target, ...], ConesSettings], object], frames: int) -> float:
        frame = Timer(lambda: [way(subject, targets, settings) for subject in people])
        return 1e3 * min(frame.repeat(15, frames)) / frames

    return AttentionTiming(
        rays_per_subject=2 * 40 * len(cones_cm),
        boxes=boxes,
        subjects=subjects,
        vectorised_ms=best_ms(pay_attention, frames=5),
        plain_ms=best_ms(plain_attention, frames=1),
    )


METHODS: dict[str, MethodSettings] = {
    "cones, one": ConesSettings(cones_cm=(10.0,)),
    "cones, two": ConesSettings(cones_cm=(10.0, 25.0)),
    "nearest": NearestSettings(method="nearest"),
    "logit, forward": LogitSettings(method="logit"),
    "logit, both": LogitSettings(method="logit", smoothing="both"),
    "bayes, forward": BayesSettings(method="bayes"),
    "bayes, both": BayesSettings(method="bayes", smoothing="both"),
}
"""The settings of every row."""

SIZES = ((6, 1), (6, 4), (20, 3))
"""Boxes and subjects of the seeded scenes."""

Scenes = Sequence[tuple[Scene, Tracked]]
"""The frames of a clip, and the tracks of their people."""


def seeded_scenes(*, boxes: int, subjects: int, frames: int = 30) -> Scenes:
    """Scenes of a room, the same in every call: objects at rest, and people who move."""
    subjects_at_rest, targets = seeded_frame(boxes=boxes, subjects=subjects)
    rng, tracks = np.random.default_rng(1), range(1, subjects + 1)
    found = []
    for index in range(frames):
        people = tuple(_moved(subject.person, rng) for subject in subjects_at_rest)
        scene = Scene(index=index, time_ns=index * FRAME_NS, targets=targets, people=people)
        found.append((scene, Tracked(ids=tuple(tracks), open=frozenset(tracks))))
    return found


def _moved(person: Person, rng: np.random.Generator) -> Person:
    """The person some centimetres and degrees from where it is."""
    gaze, head_pose, eyes = person.view.gaze, person.view.head_pose, person.eye_origin_left
    assert gaze is not None
    assert head_pose is not None
    assert eyes is not None
    view = replace(
        person.view,
        gaze=Gaze(direction=gaze.direction + rng.normal(0, 0.1, 3)),
        head_pose=HeadPose(direction=head_pose.direction + rng.normal(0, 0.05, 3)),
    )
    return replace(person, view=view, eye_origin_left=eyes + rng.normal(0, 0.02, 3))


def scenes_of(
    manifest: ClipManifest, configuration: Configuration, frames: Sequence[int], drawn: DrawnClip | None = None
) -> Scenes:
    """The scenes of a clip as a configuration perceives them."""
    clip = manifest.open()
    if isinstance(clip, MeasuredClip):
        shared = pose_frames([configuration], clip, frames, manifest)
        return [_followed(each, configuration) for each in shared]
    with Perception([configuration], clip, manifest=manifest, drawn=drawn) as perception:
        return [_followed(each, configuration) for each in perception.frames(frames)]


def _followed(shared: SharedFrame, configuration: Configuration) -> tuple[Scene, Tracked]:
    followed = shared.by_configuration[configuration.name]
    if isinstance(followed, VfoaError):
        raise followed
    return followed.scene, followed.tracked


def time_methods(material: Mapping[str, Scenes], *, rounds: int = 5) -> dict[str, dict[str, float]]:
    """CPU milliseconds per person and frame of every method on each material; the best of several rounds."""
    return {
        name: {title: _ms_per_person(settings, scenes, rounds) for title, scenes in material.items()}
        for name, settings in METHODS.items()
    }


def _ms_per_person(settings: MethodSettings, scenes: Scenes, rounds: int) -> float:
    """Attend to all scenes as a run does. They are new in every round: nothing is known of them from the one before."""
    spent = []
    for _ in range(rounds):
        attending, again = Attending(AttendSettings(attention=settings)), copy.deepcopy(scenes)
        begun = time.process_time()
        for first in range(0, len(again), FRAMES_AT_ONCE):
            attending.steps([(scene, tracked, None) for scene, tracked in again[first : first + FRAMES_AT_ONCE]])
        attending.finish()
        spent.append(time.process_time() - begun)
    return 1e3 * min(spent) / max(1, sum(len(tracked.people(scene.people)) for scene, tracked in scenes))


def attention_table(rows: Sequence[AttentionTiming]) -> Table:
    """Vectorised attention compared with the plain loop."""
    return Table.of(
        "Attention, milliseconds a frame",
        "rays per subject | boxes | subjects | vectorised | plain loop | times faster",
        (
            (
                *(row.rays_per_subject, row.boxes, row.subjects),
                *(f"{row.vectorised_ms:.2f}", f"{row.plain_ms:.1f}", f"{row.times_faster:.0f}"),
            )
            for row in rows
        ),
        words=0,
    )


def methods_table(ms_by_method: Mapping[str, Mapping[str, float]]) -> Table:
    """One row per method, one column per material."""
    titles = list(next(iter(ms_by_method.values())))
    return Table(
        title="Attention by method, CPU ms per person and frame",
        columns=("method", *titles),
        rows=tuple((name, *(f"{ms:.2f}" for ms in row.values())) for name, row in ms_by_method.items()),
        words=1,
        notes=(
            "Scenes in memory, attended to in order by each method alone: objects at rest, and people who move; in the "
            "last column those of the clip. One thread; the best of several rounds.",
        ),
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
