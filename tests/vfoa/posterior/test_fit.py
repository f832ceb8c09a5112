"""Parameters fitted to drawn sequences are those that the sequences were drawn with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vfoa.geometry import unit
from vfoa.posterior.belief import Measured, Scenery
from vfoa.posterior.fit import LabelledFrame, LabelledPerson, fit, fitted_temperatures, settings_from
from vfoa.posterior.grid import gaze_hypotheses
from vfoa.posterior.settings import PosteriorSettings
from vfoa.simulated_scenes import NOWHERE, Errors, draw_sequence


def drawn_person(seed: int, errors: Errors) -> LabelledPerson:
    drawn = draw_sequence("room", errors, np.random.default_rng(seed))
    scenery = Scenery(
        keys=(*range(len(drawn.objects)), None),
        directions=unit(drawn.objects - drawn.eyes),
        variances=np.full(len(drawn.objects), 1e-4),
        to_camera=unit(-drawn.eyes),
    )
    frames = [
        LabelledFrame(
            time_s=time_s,
            scenery=scenery,
            measured=Measured(gaze=gaze, head=head, gaze_sigma_rad=0.1, head_sigma_rad=0.1),
            looked_at=None if label == NOWHERE else int(label),
        )
        for time_s, label, gaze, head in zip(drawn.time_s, drawn.label, drawn.gaze, drawn.head, strict=True)
    ]
    return LabelledPerson(clip=seed, frames=frames)


def test_error_bias_and_gain_are_those_of_the_scenes() -> None:
    people = [drawn_person(seed, Errors(gaze_deg=8.0, bias_deg=15.0, gain=0.8)) for seed in range(12)]
    found = fit(people)
    assert found["gaze_error_deg"].value == pytest.approx(8, rel=0.25)
    assert found["bias_deg"].value == pytest.approx(15, rel=0.25)
    assert found["gain"].value == pytest.approx(0.8, abs=0.06)
    assert 0.3 < found["head_share"].value / 0.8 < 0.9
    assert 0 < found["p_nowhere"].value < 0.35
    assert 0.6 < found["dwell_s"].value < 4
    for estimate in found.values():
        assert estimate.low < estimate.value < estimate.high
        assert estimate.n > 0


def test_settings_for_a_clip_come_from_the_others_alone() -> None:
    quiet = [drawn_person(seed, Errors(gaze_deg=5.0)) for seed in range(3)]
    loud = drawn_person(9, Errors(gaze_deg=30.0))
    base = PosteriorSettings()
    assert settings_from([*quiet, loud], base, without=9) == settings_from(quiet, base)
    fitted = settings_from([*quiet, loud], base)
    assert fitted.gaze_error_deg > settings_from(quiet, base).gaze_error_deg + 3
    assert (fitted.error, fitted.spread) == ("unknown", "published")


def test_what_is_not_shown_stays_as_it_was() -> None:
    base = PosteriorSettings()
    assert settings_from([], base) == base
    only = fit([drawn_person(1, Errors())])
    assert np.isnan(only["gain"].low)


def test_the_fitted_gain_is_the_middle_of_the_hypotheses() -> None:
    people = [drawn_person(seed, Errors(gaze_deg=8.0, gain=0.5)) for seed in range(3)]
    fitted = settings_from(people, PosteriorSettings())
    assert fitted.gain == pytest.approx(0.5, abs=0.1)
    gains = gaze_hypotheses(fitted).gains
    assert gains == pytest.approx((fitted.gain - 0.2, fitted.gain, fitted.gain + 0.2))


def test_temperatures_rise_with_what_the_model_does_not_know() -> None:
    """Labels that have nothing to do with the gaze: only answers that are nearly even are honest."""
    right = drawn_person(1, Errors(gaze_deg=8.0))
    targets = [key for key in right.frames[0].scenery.keys if key is not None]
    drawn = np.random.default_rng(1).choice(targets, len(right.frames))
    wrong = [replace(frame, looked_at=int(label)) for frame, label in zip(right.frames, drawn, strict=True)]
    base = PosteriorSettings()
    honest, blind = (fitted_temperatures([each], base) for each in (right, replace(right, frames=wrong)))
    assert honest["temperature"] < 3
    assert blind["temperature"] > 2 * honest["temperature"]
    assert blind["smoothed_temperature"] > 2 * honest["smoothed_temperature"]
    assert fitted_temperatures([right], PosteriorSettings(error="told")) == {}
