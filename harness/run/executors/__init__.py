"""The protocol of an executor, and the executor that works in this process.

Workers compute with one thread each, which is the fastest for all together. A single process may use a few threads,
with the same results (a guided filter in OpenCV differs in the last bit from eight threads on, so four is the limit). A
worker that dies is replaced, and its jobs are repeated. A job that kills its worker every time is given up; the others
finish.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Protocol, TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")
Progress = Callable[[str], None]
"""Called with the name of what has advanced (the clip's name, once per frame)."""
Bar = Callable[[int, str], AbstractContextManager[Progress]]
"""Shows the progress of work on frames: called with their number and the name of the work."""

Work = Callable[[Job, Progress], Result]
Lost = Callable[[Job, str], Result]
"""Makes the outcome of a job that was given up, from the job and the reason."""


GOES_ON = ""
"""The word of a call of progress that reports nothing, and only asks whether the run goes on."""


@contextmanager
def no_bar(total: int, what: str) -> Iterator[Progress]:
    """Show nothing."""
    yield lambda clip: None


class StoppedError(Exception):
    """The run was interrupted: a worker stops after the current frame."""


MOST_THREADS = 4

ATTEMPTS = 3
"""Number of times that a job may kill its worker."""

GIVEN_UP = f"its worker process died {ATTEMPTS} times"


class Executor(Protocol):
    """Runs jobs."""

    workers: int
    """Number of jobs that run at a time."""
    threads: int
    """Number of threads that a job may use."""

    def run(
        self, work: Work[Job, Result], jobs: Sequence[Job], progress: Progress, lost: Lost[Job, Result]
    ) -> Iterator[Result]:
        """Yield ``work(job, progress)`` for each job, in the order of the jobs, each as soon as it is finished.

        ``work`` is a function of a module. Workers continue while the caller handles an outcome.
        """
        ...


class InProcess:
    """Runs one job after the other in this process, with a few threads."""

    workers = 1

    def __init__(self, threads: int = 1) -> None:
        self.threads = min(threads, MOST_THREADS)

    def run(
        self, work: Work[Job, Result], jobs: Sequence[Job], progress: Progress, lost: Lost[Job, Result]
    ) -> Iterator[Result]:
        """As :class:`Executor`."""
        compute_with(self.threads)
        for job in jobs:
            yield work(job, lambda word: None if word == GOES_ON else progress(word))


CGROUP = Path("/sys/fs/cgroup")
"""Where Linux has the limits of a container or of a job of a cluster, and of version 1 in ``cpu/``."""


def cores() -> int:
    """The number of cores that this process may use: at most those that a cluster's job or a container was given.

    A node has more cores than a job of a scheduler may run on, and a container may have a share of the time of all.
    """
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    shares = [_numbers("cpu.max"), _numbers("cpu/cpu.cfs_quota_us") + _numbers("cpu/cpu.cfs_period_us")]
    limits = [math.ceil(share[0] / share[1]) for share in shares if len(share) == 2 and min(share) > 0]
    return min(allowed, *limits) if limits else allowed


def _numbers(name: str) -> list[int]:
    """The numbers in a file of the control group; a limit that is not set is a word, or -1."""
    try:
        words = (CGROUP / name).read_text().split()
    except OSError:
        return []
    return [int(word) for word in words if word.lstrip("-").isdecimal()]


def compute_with(threads: int) -> None:
    """Set the number of threads that this process computes with."""
    import cv2

    cv2.setNumThreads(threads)
