"""The posterior against an exact particle filter, and against scenes whose errors are known."""

from __future__ import annotations

import numpy as np
import pytest

from vfoa.geometry import perturb, sigma_rad
from vfoa.posterior import kalman, looks
from vfoa.posterior.belief import Belief, MeasuredCues, Scenery
from vfoa.posterior.cues import BIAS_S, BIAS_SHARE, ELSEWHERE_DEG, FACING_S, START_S
from vfoa.posterior.filter import answered, smoothed, update
from vfoa.posterior.grid import Error
from vfoa.posterior.kalman import DRIFT, HEAD, GazeError, Normal, first_error, first_motion, next_error, next_motion
from vfoa.posterior.looks import DWELL_S, P_NOWHERE, Transition

DT_S = 0.1
ERROR_DEG = 11.1


@pytest.fixture
def no_looks_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """Looks correct neither the share of nowhere nor the dwell, so that the model is a plain hidden Markov model."""
    monkeypatch.setattr(looks, "NOWHERE_LOOKS", 1e9)
    monkeypatch.setattr(looks, "DWELL_LOOKS", 1e9)


def scenery(*angles_deg: float) -> Scenery:
    """Small targets at these angles to the right of the way to the camera."""
    camera = np.array([0.0, 0.0, -1.0])
    directions = perturb(
        np.repeat(camera[None], len(angles_deg), axis=0), np.deg2rad(angles_deg), np.zeros(len(angles_deg))
    )
    keys = (*range(len(angles_deg)), None)
    return Scenery(keys=keys, directions=directions, variances=np.full(len(angles_deg), 1e-4), to_camera=camera)


def measured(
    gaze: np.ndarray | None = None, head: np.ndarray | None = None, error_deg: float = ERROR_DEG
) -> MeasuredCues:
    return MeasuredCues(gaze=gaze, head=head, gaze_sigma_rad=sigma_rad(error_deg), head_sigma_rad=sigma_rad(5.0))


def beliefs_of(scene: Scenery, frames: list[MeasuredCues], error: Error = "unknown") -> list[Belief]:
    found: list[Belief] = []
    for frame in frames:
        found.append(update(found[-1] if found else None, scene, frame, DT_S, error))
    return found


def offsets_of(gazes_rad: np.ndarray) -> list[MeasuredCues]:
    camera = np.array([0.0, 0.0, -1.0])
    return [measured(perturb(camera, *offset)) for offset in gazes_rad]


def faced(before: np.ndarray | None, middle: np.ndarray, gaze: np.ndarray) -> np.ndarray:
    """Where the body faces after a gaze, on a plane: the running mean of the gaze."""
    keep = START_S / (START_S + FACING_S) if before is None else np.exp(-DT_S / FACING_S)
    return np.asarray(keep * (middle if before is None else before) + (1 - keep) * gaze)


def drawn_course(seed: int, angles_deg: tuple[float, ...], count: int) -> np.ndarray:
    """Gazes (N, 2) in radians, drawn from the model itself on a plane."""
    rng = np.random.default_rng(seed)
    aims = np.deg2rad([(angle, 0.0) for angle in angles_deg])
    middle, sigma = aims.mean(axis=0), sigma_rad(ERROR_DEG)
    slow, fast = BIAS_SHARE * sigma**2, (1 - BIAS_SHARE) * sigma**2
    look, drift, facing, found = -1, np.zeros(2), None, []
    keep = np.exp(-DT_S / BIAS_S)
    for frame in range(count):
        if frame == 0 or rng.random() < -np.expm1(-DT_S / DWELL_S):
            nowhere = rng.random() < P_NOWHERE
            look = len(aims) if nowhere else int(rng.integers(len(aims)))
        wide = sigma_rad(ELSEWHERE_DEG) ** 2 if look == len(aims) else 1e-4
        drift = keep * drift + np.sqrt((1 - keep**2) * (slow + wide)) * rng.normal(size=2)
        aim = aims[look] if look < len(aims) else middle if facing is None else facing
        found.append(aim + drift + np.sqrt(fast) * rng.normal(size=2))
        facing = faced(facing, middle, found[-1])
    return np.array(found)


