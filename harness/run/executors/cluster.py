"""A Dask cluster: a scheduler and its workers, here or on other machines."""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING
from uuid import uuid4

from harness.files.code_digest import code_digest
from harness.run.executors.contract import GIVEN_UP, Job, Lost, Outcome, Progress, Work
from harness.run.executors.worker import COUNTS, TOPIC, Surroundings, note_stopped, on_worker
from vfoa.errors import VfoaError

if TYPE_CHECKING:
    from distributed import Client, Future

_ADDRESS = re.compile(r"[a-z]+://.+:\d+")
PATIENCE_SECONDS = 30


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
    if not _ADDRESS.fullmatch(address):
        raise VfoaError(
            f"--scheduler {address}: expected the address of a Dask scheduler, such as tcp://127.0.0.1:8786"
        )
    try:
        client = Client(address, timeout=PATIENCE_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:
        raise VfoaError(f"--scheduler {address}: expected a Dask scheduler, found none: {error}") from None
    logger = logging.getLogger("distributed.client")
    level = logger.level
    logger.setLevel(logging.CRITICAL)  # what it logs with tracebacks is raised as well, and told in one line
    try:
        with client:
            _check_workers(client, address)
            yield client
    finally:
        logger.setLevel(level)


@contextmanager
def local_cluster(workers: int) -> Iterator[str]:
    """Yield the address of a new scheduler on this machine with this many single-threaded worker processes."""
    from distributed import LocalCluster

    # any free port: the default is 8787 on all networks, which another cluster may use
    dashboard = {"dashboard_address": "127.0.0.1:0"}
    options = {"n_workers": workers, "threads_per_worker": 1, "host": "127.0.0.1", **dashboard}
    with LocalCluster(**options, silence_logs=50) as cluster:
        yield cluster.scheduler_address


def cpu_seconds(address: str) -> float:
    """CPU seconds that the workers of the scheduler at ``address`` have used so far."""
    with connect(address) as client:
        return float(sum(client.run(time.process_time).values()))


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
    read the file ``sees``.
    """

    threads = 1

    def __init__(self, client: Client, modules: tuple[str, ...] = (), sees: Path | None = None) -> None:
        self._client, self._sees = client, sees
        self._code = modules, code_digest(modules)
        self.workers = len(client.nthreads())

    def run(
        self, work: Work[Job, Outcome], jobs: Sequence[Job], progress: Progress, lost: Lost[Job, Outcome]
    ) -> Iterator[Outcome]:
        """As :class:`harness.run.executors.Executor`.

        If the caller stops iterating, or is interrupted, control returns when no worker runs a job any more: queued
        jobs do not begin, and running ones stop after the current frame.
        """
        from distributed import CancelledError, KilledWorker
        from distributed.comm import CommClosedError

        def heard(event: tuple[float, dict[str, dict[str, int]]]) -> None:
            for word, count in event[1][COUNTS].items():
                for _ in range(count):
                    progress(word)

        self._client.subscribe_topic(TOPIC, heard)
        here = Surroundings()
        run = uuid4().hex
        submit = partial(self._client.submit, on_worker, here, self._code, self._sees, run, work, pure=False)
        futures = [submit(job) for job in jobs]
        try:
            for job, future in zip(jobs, futures, strict=True):
                try:
                    yield future.result()
                except KilledWorker:
                    yield lost(job, GIVEN_UP)
                except (CancelledError, CommClosedError):
                    raise VfoaError(
                        "--scheduler: the scheduler is gone; what is finished is kept: start a "
                        "scheduler and workers, and run the same command again"
                    ) from None
        finally:
            with suppress(CommClosedError, CancelledError, TimeoutError, OSError):  # of a scheduler that is gone
                _end(self._client, futures, run)
                self._client.cancel(futures)
                self._client.unsubscribe_topic(TOPIC)


def _end(client: Client, futures: Sequence[Future], run: str) -> None:
    """Stop the running jobs and wait for them: another run may begin at once with the same files."""
    deadline = time.monotonic() + PATIENCE_SECONDS
    while (running := [each for each in futures if not each.done()]) and time.monotonic() < deadline:
        client.run(note_stopped, run, on_error="ignore")  # repeatedly: a worker may have joined meanwhile
        with suppress(TimeoutError):
            running[0].exception(timeout=1)
