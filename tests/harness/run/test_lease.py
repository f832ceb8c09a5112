"""A lock on an address: one run at a time, taken over from a run that has ended."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from typing import Any

import pytest

from harness.remote import Remote
from harness.run import lease
from harness.run.lease import LOCK, leased
from vfoa.errors import VfoaError


@pytest.fixture
def told() -> list[str]:
    return []


def _leave_lock(address: str, **changes: Any) -> dict[str, Any]:
    """Write a lock as another run does."""
    owner = {**lease._owner(), "token": "another", **changes}
    Remote(address).write(LOCK, json.dumps(owner).encode())
    return owner


def _ended_process() -> int:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_a_second_run_is_refused_until_the_first_one_ends(address: str, told: list[str]) -> None:
    with leased(address, told.append) as check:
        with pytest.raises(VfoaError, match=rf"^{address}: process \d+ on .* runs here since .*; expected one run"):  # noqa: SIM117
            with leased(address, told.append):
                pass
        check()
    assert not Remote(address).has(LOCK)
    with leased(address, told.append):
        pass
    assert told == []


def test_the_lock_of_an_ended_process_of_this_machine_is_taken_over_at_once(address: str, told: list[str]) -> None:
    process = _ended_process()
    _leave_lock(address, process=process)
    with leased(address, told.append) as check:
        check()
    assert len(told) == 1
    assert f"took over the lock of process {process} on " in told[0]


def test_the_lock_of_another_machine_is_taken_over_when_it_expires(
    address: str, told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    _leave_lock(address, process=_ended_process(), machine="another", host="far")
    with pytest.raises(VfoaError, match=r"process \d+ on far runs here"):  # noqa: SIM117
        with leased(address, told.append):
            pass
    assert Remote(address).has(LOCK)
    monkeypatch.setattr(lease, "LEASE_SECONDS", 0.0)
    with leased(address, told.append) as check:
        check()
    assert len(told) == 1


def test_the_owner_renews_the_lock_and_another_run_does_not(address: str) -> None:
    class Once(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            passed = self.is_set()
            self.set()
            return passed

    owner = _leave_lock(address)
    before = Remote(address).read(LOCK)
    lease._renew(Remote(address), {**owner, "token": "mine"}, b"mine", Once())
    assert Remote(address).read(LOCK) == before
    lease._renew(Remote(address), owner, b"renewed", Once())
    assert Remote(address).read(LOCK) == b"renewed"


def test_a_run_that_lost_its_lock_is_told_and_leaves_the_lock_of_the_other(address: str, told: list[str]) -> None:
    with leased(address, told.append) as check:
        _leave_lock(address)
        with pytest.raises(VfoaError, match="has taken over the lock of this run"):
            check()
    assert Remote(address).has(LOCK)


def test_a_damaged_lock_counts_as_another_run(address: str, told: list[str]) -> None:
    Remote(address).write(LOCK, b"\xff")
    with pytest.raises(VfoaError, match="another run runs here since an unknown time"):  # noqa: SIM117
        with leased(address, told.append):
            pass