def particle_probabilities(gazes: np.ndarray, aims: np.ndarray, n: int) -> np.ndarray:
    """Filtered probabilities (N, T) of a bootstrap filter with n particles of (look, drift).

    A new look draws its place on the target and keeps the share of the drift that is the error's.
    """
    rng = np.random.default_rng(1)
    count = len(aims)
    facing = None
    prior = np.append(np.full(count, (1 - P_NOWHERE) / count), P_NOWHERE)
    sigma = sigma_rad(ERROR_DEG)
    slow, fast = BIAS_SHARE * sigma**2, (1 - BIAS_SHARE) * sigma**2
    variance = slow + np.append(np.full(count, 1e-4), sigma_rad(ELSEWHERE_DEG) ** 2)
    keep, leave = np.exp(-DT_S / BIAS_S), -np.expm1(-DT_S / DWELL_S)
    found = []
    look = rng.choice(count + 1, size=n, p=prior)
    drift = rng.normal(size=(n, 2)) * np.sqrt(variance[look])[:, None]
    for frame, gaze in enumerate(gazes):
        if frame:
            leaves = rng.random(n) < leave
            # the error's share of the drift, and what is left of its variance, go on; the rest is drawn anew
            share = slow / variance[look]
            error = share[:, None] * drift + np.sqrt(slow * (1 - share))[:, None] * rng.normal(size=(n, 2))
            new = rng.choice(count + 1, size=n, p=prior)
            place = np.sqrt(variance[new] - slow)[:, None] * rng.normal(size=(n, 2))
            drift = np.where(leaves[:, None], error + place, drift)
            look = np.where(leaves, new, look)
            drift = keep * drift + np.sqrt((1 - keep**2) * variance[look])[:, None] * rng.normal(size=(n, 2))
        places = np.vstack([aims, aims.mean(axis=0) if facing is None else facing])
        facing = faced(facing, aims.mean(axis=0), gaze)
        log = -((gaze - places[look] - drift) ** 2).sum(axis=1) / fast / 2
        weights = np.exp(log - log.max())
        weights /= weights.sum()
        found.append(np.bincount(look, weights, minlength=count + 1))
        kept = np.searchsorted(np.cumsum(weights), (np.arange(n) + rng.random()) / n).clip(max=n - 1)
        look, drift = look[kept], drift[kept]
    return np.array(found)


