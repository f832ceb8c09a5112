"""A pool of spawned processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event
from typing import Self

from harness.processes import spawning
from harness.run.executors.contract import (
    ATTEMPTS,
    GIVEN_UP,
    InProcess,
    Job,
    Lost,
    Outcome,
    Progress,
    StoppedError,
    Work,
    compute_with,
)

_SPAWN = spawning()
_FLUSH, _END = b"\0flush", b"\0end"
_told: Connection | None = None
_stop: Event | None = None


class Pool:
    """A pool of spawned processes, as a context manager. Imports and open clips are reused from run to run.

    The death of a process breaks the whole pool: new processes continue with the unfinished jobs.
    """

    threads = 1
    is_elsewhere = False

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._listener: _Listener | None = None
        self._processes: ProcessPoolExecutor | None = None
        self._started = 0
        self._ending = _SPAWN.Event()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        if error[0] is not None:
            self._ending.set()  # running jobs stop after the current frame
        self._stop()
        if self._listener:
            self._listener.close()

    def run(
        self, work: Work[Job, Outcome], jobs: Sequence[Job], progress: Progress, lost: Lost[Job, Outcome]
    ) -> Iterator[Outcome]:
        """As :class:`harness.run.executors.Executor`."""
        if len(jobs) == 1:  # a single job needs no process of its own
            yield from InProcess().run(work, jobs, progress, lost)
            return
        done: dict[int, Outcome] = {}
        given = 0
        for _ in range(ATTEMPTS - 1):
            left = {number: job for number, job in enumerate(jobs) if number >= given and number not in done}
            for number, outcome in self._attempt(work, left, progress):
                done[number] = outcome
                while given in done:
                    yield done.pop(given)
                    given += 1
        for number in range(given, len(jobs)):
            if number not in done:  # whichever job killed the others, it is alone now
                done.update(self._attempt(work, {number: jobs[number]}, progress))
            yield done.pop(number) if number in done else lost(jobs[number], GIVEN_UP)

    def _attempt(
        self, work: Work[Job, Outcome], jobs: dict[int, Job], progress: Progress
    ) -> Iterator[tuple[int, Outcome]]:
        """Yield the outcomes of jobs that finished before a worker died, in their order, as soon as they are there."""
        if not jobs:
            return
        broken, futures = False, dict[int, Future[Outcome]]()
        try:
            processes, listener = self._start(len(jobs), progress)
            for number, job in jobs.items():
                futures[number] = processes.submit(_in_worker, work, job)
        except BrokenProcessPool:
            broken = True
        try:
            for number, future in futures.items():
                try:
                    outcome = future.result()
                except BrokenProcessPool:
                    broken = True
                else:
                    yield number, outcome
            listener.flush()
        finally:
            for future in futures.values():
                future.cancel()
            if broken:
                self._stop()

    def _start(self, jobs: int, progress: Progress) -> tuple[ProcessPoolExecutor, _Listener]:
        """Start enough processes for this many jobs; running ones are reused."""
        wanted = min(self.workers, jobs)
        if self._started < wanted:
            self._stop()
        self._listener = self._listener or _Listener(progress)
        self._listener.progress = progress
        if self._processes is None:
            self._started = wanted
            self._processes = ProcessPoolExecutor(
                wanted, mp_context=_SPAWN, initializer=_begin, initargs=(self._listener.told, self._ending)
            )
        return self._processes, self._listener

    def _stop(self) -> None:
        if self._processes:
            self._processes.shutdown(cancel_futures=True)
        self._processes, self._started = None, 0


class _Listener:
    """Receives the progress of workers. No lock is needed: each message is short enough to be written atomically."""

    def __init__(self, progress: Progress) -> None:
        self.progress = progress
        self._heard, self.told = _SPAWN.Pipe(duplex=False)
        self._flushed = threading.Event()
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def _listen(self) -> None:
        while (word := self._heard.recv_bytes()) != _END:
            if word == _FLUSH:
                self._flushed.set()
            else:
                self.progress(word.decode())

    def flush(self) -> None:
        """Return when all earlier messages are received."""
        self._flushed.clear()
        self.told.send_bytes(_FLUSH)
        self._flushed.wait()

    def close(self) -> None:
        """Receive the remaining messages, and end."""
        self.told.send_bytes(_END)
        self._thread.join()
        self._heard.close()
        self.told.close()


def _begin(told: Connection, stop: Event) -> None:
    global _told, _stop
    _told, _stop = told, stop
    for name in ("SIGINT", "SIGHUP"):  # a terminal sends Ctrl-C to all processes; the parent decides
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    compute_with(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process with its parent: after a killed run, another run may continue its files."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _in_worker(work: Work[Job, Outcome], job: Job) -> Outcome:
    told, stop = _told, _stop
    if told is None or stop is None:
        raise AssertionError("the worker was not started by a pool")

    def progress(word: str) -> None:
        told.send_bytes(word.encode())
        if stop.is_set():
            raise StoppedError

    if stop.is_set():
        raise StoppedError
    return work(job, progress)
