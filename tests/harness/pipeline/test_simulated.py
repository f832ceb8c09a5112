"""Errors of which the model says nothing, or something else: claims, biases of a clip, gain, heavy tails."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from harness.pipeline.ground_truth import AngularError, SimulatedGazeSettings
from vfoa.geometry import angle_between, unit

TRUE = unit(np.array([0.3, -0.2, -1.0]))
CAMERA = np.array([0.0, 0.0, -1.0])


@cache
def _errors(count: int = 4000, **settings: object) -> np.ndarray:
    """Angles, in radians, of one person's errors in so many frames."""
    error = AngularError(SimulatedGazeSettings.model_validate({"bias_share": 0, **settings}), 2)
    return angle_between(np.stack([error.apply(TRUE, 1, frame) for frame in range(count)]), TRUE)


def test_a_claim_changes_the_claim_alone() -> None:
    honest, boasting = (
        AngularError(SimulatedGazeSettings(error_deg=20, claimed_error_deg=claim), 2) for claim in (None, 5.0)
    )
    assert np.array_equal(honest.apply(TRUE, 1, 7), boasting.apply(TRUE, 1, 7))
    assert boasting.claimed_sigma_rad == pytest.approx(math.radians(5) * math.sqrt(2 / math.pi))
    assert honest.claimed_sigma_rad == honest.sigma_rad


def test_a_bias_of_the_clip_stays_and_is_as_large_as_asked_for() -> None:
    settings = SimulatedGazeSettings(error_deg=0, clip_bias_deg=25)
    error = AngularError(settings, 2)
    assert len({tuple(error.apply(TRUE, 1, frame)) for frame in range(50)}) == 1
    found = [
        angle_between(AngularError(settings.model_copy(update={"draw": f"clip {number}"}), 2).apply(TRUE, 1, 0), TRUE)
        for number in range(1500)
    ]
    assert np.degrees(np.mean(found)) == pytest.approx(25, rel=0.05)


def test_gain_shrinks_angles_towards_the_camera_in_their_plane() -> None:
    error = AngularError(SimulatedGazeSettings(error_deg=0, gain=0.6), 2)
    found = error.apply(TRUE, 1, 0, CAMERA)
    assert angle_between(found, CAMERA) == pytest.approx(0.6 * angle_between(TRUE, CAMERA))
    assert found @ np.cross(TRUE, CAMERA) == pytest.approx(0, abs=1e-12)
    assert np.array_equal(error.apply(CAMERA, 1, 0, CAMERA), CAMERA)


@pytest.mark.parametrize("noise", ["normal", "student"])
def test_every_noise_has_the_mean_angle_that_was_asked_for(noise: str) -> None:
    tolerance = 0.15 if noise == "student" else 0.05  # its variance is that of heavy tails
    assert np.degrees(_errors(error_deg=8, noise=noise).mean()) == pytest.approx(8, rel=tolerance)


def test_student_noise_has_the_heavier_tails_and_the_smaller_middle() -> None:
    normal, student = (_errors(error_deg=8, noise=noise) for noise in ("normal", "student"))
    assert np.median(student) < 0.95 * np.median(normal)
    assert np.quantile(student, 0.995) > 1.5 * np.quantile(normal, 0.995)
