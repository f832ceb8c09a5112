"""Drawn scenes have the errors that were asked for, and labels that say where the eyes are."""

from __future__ import annotations

import numpy as np
import pytest

from scripts.measure.simulated_scenes import NOWHERE, Errors, draw_sequence
from vfoa.geometry import angle_between, unit


@pytest.mark.parametrize("generator", ["room", "table"])
def test_without_errors_the_gaze_is_on_the_object_that_is_looked_at(generator: str) -> None:
    for seed in range(5):
        errors = Errors(gaze_deg=0.0, head_deg=0.0) if generator == "room" else Errors(gaze_deg=1e-3, head_deg=1e-3)
        drawn = draw_sequence(generator, errors, np.random.default_rng(seed))
        on = drawn.label != NOWHERE
        towards = (drawn.objects - drawn.eyes)[drawn.label[on]]
        reach = np.arctan2(drawn.radii_m[drawn.label[on]], np.linalg.norm(towards, axis=1))
        assert (angle_between(towards, drawn.gaze[on]) <= reach + 1e-3).all()
        assert len(drawn.time_s) == len(drawn.label) == len(drawn.gaze) == len(drawn.head) == 300


@pytest.mark.parametrize("generator", ["room", "table"])
@pytest.mark.parametrize("error_deg", [5.0, 20.0])
def test_the_mean_error_is_the_one_asked_for(generator: str, error_deg: float) -> None:
    found = []
    for seed in range(30):
        true = draw_sequence(generator, Errors(gaze_deg=1e-3), np.random.default_rng(seed))
        drawn = draw_sequence(generator, Errors(gaze_deg=error_deg), np.random.default_rng(seed))
        assert (true.label == drawn.label).all()
        found.append(np.degrees(angle_between(true.gaze, drawn.gaze)).mean())
    assert np.mean(found) == pytest.approx(error_deg, rel=0.15)


def test_a_gain_leaves_a_part_of_the_angle_to_the_camera() -> None:
    whole, part = (
        draw_sequence("room", Errors(gaze_deg=0.0, gain=gain), np.random.default_rng(1)) for gain in (1.0, 0.7)
    )
    camera = unit(-whole.eyes)
    assert angle_between(camera, part.gaze) == pytest.approx(0.7 * angle_between(camera, whole.gaze))
