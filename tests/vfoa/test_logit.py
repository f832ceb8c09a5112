"""The conditional logit: its probabilities, its running means, and weights recovered from looks drawn from them."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import approx_fprime
from scipy.special import logsumexp
from scipy.stats import norm

from tests.scenes import entry_distance
from vfoa.bayes import BayesSettings, HeldBelief, Posterior
from vfoa.errors import VfoaError
from vfoa.geometry import lowered, perturb
from vfoa.instance_tracking import PATIENCE
from vfoa.logit import (
    Cases,
    Logit,
    LogitSettings,
    LogitWeights,
    Remembered,
    Weights,
    default_weights,
    probabilities,
    target_probabilities,
    weigh_again,
)
from vfoa.logit_cues import (
    LOGIT_CUES,
    ROWS,
    Case,
    FrameFeatures,
    Means,
    PosteriorAnswer,
    features,
    later_means,
    observe,
)
from vfoa.logit_fit import Design, LabelledSequence, fit, maximised
from vfoa.types import (
    Box3D,
    Cues,
    DirectionFit,
    Float,
    FrameResult,
    Gaze,
    HeadPose,
    Instance,
    NoAttention,
    Person,
    Scene,
    Subject,
    Target,
)
from vfoa.visible import FACE_RADIUS_M

EYES = np.array([0.0, 0.0, 0.0])
LEFT, RIGHT = np.array([-1.0, 0.2, 2.0]), np.array([1.0, 0.2, 2.0])


def a_target(number: int, center_m: Float, half_m: tuple[float, float, float] = (0.1, 0.1, 0.1)) -> Target:
    box = Box3D(center_m=center_m, half_size_m=np.array(half_m), left_from_box=np.eye(3))
    instance = Instance(id=number, label="cup", category_id=0, is_thing=True, score=1.0)
    return Target(instance=instance, box_px=None, points_left=np.zeros((0, 3), np.float32), box=box)


TARGETS = (a_target(2, LEFT), a_target(3, RIGHT))


def looking(gaze: Float | None, head: Float | None) -> Subject:
    given_gaze = None if gaze is None else Gaze(direction=gaze)
    given_head = None if head is None else HeadPose(direction=head)
    person = Person(view=Cues(head_pose=given_head, gaze=given_gaze), instance_id=1, eye_origin_left=EYES)
    return Subject(track_id=1, person=person, gaze=given_gaze, head_pose=given_head)


def by_posterior(targets: tuple[Target, ...] = TARGETS, chance: float = 0.3) -> PosteriorAnswer:
    """The same probability of each target, half of it by the gaze."""
    chances = {None: 1 - chance * len(targets), **{each.instance.id: chance for each in targets}}
    return PosteriorAnswer(chances, (0.5, 0.5), DirectionFit(tail=0.5))


def results(subjects: list[Subject], settings: LogitSettings) -> list[FrameResult]:
    states, found = (Remembered(),), []
    for number, subject in enumerate(subjects):
        scene = Scene(index=number, time_ns=number * 100_000_000, targets=TARGETS, people=(subject.person,))
        attentions, states = Logit(settings).attend((subject,), scene, states)
        found.append(FrameResult(scene=scene, attentions=attentions))
    return found


@pytest.mark.parametrize(("gaze", "head"), [(LEFT, LEFT), (LEFT, None), (None, LEFT)])
def test_the_target_that_all_directions_point_at_is_the_likeliest(gaze: Float | None, head: Float | None) -> None:
    for smoothing in ("forward", "both"):
        settings = LogitSettings(method="logit", smoothing=smoothing)
        window = results([looking(gaze, head)] * 5, settings)
        for frame in weigh_again(window, len(window), settings) if smoothing == "both" else window:
            (found,) = frame.attentions
            totals = {each.instance_id: each.total for each in found.values}
            assert totals[2] > totals[3]
            assert 0 < sum(totals.values()) < 1
            for value in found.values:
                assert np.nansum([value.gaze, value.head]) == pytest.approx(value.total)


@pytest.mark.parametrize(
    ("sums", "shares"),
    [
        ({"gaze": 2.5, "middle": 1, "head": 0.25, "head_swing": 0.5, "head_overlap": 0.25}, (2 / 3, 1 / 3)),
        ({"gaze": 1, "head": -2}, (1, 0)),
        ({"gaze": -2, "head": 1}, (0, 1)),
        ({"gaze": -1, "head": -1, "posterior": 1}, None),
    ],
)
def test_a_total_is_divided_by_the_sums_of_the_weights_of_gaze_and_head(
    sums: dict[str, float], shares: tuple[float, float] | None
) -> None:
    """As the posterior divides it, where neither has any; half of the weight of the middle belongs to each."""

    def divided(head: Float | None, weights: LogitWeights) -> tuple[float, float]:
        settings = LogitSettings(method="logit", weights=weights)
        (found,) = results([looking(LEFT, head)], settings)[0].attentions
        (value, _) = found.values
        return value.gaze / value.total, value.head / value.total

    default = default_weights()
    both = {name: (0.25 * sums.get(name, 0), 0.75 * sums.get(name, 0)) for name in LOGIT_CUES}
    weights = Weights(constant=0, size=0, **both)
    alone = Weights(constant=0, size=0, gaze=(1, 1), posterior=(1, 1))
    given = LogitWeights(forward=Cases(both=weights, gaze=alone, head=default.forward.head), both=default.both)
    assert divided(LEFT, given) == pytest.approx(divided(LEFT, default) if shares is None else shares)
    assert divided(None, given) == pytest.approx((1, np.nan), nan_ok=True)


def test_weights_that_are_not_filled_in_are_refused() -> None:
    with pytest.raises(VfoaError, match="left-out"):
        results([looking(LEFT, LEFT)], LogitSettings(method="logit", weights="left-out"))


def test_nowhere_is_the_focus_far_from_all_targets() -> None:
    away = np.array([0.0, -1.0, 0.2])
    (found,) = results([looking(away, away)], LogitSettings(method="logit"))[0].attentions
    assert found.focus is None
    assert sum(value.total for value in found.values) < 0.5
    (found,) = results([looking(LEFT, LEFT)], LogitSettings(method="logit"))[0].attentions
    assert found.focus == max(found.values, key=lambda value: value.total).instance_id


def test_a_subject_without_eyes_or_directions_has_a_reason() -> None:
    (found,) = results([looking(None, None)], LogitSettings(method="logit"))[0].attentions
    assert found.missing is NoAttention.NO_DIRECTION


def test_an_earlier_look_counts_less_the_longer_ago_it_is() -> None:
    def before_after(gap_s: float) -> float:
        left, right = looking(LEFT, LEFT), looking(RIGHT, RIGHT)
        _, means = observe(left, TARGETS, {}, Means(), 0.1, by_posterior())
        seen, _ = observe(right, TARGETS, {}, means, gap_s, by_posterior())
        return float(seen.before[0, 0] / seen.now[0, 0])

    assert before_after(0.1) < before_after(1.0) < before_after(30.0) == pytest.approx(1.0)


def test_means_of_a_target_go_on_beyond_frames_that_miss_it() -> None:
    def frames(gap: int) -> list[FrameFeatures]:
        """A look to the left, a frame that misses this target ``gap`` times, and a look to the right."""
        rows = [(LEFT, TARGETS), *[(RIGHT, TARGETS[1:])] * gap, (RIGHT, TARGETS)]
        found, means = [], Means()
        for gaze, targets in rows:
            seen, means = observe(looking(gaze, gaze), targets, {}, means, 0.04, by_posterior(targets))
            found.append(seen)
        return found

    for gap in (1, PATIENCE):
        first, *_, last = seen = frames(gap)
        assert all(frame.before.shape == frame.now.shape == (len(LOGIT_CUES), len(frame.ids)) for frame in seen)
        for frame, other, mean in ((last, first, last.before), (first, last, later_means(seen, [0.04] * (gap + 1))[0])):
            weight = np.exp(-0.04 * (gap + 1) / 0.3)
            expected = (frame.now[0, 0] + weight * other.now[0, 0]) / (1 + weight)
            assert mean[0, 0] == pytest.approx(expected)
    assert frames(PATIENCE + 1)[-1].before[0, 0] == pytest.approx(frames(0)[-1].now[0, 0])


def test_a_frame_without_a_cue_neither_counts_for_its_mean_nor_ends_it() -> None:
    found, means = [], Means()
    for gaze, dt_s in ((LEFT, 0.0), (None, 0.1), (RIGHT, 0.05)):
        seen, means = observe(looking(gaze, LEFT), TARGETS, {}, means, dt_s, by_posterior())
        found.append(seen)
    first, without, last = found
    weights = np.exp(-np.array([0.15, 0.1, 0.05]) / 0.3)
    assert np.isnan(without.now[:2]).all()
    assert without.before[0] == pytest.approx(first.now[0])
    assert last.before[0] == pytest.approx((last.now[0] + weights[0] * first.now[0]) / (1 + weights[0]))
    later = later_means(found, [0.1, 0.05])
    assert later[1][0] == pytest.approx(last.now[0])
    assert later[0][0] == pytest.approx((first.now[0] + weights[0] * last.now[0]) / (1 + weights[0]))


def cues_of(head: Float, target: Target, eyes: dict[int, Float] | None = None) -> dict[str, float]:
    subject = looking(None, head)
    seen = observe(subject, (target,), eyes or {}, Means(), 0.1, by_posterior((target,)))[0]
    return dict(zip(LOGIT_CUES, seen.now[:, 0].tolist(), strict=True))


@pytest.mark.parametrize(("turn_deg", "swung_deg"), [(0, 0), (10, 18), (-30, -54), (90, 162), (120, 162), (-170, -162)])
def test_a_head_that_turned_from_the_body_is_turned_on_but_not_to_behind_it(turn_deg: float, swung_deg: float) -> None:
    """1.8 times as far, at most 0.9 of half a turn; a target where it then points, 9 degrees lower, is at no angle."""
    ahead = np.array([0.0, 0.0, 1.0])
    places = [perturb(ahead, np.radians(swung_deg + aside), 0.0) for aside in (0.0, 5.0, -5.0)]
    targets = tuple(a_target(n, 2 * lowered(at, np.radians(9.0)), (0.01,) * 3) for n, at in enumerate(places, start=2))
    subject = looking(None, perturb(ahead, np.radians(turn_deg), 0.0))
    seen, _ = observe(subject, targets, {}, Means(head=1e9 * ahead), 0.0, by_posterior(targets))
    at, *beside = seen.now[LOGIT_CUES.index("head_swing")]
    assert at == pytest.approx(0, abs=1e-9)
    assert beside == pytest.approx([beside[0]] * 2, rel=1e-3)
    assert beside[0] > 0.005


def test_the_body_faces_where_the_head_pointed_on_average_of_the_last_seconds() -> None:
    """A mean with a time constant of 4 s: from there, the head is turned on by 1.8 times its turn."""
    frames = [(0.0, 40.0), (0.3, 10.0), (5.0, -20.0), (0.04, 30.0), (1.5, 0.0)]  # seconds since the last, degrees
    ahead, means, body = np.array([0.0, 0.0, 1.0]), Means(), np.zeros(3)
    for dt_s, turn_deg in frames:
        head = perturb(ahead, np.radians(turn_deg), 0.0)
        body = np.exp(-dt_s / 4.0) * body + head
        body_deg = np.degrees(np.arctan2(body[0], body[2]))
        swung = perturb(ahead, np.radians(body_deg + 1.8 * (turn_deg - body_deg)), 0.0)
        target = a_target(2, 2 * lowered(swung, np.radians(9.0)), (1e-6,) * 3)
        seen, means = observe(looking(None, head), (target,), {}, means, dt_s, by_posterior((target,)))
        assert seen.now[LOGIT_CUES.index("head_swing"), 0] == pytest.approx(0, abs=1e-9)
        assert means.head == pytest.approx(body)


@pytest.mark.parametrize("sigma_deg", [None, 2.0, 20.0])
def test_angles_are_from_the_inner_half_of_a_target_in_units_of_the_gazes_error(sigma_deg: float | None) -> None:
    """By the formula at the head of the module; 9 degrees for a gaze that claims no error, 5 for where people look."""
    scale_deg = np.hypot(9.0 if sigma_deg is None else sigma_deg, 5.0)
    gaze, level = perturb(np.array([0.0, 0.0, 1.0]), np.radians(-30.0), 0.0), np.array([0.0, 0.0, 1.0])
    half_m = np.array([0.1, 0.2, 0.3])  # 0.2 on average
    subject = looking(gaze, perturb(level, 0.0, np.radians(-9.0)))  # lowered by 9 degrees: level
    measured = Gaze(direction=gaze, sigma_rad=None if sigma_deg is None else np.radians(sigma_deg))
    target = a_target(2, np.array([0.0, 0.0, 2.0]), tuple(half_m))
    seen, _ = observe(replace(subject, gaze=measured), (target,), {}, Means(), 0.1, by_posterior((target,)))
    inner_deg = np.degrees(np.arctan(half_m.mean() / 2 / 2))
    found = dict(zip(LOGIT_CUES, seen.now[:, 0].tolist(), strict=True))
    assert found["gaze"] == pytest.approx(np.log1p(((30 - inner_deg) / scale_deg) ** 2 / 4))
    assert found["middle"] == pytest.approx(np.log1p(((15 - inner_deg) / (0.8 * scale_deg)) ** 2 / 4))
    assert found["head"] == pytest.approx(0, abs=1e-9)
    assert seen.log_size[0] == pytest.approx(np.log(np.arctan(half_m.mean() / 2)))


def test_the_middle_of_a_gaze_and_a_head_that_cancel_is_the_gaze() -> None:
    head = perturb(np.array([0.0, 0.0, 1.0]), 0.3, 0.0)
    subject = looking(-lowered(head, np.radians(9.0)), head)
    seen, _ = observe(subject, TARGETS, {}, Means(), 0.1, by_posterior())
    gaze, middle = (np.sqrt(np.expm1(seen.now[LOGIT_CUES.index(cue)])) for cue in ("gaze", "middle"))
    assert middle == pytest.approx(gaze / 0.8)  # the same angles, by the smaller scale of the middle


@pytest.mark.parametrize("half_m", [(0.1, 0.1, 0.1), (0.6, 0.05, 0.1), (0.05, 0.4, 0.1)])
@pytest.mark.parametrize("aside_deg", [0.0, 12.0])
def test_the_overlap_is_the_share_of_directions_about_the_head_that_meet_the_box(
    half_m: tuple[float, float, float], aside_deg: float
) -> None:
    target = a_target(2, np.array([0.0, 0.0, 2.0]), half_m)
    head = perturb(np.array([0.0, 0.0, 1.0]), np.radians(aside_deg), np.radians(-9.0))  # lowered by 9 degrees: level
    lowered = perturb(head, 0.0, np.radians(9.0))
    errors = np.random.default_rng(1).normal(0, np.radians(7.0), (2, 100_000))
    share = np.isfinite(entry_distance(EYES, perturb(lowered, *errors), (target.box,))).mean()
    assert np.exp(-cues_of(head, target)["head_overlap"]) == pytest.approx(share + 1e-4, rel=0.1, abs=0.002)


def test_a_head_that_points_aside_overlaps_a_wide_thing_more_than_a_tall_one() -> None:
    head = perturb(np.array([0.0, 0.0, 1.0]), np.radians(15.0), np.radians(-9.0))
    wide, tall = (a_target(2, np.array([0.0, 0.0, 2.0]), half_m) for half_m in ((0.6, 0.1, 0.1), (0.1, 0.6, 0.1)))
    assert cues_of(head, wide)["head_overlap"] < cues_of(head, tall)["head_overlap"]


def test_an_extrapolated_head_counts_less_sideways_than_up_and_down() -> None:
    below = a_target(2, 2 * perturb(np.array([0.0, 0.0, 1.0]), 0.0, np.radians(20.0)))
    aside = a_target(2, 2 * perturb(np.array([0.0, 0.0, 1.0]), np.radians(20.0), 0.0))
    level = perturb(np.array([0.0, 0.0, 1.0]), 0.0, np.radians(-9.0))
    assert cues_of(level, aside)["head"] == pytest.approx(cues_of(level, below)["head"], rel=0.01)
    assert cues_of(level, aside)["head_swing"] < 0.5 * cues_of(level, below)["head_swing"]
    inner = np.arctan(0.1 / 2 / 2)
    for towards in (0.0, 0.5, 1.2, np.pi / 2):
        right, down = np.cos(towards), np.sin(towards)
        oblique = a_target(2, 2 * perturb(np.array([0.0, 0.0, 1.0]), right * np.radians(20.0), down * np.radians(20.0)))
        angle = (np.radians(20.0) - inner) * np.hypot(0.3 * right, down)
        assert cues_of(level, oblique)["head_swing"] == pytest.approx(np.log1p((angle / np.radians(6.0)) ** 2 / 4))


def test_a_face_has_its_own_size_whatever_the_box_of_its_body() -> None:
    face = {2: np.array([0.3, 0.0, 1.5])}
    slim, broad = (a_target(2, np.array([0.3, 0.5, 1.5]), half_m) for half_m in ((0.1, 0.6, 0.1), (0.5, 0.8, 0.3)))
    head = np.array([0.2, 0.0, 1.0])
    assert cues_of(head / np.linalg.norm(head), slim, face) == pytest.approx(
        cues_of(head / np.linalg.norm(head), broad, face), nan_ok=True
    )


def test_a_face_stays_where_it_was_while_its_head_is_missed() -> None:
    """As for the posterior, whose answer is a cue."""
    face, looker = np.array([0.0, 0.1, 2.0]), looking(LEFT, LEFT)
    other = replace(looker, track_id=2, person=replace(looker.person, instance_id=7, eye_origin_left=face))
    body = a_target(7, np.array([0.0, 0.8, 2.0]), (0.2, 0.8, 0.2))
    found = {}
    for is_missed in (False, True):
        states = (Remembered(), Remembered())
        for number, subjects in enumerate([(looker, other), (looker,) if is_missed else (looker, other)]):
            people = tuple(subject.person for subject in subjects)
            scene = Scene(index=number, time_ns=number * 100_000_000, targets=(body,), people=people)
            answers, states = Logit(LogitSettings(method="logit")).attend(subjects, scene, states[: len(subjects)])
        found[is_missed] = answers[0].belief.now
    np.testing.assert_array_equal(found[True], found[False])


def test_a_face_is_a_square_about_its_eyes_and_other_targets_are_as_without_it() -> None:
    """Seen from eyes that are not at the camera; a body without known eyes is its box, as a thing is."""
    origin, towards = np.array([0.4, -0.2, 0.5]), perturb(np.array([0.0, 0.0, 1.0]), 0.3, 0.0)
    bodies = tuple(a_target(n, np.array([x, 0.9, 2.4]), (0.2, 0.8, 0.2)) for n, x in ((2, -0.8), (3, 0.9), (4, 1.6)))
    eyes = {3: origin + 1.5 * towards, 1: origin, 7: np.zeros(3)}
    subject = looking(perturb(towards, np.radians(20.0), 0.0), lowered(towards, np.radians(-9.0)))
    subject = replace(subject, person=replace(subject.person, eye_origin_left=origin))

    def seen_with(eyes: dict[int, Float]) -> FrameFeatures:
        return observe(subject, bodies, eyes, Means(), 0.1, by_posterior(bodies))[0]

    before, seen, again = seen_with({}), seen_with(eyes), seen_with({})
    assert seen.ids == (2, 3, 4)
    np.testing.assert_array_equal(again.now, before.now)
    np.testing.assert_allclose(seen.now[:, [0, 2]], before.now[:, [0, 2]], rtol=1e-12)  # matrix products differ by ulps
    found = dict(zip(LOGIT_CUES, seen.now[:, 1].tolist(), strict=True))
    radius, inner = np.arctan(np.array([1.0, 0.5]) * FACE_RADIUS_M / 1.5)
    assert seen.log_size[1] == pytest.approx(np.log(radius))
    assert found["head"] == pytest.approx(0, abs=1e-9)
    scale = np.radians(np.hypot(9.0, 5.0))
    assert found["gaze"] == pytest.approx(np.log1p(((np.radians(20.0) - inner) / scale) ** 2 / 4))
    within = norm.cdf(radius / np.radians(7.0)) - norm.cdf(-radius / np.radians(7.0))
    assert np.exp(-found["head_overlap"]) == pytest.approx(within**2 + 1e-4)
    moved = np.array([1.0, -2.0, 3.0])
    there = tuple(
        replace(body, box=replace(body.box, center_m=body.box.center_m + moved)) for body in bodies if body.box
    )
    person = replace(subject.person, eye_origin_left=origin + moved)
    elsewhere = {number: place + moved for number, place in eyes.items()}
    same, _ = observe(replace(subject, person=person), there, elsewhere, Means(), 0.1, by_posterior(bodies))
    np.testing.assert_allclose(same.now, seen.now, atol=1e-9)


def test_later_means_mirror_the_earlier_ones() -> None:
    subjects = [looking(LEFT, LEFT), looking(RIGHT, RIGHT), looking(LEFT, RIGHT)]
    one_way = [each.attentions[0].belief for each in results(subjects, LogitSettings(method="logit"))]
    other_way = [each.attentions[0].belief for each in results(subjects[::-1], LogitSettings(method="logit"))]
    # the gaze alone: what the head extrapolates from depends on the order of time
    mirrored = later_means(other_way, [0.1, 0.1])[::-1]
    for forward, later in zip(one_way, mirrored, strict=True):
        assert forward.before[0] == pytest.approx(later[0])


@given(st.lists(st.lists(st.floats(-500, 500), min_size=3, max_size=3), min_size=1, max_size=4))
def test_probabilities_are_those_of_the_outside_option(utility: list[list[float]]) -> None:
    found = probabilities(np.array(utility))
    assert (found >= 0).all()
    assert (found.sum(axis=1) <= 1 + 1e-9).all()
    small = np.abs(np.array(utility)).max() < 30
    if small:
        odds = np.exp(np.array(utility))
        assert found == pytest.approx(odds / (1 + odds.sum(axis=1, keepdims=True)))


@given(st.floats(-8, 8), st.floats(0.1, 5))
def test_a_spread_of_the_constant_makes_probabilities_less_sure(utility: float, spread: float) -> None:
    drawn = utility + spread * np.random.default_rng(1).normal(size=200_000)
    (found,) = probabilities(np.array([utility]), spread)
    assert found == pytest.approx(np.mean(1 / (1 + np.exp(-drawn))), abs=0.01)
    (sure,) = probabilities(np.array([utility]))
    assert abs(found - 0.5) <= abs(sure - 0.5) + 1e-9


def test_the_posterior_is_a_cue_of_its_own() -> None:
    """A target that is likelier by the posterior alone gets a greater utility, in proportion to its weight."""
    subject = looking(None, LEFT)
    seen = {chance: observe(subject, TARGETS, {}, Means(), 0.1, by_posterior(chance=chance)) for chance in (0.1, 0.4)}
    now = {chance: found.now[LOGIT_CUES.index("posterior")] for chance, (found, _) in seen.items()}
    assert now[0.1] == pytest.approx(np.log(0.801 / 0.101))
    assert now[0.4] == pytest.approx(np.log(0.201 / 0.401))
    of_one, _ = observe(subject, TARGETS, {}, Means(), 0.1, by_posterior(TARGETS[:1], chance=0.4))
    assert of_one.now[LOGIT_CUES.index("posterior")] == pytest.approx(np.log([0.601 / 0.401, 0.601 / 0.001]))


@pytest.mark.parametrize("directions", [(LEFT, LEFT), (LEFT, None), (None, LEFT)])
@given(parts=st.lists(st.floats(0, 1), min_size=3, max_size=3).filter(lambda parts: sum(parts) > 0.1))
def test_without_labels_the_answer_is_the_posterior_and_less_sure(
    directions: tuple[Float | None, Float | None], parts: list[float]
) -> None:
    chance, added = np.array(parts) / sum(parts), 1e-3
    answer = by_posterior()._replace(chances=dict(zip((2, 3), chance.tolist(), strict=False)))
    seen, _ = observe(looking(*directions), TARGETS, {}, Means(), 0.1, answer)
    assert seen.ids == (2, 3)
    for cases, after in ((default_weights().forward, None), (default_weights().both, later_means([seen], [])[0])):
        weights = getattr(cases, seen.case)
        plain = target_probabilities(seen, weights.model_copy(update={"spread": 0.0}), after)
        assert plain == pytest.approx((chance[:2] + added) / (1 + 3 * added))
        found = target_probabilities(seen, weights, after)
        assert found[0] * plain[1] == pytest.approx(found[1] * plain[0])  # the share of nowhere alone is not known
        sure, less_sure = (abs(each.sum() - 0.5) for each in (plain, found))
        assert less_sure <= sure + 1e-12


@pytest.mark.parametrize("smoothing", ["forward", "both"])
def test_without_labels_directions_are_judged_as_by_the_posterior(smoothing: Literal["forward", "both"]) -> None:
    """How well they fit it, and how the total is divided between gaze and head."""
    subjects = [looking(LEFT, LEFT), looking(LEFT, RIGHT), looking(RIGHT, RIGHT)]
    frames = results(subjects, LogitSettings(method="logit", smoothing=smoothing))
    if smoothing == "both":
        frames = weigh_again(frames, len(frames), LogitSettings(method="logit", smoothing=smoothing))
    held: tuple[HeldBelief | None, ...] = (None,)
    for subject, frame in zip(subjects, frames, strict=True):
        (of_posterior,), held = Posterior(BayesSettings(method="bayes")).attend((subject,), frame.scene, held)
        (found,) = frame.attentions
        assert found.fit == of_posterior.fit is not None
        for value, expected in zip(found.values, of_posterior.values, strict=True):
            shares = [(each.gaze or 0.0) / each.total for each in (value, expected)]
            assert shares[0] == pytest.approx(shares[1])
            assert shares[0] > 0


def test_weights_are_recovered_from_looks_drawn_with_them() -> None:
    generator = np.random.default_rng(1)
    true = np.array([1.0, 0.5, 2.0, -1.0])
    x = generator.normal(size=(6000, 4, 4))
    x[..., 0] = 1
    chances = probabilities(x @ true)
    everywhere = np.column_stack([chances, 1 - chances.sum(axis=1)])
    looked = np.array([generator.choice(5, p=row) for row in everywhere])
    right = np.arange(5) == (looked[:, None] + 1) % 5  # nowhere comes first
    design = Design(features=x, right=right, weight=np.ones(len(x)))
    assert maximised(design, np.full(4, 0.01), np.zeros(4)) == pytest.approx(true, abs=0.12)
    # against a prior that is certain, no look counts
    elsewhere = np.array([3.0, 0.0, 0.0, 1.0])
    assert maximised(design, np.full(4, 1e9), elsewhere) == pytest.approx(elsewhere, abs=1e-3)
    assert maximised(design, np.full(4, 0.01), elsewhere) == pytest.approx(true, abs=0.12)


def test_weights_are_recovered_from_labels_that_name_several_targets() -> None:
    """Of four targets, the first three have one name, and their order says nothing."""
    generator = np.random.default_rng(1)
    true = np.array([1.0, 0.5, 2.0, -1.0])
    x = generator.normal(size=(6000, 4, 4))
    x[..., 0] = 1
    chances = probabilities(x @ true)
    everywhere = np.column_stack([1 - chances.sum(axis=1), chances])
    looked = np.array([generator.choice(5, p=row) for row in everywhere])
    names = np.array([0, 1, 1, 1, 2])
    design = Design(features=x, right=names == names[looked][:, None], weight=np.ones(len(x)))
    for start in (np.zeros(4), np.array([3.0, 0.0, 0.0, 1.0])):
        assert maximised(design, np.full(4, 0.01), start) == pytest.approx(true, abs=0.15)


def test_a_direction_that_was_never_measured_keeps_the_default_weights() -> None:
    seen: list[FrameFeatures] = []
    means = Means()
    subject = looking(None, LEFT)
    for _ in range(20):
        found, means = observe(subject, TARGETS, {}, means, 0.1, by_posterior())
        seen.append(found)
    sequence = LabelledSequence(group="a", times_s=np.arange(20) * 0.1, seen=seen, targets=[(2,)] * 10 + [(None,)] * 10)
    fitted, unfitted = fit([sequence]), default_weights()
    assert fitted.forward.gaze == unfitted.forward.gaze
    assert fitted.forward.head != unfitted.forward.head
    assert fitted.forward.head.spread == 0


def test_frames_without_targets_say_nothing_of_the_weights() -> None:
    def sequence(seen: list[FrameFeatures]) -> LabelledSequence:
        count = len(seen)
        return LabelledSequence(
            group="a", times_s=[0.1 * k for k in range(count)], seen=seen, targets=[(None,)] * count
        )

    subject = looking(LEFT, LEFT)
    (with_targets, _), (without, _) = (
        observe(subject, targets, {}, Means(), 0.1, by_posterior(targets)) for targets in (TARGETS, ())
    )
    assert fit([sequence([without] * 3)]) == default_weights()
    fitted, expected = fit([sequence([without] * 9 + [with_targets] * 3)]), fit([sequence([with_targets] * 3)])
    assert fitted.forward.both.vector == pytest.approx(expected.forward.both.vector)


def test_clips_of_one_frame_are_fitted() -> None:
    seen, _ = observe(looking(LEFT, LEFT), TARGETS, {}, Means(), 0.04, by_posterior())
    one = LabelledSequence(group="a", times_s=[3.0], seen=[seen], targets=[(None,)])
    fitted = fit([one] * 20, ["forward"]).forward.both
    assert fitted.constant < default_weights().forward.both.constant - 0.5  # targets are less likely


def test_a_label_stands_for_the_time_to_the_next_one() -> None:
    """Labels of every fifth frame weigh as much as those of a clip that has no other frames; a pause weighs nothing."""
    subjects = [
        looking(LEFT + aside, LEFT + aside) for aside in np.random.default_rng(1).normal(size=(100, 3), scale=0.4)
    ]
    seen: list[FrameFeatures] = []
    means = Means()
    for subject in subjects:
        found, means = observe(subject, TARGETS, {}, means, 0.1, by_posterior())
        seen.append(found)
    targets = [(2,) if k % 20 else (None,) for k in range(100)]
    times_s = np.arange(100) * 0.1 + 30 * (np.arange(100) >= 50)
    sparse = LabelledSequence(
        group="a",
        times_s=times_s,
        seen=seen,
        targets=[target if k % 5 == 0 else () for k, target in enumerate(targets)],
    )
    alone = LabelledSequence(group="a", times_s=np.arange(0, 10, 0.5), seen=seen[::5], targets=targets[::5])
    assert sparse.label_s[::5] == pytest.approx([0.5] * 20)
    fitted, expected = (fit([each], ["forward"]).forward.both.vector for each in (sparse, alone))
    assert fitted == pytest.approx(expected)


def looks_of(seed: int, start_s: float, weight: float) -> LabelledSequence:
    """Looks at one to three targets, two of one name, with a pause; some frames lack a label or a gaze."""
    rng, means = np.random.default_rng(seed), Means()
    places = [a_target(n, np.array([x, 0.2, 2.0])) for n, x in ((2, -1.0), (3, 0.0), (4, 1.0))]
    times_s = start_s + np.cumsum(rng.uniform(0.05, 0.4, 60)) + 20 * (np.arange(60) >= 30)
    seen, targets, before_s = list[FrameFeatures](), list[tuple[int | None, ...]](), start_s
    for number, at_s in enumerate(times_s):
        there = tuple(places[: rng.integers(1, 4)])
        looked = there[rng.integers(len(there))] if rng.random() < 0.7 else None
        way = np.array([rng.normal(), -1.0, 1.0]) if looked is None else looked.box.center_m
        gaze, head = (way + rng.normal(0, spread, 3) for spread in (0.3, 0.6))
        gaze, head = (direction / np.linalg.norm(direction) for direction in (gaze, head))
        subject = looking(None if number % 7 == 3 else gaze, head)
        found, means = observe(subject, there, {}, means, at_s - before_s, by_posterior(there))
        of_name = {None: (None,), 2: (2,)}.get(looked and looked.instance.id, (3, 4))
        seen.append(found)
        targets.append(() if rng.random() < 0.3 else tuple(n for n in of_name if n is None or n in found.ids))
        before_s = at_s
    return LabelledSequence(group=seed, times_s=times_s.tolist(), seen=seen, targets=targets, weight=weight)


def label_weights(times_s: list[float], labelled: list[int]) -> list[float]:
    """How much each frame counts, 1 for half a second: it lasts to the next label, but at most for the usual time."""
    to_next_s = [times_s[after] - times_s[before] for before, after in pairwise(labelled)]
    usual_s = np.median(to_next_s) if to_next_s else 0.5
    lasts = dict(zip(labelled, [*np.minimum(to_next_s, usual_s), usual_s], strict=True))
    frames_s = [*np.diff(times_s), 0.0]
    return [min(max(frame_s, lasts.get(place, 0.0)) / 0.5, 1.0) for place, frame_s in enumerate(frames_s)]


@pytest.mark.parametrize("smoothing", ["forward", "both"])
@pytest.mark.parametrize("case", ["both", "head"])
def test_no_other_weights_are_likelier_than_those_of_a_fit(smoothing: Literal["forward", "both"], case: Case) -> None:
    sequences = [looks_of(1, 0.0, 1.0), looks_of(2, 100.0, 0.4)]
    frames: list[tuple[float, Float, list[bool]]] = []  # weight, features of each target, and which answers are right
    for sequence in sequences:
        places = [place for place, each in enumerate(sequence.seen) if each.case == case]
        times_s, seen = [sequence.times_s[place] for place in places], [sequence.seen[place] for place in places]
        right = [sequence.targets[place] for place in places]
        after = later_means(seen, np.diff(times_s)) if smoothing == "both" else [None] * len(seen)
        counts = label_weights(times_s, [place for place, targets in enumerate(right) if targets])
        frames += [
            (sequence.weight * count, features(each, case, mean), [number in targets for number in (None, *each.ids)])
            for each, mean, count, targets in zip(seen, after, counts, right, strict=True)
            if targets
        ]
    middle = getattr(getattr(default_weights(), smoothing), case).vector
    scales = 2 if smoothing == "forward" else 3
    spreads = [2.0, 1.0, *np.repeat([0.3 if row == 4 else 1.0 for row in ROWS[case]], scales)]

    def loss(weights: Float) -> float:
        logs = 0.0
        for count, x, answers in frames:
            utility = np.array([0.0, *x @ weights])
            logs += count * (logsumexp(utility[answers]) - logsumexp(utility))
        return float((((weights - middle) / spreads) ** 2).sum() / 2 - logs)

    found = getattr(getattr(fit(sequences, [smoothing], [case]), smoothing), case).vector
    assert loss(found) < loss(middle) - 1
    assert approx_fprime(found, loss, 1e-5) == pytest.approx(np.zeros(len(found)), abs=2e-3)


def test_weights_survive_their_vector() -> None:
    for case, rows in ROWS.items():
        constant, size, *of_cues = vector = [*range(1, 3 + 3 * len(rows))]
        weights = Weights.of(case, vector)
        assert weights.vector.tolist() == vector
        assert (weights.constant, weights.size, weights.spread) == (constant, size, 0)
        for row, first in zip(rows, of_cues[::3], strict=True):
            assert getattr(weights, LOGIT_CUES[row]) == (first, first + 1, first + 2)


def test_weights_of_the_wrong_shape_are_refused() -> None:
    plain = default_weights().model_dump()
    plain["forward"]["head"]["gaze"] = (1.0, 1.0)
    with pytest.raises(ValueError, match=r"forward\.head: expected 2 weights of head, head_swing"):
        LogitSettings.model_validate({"method": "logit", "weights": plain})