@pytest.mark.usefixtures("no_looks_count")
def test_nowhere_is_as_likely_as_a_particle_filter_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The particle filter holds every course of looks and drift; this one collapses them after every frame."""
    monkeypatch.setattr(kalman, "TAILS", 1e9)
    angles = (-20.0, 5.0, 25.0)
    aims = np.deg2rad([(angle, 0.0) for angle in angles])
    exact, found = [], []
    for seed in (0, 1, 2, 3, 5):
        gazes = drawn_course(seed, angles, 60)
        exact.append(particle_probabilities(gazes, aims, 20_000))
        found.append([each.probabilities for each in beliefs_of(scenery(*angles), offsets_of(gazes), "told")])
    nowhere = [np.mean(each, axis=(0, 1))[-1] for each in (exact, found)]
    assert nowhere[0] > 0.1
    assert nowhere[1] == pytest.approx(nowhere[0], rel=0.1)
    assert np.abs(np.array(found) - exact).mean() < 0.03


@pytest.mark.parametrize("last", [0, 1], ids=["from a point", "from a wide target"])
def test_of_the_drift_the_part_of_the_error_outlasts_a_look(last: int) -> None:
    """Drawn errors and points on two targets: what is left in the next look has the moments that the filter has."""
    rng = np.random.default_rng(0)
    slow, on_target = 0.01, np.array([[1e-6], [0.03]])
    error = rng.normal(size=1_000_000) * np.sqrt(slow)
    drift = error + rng.normal(size=error.size) * np.sqrt(on_target[last])
    kept = error[np.abs(drift - 0.15) < 0.005]  # those whose drift in the look before was as measured

    slow_of_each = np.array([slow])
    known = first_error(0.0, slow_of_each, on_target)
    means = np.zeros((2, 2, 2, 1))
    means[DRIFT, 0] = 0.15
    before = GazeError(Normal(means, np.zeros((2, 2, 2, 1))), known.lasting)
    looked, none = np.eye(2)[:, [last]], np.zeros((2, 1))
    after = next_error(before, Transition(np.arange(2), looked, none, none), slow_of_each, on_target, keep=1.0).state
    assert after.means[DRIFT, 0, :, 0] == pytest.approx(np.full(2, kept.mean()), abs=0.003)
    assert after.covariances[DRIFT, DRIFT] == pytest.approx(kept.var() + on_target, rel=0.05, abs=1e-5)


def test_a_large_error_is_found_out_and_a_small_one_too() -> None:
    rng = np.random.default_rng(2)
    for factor in (0.4, 2.5):
        gazes = np.deg2rad([(10.0, 0.0)]) + factor * sigma_rad(11.1) * rng.normal(size=(60, 2))
        last = beliefs_of(scenery(-30.0, 10.0, 50.0), offsets_of(gazes))[-1]
        scale = float(last.gaze_weights @ last.gaze.scale)
        assert scale == pytest.approx(factor, rel=0.4)


def test_a_constant_bias_is_learned_from_the_looks() -> None:
    """Looks go from target to target, all of them 20 degrees low: told the error, the filter has them at nowhere."""
    rng = np.random.default_rng(3)
    angles = (-40.0, 0.0, 40.0)
    looks = np.repeat([0, 2, 1, 0, 1, 2], 15)
    aims = np.column_stack([np.deg2rad(np.array(angles)[looks]), np.full(len(looks), np.deg2rad(20.0))])
    frames = offsets_of(aims + sigma_rad(5.0) * rng.normal(size=aims.shape))
    beliefs = beliefs_of(scenery(*angles), frames)
    last = beliefs[-1]
    bias = last.gaze.bias_rad @ last.gaze_weights
    assert np.degrees(bias) == pytest.approx([0, 20], abs=8)
    right = [np.argmax(each.probabilities) == look for each, look in zip(beliefs, looks, strict=True)]
    assert np.mean(right[-30:]) > 0.9


def test_a_gaze_shrunk_towards_the_camera_is_stretched_again() -> None:
    """Targets at 0, 30 and 60 degrees look as if at 0, 18 and 36: the nearest of 36 is that at 30."""
    rng = np.random.default_rng(4)
    angles = (0.0, 30.0, 60.0)
    looks = np.repeat([0, 2, 1, 2, 0, 2], 20)
    aims = 0.6 * np.deg2rad(np.array(angles)[looks])
    frames = offsets_of(np.column_stack([aims, np.zeros(len(aims))]) + sigma_rad(4.0) * rng.normal(size=(len(aims), 2)))
    found = [int(np.argmax(each.probabilities)) for each in beliefs_of(scenery(*angles), frames)]
    assert np.mean(np.array(found[-40:]) == looks[-40:]) > 0.9


def test_people_who_look_at_nothing_look_where_their_head_points() -> None:
    """Head and gaze agree, far from every target."""
    camera = np.array([0.0, 0.0, -1.0])
    away = perturb(camera, np.deg2rad(-50.0), np.deg2rad(-30.0))
    last = beliefs_of(scenery(0.0, 30.0), [measured(away, away)] * 20)[-1]
    assert last.probabilities[-1] > 0.8


def test_a_head_of_long_ago_does_not_say_where_nowhere_is() -> None:
    """Seconds later, a gaze on nothing is no error of a gaze at the targets on the head's side."""
    scene, kept = scenery(10, 30), round(FACING_S / DT_S)
    at_target, on_nothing, old_head = perturb(scene.to_camera, np.deg2rad([10, 45, -75]), np.deg2rad([0, 10, 0]))
    looks_at = [measured(at_target, old_head), *[measured(at_target)] * (2 * kept), *[measured(on_nothing)] * 10]
    found = beliefs_of(scene, looks_at)
    assert [belief.last_head is None for belief in (found[kept - 1], found[kept + 1])] == [False, True]
    assert found[-1].probabilities[-1] > 0.9


