"""Stages that answer with the truth, and those that answer with it and an error of a known size."""

from dataclasses import make_dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from harness.labels.labels import Label
from harness.pipeline.configuration import STAGES
from harness.pipeline.ground_truth import (
    AngularError,
    OracleSettings,
    SimulatedGaze,
    SimulatedGazeSettings,
    SimulatedHeadPose,
    SimulatedHeadPoseSettings,
    TruthGaze,
    TruthHeadPose,
    TruthHeads,
    TruthMatcher,
    TruthSegmenter,
    true_labels,
    truth_of,
)
from harness.sources import PersonTruth, Truth
from tests.examples import few
from vfoa.errors import VfoaError
from vfoa.geometry import angle_between, unit
from vfoa.types import Disparity, Head, Instance, Instances, StereoFrame, StereoRig

RIG = StereoRig(width_px=8, height_px=4, fx_px=10, fy_px=10, cx_px=3.5, cy_px=1.5, baseline_m=0.1, cx_right_px=3.5)
LEFT_HEAD, RIGHT_HEAD = np.array([0.0, 0, 2, 2]), np.array([5.0, 0, 7, 2])
GAZES = {1: unit([0.5, 0.2, -1.0]), 2: unit([-1.0, 0.0, -0.3])}
HEADS = {1: unit([0.2, 0.1, -1.0]), 2: unit([-0.5, 0.0, -1.0])}


def person(number: int, target: str | None = None, **known: Any) -> PersonTruth:
    values = {"gaze_direction": GAZES[number], "head_direction": HEADS[number]} | known
    box = (LEFT_HEAD, RIGHT_HEAD)[number - 1]
    return PersonTruth(name=("anna", "ben")[number - 1], instance_id=number, head_box_px=box, target=target, **values)


def whole_truth() -> Truth:
    ids = np.zeros((4, 8), dtype=np.uint16)
    ids[:, :3], ids[:, 5:] = 1, 2
    listed = (Instance(id=k, label="person", category_id=1, is_thing=True, score=1) for k in (1, 2))
    return Truth(
        disparity=Disparity(disparity_px=np.full((4, 8), 2.5, dtype=np.float32)),
        instances=Instances(ids=ids, instances=tuple(listed)),
        people=(person(1), person(2)),
    )


class FakeClip:
    """A clip of two people in every frame, or with what truth a test gives it. Counts how often it is asked."""

    frames = range(1, 10_001)
    rate_hz = 25.0
    notes = ()

    def __init__(self, *truths: Truth) -> None:
        self._truths = truths or (whole_truth(),)
        self.asked = 0
        if truths:
            self.frames = range(1, len(truths) + 1)

    def time_ns(self, number: int) -> int:
        return 0

    def frame(self, number: int) -> StereoFrame:
        image = np.zeros((4, 8, 3), dtype=np.uint8)
        return StereoFrame(index=number, time_ns=0, left=image, right=image, rig=RIG)

    def truth(self, number: int) -> Truth:
        self.asked += 1
        return self._truths[min(number, len(self._truths)) - 1]

    def digest(self) -> str:
        return "0" * 64


NONE = OracleSettings()
HEAD_1 = Head(box_px=LEFT_HEAD, score=1, instance_id=1)
HEAD_2 = Head(box_px=RIGHT_HEAD, score=1, instance_id=2)


