"""The protocol of an executor, and the one that works in this process.

Workers compute with one thread each: that is the quickest for all together. Where one process does everything, it may
use a few, with the same results (a guided filter in OpenCV differs in its last bit from eight threads on: four are the
most). A worker that dies is replaced, and its jobs are done again; a job that takes its worker along every time is
given up, and the others are finished.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol, TypeVar

Job = TypeVar("Job")
Outcome = TypeVar("Outcome")
Progress = Callable[[str], None]
"""Called with a word on what has just moved on (the clip's name, once a frame)."""

Work = Callable[[Job, Progress], Outcome]
Lost = Callable[[Job, str], Outcome]
"""The outcome of a job that was given up, and why."""


class StoppedError(Exception):
    """The run was interrupted: a worker stops after the frame in hand."""


MOST_THREADS = 4

ATTEMPTS = 3
"""How often a job may take its worker along."""

GIVEN_UP = f"its worker process died {ATTEMPTS} times over"


class Executor(Protocol):
    """Works through jobs."""

    @property
    def workers(self) -> int:
        """How many jobs are done at a time."""
        ...

    @property
    def threads(self) -> int:
        """With how many threads a job may be done."""
        ...

    @property
    def is_elsewhere(self) -> bool:
        """Whether workers may be on other machines."""
        ...

    def run(
        self, work: Work[Job, Outcome], jobs: Sequence[Job], progress: Progress, lost: Lost[Job, Outcome]
    ) -> Iterator[Outcome]:
        """Yield ``work(job, progress)`` for each job, in the order of the jobs, each as soon as it is there.

        ``work`` is a module's function. Workers go on while whoever asked deals with an outcome.
        """
        ...


class InProcess:
    """One job after the other, here, with a few threads."""

    workers = 1
    is_elsewhere = False

    def __init__(self, threads: int = 1) -> None:
        self.threads = min(threads, MOST_THREADS)

    def run(
        self, work: Work[Job, Outcome], jobs: Sequence[Job], progress: Progress, lost: Lost[Job, Outcome]
    ) -> Iterator[Outcome]:
        """As :class:`Executor`."""
        compute_with(self.threads)
        for job in jobs:
            yield work(job, progress)


def compute_with(threads: int) -> None:
    """Set the number of threads that this process computes with."""
    import cv2

    cv2.setNumThreads(threads)
