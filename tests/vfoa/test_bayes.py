"""Posterior attention against scenes whose probabilities are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.scenes import make_box, make_subject, make_target, random_room, with_points
from vfoa.bayes import BayesSettings, Posterior, Sights, smooth
from vfoa.geometry import sigma_rad
from vfoa.instance_tracking import PATIENCE
from vfoa.pipeline import Attending, AttendSettings
from vfoa.posterior.cues import ELSEWHERE_DEG
from vfoa.posterior.filter import COUNTED_S, smoothed
from vfoa.posterior.kalman import TAILS
from vfoa.posterior.looks import P_NOWHERE
from vfoa.tracking import Tracked
from vfoa.types import Attention, FrameResult, NoAttention, Scene, Target
from vfoa.visible import FACE_RADIUS_M

BAYES = BayesSettings(method="bayes", error="told", smoothing="off", gaze_error_deg=10.0)
"""Told the error, every frame by itself: the posterior is one of a few densities of Student."""
SMOOTHED = BAYES.model_copy(update={"smoothing": "forward", "gaze_error_deg": 11.1})
AHEAD = (0, 0, 1)
LEFT, RIGHT = make_target(1, make_box((-0.3, 0, 2))), make_target(2, make_box((0.3, 0, 2)))


def attend(subjects, targets, states=None, settings=BAYES, time_ns=0):
    """The answers in a frame, and the states after it; frames of one time are 0.04 s apart."""
    scene = Scene(index=0, time_ns=time_ns, targets=tuple(targets), people=tuple(each.person for each in subjects))
    return Posterior(settings).attend(tuple(subjects), scene, states or (None,) * len(subjects))


def infer(subject, targets, settings=BAYES):
    (attention,), _ = attend([subject], targets, settings=settings)
    return attention


def density(variance, square=0.0):
    """Student's density in two dimensions, but for a factor, where the squared angle is ``square``."""
    return (1 + square / variance / TAILS) ** (-TAILS / 2 - 1) / variance


def totals(attention):
    return {value.instance_id: value.total for value in attention.values}


def test_two_equal_targets_beside_the_gaze_are_equally_likely():
    targets = (make_target(1, make_box((-0.4, 0, 2))), make_target(2, make_box((0.4, 0, 2))))
    found = totals(infer(make_subject(gaze=AHEAD, head=AHEAD), targets))
    assert found[1] == pytest.approx(found[2], rel=0.02)


def test_a_small_target_on_the_axis_has_the_posterior_of_the_two_densities():
    """Densities about the same direction are as the inverses of their variances."""
    error, look = 10.0**2, ELSEWHERE_DEG**2
    target, nowhere = (1 - P_NOWHERE) / error, P_NOWHERE / (error + look)
    attention = infer(make_subject(gaze=AHEAD), (make_target(1, make_box((0, 0, 3), 0.001)),))
    assert totals(attention)[1] == pytest.approx(target / (target + nowhere), rel=1e-4)
    assert attention.focus == 1


def test_two_small_targets_and_nowhere_between_them_have_the_posterior_of_three_densities():
    """Each is weighed by the density of its angle to the gaze; nowhere lies in the middle, along the gaze."""
    settings = BAYES.model_copy(update={"gaze_error_deg": 20.0})
    targets = tuple(make_target(number, make_box((x, 0, 3), 0.001)) for number, x in ((1, -3), (2, 3)))
    error, look = sigma_rad(20.0) ** 2, sigma_rad(ELSEWHERE_DEG) ** 2
    beside, nowhere = (1 - P_NOWHERE) / 2 * density(error, (np.pi / 4) ** 2), P_NOWHERE * density(error + look)
    found = totals(infer(make_subject(gaze=AHEAD), targets, settings))
    assert found == pytest.approx(dict.fromkeys((1, 2), beside / (2 * beside + nowhere)), rel=1e-4)


