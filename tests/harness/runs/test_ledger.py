from __future__ import annotations

from harness.runs.ledger import Ledger
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
