"""The gaze filter: what it gains on a signal of known truth, and what it does when measurements fail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.spatial.transform import Rotation
from scipy.special import expit

from scripts.measure.gaze_filter import filtered, measure_gaze_filter, noisy, saccade, steps_and_pursuits
from tests.examples import few
from tests.scenes import make_person
from vfoa.gaze_filter import CueFilter, GazeFilterSettings, GazeFilterState, filter_cues, follow
from vfoa.geometry import angle_between, perturb
from vfoa.types import Float, Gaze, HeadPose

GAZE = GazeFilterSettings(cues="gaze")
AHEAD = np.array([0.0, 0.0, 1.0])


def at(right_deg: float) -> Float:
    """A direction this far to the right of straight ahead."""
    return perturb(AHEAD, np.deg2rad(right_deg), 0)


def followed(measurements: list[Float | None], wanted: GazeFilterSettings = GAZE) -> list[CueFilter | None]:
    """The filter after each measurement."""
    states: list[CueFilter | None] = []
    for measured in measurements:
        states.append(follow(states[-1] if states else None, measured, wanted))
    return states


# What it gains


def test_it_smooths_noise_and_lets_saccades_through():
    rows = {row.noise_deg: row for row in measure_gaze_filter(noises_deg=(4, 8), seeds=(0, 1))}
    assert rows[4].raw_rmse_deg == pytest.approx(4 * np.sqrt(2), rel=0.05)
    assert rows[4].ratio <= 0.7
    assert rows[8].ratio <= 0.7
    assert rows[4].after_3_deg <= 5


def test_without_noise_a_saccade_of_thirty_degrees_is_followed_at_once():
    true = saccade(np.random.default_rng(0))
    assert np.rad2deg(angle_between(filtered(true, GAZE), true)).max() < 5


def test_the_signal_has_saccades_and_pursuits_but_no_jump_beyond_forty_degrees():
    steps_deg = np.rad2deg(angle_between(*(lambda d: (d[1:], d[:-1]))(steps_and_pursuits(np.random.default_rng(0)))))
    assert np.count_nonzero(steps_deg > 4) > 10
    assert np.count_nonzero((steps_deg > 0.1) & (steps_deg < 1.1)) > 50
    assert steps_deg.max() < 42


def test_a_steady_gaze_stays_where_it_is_and_becomes_certain():
    states = followed([at(10)] * 50)
    assert all(np.rad2deg(angle_between(state.direction, at(10))) < 1e-6 for state in states)
    assert np.diag(states[-1].covariance)[0] < np.diag(states[0].covariance)[0]


def test_a_saccade_releases_the_filter_for_as_long_as_it_holds():
    theta = [state.theta for state in followed([at(0)] * 10 + [at(40)] * 10)]
    assert max(theta[:10]) < 0.01
    assert min(theta[10:15]) > 0.99
    assert theta[15:18] == pytest.approx([0.3, 0.09, 0.027], abs=0.01)


@few
@given(st.integers(0, 2**32 - 1))
def test_no_direction_is_special(seed):
    rng = np.random.default_rng(seed)
    measured = noisy(steps_and_pursuits(rng, 40), 5, rng)
    turn = Rotation.random(rng=rng).as_matrix()
    np.testing.assert_allclose(filtered(measured @ turn.T, GAZE), filtered(measured, GAZE) @ turn.T, atol=1e-9)


def test_a_frame_is_one_step_of_the_kalman_filter_as_it_is_printed():
    """Right and down of straight ahead are the camera's x and y. Degrees, one axis: position and velocity."""
    noise = 4.0
    moving = CueFilter(direction=AHEAD, velocity_deg=np.array([3.0, -2.0, 0.0]), covariance=np.diag([9.0, 9, 2, 2]))
    found = follow(moving, perturb(AHEAD, *np.deg2rad([7.0, 3.0])), GazeFilterSettings(cues="gaze", noise_deg=noise))

    theta = expit(0.5 * (np.hypot(7, 3) - 3 * noise))
    transition = np.array([[1, 1], [0, 0.5]])
    predicted = transition @ np.diag([9.0, 2]) @ transition.T + np.diag([1, 0.01])
    gain = predicted @ np.linalg.inv(predicted + np.diag([noise**2 * (1 - theta), 1]))
    right, down = (
        (state := transition @ (0, velocity)) + gain @ (np.array([offset, offset]) - state)
        for velocity, offset in ((3.0, 7.0), (-2.0, 3.0))
    )
    assert found is not None
    assert found.saccades == pytest.approx((theta,))
    assert found.theta == pytest.approx(theta)
    np.testing.assert_allclose(found.direction, perturb(AHEAD, *np.deg2rad([right[0], down[0]])))
    np.testing.assert_allclose(found.velocity_deg, (right[1], down[1], 0), atol=1e-12)
    axis = np.ix_([0, 2], [0, 2])
    np.testing.assert_allclose(found.covariance[axis], (np.eye(2) - gain) @ predicted)
    np.testing.assert_allclose(found.covariance[1:, 1:][axis], (np.eye(2) - gain) @ predicted)


