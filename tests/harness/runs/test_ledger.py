from __future__ import annotations

from types import SimpleNamespace

import pytest

from harness.runs.ledger import Bill, Ledger, timed
from vfoa.tracking import TrackingSettings


def test_a_call_is_made_once_for_the_same_inputs() -> None:
    ledger, calls = Ledger(), []
    thing = object()

    def work(given: object) -> object:
        calls.append(given)
        return object()

    first, second = ledger.call("stage", work, thing), ledger.call("stage", work, thing)
    assert first is second
    assert calls == [thing]
    assert ledger.call("stage", work, object()) is not first


def test_everyone_who_uses_an_output_is_billed_in_full() -> None:
    ledger, thing = Ledger(), object()

    def work(given: object) -> object:
        return given

    ledger.call("stage", work, thing)
    first, ledger.bill = ledger.bill, {}
    ledger.call("stage", work, thing)
    assert ledger.bill == first
    assert first["stage"] > 0


def test_a_call_within_a_call_is_billed_under_its_own_name_again_and_again() -> None:
    ledger, thing = Ledger(), object()

    def inner(given: object) -> object:
        return given

    def outer(given: object) -> object:
        return ledger.call("inner", inner, given)

    ledger.call("outer", outer, thing)
    first, ledger.bill = ledger.bill, {}
    ledger.call("outer", outer, thing)
    assert list(first) == list(ledger.bill) == ["inner"]
    assert first == ledger.bill


def test_equal_objects_are_different_inputs_but_equal_settings_are_the_same() -> None:
    ledger = Ledger()

    def work(given: object) -> object:
        return object()

    assert len({id(ledger.call("stage", work, [1])) for _ in range(3)}) == 3
    assert len({id(ledger.call("stage", work, TrackingSettings())) for _ in range(3)}) == 1


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A clock that stands unless a test moves it."""
    now = SimpleNamespace(s=100.0)
    monkeypatch.setattr("harness.runs.ledger.time", SimpleNamespace(perf_counter=lambda: now.s))
    return now


def test_a_block_is_billed_its_seconds_and_a_second_one_added(clock: SimpleNamespace) -> None:
    bill: Bill = {"decode": 3.0}
    for seconds in (2.5, 0.5):
        with timed(bill, "stereo"):
            clock.s += seconds
    assert bill == {"decode": 3.0, "stereo": 3.0}


def test_a_function_is_billed_or_else_the_calls_it_makes_and_whoever_shares_them_in_full(
    clock: SimpleNamespace,
) -> None:
    ledger = Ledger()

    def takes(seconds: float) -> float:
        clock.s += seconds
        return seconds

    def perceive() -> None:
        takes(8.0)  # its own time is nobody's: what it calls is billed
        for stage, seconds in (("stereo", 2.0), ("gaze", 1.0)):
            ledger.call(stage, takes, seconds)

    one, two = 5.0, 7.0
    for _ in range(2):
        ledger.bill = {"decode": 4.0}
        ledger.call("attention", takes, one)
        ledger.call("perceive", perceive)
        ledger.call("attention", takes, two)
        assert ledger.bill == {"decode": 4.0, "attention": 12.0, "stereo": 2.0, "gaze": 1.0}
