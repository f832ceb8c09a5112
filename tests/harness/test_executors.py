from __future__ import annotations

import os
from collections.abc import Callable

import pytest

from harness.executors import work_through


def _square(number: int, progress: Callable[[str], None]) -> tuple[int, int]:
    import cv2

    progress(str(number))
    return number**2, cv2.getNumThreads()


def _fail(number: int, progress: Callable[[str], None]) -> int:
    raise ZeroDivisionError(f"job {number}")


@pytest.mark.parametrize("workers", [1, 2])
def test_outcomes_come_in_the_order_of_the_jobs_with_one_thread_each(workers: int) -> None:
    told: list[str] = []
    outcomes = list(work_through(_square, [3, 1, 2], workers, told.append))
    assert outcomes == [(9, 1), (1, 1), (4, 1)]
    assert sorted(told) == ["1", "2", "3"]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_bug_keeps_its_type_and_message(workers: int) -> None:
    with pytest.raises(ZeroDivisionError, match="job 1"):
        list(work_through(_fail, [1, 2], workers, lambda word: None))


def _pid(number: int, progress: Callable[[str], None]) -> int:
    return os.getpid()


def test_one_worker_stays_in_this_process() -> None:
    assert set(work_through(_pid, [1, 2], 1, lambda word: None)) == {os.getpid()}