class TestTruthStages:
    def test_they_answer_with_the_truth(self) -> None:
        clip = FakeClip()
        frame, truth = clip.frame(3), whole_truth()
        assert np.array_equal(TruthMatcher(NONE, clip).match(frame).disparity_px, truth.disparity.disparity_px)  # type: ignore[union-attr]
        instances = TruthSegmenter(NONE, clip).segment(frame)
        assert np.array_equal(instances.ids, truth.instances.ids)  # type: ignore[union-attr]
        heads = TruthHeads(NONE, clip).detect(frame, instances)
        assert [head.instance_id for head in heads] == [1, 2]
        for head in heads:
            pose, gaze = (
                TruthHeadPose(NONE, clip).estimate(frame, head),
                TruthGaze(NONE, clip).estimate(frame, head, None),
            )
            assert pose is not None
            assert gaze is not None
            assert np.allclose(pose.direction, HEADS[head.instance_id or 0])
            assert np.allclose(gaze.direction, GAZES[head.instance_id or 0])

    def test_a_head_is_recognised_by_its_place_where_its_instance_is_not_known(self) -> None:
        clip = FakeClip()
        seen = Head(box_px=RIGHT_HEAD + np.array([0.2, 0.1, 0.2, 0.1]), score=0.9)
        gaze = TruthGaze(NONE, clip).estimate(clip.frame(1), seen, None)
        assert gaze is not None
        assert np.allclose(gaze.direction, GAZES[2])

    @pytest.mark.parametrize("instance_id", [None, 2, 7])
    def test_a_heads_instance_has_the_segmentations_number_not_the_sources(self, instance_id: int | None) -> None:
        """Masks found by a network are numbered anew: 2 need not be the source's person 2."""
        clip = FakeClip()
        gaze = TruthGaze(NONE, clip).estimate(
            clip.frame(1), Head(box_px=LEFT_HEAD, score=0.9, instance_id=instance_id), None
        )
        assert gaze is not None
        assert np.allclose(gaze.direction, GAZES[1])

    def test_a_head_that_overlaps_little_is_a_persons_if_its_instance_says_so(self) -> None:
        """The head of a mask with an arm raised, say."""
        clip = FakeClip()
        box = np.array([1.5, 0, 6, 4])
        gaze = TruthGaze(NONE, clip).estimate(clip.frame(1), Head(box_px=box, score=0.9, instance_id=2), None)
        assert gaze is not None
        assert np.allclose(gaze.direction, GAZES[2])
        assert TruthGaze(NONE, clip).estimate(clip.frame(1), Head(box_px=box, score=0.9), None) is None

    def test_a_head_that_is_nobodys_gets_no_answer(self) -> None:
        clip, head = FakeClip(), Head(box_px=np.array([2.5, 2, 4.5, 4]), score=0.9, instance_id=1)
        assert TruthGaze(NONE, clip).estimate(clip.frame(1), head, None) is None
        assert TruthHeadPose(NONE, clip).estimate(clip.frame(1), head) is None
        assert SimulatedGaze(SimulatedGazeSettings(), clip).estimate(clip.frame(1), head, None) is None

    def test_where_nobody_is_a_head_is_nobodys(self) -> None:
        clip = FakeClip(Truth(people=()))
        assert TruthGaze(NONE, clip).estimate(clip.frame(1), HEAD_1, None) is None

    def test_a_clip_may_say_why_it_does_not_know(self) -> None:
        clip = FakeClip(Truth(missing={"disparity": "no such file"}))
        with pytest.raises(VfoaError, match=r'stereo\.matcher = "truth" \(no such'):
            TruthMatcher(NONE, clip).match(clip.frame(1))
        with pytest.raises(VfoaError, match=r'needed by segmentation\.model = "truth"$'):
            TruthSegmenter(NONE, clip).segment(clip.frame(1))

    @pytest.mark.parametrize("label", ["person", "cup"])
    def test_heads_leave_the_instance_open_where_the_segmentation_is_another(self, label: str) -> None:
        """A detected instance 2 need not be the source's person 2."""
        clip = FakeClip()
        others = Instances(
            ids=np.full((4, 8), 2, dtype=np.uint16),
            instances=(Instance(id=2, label=label, category_id=47, is_thing=True, score=1),),
        )
        heads = TruthHeads(NONE, clip).detect(clip.frame(1), others)
        assert [head.instance_id for head in heads] == [None, None]

    def test_one_frames_truth_is_read_once(self) -> None:
        clip = FakeClip()
        stage = TruthGaze(NONE, clip)
        for head in (HEAD_1, HEAD_2, HEAD_1):
            stage.estimate(clip.frame(1), head, None)
        assert clip.asked == 1
        stage.estimate(clip.frame(2), HEAD_1, None)
        assert clip.asked == 2

    @pytest.mark.parametrize(
        ("truth", "call", "message"),
        [
            (
                Truth(),
                lambda c, f: TruthMatcher(NONE, c).match(f),
                'no true disparity; needed by stereo.matcher = "truth"',
            ),
            (
                Truth(),
                lambda c, f: TruthSegmenter(NONE, c).segment(f),
                "no true instances; needed by segmentation.model",
            ),
            (
                Truth(),
                lambda c, f: TruthHeads(NONE, c).detect(f, whole_truth().instances),
                "no true people; needed by heads.detector",
            ),
            (
                Truth(people=(person(1, head_direction=None),)),
                lambda c, f: TruthHeadPose(NONE, c).estimate(f, HEAD_1),
                "no true head direction of 'anna'; needed by head_pose.model",
            ),
            (
                Truth(people=(person(1, gaze_direction=None),)),
                lambda c, f: SimulatedGaze(SimulatedGazeSettings(), c).estimate(f, HEAD_1, None),
                "no true gaze direction of 'anna'; needed by gaze.model = \"simulated\"",
            ),
        ],
    )
    def test_what_a_clip_does_not_know_is_an_error(self, truth: Truth, call: Any, message: str) -> None:
        clip = FakeClip(truth)
        with pytest.raises(VfoaError) as error:
            call(clip, clip.frame(1))
        assert str(error.value).startswith("FakeClip, frame 1: the clip has ")
        assert message in str(error.value)


