"""Frames that wait for later ones come back in order, all of them, and revised."""

from __future__ import annotations

import numpy as np
import pytest

from harness.run.loop import SmoothingBuffer
from tests.scenes import make_box, make_subject, make_target
from vfoa.attention import AttentionSettings
from vfoa.bayes import BayesSettings, smooth
from vfoa.pipeline import AttendSettings, Memory, attend
from vfoa.types import Scene

TARGETS = (make_target(1, make_box((-0.3, 0, 2))), make_target(2, make_box((0.3, 0, 2))))


def bayes(smoothing, **settings):
    return AttendSettings(
        attention=BayesSettings(
            method="bayes", surface="box", smoothing=smoothing, look_ahead_s=0.12, error="told", **settings
        )
    )


def through(settings, gazes):
    """The focus of every frame, by index, as it comes back; and how many came back before the end."""
    buffer, memory, found = SmoothingBuffer(settings), Memory(), []
    for index, x in enumerate(gazes):
        subject = make_subject(gaze=(x, 0, 1))
        scene = Scene(index=index, time_ns=0, targets=TARGETS, people=(subject.person,))
        result, memory = attend(scene, memory, settings)
        found += list(buffer.add(result, index))
    before_the_end = len(found)
    found += list(buffer.finish())
    assert [result.scene.index for result, _ in found] == [companion for _, companion in found]
    return [result.attentions[0].focus for result, _ in found], before_the_end


@pytest.mark.parametrize(
    "settings", [AttendSettings(attention=AttentionSettings(cones_deg=(10,))), bayes("off"), bayes("forward")]
)
def test_nothing_waits_that_does_not_look_ahead(settings):
    assert through(settings, [0.15] * 5) == ([2] * 5, 5)


def test_a_first_frame_is_corrected_by_those_after_it():
    gazes = [-0.1, *[0.15] * 7]
    forward, _ = through(bayes("forward"), gazes)
    revised, before_the_end = through(bayes("both"), gazes)
    assert forward[0] == 1
    assert revised == [2] * 8
    assert before_the_end == 4  # the first block: seven have come, and three must be ahead of each


@pytest.mark.parametrize("rate_hz", [25, 50])
def test_every_frame_is_revised_by_all_that_waits_at_least_the_time_ahead(rate_hz):
    """0.12 s are 3 frames at 25 Hz and 6 at 50 Hz; blocks as long come back, and the rest at the end."""
    settings = bayes("both", gaze_error_deg=25, evidence=1)
    buffer, memory, found, results = SmoothingBuffer(settings), Memory(), [], []
    for index, x in enumerate(np.random.default_rng(3).uniform(-0.5, 0.5, 20)):
        subject = make_subject(gaze=(x, 0, 1))
        scene = Scene(index=index, time_ns=index * 10**9 // rate_hz, targets=TARGETS, people=(subject.person,))
        result, memory = attend(scene, memory, settings)
        results.append(result)
        found += [(index, each) for each, _ in buffer.add(result, None)]
    found += [(19, each) for each, _ in buffer.finish()]
    ahead = 3 * rate_hz // 25
    assert [each.scene.index for _, each in found] == list(range(20))
    first = 0
    for index, (newest, result) in enumerate(found):
        assert newest - index >= ahead or newest == 19
        if index and found[index - 1][0] != newest:
            first = index
        expected = smooth(results[first : newest + 1], settings.attention)[index - first]
        assert result.attentions[0].focus == expected.attentions[0].focus
        totals = [[value.total for value in each.attentions[0].values] for each in (result, expected)]
        assert totals[0] == totals[1]
