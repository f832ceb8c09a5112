"""A pool of spawned processes, which end within seconds when the run is interrupted, whatever they are doing."""

from __future__ import annotations

import logging
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
import zlib
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from ctypes import c_bool
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext, SpawnProcess
from types import ModuleType
from typing import Any, Self

from harness.files.digests import IMPORTED
from harness.files.folders import UNWRITABLE
from harness.processes import keep_working_directory_out
from harness.run.executors import (
    ATTEMPTS,
    GIVEN_UP,
    GOES_ON,
    InProcess,
    Job,
    Lost,
    Progress,
    Result,
    StoppedError,
    Work,
    compute_with,
)

_log = logging.getLogger(__name__)

_FLUSH, _END = b"\0flush", b"\0end"
_ENDED = (None, 0, -signal.SIGTERM)
"""Exit codes of the processes of a pool that did not break it: they went on, or were ended because another one died."""
_sender: Connection | None = None
_stop: c_bool | None = None

GRACE_S = 2.0
"""Seconds that the workers of an interrupted run have for their current frame; then they are killed."""


class _Spawning(SpawnContext):
    """The context of one pool, which knows its processes, also one whose start was interrupted."""

    def __init__(self) -> None:
        super().__init__()
        self.started: list[SpawnProcess] = []

    def Process(self, *args: Any, **options: Any) -> SpawnProcess:  # type: ignore[override]  # noqa: N802
        """Make a process and note it."""
        self.started.append(_WithoutScript(*args, **options))
        return self.started[-1]


class _WithoutScript(SpawnProcess):
    """A process that does not run the script of its parent again: one without ``if __name__ == "__main__":`` may run.

    Nothing that a worker is given is defined there.
    """

    def start(self) -> None:
        """As of any process."""
        script = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            super().start()
        finally:
            sys.modules["__main__"] = script


class Pool:
    """A pool of spawned processes, as a context manager. Imports and open clips are reused from run to run.

    The death of a process breaks the whole pool: new processes continue with the unfinished jobs.
    """

    threads = 1

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._listener: _Listener | None = None
        self._processes: ProcessPoolExecutor | None = None
        self._started = 0
        self._death = ""
        keep_working_directory_out()
        self._context = _Spawning()
        with _ignored_by_children():
            self._ending = self._context.RawValue(c_bool, False)  # no Event: a killed worker may hold its lock

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        if error[0] is None:
            self._stop()
        else:
            self._give_up()
        if self._listener:
            self._listener.close()

    def run(
        self, work: Work[Job, Result], jobs: Sequence[Job], progress: Progress, lost: Lost[Job, Result]
    ) -> Iterator[Result]:
        """As :class:`harness.run.executors.Executor`."""
        if len(jobs) == 1:  # a single job needs no process of its own
            yield from InProcess().run(work, jobs, progress, lost)
            return
        done: dict[int, Result] = {}
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
            yield done.pop(number) if number in done else lost(jobs[number], f"{GIVEN_UP}: {self._death}")

    def _attempt(
        self, work: Work[Job, Result], jobs: dict[int, Job], progress: Progress
    ) -> Iterator[tuple[int, Result]]:
        """Yield the outcomes of jobs that finished before a worker died, in their order, as soon as they are there."""
        if not jobs:
            return
        broken, futures = False, dict[int, Future[Result]]()
        processes, listener = self._start(len(jobs), progress)
        try:
            with _ignored_by_children():
                for number, job in jobs.items():
                    futures[number] = processes.submit(_in_worker, work, job)
        except BrokenProcessPool:
            broken = True
        except OSError:  # perhaps a worker died while others were started: what they would be given is closed then
            if not (broken := _is_broken(processes)):
                raise
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
                self._note_death()

    def _note_death(self) -> None:
        """Note how a worker died, and say so the first time: the others were ended because of it."""
        codes = [process.exitcode for process in self._context.started]
        self._context.started.clear()
        is_first = not self._death
        self._death = _how_it_died(next((code for code in codes if code not in _ENDED), -signal.SIGTERM))
        if is_first:
            _log.warning("a worker process died: %s; unfinished clips are run again", self._death)

    def _start(self, jobs: int, progress: Progress) -> tuple[ProcessPoolExecutor, _Listener]:
        """Start enough processes for this many jobs; running ones are reused."""
        wanted = min(self.workers, jobs)
        if self._started < wanted:
            self._stop()
        self._listener = self._listener or _Listener(self._context, progress)
        self._listener.progress = progress
        if self._processes is None:
            self._started = wanted
            # compressed: what does not fit into a pipe, 64 kB, is awaited forever from a process that dies at its start
            given = self._listener.sender, self._ending, zlib.compress(pickle.dumps((IMPORTED, UNWRITABLE)))
            self._processes = ProcessPoolExecutor(wanted, mp_context=self._context, initializer=_begin, initargs=given)
        return self._processes, self._listener

    def _stop(self) -> None:
        if self._processes:
            self._processes.shutdown(cancel_futures=True)
        self._processes, self._started = None, 0

    def _give_up(self) -> None:
        """End the workers: those that do not stop after their current frame, or are still importing, are killed."""
        self._ending.value = True
        if self._processes:
            self._processes.shutdown(wait=False, cancel_futures=True)
        workers = [process for process in self._context.started if process.is_alive()]
        deadline = time.monotonic() + GRACE_S
        try:
            for worker in workers:
                worker.join(max(deadline - time.monotonic(), 0))
        finally:  # also after a second Ctrl-C
            for worker in workers:
                worker.kill()
                worker.join(GRACE_S)