@pytest.mark.parametrize("options", [{}, {"frozen": True, "slots": True}], ids=["no hash", "no weak references"])
def test_a_clip_may_be_a_dataclass_of_any_kind(options: dict[str, bool]) -> None:
    methods = {"truth": lambda self, number: self.known}
    kind = make_dataclass("DataClip", [("known", Truth)], namespace=methods, **options)
    truth = whole_truth()
    assert truth_of(kind(truth), 1) is truth_of(kind(truth), 2) is truth


class TestTrueLabels:
    def test_neighbouring_frames_of_one_target_are_one_range(self) -> None:
        targets = ["cup", "cup", None, "none", "none", "cup"]
        clip = FakeClip(*(Truth(people=(person(1, target), person(2, "cup"))) for target in targets))
        labels = true_labels(clip)
        assert [(row.first_frame, row.last_frame, row.label) for row in labels.ranges if row.subject == "anna"] == [
            (1, 2, Label(target="cup")),
            (3, 3, Label(target="ignore", note="saccade")),
            (4, 5, Label(target="none")),
            (6, 6, Label(target="cup")),
        ]
        assert [(row.first_frame, row.last_frame) for row in labels.ranges if row.subject == "ben"] == [(1, 6)]


def errors_rad(error: AngularError, frames: range, person_id: int = 1) -> np.ndarray:
    true = GAZES[1]
    return angle_between(np.stack([error.apply(true, person_id, frame) for frame in frames]), true)


