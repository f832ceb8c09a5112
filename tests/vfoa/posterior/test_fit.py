"""Parameters fitted to drawn sequences are those that the sequences were drawn with."""

from __future__ import annotations

import numpy as np
import pytest

from vfoa.geometry import unit
from vfoa.posterior.belief import Measured, Scenery
from vfoa.posterior.fit import LabelledFrame, LabelledPerson, fit, settings_from
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