def test_people_are_looked_at_in_the_face_where_their_eyes_are_known():
    low = make_box((0, 1.5, 2), 0.1)
    looker, seen, hidden = (
        make_subject(gaze=AHEAD),
        make_subject(gaze=AHEAD, eyes=(0, 0, 2), instance_id=7),
        make_subject(gaze=AHEAD, eyes=None, instance_id=7),
    )
    (face, *_), _ = attend([looker, seen], [make_target(7, low)])
    error, look = sigma_rad(10.0) ** 2, sigma_rad(ELSEWHERE_DEG) ** 2
    target, nowhere = (1 - P_NOWHERE) * density(error + (FACE_RADIUS_M / 2) ** 2), P_NOWHERE * density(error + look)
    assert totals(face)[7] == pytest.approx(target / (target + nowhere))
    (body, *_), _ = attend([looker, hidden], [make_target(7, low)])
    assert totals(body) == totals(infer(looker, (make_target(7, low),)))


@pytest.mark.parametrize(
    ("gaze", "head", "parts"), [(True, True, (0.7009, 0.2991)), (True, False, (1, None)), (False, True, (None, 1))]
)
def test_the_cues_divide_the_total_by_what_each_tells_of_the_target(gaze, head, parts):
    """Squares of degrees: the gaze's error 100; the head's 25 and 25 aside and 49 of its rest, over 0.65 squared."""
    subject = make_subject(gaze=AHEAD if gaze else None, head=AHEAD if head else None)
    (value,) = infer(subject, (make_target(1, make_box((0, 0, 2))),)).values
    for found, part in zip((value.gaze, value.head), parts, strict=True):
        assert found == pytest.approx(np.nan if part is None else part * value.total, rel=1e-3, nan_ok=True)


def test_without_smoothing_every_frame_stands_by_itself():
    targets = (make_target(1, make_box((-0.3, 0, 2))), make_target(2, make_box((0.3, 0, 2))))
    subject = make_subject(gaze=(-0.15, 0, 1))
    _, states = attend([subject], targets)
    assert states == (None,)


def test_a_frame_without_a_direction_leaves_the_belief_as_it_was():
    targets = (make_target(1, make_box((-0.3, 0, 2))),)
    _, before = attend([make_subject(gaze=AHEAD)], targets, settings=SMOOTHED)
    _, after = attend([make_subject()], targets, before, SMOOTHED)
    assert after == before != (None,)


def test_a_bigger_target_is_not_favoured():
    """Same nearest direction, one twice as large: the mean density of the small one is the greater."""
    targets = (make_target(1, make_box((-0.5, 0, 2), 0.1)), make_target(2, make_box((0.7, 0, 2), 0.3)))
    found = totals(infer(make_subject(gaze=AHEAD), targets))
    assert found[1] > found[2]


@given(st.integers(0, 10_000))
def test_probabilities_are_shared_out_among_targets_and_nowhere(seed):
    subject, targets = random_room(seed)
    values = infer(subject, targets).values
    assert all(0 <= value.total <= 1 for value in values)
    assert sum(value.total for value in values) <= 1 + 1e-9
    assert [value.gaze + value.head for value in values] == pytest.approx([value.total for value in values])


def test_a_look_away_from_everything_is_nowhere():
    assert infer(make_subject(gaze=(0, 0, -1)), (make_target(1, make_box((0, 0, 2))),)).focus is None
    assert infer(make_subject(gaze=AHEAD), ()).focus is None


def test_between_two_opposite_targets_the_one_that_is_looked_at_is_likelier():
    """They have no middle for nowhere to lie about."""
    targets = tuple(with_points(make_target(n, make_box((x, 0, 0))), [(x, 0, 0)]) for n, x in ((1, 1.0), (2, -1.0)))
    found = infer(make_subject(gaze=(1, 0, 0)), targets)
    assert found.focus == 1
    assert 0 < totals(found)[2] < totals(found)[1] < 1


def test_nobody_looks_at_their_own_body():
    subject = make_subject(gaze=AHEAD, instance_id=1)
    assert infer(subject, (make_target(1, make_box((0, 0, 2))),)).values == ()


def test_a_target_that_turns_out_to_be_their_own_body_is_forgotten() -> None:
    scene = Scene(index=0, time_ns=0, targets=(LEFT, RIGHT), people=())
    unknown = Sights().then(make_subject(), scene, {1: np.ones(3), 3: np.ones(3)})
    assert (*unknown.missed,) == (1, 2)
    assert {*unknown.eyes} == {1}
    known = unknown.then(make_subject(instance_id=1), replace(scene, time_ns=40_000_000), {})
    assert [target.instance.id for target in known.targets] == [*known.missed] == [2]
    assert known.eyes == {}


