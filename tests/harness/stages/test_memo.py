from __future__ import annotations

from types import SimpleNamespace

import pytest

from harness.stages.stage_runner import StageMemo, Timings, timed
from vfoa.tracking import TrackingSettings


def test_a_call_is_made_once_for_the_same_inputs() -> None:
    memo, calls = StageMemo(), []
    thing = object()

    def work(given: object) -> object:
        calls.append(given)
        return object()

    first, second = memo.call("stage", work, thing), memo.call("stage", work, thing)
    assert first is second
    assert calls == [thing]
    assert memo.call("stage", work, object()) is not first


def test_everyone_who_uses_an_output_is_charged_in_full() -> None:
    memo, thing = StageMemo(), object()

    def work(given: object) -> object:
        return given

    memo.call("stage", work, thing)
    first, memo.timings = memo.timings, {}
    memo.call("stage", work, thing)
    assert memo.timings == first
    assert first["stage"] > 0


def test_a_call_within_a_call_is_charged_under_its_own_name_again_and_again() -> None:
    memo, thing = StageMemo(), object()

    def inner(given: object) -> object:
        return given

    def outer(given: object) -> object:
        return memo.call("inner", inner, given)

    memo.call("outer", outer, thing)
    first, memo.timings = memo.timings, {}
    memo.call("outer", outer, thing)
    assert list(first) == list(memo.timings) == ["inner"]
    assert first == memo.timings


def test_equal_objects_are_different_inputs_but_equal_settings_are_the_same() -> None:
    memo = StageMemo()

    def work(given: object) -> object:
        return object()

    assert len({id(memo.call("stage", work, [1])) for _ in range(3)}) == 3
    assert len({id(memo.call("stage", work, TrackingSettings())) for _ in range(3)}) == 1


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A clock that stands unless a test moves it."""
    now = SimpleNamespace(s=100.0)
    monkeypatch.setattr("harness.stages.stage_runner.time", SimpleNamespace(perf_counter=lambda: now.s))
    return now


def test_a_block_is_charged_its_seconds_and_a_second_one_added(clock: SimpleNamespace) -> None:
    timings: Timings = {"decode": 3.0}
    for seconds in (2.5, 0.5):
        with timed(timings, "stereo"):
            clock.s += seconds
    assert timings == {"decode": 3.0, "stereo": 3.0}


def test_a_function_is_charged_or_else_the_calls_it_makes_and_whoever_shares_them_in_full(
    clock: SimpleNamespace,
) -> None:
    memo = StageMemo()

    def takes(seconds: float) -> float:
        clock.s += seconds
        return seconds

    def perceive() -> None:
        takes(8.0)  # its own time is nobody's: what it calls is charged
        for stage, seconds in (("stereo", 2.0), ("gaze", 1.0)):
            memo.call(stage, takes, seconds)

    one, two = 5.0, 7.0
    for _ in range(2):
        memo.timings = {"decode": 4.0}
        memo.call("attention", takes, one)
        memo.call("perceive", perceive)
        memo.call("attention", takes, two)
        assert memo.timings == {"decode": 4.0, "attention": 12.0, "stereo": 2.0, "gaze": 1.0}
