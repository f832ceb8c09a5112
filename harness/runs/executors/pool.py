"""A pool of spawned processes."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import Connection

from harness.runs.executors import ATTEMPTS, InProcess, Job, Lost, Outcome, Progress, Work, compute_with

_SPAWN = multiprocessing.get_context("spawn")
_END = b""
_told: Connection | None = None


class Pool:
    """So many spawned processes. A death breaks a whole pool: a new one goes on with what is not done."""

    threads = 1

    def __init__(self, workers: int) -> None:
        self.workers = workers

    def run(
        self, work: Work[Job, Outcome], jobs: Sequence[Job], progress: Progress, lost: Lost[Job, Outcome]
    ) -> Iterator[Outcome]:
        """As :class:`harness.runs.executors.Executor`."""
        if len(jobs) == 1:  # it would be waited for alone, and its process started for nothing
            yield from InProcess().run(work, jobs, progress, lost)
            return
        done: dict[int, Outcome] = {}
        for _ in range(ATTEMPTS - 1):
            done |= self._attempt(work, {n: job for n, job in enumerate(jobs) if n not in done}, progress)
        for number, job in enumerate(jobs):
            if number not in done:  # whoever it was that took the others along, it is alone now
                done |= self._attempt(work, {number: job}, progress)
            yield done[number] if number in done else lost(job, f"its worker process died {ATTEMPTS} times over")

    def _attempt(self, work: Work[Job, Outcome], jobs: dict[int, Job], progress: Progress) -> dict[int, Outcome]:
        """The outcomes of what could be finished before a worker died."""
        if not jobs:
            return {}
        done: dict[int, Outcome] = {}
        with (
            _listening(progress) as told,
            ProcessPoolExecutor(
                min(self.workers, len(jobs)), mp_context=_SPAWN, initializer=_start, initargs=(told,)
            ) as pool,
        ):
            try:
                futures = {number: pool.submit(_in_worker, work, job) for number, job in jobs.items()}
            except BrokenProcessPool:
                return {}
            for number, future in futures.items():
                try:
                    done[number] = future.result()
                except BrokenProcessPool:
                    continue
        return done


@contextmanager
def _listening(progress: Progress) -> Iterator[Connection]:
    """Yield where workers write what has moved on. No lock: so short a write is whole, whenever its writer dies."""
    heard, told = _SPAWN.Pipe(duplex=False)
    listener = threading.Thread(target=_listen, args=(heard, progress))
    listener.start()
    try:
        yield told
    finally:
        told.send_bytes(_END)
        listener.join()
        heard.close()
        told.close()


def _listen(heard: Connection, progress: Progress) -> None:
    while (word := heard.recv_bytes()) != _END:
        progress(word.decode())


def _start(told: Connection) -> None:
    global _told
    _told = told
    compute_with(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Do not outlive a run that was killed: another may go on with its files."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _in_worker(work: Work[Job, Outcome], job: Job) -> Outcome:
    told = _told
    if told is None:
        raise AssertionError("the worker was not started by a pool")
    return work(job, lambda word: told.send_bytes(word.encode()))