def test_a_target_without_a_cloud_has_no_probability_beside_one_that_has_a_cloud() -> None:
    found = totals(infer(make_subject(gaze=(0.3, 0, 2)), (with_points(LEFT, [(-0.3, 0, 2)]), RIGHT)))
    assert found[2] == 0 < found[1]


def test_what_is_missing_is_said():
    assert infer(make_subject(eyes=None, gaze=AHEAD), ()).missing is NoAttention.NO_EYES_3D
    assert infer(make_subject(), ()).missing is NoAttention.NO_DIRECTION


def test_a_frame_that_disagrees_is_outvoted_by_the_frames_before_it():
    targets = (make_target(1, make_box((-0.3, 0, 2))), make_target(2, make_box((0.3, 0, 2))))
    left, right = (make_subject(gaze=(x, 0, 1)) for x in (-0.15, 0.1))
    states = (None,)
    for subject in (left, left, left, right):
        (attention,), states = attend([subject], targets, states, SMOOTHED)
    assert attention.focus == 1
    assert infer(right, targets).focus == 2


def test_a_gaze_that_moves_on_is_believed_in_the_end():
    targets = (make_target(1, make_box((-0.6, 0, 2))), make_target(2, make_box((0.6, 0, 2))))
    states = (None,)
    for x in [-0.3] * 10 + [0.3] * 10:
        (attention,), states = attend([make_subject(gaze=(x, 0, 1))], targets, states, SMOOTHED)
    assert attention.focus == 2


def test_targets_that_come_and_go_are_known_by_their_ids():
    one, other = make_target(1, make_box((-0.3, 0, 2))), make_target(2, make_box((0.3, 0, 2)))
    subject = make_subject(gaze=(0.15, 0, 1))
    states = (None,)
    for targets in ((other,), (other, one), (other,), (one, other)):
        (attention,), states = attend([subject], targets, states, SMOOTHED)
    assert attention.focus == 2


def looked_at_left(misses: Sequence[Sequence[Target]], settings: BayesSettings = SMOOTHED) -> list[Attention]:
    """The answers in the last frames, which see these targets, while the gaze stays a little beside the left one."""
    subject, states, found = make_subject(gaze=(-0.1, 0, 1)), (None,), []
    for targets in [(LEFT, RIGHT)] * 10 + [*misses]:
        (attention,), states = attend([subject], targets, states, settings)
        found.append(attention)
    return found[10:]


@pytest.mark.parametrize("gap", [1, 3, PATIENCE])
@pytest.mark.parametrize("found", [[RIGHT], [replace(LEFT, box=None), RIGHT]])
def test_a_look_at_a_target_that_some_frames_miss_goes_on(gap: int, found: list[Target]) -> None:
    """They do not find it, or find no box of it."""
    *missed, back = looked_at_left([found] * gap + [[RIGHT, LEFT]])
    seen = looked_at_left([[LEFT, RIGHT]] * (gap + 1))[-1]
    assert totals(back) == pytest.approx(totals(seen), abs=1e-9)
    for attention in missed:
        assert attention.focus is None  # the target is not among those found, and no other one is looked at
        assert totals(attention)[2] < 0.05


def test_a_target_that_was_missed_for_longer_is_forgotten() -> None:
    *_, last = looked_at_left([[RIGHT]] * (PATIENCE + 1))
    assert last.belief.keys == (2, None)


@pytest.mark.parametrize(("rate_hz", "patience"), [(10, PATIENCE), (25, PATIENCE), (100, 4 * PATIENCE)])
def test_a_fast_camera_does_not_forget_a_target_sooner(rate_hz: int, patience: int) -> None:
    subject, states = make_subject(gaze=(-0.1, 0, 1)), (None,)
    for number, targets in enumerate([(LEFT, RIGHT), *[(RIGHT,)] * (patience + 1)]):
        time_ns = number * 1_000_000_000 // rate_hz
        (attention,), states = attend([subject], targets, states, SMOOTHED, time_ns)
        assert (1 in attention.belief.keys) == (number <= patience)