def test_a_filter_starts_as_uncertain_as_a_measurement_and_at_rest():
    (start,) = followed([at(5)], GazeFilterSettings(cues="gaze", noise_deg=4))
    assert start.covariance.tolist() == np.diag([16.0, 16, 1, 1]).tolist()
    assert not start.velocity_deg.any()


@pytest.mark.parametrize(("down_deg", "missing"), [(89, 0), (90, 1)])
def test_the_gate_stands_about_the_prediction(down_deg, missing):
    """The gaze was moving right by 10 degrees a frame: 89 down is hypot(10, 89) = 89.6 degrees off, 90 down 90.6."""
    moving = CueFilter(direction=AHEAD, velocity_deg=np.array([10.0, 0, 0]), covariance=np.eye(4))
    found = follow(moving, perturb(AHEAD, 0, np.deg2rad(down_deg)), GAZE)
    assert found is not None
    assert found.missing == missing


# What is missing or wrong


def test_a_prediction_stands_in_for_a_missing_cue_and_grows_uncertain_until_the_cue_is_gone():
    wanted = GazeFilterSettings(cues="gaze", max_missing=3)
    states = followed([at(0)] * 5 + [None] * 4 + [at(60)], wanted)
    variances = [np.trace(state.covariance[:2, :2]) for state in states[4:8]]
    assert variances == sorted(set(variances))
    assert [state is None for state in states[5:]] == [False, False, False, True, False]
    np.testing.assert_allclose(states[-1].direction, at(60))


def test_a_prediction_follows_a_moving_gaze_but_does_not_run_away():
    moving = [at(degree) for degree in np.arange(0, 20, 1.0)]
    last, *predicted = followed([*moving, None, None, None, None, None])[19:]
    beyond = [np.rad2deg(angle_between(state.direction, last.direction)) for state in predicted]
    assert beyond == sorted(beyond)
    assert 0.1 < beyond[-1] < 2


def test_a_measurement_that_nobody_can_make_is_taken_for_missing_until_it_lasts():
    wanted = GazeFilterSettings(cues="gaze", max_missing=3)
    states = followed([at(0)] * 5 + [at(150)] + [at(0)] + [at(150)] * 4, wanted)
    off_deg = [float(np.rad2deg(angle_between(state.direction, at(0)))) for state in states]
    assert max(off_deg[:10]) < 1
    assert off_deg[10] == pytest.approx(150)


@pytest.mark.parametrize("opposite", [-AHEAD, np.array([0.0, -1.0, 0.0])])
def test_the_opposite_and_the_vertical_direction_are_measurements_like_any(opposite):
    wanted = GazeFilterSettings(cues="gaze", gate_deg=180)
    start = AHEAD if opposite[2] else -opposite
    states = followed([start, opposite, opposite], wanted)
    assert np.rad2deg(angle_between(states[-1].direction, opposite)) < 2


# Subjects