@pytest.mark.parametrize("seed", range(3))
def test_a_gaze_alone_at_nothing_is_known_where_targets_are_on_all_sides(seed: int) -> None:
    """Looks of ten frames at points about 90 degrees to the right and 30 up, 5 degrees off; no target is there."""
    rng = np.random.default_rng(seed)
    camera, all_sides = np.array([0.0, 0.0, -1.0]), np.arange(-150.0, 180.0, 60.0)
    points = np.deg2rad([90.0, -30.0]) + np.deg2rad(25.0) * rng.uniform(-1, 1, size=(20, 2))
    gazes = points.repeat(10, axis=0) + sigma_rad(5.0) * rng.normal(size=(200, 2))
    found = beliefs_of(scenery(*all_sides), [measured(perturb(camera, *gaze), error_deg=5.0) for gaze in gazes])
    assert np.mean([each.probabilities[-1] for each in found]) > 0.4


@pytest.mark.usefixtures("no_looks_count")
def test_a_dwell_is_the_same_time_at_every_frame_rate() -> None:
    """One frame that says another target: what is left of the belief depends on seconds alone."""
    scene = scenery(-10.0, 10.0)
    camera = np.array([0.0, 0.0, -1.0])
    at = measured(perturb(camera, np.deg2rad(-10.0), 0.0))
    none = MeasuredCues(gaze=None, head=None, gaze_sigma_rad=0.1, head_sigma_rad=0.1)
    left = []
    for rate_hz in (10, 40):
        belief = update(None, scene, at, 0.0, "told")
        for _ in range(rate_hz):
            belief = update(belief, scene, none, 1 / rate_hz, "told")
        left.append(belief.probabilities)
    assert left[0] == pytest.approx(left[1])
    first = update(None, scene, at, 0.0, "told").probabilities
    stays = np.exp(-1 / DWELL_S)
    count = (1 - P_NOWHERE) / 2
    fresh = np.array([count, count, P_NOWHERE])
    assert left[0] == pytest.approx(stays * first + (1 - stays) * fresh)


def test_looks_teach_how_often_a_person_looks_at_nothing() -> None:
    """A long time away and back: new looks are expected at nowhere more often than before."""
    camera = np.array([0.0, 0.0, -1.0])
    away, at = (measured(gaze, gaze) for gaze in (perturb(camera, -1.0, -0.6), camera))
    frames = ([away] * 20 + [at] * 5) * 4
    last = beliefs_of(scenery(0.0, 40.0), frames)[-1]
    expected = float((last.weights * last.new[-1]).sum())
    assert expected > P_NOWHERE * 1.3


def test_a_cue_that_comes_later_brings_its_hypotheses() -> None:
    camera = np.array([0.0, 0.0, -1.0])
    frames = [measured(head=camera)] * 3 + [measured(camera, camera)] * 3 + [measured(gaze=camera)] * 3
    beliefs = beliefs_of(scenery(0.0, 40.0), frames)
    assert [len(belief.gaze.scale) for belief in beliefs[:3]] == [1, 1, 1]
    assert len(beliefs[3].gaze.scale) > 50
    assert all(belief.probabilities.sum() == pytest.approx(1) for belief in beliefs)
    assert all(probability.sum() == pytest.approx(1) for probability in smoothed(beliefs))


def test_the_tail_is_small_where_the_directions_do_not_fit() -> None:
    camera = np.array([0.0, 0.0, -1.0])
    still = [measured(camera, error_deg=3.0)] * 10
    jump = measured(perturb(camera, -2.0, 1.0), error_deg=3.0)
    beliefs = beliefs_of(scenery(0.0, 40.0), [*still, jump], "told")
    assert min(belief.tail for belief in beliefs[:-1]) > 0.2
    assert beliefs[-1].tail < 0.02


