"""Frames that wait for later ones come back in order, all of them, and revised."""

from __future__ import annotations

import numpy as np
import pytest

from harness.runs.hindsight import Hindsight
from tests.scenes import make_box, make_subject, make_target
from vfoa.attention import AttentionSettings
from vfoa.bayes import BayesSettings
from vfoa.dwell import revise
from vfoa.pipeline import AttendSettings, Memory, attend
from vfoa.types import Scene

TARGETS = (make_target(1, make_box((-0.3, 0, 2))), make_target(2, make_box((0.3, 0, 2))))


def bayes(smoothing, **settings):
    return AttendSettings(
        attention=BayesSettings(method="bayes", surface="box", smoothing=smoothing, look_ahead_frames=3, **settings)
    )


def through(settings, gazes):
    """The focus of every frame, by index, as it comes back; and how many came back before the end."""
    hindsight, memory, found = Hindsight(settings), Memory(), []
    for index, x in enumerate(gazes):
        subject = make_subject(gaze=(x, 0, 1))
        scene = Scene(index=index, time_ns=0, targets=TARGETS, people=(subject.person,))
        result, memory = attend(scene, memory, settings)
        found += list(hindsight.add(result, index))
    before_the_end = len(found)
    found += list(hindsight.finish())
    assert [result.scene.index for result, _ in found] == [companion for _, companion in found]
    return [result.attentions[0].focus for result, _ in found], before_the_end


@pytest.mark.parametrize(
    "settings", [AttendSettings(attention=AttentionSettings(cones_deg=(10,))), bayes("off"), bayes("forward")]
)
def test_nothing_waits_that_does_not_look_ahead(settings):
    assert through(settings, [0.15] * 5) == ([2] * 5, 5)


@pytest.mark.parametrize("smoothing", ["both", "viterbi"])
def test_a_first_frame_is_corrected_by_those_after_it(smoothing):
    gazes = [-0.1, *[0.15] * 7]
    forward, _ = through(bayes("forward"), gazes)
    revised, before_the_end = through(bayes(smoothing), gazes)
    assert forward[0] == 1
    assert revised == [2] * 8
    assert before_the_end == 5


@pytest.mark.parametrize("smoothing", ["both", "viterbi"])
def test_a_frame_is_revised_by_as_many_frames_before_it_as_after_it(smoothing):
    """Uncertain looks of three frames, so that the likeliest sequence depends on where it begins."""
    settings = bayes(smoothing, dwell_frames=3, gaze_error_deg=25, bias_share=0, evidence=1)
    hindsight, memory, found, results = Hindsight(settings), Memory(), [], []
    for index, x in enumerate(np.random.default_rng(3).uniform(-0.5, 0.5, 60)):
        subject = make_subject(gaze=(x, 0, 1))
        result, memory = attend(
            Scene(index=index, time_ns=0, targets=TARGETS, people=(subject.person,)), memory, settings
        )
        results.append(result)
        found += [each for each, _ in hindsight.add(result, None)]
    found += [each for each, _ in hindsight.finish()]
    for index, result in enumerate(found):
        first = max(index - 3, 0)
        expected = revise(results[first : index + 4], index - first, settings.attention)
        assert result.attentions[0].focus == expected.attentions[0].focus
        assert [each.total for each in result.attentions[0].values] == [
            each.total for each in expected.attentions[0].values
        ]