def people(*directions: float | None):
    """Tracked people, ids from 1, whose head points where they look."""
    return tuple(
        (number, make_person(gaze=None if degree is None else at(degree), head=None if degree is None else at(degree)))
        for number, degree in enumerate(directions, start=1)
    )


def test_off_hands_the_measurements_on():
    tracked = people(3, None)
    subjects, state = filter_cues(tracked, GazeFilterState(), GazeFilterSettings())
    for subject, (track_id, person) in zip(subjects, tracked, strict=True):
        assert (subject.track_id, subject.person) == (track_id, person)
        assert (subject.gaze, subject.head_pose) == (person.view.gaze, person.view.head_pose)
    assert not state.filters


@pytest.mark.parametrize(("cues", "head_deg"), [("gaze", 8), ("both", 2)])
def test_the_head_is_filtered_only_if_wanted(cues, head_deg):
    wanted = GazeFilterSettings(cues=cues)
    _, state = filter_cues(people(0), GazeFilterState(), wanted)
    for _ in range(20):
        _, state = filter_cues(people(0), state, wanted)
    (subject,), _ = filter_cues(people(8), state, wanted)
    assert np.rad2deg(angle_between(subject.gaze.direction, at(0))) < 4
    assert np.rad2deg(angle_between(subject.head_pose.direction, at(0))) == pytest.approx(head_deg, abs=2)


def test_subjects_are_filtered_apart_and_the_state_is_not_changed():
    together, alone = GazeFilterState(), GazeFilterState()
    for degree in (0, 4, 1, 5):
        (_, second), after = filter_cues(people(-degree, degree), together, GAZE)
        again, _ = filter_cues(people(-degree, degree), together, GAZE)
        (single,), alone = filter_cues(people(-degree, degree)[1:], alone, GAZE)
        np.testing.assert_array_equal(second.gaze.direction, single.gaze.direction)
        np.testing.assert_array_equal(second.gaze.direction, again[1].gaze.direction)
        together = after


def test_a_subject_who_is_gone_for_long_is_forgotten():
    _, state = filter_cues(people(0), GazeFilterState(), GAZE)
    for _ in range(GAZE.max_missing):
        _, state = filter_cues((), state, GAZE)
        assert state.filters
    _, state = filter_cues((), state, GAZE)
    assert not state.filters


def test_a_gaze_that_was_never_measured_is_none():
    (subject,), _ = filter_cues(people(None), GazeFilterState(), GazeFilterSettings(cues="both"))
    assert (subject.gaze, subject.head_pose) == (None, None)


def test_each_cue_is_filtered_by_its_own_measurements_and_keeps_their_uncertainty():
    wanted = GazeFilterSettings(cues="both")
    ((track_id, person),) = people(0)
    view = replace(
        person.view,
        gaze=Gaze(direction=at(5), sigma_rad=0.1),
        head_pose=HeadPose(direction=at(-5), yaw_rad=0.3, sigma_rad=0.2),
    )
    (subject,), state = filter_cues(((track_id, replace(person, view=view)),), GazeFilterState(), wanted)
    np.testing.assert_allclose(subject.gaze.direction, at(5))
    np.testing.assert_allclose(subject.head_pose.direction, at(-5))
    assert (subject.gaze.sigma_rad, subject.head_pose.sigma_rad) == (0.1, 0.2)
    assert np.isnan(subject.head_pose.yaw_rad)

    (predicted,), _ = filter_cues(people(None), state, wanted)
    np.testing.assert_allclose(predicted.gaze.direction, at(5))
    np.testing.assert_allclose(predicted.head_pose.direction, at(-5))
    assert (predicted.gaze.sigma_rad, predicted.head_pose.sigma_rad) == (None, None)


@pytest.mark.parametrize(("name", "wrong"), [("noise_deg", 0), ("gate_deg", 0), ("hold", 0), ("max_missing", -1)])
def test_a_setting_outside_of_its_range_is_refused(name, wrong):
    with pytest.raises(ValidationError, match=name):
        GazeFilterSettings(**{name: wrong})
