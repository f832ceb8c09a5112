"""The protocol of an executor, and the executor that works in this process.

Workers compute with one thread each, which is the fastest for all together. A single process may use a few threads,
with the same results (a guided filter in OpenCV differs in the last bit from eight threads on, so four is the limit). A
worker that dies is replaced, and its jobs are repeated. A job that kills its worker every time is given up; the others
finish.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
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

GIVEN_UP = f"its worker process died {ATTEMPTS} times over"


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


def compute_with(threads: int) -> None:
    """Set the number of threads that this process computes with."""
    import cv2

    cv2.setNumThreads(threads)
