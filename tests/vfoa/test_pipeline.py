"""The whole diagram on a scene of known truth: a person to the left and two things, seen without error."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from tests.scenes import make_box, make_rig, rendered_boxes
from vfoa.attention import AttentionSettings
from vfoa.gaze_filter import GazeFilterSettings
from vfoa.geometry import project, unit
from vfoa.pipeline import AttendSettings, Memory, Stages, attend, perceive, reconstruct
from vfoa.reconstruction import ReconstructionSettings
from vfoa.tracking import TrackingSettings
from vfoa.types import (
    Disparity,
    Float,
    FrameResult,
    Gaze,
    Head,
    HeadPose,
    Instances,
    NoAttention,
    Percepts,
    StereoFrame,
)

PERSON, NEAR, FAR = 1, 2, 3
BOXES = {
    PERSON: make_box((-0.6, 0, 2.0), 0.2),
    NEAR: make_box((0.5, 0.2, 1.8), 0.15),
    FAR: make_box((0.5, -0.5, 2.6), 0.2),
}
EYES = np.array([-0.6, -0.06, 1.8])
"""In the front of the person's box, 35 % of its height from the top."""


@dataclass(frozen=True)
class Seen:
    """All five stages at once: they answer what is true, and look at the target with the id ``looked_at``."""

    percepts: Percepts
    looked_at: int
    head_px: Float

    def match(self, frame: StereoFrame) -> Disparity:
        return self.percepts.disparity

    def segment(self, frame: StereoFrame) -> Instances:
        return self.percepts.instances

    def detect(self, frame: StereoFrame, instances: Instances) -> tuple[Head, ...]:
        return (Head(box_px=self.head_px, score=0.9),)

    @property
    def direction(self):
        return unit(BOXES[self.looked_at].center_m - EYES)


class TrueHeadPose(Seen):
    def estimate(self, frame: StereoFrame, head: Head) -> HeadPose:
        return HeadPose(direction=self.direction)


class TrueGaze(Seen):
    def estimate(self, frame: StereoFrame, head: Head, head_pose: HeadPose | None) -> Gaze:
        return Gaze(direction=self.direction)


@pytest.fixture(scope="module")
def percepts() -> Percepts:
    seen = rendered_boxes(make_rig(400, 240, fx_px=320), list(BOXES.values()))
    person, *things = seen.instances.instances
    instances = Instances(ids=seen.instances.ids, instances=(replace(person, label="person"), *things))
    return replace(seen, instances=instances)


def run(
    percepts: Percepts, looked_at: list[int], *, cues: bool = True, settings: AttendSettings | None = None
) -> list[FrameResult]:
    """Frames in which the person looks at one target after the other, through all of the pipeline."""
    face = project([[-0.8, -0.2, 1.8], [-0.4, 0.2, 1.8]], percepts.rig).ravel()
    size = (percepts.rig.height_px, percepts.rig.width_px, 3)
    memory, results = Memory(), []
    for index, target in enumerate(looked_at):
        black = np.zeros(size, np.uint8)
        frame = StereoFrame(index=index, time_ns=0, left=black, right=black, rig=percepts.rig)
        given = {"percepts": percepts, "looked_at": target, "head_px": face}
        seen = Seen(**given)
        models = {"head_pose": TrueHeadPose(**given) if cues else None, "gaze": TrueGaze(**given) if cues else None}
        stages = Stages(matcher=seen, segmenter=seen, heads=seen, **models)
        scene = reconstruct(perceive(frame, stages), ReconstructionSettings(eyes="patch"))
        result, memory = attend(scene, memory, settings or AttendSettings())
        results.append(result)
    return results


def test_the_person_is_followed_and_looks_where_the_truth_says(percepts):
    results = run(percepts, [NEAR, NEAR, FAR, PERSON])
    assert [result.scene.index for result in results] == [0, 1, 2, 3]
    attentions = [attention for result in results for attention in result.attentions]
    assert [attention.subject.track_id for attention in attentions] == [1, 1, 1, 1]
    assert [attention.focus for attention in attentions] == [NEAR, NEAR, FAR, None]
    np.testing.assert_allclose(attentions[0].subject.person.eye_origin_left, EYES, atol=0.02)
    assert attentions[0].subject.person.instance_id == PERSON
    assert [value.instance_id for value in attentions[0].values] == [NEAR, FAR]


def test_without_a_model_for_a_direction_the_result_says_so(percepts):
    (result,) = run(percepts, [NEAR], cues=False)
    assert [attention.missing for attention in result.attentions] == [NoAttention.NO_DIRECTION]


def test_the_settings_of_each_part_reach_it(percepts):
    settings = AttendSettings(
        tracking=TrackingSettings(sigma_l=0.5),
        gaze_filter=GazeFilterSettings(cues="both", noise_deg=30),
        attention=AttentionSettings(cones_deg=(30, 60), n_rays=7),
    )
    first, second = run(percepts, [NEAR, FAR], settings=settings)
    assert [(cone.cue, round(np.degrees(cone.fov_rad)), cone.n_rays) for cone in first.attentions[0].cones] == [
        ("gaze", 30, 7),
        ("gaze", 60, 7),
        ("head", 30, 7),
        ("head", 60, 7),
    ]
    subject = second.attentions[0].subject
    assert not np.allclose(subject.gaze.direction, subject.person.view.gaze.direction)
    strict = AttendSettings(tracking=TrackingSettings(sigma_l=0.95))
    assert run(percepts, [NEAR], settings=strict)[0].attentions == ()
