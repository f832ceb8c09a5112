"""A Dask cluster: a scheduler and its workers, here or on other machines."""

from __future__ import annotations

import logging
import os
import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self
from uuid import uuid4

from harness.files.digests import code_digest
from harness.files.folders import VARIABLE as CACHE_VARIABLE
from harness.files.remote import forget_copies
from harness.run.executors import GIVEN_UP, GOES_ON, Job, Lost, Progress, Result, StoppedError, Work, compute_with
from vfoa.errors import VfoaError

if TYPE_CHECKING:
    from distributed import Client, Future


_ADDRESS = re.compile(r"(tcp|tls|ucx|wss?)://.+:\d+")
"""Of the schemes that Dask knows. For another one it would wait a minute at the exit, and print a traceback."""
PATIENCE_SECONDS = 30


def check_address(address: str) -> None:
    """Raise :class:`VfoaError` for what is no address of a scheduler; whether one answers there is not checked."""
    if not _ADDRESS.fullmatch(address):
        raise VfoaError(
            f"--scheduler {address}: expected the address that `dask scheduler` prints, such as tcp://127.0.0.1:8786"
        )


@contextmanager
def connect(address: str) -> Iterator[Client]:
    """Yield a client of the scheduler at ``tcp://host:port``.

    Raises
    ------
    VfoaError
        If it does not answer, has no workers, or has workers with several threads.
    """
    try:
        from distributed import Client
    except ImportError:
        raise VfoaError("--scheduler: needs Dask's distributed; install vfoa[cluster]") from None
    check_address(address)
    try:
        client = Client(address, timeout=PATIENCE_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:
        raise VfoaError(f"--scheduler {address}: expected a Dask scheduler, found none: {error}") from None
    logger = logging.getLogger("distributed.client")
    level = logger.level
    logger.setLevel(logging.CRITICAL)  # it logs tracebacks of errors that are also raised, and reported in one line
    try:
        with client:
            _check_workers(client, address)
            yield client
    finally:
        logger.setLevel(level)


def _check_workers(client: Client, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=PATIENCE_SECONDS)
    except OSError:
        raise VfoaError(f"--scheduler {address}: has no workers; start some with dask worker --nthreads 1") from None
    for worker, threads in client.nthreads().items():
        if threads != 1:
            raise VfoaError(f"{worker}: has {threads} threads; expected one: dask worker --nthreads 1")


class Cluster:
    """An executor on the workers of a Dask scheduler.

    Each worker must have one thread and the same code, and must find clips, weights and the run's directory at the same
    paths. It works in the folder from which the run was started, if it has that folder, and with the same ``VFOA_``
    variables, except a ``VFOA_CACHE`` of its own. Each job holds the digest of the code of ``modules``, which decide
    the results: a worker with other code, which may join during the run, refuses the job. So does a worker that cannot
    read ``shared_file``.
    """

    threads = 1

    def __init__(self, client: Client, modules: tuple[str, ...] = (), shared_file: Path | None = None) -> None:
        self._client, self._shared_file = client, shared_file
        self._code = modules, code_digest(modules)
        self._running: dict[str, list[Future[Any]]] = {}
        self.workers = len(client.nthreads())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """End the runs of which a caller that was interrupted still holds the iterator."""
        for run in tuple(self._running):
            self._end(run)

    def run(
        self, work: Work[Job, Result], jobs: Sequence[Job], progress: Progress, lost: Lost[Job, Result]
    ) -> Iterator[Result]:
        """As :class:`harness.run.executors.Executor`; the progress of a job is reported when it is finished.

        When the iterator or this executor is closed, control returns when no worker runs a job any more: queued jobs do
        not begin, and running ones stop after the current frame.
        """
        from distributed import CancelledError, KilledWorker
        from distributed.comm import CommClosedError

        here = Surroundings()
        run = uuid4().hex
        submit = partial(self._client.submit, on_worker, here, self._code, self._shared_file, run, work, pure=False)
        futures = self._running.setdefault(run, [])
        try:
            futures += map(submit, jobs)
            for job, future in zip(jobs, futures, strict=True):
                try:
                    outcome, words = future.result()
                except KilledWorker:
                    yield lost(job, GIVEN_UP)
                except (CancelledError, CommClosedError):
                    raise VfoaError(
                        "--scheduler: the scheduler is gone; what is finished is kept: start a "
                        "scheduler and workers, and run the same command again"
                    ) from None
                else:
                    for word in words:
                        progress(word)
                    yield outcome
        finally:
            self._end(run)

    def _end(self, run: str) -> None:
        """Stop the running jobs and wait for them, unless that was done: another run may begin with the same files."""
        from distributed import CancelledError
        from distributed.comm import CommClosedError

        if not (futures := self._running.pop(run, [])):
            return
        deadline = time.monotonic() + PATIENCE_SECONDS
        with suppress(CommClosedError, CancelledError, TimeoutError, OSError):  # of a scheduler that is gone
            while (running := [future for future in futures if not future.done()]) and time.monotonic() < deadline:
                self._client.run(note_stopped, run, on_error="ignore")  # repeatedly: a worker may have joined meanwhile
                with suppress(TimeoutError):
                    running[0].exception(timeout=1)
            self._client.cancel(futures)


_stopped: set[str] = set()
"""In a worker: the runs whose jobs must stop."""


def note_stopped(run: str) -> None:
    """Let the jobs of a run stop after the current frame."""
    _stopped.add(run)


_OWN_CACHE, _OWN_FOLDER = os.environ.get(CACHE_VARIABLE), Path.cwd()
"""In a worker: the value of ``VFOA_CACHE`` and the folder that it was started with."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """The folder and the environment variables that paths and weights depend on."""

    folder: str = field(default_factory=lambda: str(Path.cwd()))
    variables: dict[str, str] = field(
        default_factory=lambda: {name: value for name, value in os.environ.items() if name.startswith("VFOA_")}
    )

    def enter(self) -> None:
        """Set the folder and the variables in this process, as far as this machine has them."""
        os.chdir(self.folder if Path(self.folder).is_dir() else _OWN_FOLDER)
        variables = self.variables | ({CACHE_VARIABLE: _OWN_CACHE} if _OWN_CACHE else {})
        for name in [name for name in os.environ if name.startswith("VFOA_") and name not in variables]:
            del os.environ[name]
        os.environ.update(variables)


_run = ""
"""In a worker: the run of the job before."""


def on_worker(
    here: Surroundings,
    code: tuple[tuple[str, ...], str],
    shared_file: Path | None,
    run: str,
    work: Callable[[Any, Progress], Any],
    job: Any,
) -> tuple[Any, list[str]]:
    """Return ``work(job, progress)``, and what ``progress`` was called with.

    Parameters
    ----------
    here
        The folder and the variables of the process that started the run.
    code
        Modules that decide the results, and the digest of their code there.
    shared_file
        A file of the run, which is on a shared disk.
    run
        A name for the run, the same for all of its jobs.

    Raises
    ------
    VfoaError
        If this worker has other code, does not see the file, or cannot read or write what it needs; the message names
        the worker.
    """
    from distributed import get_worker

    words: list[str] = []

    def progress(word: str) -> None:
        if word != GOES_ON:
            words.append(word)
        _check_goes_on(run)

    try:
        _prepare(here, code, shared_file, run)
        _check_goes_on(run)
        return work(job, progress), words
    except VfoaError as error:  # such as that of a storage that only this worker cannot read
        if type(error) is VfoaError:
            raise VfoaError(f"{get_worker().address}: {error}") from None
        raise


def _prepare(here: Surroundings, code: tuple[tuple[str, ...], str], shared_file: Path | None, run: str) -> None:
    """Take on the surroundings of a run, and check that this worker can work for it; see :func:`on_worker`."""
    global _run
    here.enter()
    if run != _run:  # a clip may have changed since the last one
        forget_copies()
        _run = run
    compute_with(1)
    modules, digest = code
    if code_digest(modules) != digest:
        raise VfoaError("runs another version of vfoa; expected the same source as here")
    if shared_file is not None and not _appears(shared_file):
        raise VfoaError(f"cannot read {shared_file}; expected the disk of the run's directory at the same path")


def _check_goes_on(run: str) -> None:
    if run in _stopped:
        raise StoppedError


def _appears(path: Path) -> bool:
    """Whether a file that was just written exists here: shared disks may show it after a delay."""
    deadline = time.monotonic() + PATIENCE_SECONDS
    while not path.exists():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.2)
    return True