def _is_broken(processes: ProcessPoolExecutor) -> bool:
    """Whether a process of a pool has died."""
    try:
        processes.submit(int)
    except BrokenProcessPool:
        return True
    except OSError:
        return False
    return False


def _how_it_died(code: int) -> str:
    """The exit code of a process in words."""
    if code >= 0:
        return f"ended with exit code {code}"
    name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
    hint = ", perhaps for lack of memory: use fewer --workers" if code == -signal.SIGKILL else ""
    return f"killed by {name}{hint}"


@contextmanager
def _ignored_by_children() -> Iterator[None]:
    """Hide the signals that a terminal sends to all processes from those that start in the block: the parent decides.

    A worker sets its own handlers only after its imports, and multiprocessing's tracker ignores no SIGHUP.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGHUP))
    try:
        resource_tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,))  # starting the tracker unblocks it
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Listener:
    """Receives the progress of workers. No lock is needed: each message is short enough to be written atomically."""

    def __init__(self, context: SpawnContext, progress: Progress) -> None:
        self.progress = progress
        self._receiver, self.sender = context.Pipe(duplex=False)
        self._flushed = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        while (word := self._receiver.recv_bytes()) != _END:
            if word == _FLUSH:
                self._flushed.set()
            else:
                self.progress(word.decode())

    def flush(self) -> None:
        """Return when all earlier messages are received."""
        self._flushed.clear()
        self.sender.send_bytes(_FLUSH)
        self._flushed.wait()

    def close(self) -> None:
        """Receive the remaining messages, and end."""
        self.sender.send_bytes(_END)
        self._thread.join()
        self._receiver.close()
        self.sender.close()


def _begin(pipe: Connection, stop: c_bool, known: bytes) -> None:
    """Begin a worker. ``known`` is what the parent's :data:`IMPORTED` and :data:`UNWRITABLE` have, for all workers."""
    global _sender, _stop
    _sender, _stop = pipe, stop
    imported, unwritable = pickle.loads(zlib.decompress(known))
    IMPORTED.update(imported)
    UNWRITABLE.update(unwritable)
    for number in (signal.SIGINT, signal.SIGHUP):  # a terminal sends them to all processes; the parent decides
        signal.signal(number, signal.SIG_IGN)
    compute_with(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process with its parent: after a killed run, another run may continue its files."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _in_worker(work: Work[Job, Result], job: Job) -> Result:
    pipe, stop = _sender, _stop
    if pipe is None or stop is None:
        raise AssertionError("_begin has not run in this worker process")

    def progress(word: str) -> None:
        if word != GOES_ON:
            pipe.send_bytes(word.encode())
        if stop.value:
            raise StoppedError

    if stop.value:
        raise StoppedError
    return work(job, progress)