class TestSimulated:
    @pytest.mark.parametrize(("error_deg", "bias_share"), [(2.0, 0.0), (11.1, 0.5), (20.0, 0.5), (20.0, 1.0)])
    def test_the_mean_error_is_the_one_asked_for(self, error_deg: float, bias_share: float) -> None:
        """Over 10 seeds with 300 independent biases each, the mean of a Rayleigh distribution is known to 1 %."""
        means = [
            errors_rad(
                AngularError(
                    SimulatedGazeSettings(error_deg=error_deg, bias_share=bias_share, bias_frames=1, seed=seed), 2
                ),
                range(300),
            ).mean()
            for seed in range(10)
        ]
        assert np.degrees(np.mean(means)) == pytest.approx(error_deg, rel=0.04)

    def test_a_slow_bias_is_as_large_between_its_knots_as_on_them(self) -> None:
        found = [
            errors_rad(
                AngularError(SimulatedGazeSettings(bias_share=1, bias_frames=10, seed=seed), 2), range(5, 4000, 10)
            )
            for seed in range(12)
        ]
        assert np.degrees(np.mean(found)) == pytest.approx(11.1, rel=0.05)

    def test_the_bias_is_slow_and_the_noise_is_not(self) -> None:
        def step_deg(bias_share: float) -> float:
            error = AngularError(SimulatedGazeSettings(bias_share=bias_share, bias_frames=25), 2)
            directions = np.stack([error.apply(GAZES[1], 1, frame) for frame in range(1000)])
            return float(np.degrees(angle_between(directions[1:], directions[:-1]).mean()))

        assert step_deg(1) < 2
        assert step_deg(0) > 10
        assert step_deg(1) < step_deg(0.5) < step_deg(0)

    @pytest.mark.parametrize("numbers", [range(1, 401), range(0, 4000, 10), range(10**18, 10**18 + 400 * 10**6, 10**6)])
    def test_the_bias_is_as_slow_in_a_clip_whose_numbers_have_steps(self, numbers: range) -> None:
        """Such as stamps in ns, or every tenth frame: ``bias_frames`` are frames of the clip."""
        clip = FakeClip(*[whole_truth()] * len(numbers))
        clip.frames = numbers
        clip.truth = lambda number: whole_truth()  # type: ignore[method-assign]
        stage = SimulatedGaze(SimulatedGazeSettings(bias_share=1, bias_frames=25), clip)
        gazes = [stage.estimate(clip.frame(number), HEAD_1, None) for number in numbers]
        directions = np.stack([gaze.direction for gaze in gazes if gaze is not None])
        steps_deg = np.degrees(angle_between(directions[1:], directions[:-1]))
        assert 0 < steps_deg.mean() < 2
        assert np.degrees(angle_between(directions[25:], directions[:-25])).mean() > 10

    def test_a_long_mean_removes_the_noise_but_not_the_bias(self) -> None:
        def left_deg(bias_share: float) -> float:
            left = []
            for seed in range(40):
                error = AngularError(SimulatedGazeSettings(bias_share=bias_share, bias_frames=100, seed=seed), 2)
                mean = np.mean([error.apply(GAZES[1], 1, frame) for frame in range(20)], axis=0)
                left.append(angle_between(mean, GAZES[1]))
            return float(np.degrees(np.mean(left)))

        assert left_deg(0) < 11.1 / 3
        assert left_deg(1) > 11.1 * 0.75

    @few
    @given(st.permutations(range(-3, 5)), st.integers(0, 2**32))
    def test_the_order_of_frames_does_not_matter(self, order: list[int], seed: int) -> None:
        one, other = (AngularError(SimulatedGazeSettings(seed=seed), 2) for _ in range(2))
        straight = {frame: one.apply(GAZES[1], 1, frame) for frame in range(-3, 5)}
        for frame in order:
            assert np.array_equal(other.apply(GAZES[1], 1, frame), straight[frame])
        assert len({tuple(each) for each in straight.values()}) == len(straight)

    def test_seeds_clips_people_and_models_have_errors_of_their_own(self) -> None:
        def first(seed: int, draw: str, stream: int, person_id: int) -> tuple[float, ...]:
            settings = SimulatedGazeSettings(seed=seed, draw=draw)
            return tuple(AngularError(settings, stream).apply(GAZES[1], person_id, 1))

        keys = [(1, "a", 1, 1), (2, "a", 1, 1), (1, "b", 1, 1), (1, "a", 2, 1), (1, "a", 1, 2)]
        assert len({first(*key) for key in keys}) == len(keys)

    def test_every_clip_of_a_run_has_errors_of_its_own_unless_they_share_a_draw(self) -> None:
        def chosen(table: dict[str, Any], clip: str) -> str:
            choice = STAGES["gaze"].parse({"model": "simulated", **table}, "x")
            assert choice is not None
            return choice.for_clip(clip).key

        assert chosen({}, "one") == chosen({}, "one") != chosen({}, "two")
        assert chosen({"draw": "same"}, "one") == chosen({"draw": "same"}, "two")

    def test_without_error_it_is_the_truth(self) -> None:
        clip = FakeClip()
        frame = clip.frame(1)
        gaze = SimulatedGaze(SimulatedGazeSettings(error_deg=0), clip).estimate(frame, HEAD_2, None)
        pose = SimulatedHeadPose(SimulatedHeadPoseSettings(error_deg=0), clip).estimate(frame, HEAD_2)
        assert gaze is not None
        assert pose is not None
        assert np.allclose(gaze.direction, GAZES[2])
        assert np.allclose(pose.direction, HEADS[2])

    def test_the_sigma_it_claims_is_the_error_it_makes(self) -> None:
        """Sigma is the standard deviation in each of two directions: the mean of squared angles is 2 sigma^2."""
        clip = FakeClip()
        stage = SimulatedGaze(SimulatedGazeSettings(bias_share=0), clip)
        gazes = [stage.estimate(clip.frame(number), HEAD_1, None) for number in range(1, 3000)]
        squares = [angle_between(gaze.direction, GAZES[1]) ** 2 for gaze in gazes if gaze is not None]
        assert gazes[0] is not None
        assert np.mean(squares) == pytest.approx(2 * (gazes[0].sigma_rad or 0) ** 2, rel=0.06)

    def test_a_bias_has_no_leaps(self) -> None:
        """From one frame to the next it turns by a hundredth of a quarter turn, also from knot to knot."""
        error = AngularError(SimulatedGazeSettings(bias_share=1, bias_frames=100), 2)
        directions = np.stack([error.apply(GAZES[1], 1, frame) for frame in range(-400, 800)])
        steps_deg = np.degrees(angle_between(directions[1:], directions[:-1]))
        # a pair of normal numbers is hardly ever longer than 5
        assert 0 < steps_deg.max() < np.degrees(error.sigma_rad) * np.pi / 2 / 100 * 5 * np.sqrt(2)

    def test_every_frame_person_and_model_errs_for_itself(self) -> None:
        settings = SimulatedGazeSettings(bias_share=0)
        found = [
            tuple(AngularError(settings, stream).apply(GAZES[1], number, frame))
            for stream in (1, 2)
            for number in (1, 2)
            for frame in range(-6, 7)
        ]
        assert len(set(found)) == 2 * 2 * 13

    def test_gaze_and_head_of_one_seed_err_apart(self) -> None:
        alike = person(1, gaze_direction=GAZES[1], head_direction=GAZES[1])
        clip = FakeClip(Truth(people=(alike,)))
        gaze = SimulatedGaze(SimulatedGazeSettings(error_deg=9), clip).estimate(clip.frame(1), HEAD_1, None)
        head = SimulatedHeadPose(SimulatedHeadPoseSettings(error_deg=9), clip).estimate(clip.frame(1), HEAD_1)
        assert gaze is not None
        assert head is not None
        assert gaze.sigma_rad == head.sigma_rad
        assert angle_between(gaze.direction, head.direction) > 0.01

    @pytest.mark.parametrize(
        "wrong", [{"error_deg": -1}, {"error_deg": 61}, {"bias_share": -0.1}, {"bias_share": 1.1}, {"bias_frames": 0}]
    )
    def test_a_setting_outside_of_its_range_is_refused(self, wrong: dict[str, float]) -> None:
        with pytest.raises(ValidationError, match=next(iter(wrong))):
            SimulatedGazeSettings(**wrong)


def test_a_gain_turns_nobody_towards_a_camera_at_their_eyes() -> None:
    stage = SimulatedGaze(SimulatedGazeSettings(error_deg=0, gain=0.5), FakeClip())
    assert stage.of_person(1, person(1, eye_origin_left=np.zeros(3))).direction == pytest.approx(GAZES[1])
    turned = stage.of_person(1, person(1, eye_origin_left=np.array([0.0, 0, 2])))
    assert angle_between(turned.direction, (0, 0, -1)) == pytest.approx(angle_between(GAZES[1], (0, 0, -1)) / 2)
