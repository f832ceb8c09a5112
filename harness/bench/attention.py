"""Time of attention by each method over scenes."""

from __future__ import annotations

import copy
import time
from collections.abc import Mapping, Sequence

import numpy as np

from harness.clips.manifest import ClipManifest
from harness.pipeline.configuration import Configuration
from harness.pipeline.drawn_stage import DrawnClip
from harness.pipeline.perception import Perception, SharedFrame, pose_frames
from harness.report.formats import Table
from harness.run.attend import FRAMES_AT_ONCE
from harness.sources import MeasuredClip
from vfoa.bayes import BayesSettings
from vfoa.cones import ConesSettings
from vfoa.errors import VfoaError
from vfoa.geometry import unit
from vfoa.logit import LogitSettings
from vfoa.methods import MethodSettings
from vfoa.nearest import NearestSettings
from vfoa.pipeline import Attending, AttendSettings
from vfoa.tracking import Tracked
from vfoa.types import Box3D, Float, Gaze, Head, HeadPose, HeadView, Instance, Person, Scene, Target

FRAME_NS = 40_000_000


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
    """Scenes of a room, the same in every call: objects at rest, and people who move by centimetres and degrees."""
    rng, moves, tracks = np.random.default_rng(0), np.random.default_rng(1), range(1, subjects + 1)
    targets = tuple(_target(number, rng) for number in range(1, boxes + 1))
    at_rest = [
        (unit(rng.normal((0, 0, 1), 0.3, (2, 3))), rng.uniform((-1, -0.5, 0), (1, 0.5, 0))) for _ in range(subjects)
    ]
    found = []
    for index in range(frames):
        people = tuple(_moved(gaze, head, eyes, moves) for (gaze, head), eyes in at_rest)
        scene = Scene(index=index, time_ns=index * FRAME_NS, targets=targets, people=people)
        found.append((scene, Tracked(ids=tuple(tracks), open=frozenset(tracks))))
    return found


def _target(number: int, rng: np.random.Generator) -> Target:
    box = Box3D(
        center_m=rng.uniform((-2, -1, 1), (2, 1, 4)), half_size_m=rng.uniform(0.05, 0.4, 3), left_from_box=np.eye(3)
    )
    thing = Instance(id=number, label="thing", category_id=1, is_thing=True, score=1.0)
    return Target(instance=thing, box_px=np.zeros(4), points_left=np.zeros((0, 3), np.float32), box=box)


def _moved(gaze: Float, head: Float, eyes: Float, rng: np.random.Generator) -> Person:
    view = HeadView(
        head=Head(box_px=np.array([0.0, 0, 1, 1]), score=1.0),
        gaze=Gaze(direction=gaze + rng.normal(0, 0.1, 3)),
        head_pose=HeadPose(direction=head + rng.normal(0, 0.05, 3)),
    )
    return Person(view=view, instance_id=None, eye_origin_left=eyes + rng.normal(0, 0.02, 3))


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
