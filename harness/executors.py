"""Ways to work through jobs: in this process, or in a pool of spawned ones."""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.queues import SimpleQueue
from typing import TypeVar

Job = TypeVar("Job")
Outcome = TypeVar("Outcome")
Progress = Callable[[str], None]
"""Called with a word on what has just moved on (the clip's name, once a frame)."""

Work = Callable[[Job, Progress], Outcome]

_queue: SimpleQueue[str | None] | None = None


def work_through(work: Work[Job, Outcome], jobs: Sequence[Job], workers: int, progress: Progress) -> Iterator[Outcome]:
    """Yield ``work(job, progress)`` for each job, in the order of the jobs.

    ``work`` is a module-level function. Every process computes with one thread, so that the results do not depend
    on the number of workers (a guided filter in OpenCV differs in its last bit with the number of threads).
    """
    if workers == 1 or len(jobs) == 1:
        _one_thread()
        for job in jobs:
            yield work(job, progress)
        return
    context = multiprocessing.get_context("spawn")
    queue: SimpleQueue[str | None] = context.SimpleQueue()
    listener = threading.Thread(target=_listen, args=(queue, progress))
    listener.start()
    try:
        with ProcessPoolExecutor(
            min(workers, len(jobs)), mp_context=context, initializer=_start_worker, initargs=(queue,)
        ) as pool:
            yield from pool.map(_in_worker, [work] * len(jobs), jobs)
    finally:
        queue.put(None)
        listener.join()


def _one_thread() -> None:
    import cv2

    cv2.setNumThreads(1)


def _start_worker(queue: SimpleQueue[str | None]) -> None:
    global _queue
    _queue = queue
    _one_thread()


def _in_worker(work: Work[Job, Outcome], job: Job) -> Outcome:
    queue = _queue
    if queue is None:
        raise AssertionError("the worker was not started by work_through")
    return work(job, queue.put)


def _listen(queue: SimpleQueue[str | None], progress: Progress) -> None:
    while (word := queue.get()) is not None:
        progress(word)
