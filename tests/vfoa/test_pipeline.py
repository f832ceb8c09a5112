"""The whole diagram on a scene of known truth: a person to the left and two things, seen without error."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import get_ident
from types import SimpleNamespace

import numpy as np
import pytest

from tests.true_stages import EYES, FAR, NEAR, PERSON, true_percepts, true_stages
from vfoa.cones import ConesSettings
from vfoa.errors import VfoaError
from vfoa.gaze_filter import GazeFilterSettings
from vfoa.pipeline import Attending, AttendSettings, perceive, reconstruct
from vfoa.reconstruction import ReconstructionSettings
from vfoa.stereo.region import needed_region
from vfoa.tracking import Tracker, TrackingSettings
from vfoa.types import FrameResult, Head, NoAttention, Percepts, StereoFrame


@pytest.fixture(scope="module")
def percepts() -> Percepts:
    return true_percepts()


def run(
    percepts: Percepts, looked_at: list[int], *, cues: bool = True, settings: AttendSettings | None = None
) -> list[FrameResult]:
    """Frames in which the person looks at one target after the other, through all of the pipeline."""
    size = (percepts.rig.height_px, percepts.rig.width_px, 3)
    chosen = settings or AttendSettings()
    tracker, attending, results = Tracker(chosen.tracking), Attending(chosen), []
    for index, target in enumerate(looked_at):
        black = np.zeros(size, np.uint8)
        frame = StereoFrame(index=index, time_ns=0, left=black, right=black, rig=percepts.rig)
        scene = reconstruct(
            perceive(frame, true_stages(percepts, target, cues=cues)), ReconstructionSettings(eyes="patch")
        )
        results += attending.step(scene, tracker.step(scene.people))
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
        attention=ConesSettings(cones_deg=(30, 60), n_rays=7),
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


def black_frame(percepts: Percepts) -> StereoFrame:
    black = np.zeros((percepts.rig.height_px, percepts.rig.width_px, 3), np.uint8)
    return StereoFrame(index=0, time_ns=0, left=black, right=black, rig=percepts.rig)


def test_faces_are_found_while_the_frame_is_segmented(percepts):
    stages, frame = true_stages(percepts, NEAR), black_frame(percepts)
    threads = []

    class Faces:
        def faces(self, frame):
            threads.append(get_ident())
            return stages.heads.detect(frame, percepts.instances)

        def with_people(self, faces, frame, instances):
            assert instances is percepts.instances
            return faces[:1]

        def detect(self, frame, instances):
            raise AssertionError("waits for the masks")

    early = replace(stages, heads=Faces())
    alone = perceive(frame, early)
    with ThreadPoolExecutor(1) as pool:
        beside = perceive(frame, early, executor=pool)
    (ours,), (others,) = beside.views, alone.views
    np.testing.assert_array_equal(ours.head.box_px, others.head.box_px)
    assert threads[0] == get_ident() != threads[1]


def test_models_of_heads_beside_the_matcher_give_the_same(percepts):
    stages, threads = true_stages(percepts, NEAR), []
    seen = SimpleNamespace(estimate=lambda *inputs: threads.append(get_ident()) or stages.gaze.estimate(*inputs))
    frame = black_frame(percepts)
    alone = perceive(frame, stages)
    with ThreadPoolExecutor(1) as pool:
        beside = perceive(frame, replace(stages, gaze=seen), executor=pool)
    assert threads
    assert get_ident() not in threads
    np.testing.assert_array_equal(beside.disparity.disparity_px, alone.disparity.disparity_px)
    np.testing.assert_array_equal(beside.views[0].gaze.direction, alone.views[0].gaze.direction)
    np.testing.assert_array_equal(beside.views[0].head_pose.direction, alone.views[0].head_pose.direction)


def test_where_both_sides_fail_it_is_the_error_of_the_matcher_as_without_threads(percepts):
    def fails(name):
        def method(*inputs):
            raise VfoaError(name)

        return SimpleNamespace(estimate=method, match=method)

    stages = replace(true_stages(percepts, NEAR), matcher=fails("matcher"), head_pose=fails("head pose"))
    with ThreadPoolExecutor(1) as pool, pytest.raises(VfoaError, match="matcher"):
        perceive(black_frame(percepts), stages, executor=pool)
    stages = replace(true_stages(percepts, NEAR), head_pose=fails("head pose"))
    with ThreadPoolExecutor(1) as pool, pytest.raises(VfoaError, match="head pose"):
        perceive(black_frame(percepts), stages, executor=pool)


@pytest.mark.parametrize("threads", [0, 1])
def test_a_matcher_of_a_region_matches_objects_heads_and_what_a_person_drew(percepts, threads):
    stages, frame, asked = true_stages(percepts, NEAR), black_frame(percepts), []
    cut_out = replace(percepts.instances)
    (head,) = stages.heads.detect(frame, percepts.instances)
    drawn_head = Head(box_px=np.array([2.0, 100, 12, 110]), score=1.0)
    placed = SimpleNamespace(window=(slice(3, 9), slice(390, 398)))
    drawing = SimpleNamespace(
        place=lambda frame, instances: (placed,),
        add_heads=lambda frame, heads, drawn: (*heads, drawn_head),
        add_masks=lambda frame, instances, drawn, disparity: cut_out,
    )
    matcher = SimpleNamespace(match_region=lambda frame, region: asked.append(region) or percepts.disparity)
    stages = replace(stages, matcher=None, region_matcher=matcher)
    with ThreadPoolExecutor(1) as pool:
        executor = pool if threads else None
        plain, drawn = (perceive(frame, replace(stages, drawing=each), executor=executor) for each in (None, drawing))
    found = needed_region(percepts.instances, [head], percepts.rig)
    assert asked == [found, replace(found, u0=2, v0=3, u1=398)]
    assert (plain.instances is percepts.instances, drawn.instances is cut_out) == (True, True)
    assert [len(each.views) for each in (plain, drawn)] == [1, 2]
    assert drawn.views[1].head is drawn_head