@pytest.mark.parametrize("error", ["told", "unknown"])
def test_the_frames_before_help_where_looks_are_short_and_heads_set_out_late(error: Error) -> None:
    """Looks of 0.7 s; the head stays for 0.12 s, then turns in 0.36 s as smoothly as can be. 25 frames a second."""
    angles = (-36.0, -24.0, -12.0, 0.0, 12.0, 24.0, 36.0)
    scene = scenery(*angles)
    camera = np.array([0.0, 0.0, -1.0])
    alone, forward = [], []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        looks = np.repeat(rng.permutation(len(angles)), 17)
        goal = 0.65 * np.deg2rad(angles)[looks]
        since = np.tile(np.arange(17), len(angles))
        part = np.clip((since - 2) / 9, 0, 1)
        turned = part**3 * (10 - 15 * part + 6 * part**2)
        start = np.concatenate([goal[:17], goal[:-17]])
        heads = start + turned * (goal - start)
        belief = None
        for look, head in zip(looks, heads, strict=True):
            gaze_noise, head_noise = sigma_rad(11.1) * rng.normal(size=2), sigma_rad(5.0) * rng.normal(size=2)
            frame = measured(
                perturb(camera, np.deg2rad(angles[look]) + gaze_noise[0], gaze_noise[1]),
                perturb(camera, head + head_noise[0], head_noise[1]),
            )
            belief = update(belief, scene, frame, 0.04, error)
            forward.append(int(belief.probabilities.argmax()) == look)
            alone.append(int(update(None, scene, frame, 0.04, error).probabilities.argmax()) == look)
    assert np.mean(forward) > np.mean(alone) + 0.05


def test_how_uncertain_a_turning_head_is_depends_on_the_time_alone() -> None:
    """One step of 0.04 s and four of 0.01 s, towards a goal 40 degrees away, without an error of the measurement."""

    def after(steps: int) -> Normal:
        one, nothing, far = np.ones((1, 1)), np.zeros((1, 1)), np.full((2, 1, 1), np.deg2rad(40.0))
        goal = np.zeros_like(far)
        motion = Normal(np.stack([goal, goal, far]), first_motion(np.zeros(1), nothing).covariances)
        for _ in range(steps):
            goes_on = Transition(np.zeros(1, int), one, one, one)
            motion = next_motion(motion, goes_on, far, 0.0, nothing, 0.04 / steps, 0.35)
        return motion

    coarse, fine = (after(steps).covariances[HEAD, HEAD, 0, 0] for steps in (1, 4))
    assert fine == pytest.approx(coarse, rel=0.25)


def test_answers_of_an_unknown_error_are_flatter_and_most_where_later_frames_are_known() -> None:
    model = np.array([0.6, 0.3, 0.1])
    belief, known = (
        beliefs_of(scenery(0, 20), offsets_of(np.zeros((1, 2))), error)[0] for error in ("unknown", "told")
    )
    forward, both = answered(belief, model, "unknown"), answered(belief, model, "unknown", later_known=True)
    assert 1 / 3 < both[0] < forward[0] < model[0]
    assert both == pytest.approx(np.sqrt(model) / np.sqrt(model).sum())
    assert answered(known, model, "told", later_known=True) == pytest.approx(model)


def test_heads_turn_from_where_the_body_faces_and_not_from_the_middle_of_the_targets() -> None:
    """Targets on all sides: a body that faces 145 degrees to the right, heads 60 % of the way to 100 and 190."""
    angles = (0.0, 60.0, 100.0, 190.0, -60.0, -110.0)
    looks = np.repeat([2, 3] * 5, 20)
    heads = np.deg2rad(145 + 0.6 * (np.array(angles)[looks] - 145))
    camera, low = np.array([0.0, 0.0, -1.0]), 0.6 * np.deg2rad(8.0)
    frames = [measured(head=perturb(perturb(camera, head, 0.0), 0.0, -low)) for head in heads]
    found = beliefs_of(scenery(*angles), frames)
    right = np.array([int(each.probabilities.argmax()) for each in found]) == looks
    assert right[60:].mean() > 0.8


def test_heads_that_turn_all_of_the_way_make_answers_flatter() -> None:
    """Nobody turns the head 95 % of the way to every target: the answer is less sure than the model."""
    camera = np.array([0.0, 0.0, -1.0])
    angles = (-60.0, -20.0, 20.0, 60.0)
    looks = np.repeat([0, 3, 1, 2, 0, 2, 3, 1], 12)
    sure = {}
    for share in (0.55, 1.0):
        frames = [
            measured(head=perturb(camera, np.deg2rad(share * angles[look]), -np.deg2rad(8.0) * share)) for look in looks
        ]
        last = beliefs_of(scenery(*angles), frames)[-1]
        answer = answered(last, last.probabilities, "unknown")
        sure[share] = answer.max() / last.probabilities.max()
    assert sure[0.55] == pytest.approx(1.0)
    assert sure[1.0] < 0.98
