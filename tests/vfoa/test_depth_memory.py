"""Objects and eyes that are seen without a depth are where their last depth puts them, for a few frames."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import vfoa
from harness.clips.manifest import load_manifest
from harness.pipeline.ground_truth import TruthMatcher
from harness.pipeline.perception import FollowedFrame, Perception
from harness.run.experiment import load_experiment
from tests.disk import write_text
from tests.experiments import NO_ERRORS, experiment_of
from tests.scenes import make_box, make_person, make_rig, rendered_boxes
from tests.true_stages import FAR, NEAR, true_percepts, true_stages
from vfoa.depth_memory import DepthMemory, EyeMemory
from vfoa.instance_tracking import PATIENCE
from vfoa.reconstruction import ReconstructionSettings, place_targets
from vfoa.types import Disparity, Percepts, Person, StereoFrame, Target

RIG = make_rig(320, 200, fx_px=260)
BLACK = np.zeros((240, 400, 3), np.uint8)
PLAIN, OTHER = 1, 2
SETTINGS = ReconstructionSettings()
EXPERIMENT = experiment_of(["studio_table"], {"fine": {}, "coarse": {"reconstruction.max_points": 200}}, NO_ERRORS)


def scene(x: float = -0.4, *, of: tuple[int, ...] = (PLAIN, OTHER)) -> Percepts:
    """Two boxes, of which these have a depth."""
    seen = rendered_boxes(RIG, [make_box((x, 0.3, 1.8), 0.15), make_box((0.6, 0, 2.5), 0.2)])
    return replace(seen, disparity=of_ids(seen, of))


def at(number: int, rate_hz: int = 25) -> Percepts:
    """The frame of this number."""
    return replace(SCENE, index=number, time_ns=number * 1_000_000_000 // rate_hz)


def of_ids(percepts: Percepts, known: tuple[int, ...]) -> Disparity:
    """The disparities of these instances alone."""
    is_known = np.isin(percepts.instances.ids, known)
    disparity = np.where(is_known, percepts.disparity.disparity_px, np.float32(np.nan))
    return Disparity(disparity_px=disparity.astype(np.float32))


def placed(percepts: Percepts) -> tuple[Target, ...]:
    return place_targets(percepts.disparity, percepts.instances, percepts.rig, SETTINGS)


SCENE = scene()


def test_an_object_without_a_depth_is_where_its_last_depth_puts_it() -> None:
    memory = DepthMemory()
    (before, _), blind = memory.step(placed(scene()), at(7)), placed(scene(of=(OTHER,)))
    (after, other) = memory.step(blind, at(8))
    (later, _) = memory.step(blind, at(9))
    assert before.box is not None
    assert after.box is not None
    assert blind[0].box is None
    np.testing.assert_allclose(after.box.center_m, before.box.center_m)
    np.testing.assert_array_equal(after.points_left, before.points_left)
    assert other is blind[1]
    assert [each.depth_from for each in (before, after, later, other)] == [None, 7, 7, None]


@pytest.mark.parametrize("moved_m", [-0.1, 0.05, 0.2])
def test_it_moves_with_its_mask(moved_m: float) -> None:
    memory, true = DepthMemory(), placed(scene(-0.4 + moved_m))[0]
    memory.step(placed(scene()), at(1))
    after = memory.step(placed(scene(-0.4 + moved_m, of=(OTHER,))), at(2))[0]
    assert true.box is not None
    assert after.box is not None
    # from elsewhere, the camera sees another part of its side
    np.testing.assert_array_less(abs(after.box.center_m - true.box.center_m), [0.01, 0.01, 0.04])


def test_after_some_frames_its_depth_is_not_known() -> None:
    memory = DepthMemory()
    memory.step(placed(scene()), at(1))
    found = [memory.step(placed(scene(of=(OTHER,))), at(2 + n))[0].box for n in range(PATIENCE + 2)]
    assert [box is not None for box in found] == [True] * PATIENCE + [False] * 2


def test_a_depth_is_known_for_as_long_at_100_frames_a_second_as_at_25() -> None:
    objects, eyes, patience = DepthMemory(), EyeMemory(), 4 * PATIENCE
    objects.step(placed(scene()), at(0, 100))
    eyes.step((person((-0.2, -0.3, 2.0)),), (1,), at(0, 100))
    for number in range(1, patience + 2):
        target, _ = objects.step(placed(scene(of=(OTHER,))), at(number, 100))
        (seen,) = eyes.step((person(None),), (1,), at(number, 100))
        known = target.box is not None, seen.eye_origin_left is not None
        assert known == (number <= patience,) * 2


def test_frames_that_miss_the_object_count() -> None:
    memory = DepthMemory()
    memory.step(placed(scene()), at(1))
    for n in range(PATIENCE):
        memory.step((), at(2 + n))
    blind = placed(scene(of=(OTHER,)))
    assert memory.step(blind, at(2 + PATIENCE)) is blind


def test_what_never_had_a_depth_has_none_and_what_has_one_stays() -> None:
    memory, blind, seen = DepthMemory(), placed(scene(of=(OTHER,))), placed(scene())
    assert memory.step(blind, at(1)) is blind
    assert memory.step(seen, at(2)) is seen


HEAD_PX = (100.0, 40.0, 130.0, 80.0)


def person(origin: tuple[float, float, float] | None, by_px: float = 0.0) -> Person:
    u0, v0, u1, v1 = HEAD_PX
    eyes = None if origin is None else np.array(origin)
    return replace(make_person((u0 + by_px, v0, u1 + by_px, v1)), eye_origin_left=eyes)


def test_eyes_without_a_depth_are_where_their_last_depth_puts_them() -> None:
    memory = EyeMemory()
    both = person((-0.2, -0.3, 2.0)), person((0.5, -0.3, 3.0))
    assert memory.step(both, (1, 2), at(7)) is both
    blind = person(None, by_px=13.0), both[1], person(None)
    moved, other, new = memory.step(blind, (1, 2, 3), at(8))
    np.testing.assert_allclose(moved.eye_origin_left, [-0.2 + 13 * 2.0 / 260, -0.3, 2.0])
    assert (other, new.eye_origin_left) == (both[1], None)
    assert [each.depth_from for each in (moved, other, new)] == [7, None, None]
    found = [memory.step((person(None),), (1,), at(9 + n))[0].eye_origin_left for n in range(PATIENCE)]
    assert [origin is not None for origin in found] == [True] * (PATIENCE - 1) + [False]


def test_eyes_are_those_of_the_track_and_not_of_the_place() -> None:
    memory, blind = EyeMemory(), (person(None),)
    memory.step((person((-0.2, -0.3, 2.0)),), (1,), at(1))
    assert memory.step(blind, (2,), at(2)) is blind
    assert memory.step(blind, (None,), at(3)) is blind


def test_a_person_whose_head_has_no_depth_is_answered() -> None:
    percepts = true_percepts()
    follower = vfoa.Estimator(true_stages(percepts, NEAR), reconstruction=ReconstructionSettings(eyes="patch")).follow(
        percepts.rig
    )
    (before,) = follower.step(BLACK, BLACK).looks
    follower._stages = true_stages(replace(percepts, disparity=of_ids(percepts, (NEAR, FAR))), NEAR)
    (after,) = follower.step(BLACK, BLACK).looks
    assert (after.target, after.missing) == (before.target, None)
    np.testing.assert_allclose(after.distance_m, before.distance_m)


def test_a_look_at_it_goes_on() -> None:
    percepts = true_percepts()
    follower = vfoa.Estimator(true_stages(percepts, NEAR), reconstruction=ReconstructionSettings(eyes="patch")).follow(
        percepts.rig
    )
    blind = replace(percepts, disparity=of_ids(percepts, tuple({*range(4)} - {NEAR})))
    stages = true_stages(blind, NEAR)
    (before,) = follower.step(BLACK, BLACK).looks
    follower._stages = stages
    (after,) = follower.step(BLACK, BLACK).looks
    assert after.target == before.target is not None
    np.testing.assert_allclose(after.distance_m, before.distance_m)


def test_in_a_run_each_object_has_a_box_when_the_matcher_finds_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    match = TruthMatcher.match

    def blinking(self: TruthMatcher, frame: StereoFrame) -> Disparity:
        found = match(self, frame)
        return found if frame.index != 2 else Disparity(disparity_px=np.full_like(found.disparity_px, np.nan))

    monkeypatch.setattr(TruthMatcher, "match", blinking)
    configurations = load_experiment(str(write_text(tmp_path / "true.toml", EXPERIMENT))).configurations
    with Perception(configurations, load_manifest("studio_table").open_images()) as perception:
        frames = list(perception.frames((1, 2, 3)))
    for name in ("fine", "coarse"):
        boxes = []
        for frame in frames:
            followed = frame.by_configuration[name]
            assert isinstance(followed, FollowedFrame)
            boxes.append({target.instance.id for target in followed.scene.targets if target.box})
            assert all(person.eye_origin_left is not None for person in followed.scene.people)
        assert boxes[1] == boxes[0] != set()
        assert len(boxes[2]) >= len(boxes[1])