def test_later_frames_count_beyond_a_frame_that_misses_the_target() -> None:
    def smoothed(second: Sequence[Target]) -> list[Attention]:
        subject, states, window = make_subject(gaze=(-0.1, 0, 1)), (None,), []
        for number, seen in enumerate([(LEFT, RIGHT), tuple(second), (RIGHT, LEFT), (LEFT, RIGHT)]):
            attentions, states = attend([subject], seen, states, SMOOTHED)
            scene = Scene(index=number, time_ns=number, targets=seen, people=(subject.person,))
            window.append(FrameResult(scene=scene, attentions=attentions))
        return [frame.attentions[0] for frame in smooth(window, len(window), SMOOTHED)]

    complete, missing = smoothed([LEFT, RIGHT]), smoothed([RIGHT])
    for number, (expected, found) in enumerate(zip(complete, missing, strict=True)):
        seen = {2} if number == 1 else {1, 2}
        assert totals(found) == pytest.approx({key: totals(expected)[key] for key in seen})
    assert missing[1].focus is None


def test_a_face_stays_where_it_was_while_its_head_is_missed() -> None:
    looker, face = make_subject(gaze=(0, 0, 1)), (0.0, 0.0, 2.0)
    other = make_subject(eyes=face, instance_id=7)
    body = make_target(7, make_box((0, 0.7, 2), (0.2, 0.8, 0.2)))
    found = []
    for subjects in ((looker, other), (looker,)):
        states = (None,) * len(subjects)
        (_, *_), states = attend([looker, other], [body], settings=SMOOTHED)
        (attention, *_), _ = attend(subjects, [body], states[: len(subjects)], SMOOTHED)
        found.append(totals(attention)[7])
    assert found[0] == pytest.approx(found[1])


def test_a_face_whose_head_is_missed_for_longer_is_forgotten() -> None:
    body, sights = make_target(7, make_box((0, 0.7, 2))), Sights()
    for number in range(PATIENCE + 2):
        scene = Scene(index=number, time_ns=number * 40_000_000, targets=(body,), people=())
        sights = sights.then(make_subject(), scene, {} if number else {7: np.ones(3)})
        assert (7 in sights.eyes) == (number <= PATIENCE)
        assert (*sights.missed,) == (7,)


COUNTED_NS = round(1e9 * COUNTED_S)
LEARNING = BayesSettings(method="bayes")
"""The error unknown: what is learned of it depends most on how many frames count."""


def noisy_look(number: int) -> tuple[float, float, float]:
    """A gaze at the left target, and from frame 40 on at the right one, with an error of 11 degrees."""
    error = np.random.default_rng(number).normal(0, sigma_rad(11.1), 2)
    return ((-0.15 if number < 40 else 0.15) + error[0], error[1], 1.0)


def looks_at(times_ns: Sequence[int], numbers: Sequence[int]) -> list[Attention]:
    """The answers in frames at these times, each with the noisy look of its number."""
    found, states = [], (None,)
    for time_ns, number in zip(times_ns, numbers, strict=True):
        subject = make_subject(gaze=noisy_look(number), head=noisy_look(1000 + number))
        (attention,), states = attend([subject], (LEFT, RIGHT), states, LEARNING, time_ns)
        found.append(attention)
    return found


def chances(attentions: Sequence[Attention]) -> np.ndarray:
    return np.array([[value.total for value in attention.values] for attention in attentions])


@pytest.mark.parametrize(
    "gaps_s",
    [
        [COUNTED_S],
        [1 / 15],
        [0.5],
        [0.03, 0.05],  # a camera whose frames come too early and too late
        [0.1, 3.0, 0.011, 0.1],  # a pause, and a frame soon after it
        [1 / 25, 2 / 25, 1 / 25],  # a frame is missing now and then
    ],
)
def test_each_frame_counts_at_25_frames_a_second_or_less(gaps_s, monkeypatch) -> None:
    times_ns = np.cumsum(np.round(1e9 * np.resize(gaps_s, 80))).astype(int).tolist()
    found = looks_at(times_ns, range(80))
    assert all(attention.belief.counts for attention in found)
    monkeypatch.setattr("vfoa.posterior.filter.COUNTED_S", 0.0)
    assert (chances(found) == chances(looks_at(times_ns, range(80)))).all()


