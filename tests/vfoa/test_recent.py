"""Answers are shared by the same question alone, and the methods that share theirs answer as each would alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.attended import values_of
from tests.examples import few
from tests.scenes import make_person, random_room
from vfoa import bayes, logit, visible
from vfoa.bayes import BayesSettings
from vfoa.logit import LogitSettings
from vfoa.methods import MethodSettings
from vfoa.pipeline import Attending, AttendSettings
from vfoa.recent import Recent
from vfoa.tracking import Tracked
from vfoa.types import Scene

METHODS: dict[str, MethodSettings] = {
    "bayes": BayesSettings(method="bayes"),
    "bayes, both": BayesSettings(method="bayes", smoothing="both", look_ahead_s=0.1),
    "bayes, told": BayesSettings(method="bayes", error="told"),
    "bayes, off": BayesSettings(method="bayes", smoothing="off"),
    "logit": LogitSettings(method="logit"),
    "logit, both": LogitSettings(method="logit", smoothing="both", look_ahead_s=0.1),
}


def course(seed: int, frames: int = 6) -> list[Scene]:
    """Two people among the same eight boxes, in each frame with other eyes, gazes and heads; the second lacks cues."""
    _, targets = random_room(seed)
    scenes = []
    for index in range(frames):
        subjects = [random_room(seed + 100 * index + person)[0] for person in (1, 2)]
        one, other = (
            make_person(
                (100 * number, 0, 100 * number + 50, 50),
                eyes=subject.person.eye_origin_left,
                gaze=None if number and index % 2 else subject.direction("gaze"),
                head=None if number and index % 3 == 1 else subject.direction("head"),
            )
            for number, subject in enumerate(subjects)
        )
        scenes.append(Scene(index=index, time_ns=index * 40_000_000, targets=targets, people=(one, other)))
    return scenes


def answers(scenes: list[Scene], *names: str) -> dict[str, list[Any]]:
    """The answers of methods that attend to each frame one after the other."""
    tracked = Tracked(ids=(1, 2), open=frozenset({1, 2}))
    attending = {name: Attending(AttendSettings(attention=METHODS[name])) for name in names}
    found: dict[str, list[Any]] = {name: [] for name in names}
    for scene in scenes:
        for name, each in attending.items():
            found[name] += each.step(scene, tracked)
    return {name: [values_of(result) for result in found[name] + each.finish()] for name, each in attending.items()}


@few
@given(st.integers(0, 10_000))
def test_methods_that_share_beliefs_answer_as_each_alone(seed: int) -> None:
    scenes = course(seed)
    together = answers(scenes, *METHODS)
    with pytest.MonkeyPatch.context() as patch:
        for module in (bayes, logit, visible):
            patch.setattr(module, "_RECENT", Recent(0))
        assert {name: answers(scenes, name)[name] for name in METHODS} == together


def test_a_belief_is_computed_once_for_all_methods_with_its_assumptions(monkeypatch: pytest.MonkeyPatch) -> None:
    computed = []
    update = bayes.update
    monkeypatch.setattr(bayes, "update", lambda *asked: computed.append(asked) or update(*asked))
    scenes = course(20_000)
    for names, count in (
        (("bayes", "bayes, both", "logit", "logit, both"), 1),
        (("bayes", "bayes, told", "bayes, off"), 3),
    ):
        computed.clear()
        monkeypatch.setattr(bayes, "_RECENT", Recent(16))
        answers(scenes, *names)
        # the second person has no cue in one frame of six; every method begins with the same belief
        assert len(computed) == count * 11 - (2 if "bayes, off" in names else 0)


def test_only_the_same_question_has_the_same_answer() -> None:
    recent: Recent[object] = Recent(2)
    array, equal = np.zeros(2), np.zeros(2)
    first = recent.get((array,), (1,), object)
    assert recent.get((array,), (1,), object) is first
    others = [recent.get(*asked, object) for asked in (((equal,), (1,)), ((array,), (2,)), ((array, array), (1,)))]
    assert first not in others
    assert recent.get((array,), (1,), object) is not first  # two others came since