def test_each_frame_counts_where_times_do_not_increase() -> None:
    for times_ns in ([7] * 30, range(30, 0, -1)):
        assert all(attention.belief.counts for attention in looks_at(times_ns, range(30)))


@pytest.mark.parametrize("rate_hz", [30, 50, 60, 90, 120, 1000])
def test_25_frames_a_second_count_at_any_greater_rate(rate_hz: int) -> None:
    times_ns = [round(1e9 * number / rate_hz) for number in range(2 * rate_hz)]
    counted = sum(attention.belief.counts for attention in looks_at(times_ns, [0] * len(times_ns)))
    assert counted == pytest.approx(2 / COUNTED_S, abs=2)


@pytest.mark.parametrize("rate_hz", [30, 50, 60, 100, 120, 240])
def test_a_jitter_of_a_tenth_of_a_millisecond_does_not_change_which_frames_count(rate_hz: int) -> None:
    """Some frames come exactly when one may count."""
    times_ns = [round(1e9 * number / rate_hz) for number in range(3 * rate_hz)]
    jitter_ns = np.random.default_rng(rate_hz).integers(-100_000, 100_000, len(times_ns))
    exact, jittered = (
        [attention.belief.counts for attention in looks_at(times, [0] * len(times_ns))]
        for times in (times_ns, (times_ns + jitter_ns).tolist())
    )
    assert exact == jittered


@pytest.mark.parametrize("every", [2, 4, 8])
def test_repeated_frames_change_the_answers_little(every: int) -> None:
    """A camera that gives each frame several times says no more about the look and the error than the frame itself."""
    times_ns = [number * COUNTED_NS for number in range(80)]
    repeated_ns = [time_ns + part * COUNTED_NS // every for time_ns in times_ns for part in range(every)]
    alone = chances(looks_at(times_ns, range(80)))
    repeated = chances(looks_at(repeated_ns, np.repeat(np.arange(80), every).tolist()))[every - 1 :: every]
    assert np.abs(repeated - alone).mean() < 0.1


def test_later_frames_tell_a_frame_that_counts_the_same_without_those_that_do_not() -> None:
    beliefs = [attention.belief for attention in looks_at([n * COUNTED_NS // 4 for n in range(161)], range(161))]
    last = max(place for place, belief in enumerate(beliefs) if belief.counts)
    beliefs = beliefs[: last + 1]
    counts = [belief.counts for belief in beliefs]
    found = np.array(smoothed(beliefs))
    assert found.sum(axis=1) == pytest.approx(1)
    assert found[counts] == pytest.approx(np.array(smoothed([belief for belief in beliefs if belief.counts])))
    assert 35 < sum(counts) < 45


def test_the_first_gaze_counts_at_once() -> None:
    states, found = (None,), []
    for number, gaze in enumerate([None, None, None, AHEAD, AHEAD]):
        subject = make_subject(gaze=gaze, head=AHEAD)
        (attention,), states = attend([subject], (LEFT, RIGHT), states, LEARNING, number * 1_000_000)
        found.append(attention.belief.counts)
    assert found == [True, True, False, True, False]  # the second one has the time that the first one left


def test_the_pipeline_carries_beliefs_from_frame_to_frame():
    subject = make_subject(gaze=(-0.15, 0, 0.989))
    targets = (make_target(1, make_box((-0.3, 0, 2))), make_target(2, make_box((0.3, 0, 2))))
    scene = Scene(index=1, time_ns=0, targets=targets, people=(subject.person,))
    attending = Attending(AttendSettings(attention=SMOOTHED))
    tracked = Tracked(ids=(1,), open=frozenset({1}))
    (first,), (second,) = attending.step(scene, tracked), attending.step(replace(scene, index=2), tracked)
    assert totals(second.attentions[0])[1] > totals(first.attentions[0])[1]


def test_settings_of_cones_are_refused():
    with pytest.raises(ValidationError, match="n_rays"):
        BayesSettings.model_validate({"method": "bayes", "n_rays": 4})
