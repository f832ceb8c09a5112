"""A Dask cluster: a scheduler and its workers, here or on other machines."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.runs import provenance
from harness.runs.executors import GIVEN_UP, Job, Lost, Outcome, Progress, Work, compute_with
from vfoa.errors import VfoaError

if TYPE_CHECKING:
    from distributed import Client

TOPIC = "vfoa"
PATIENCE_SECONDS = 30


@contextmanager
def connect(address: str) -> Iterator[Client]:
    """Yield a client of the scheduler at ``tcp://host:port``.

    Raises
    ------
    VfoaError
        If it does not answer, or its workers are none, have several threads, or run another program.
    """
    try:
        from distributed import Client
    except ImportError:
        raise VfoaError("--scheduler: needs Dask's distributed; install vfoa[cluster]") from None
    try:
        client = Client(address, timeout=PATIENCE_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:
        raise VfoaError(f"--scheduler {address}: expected a Dask scheduler, found none: {error}") from None
    with client:
        _check_workers(client, address)
        yield client


@contextmanager
def local_cluster(workers: int) -> Iterator[str]:
    """Yield the address of a scheduler on this machine with so many workers: processes of one thread."""
    from distributed import LocalCluster

    # any free port: without an address it takes 8787, of every network, which another cluster may have
    dashboard = {"dashboard_address": "127.0.0.1:0"}
    options = {"n_workers": workers, "threads_per_worker": 1, "host": "127.0.0.1", **dashboard}
    with LocalCluster(**options, silence_logs=50) as cluster:
        yield cluster.scheduler_address


def cpu_seconds(address: str) -> float:
    """What the workers of the scheduler at ``address`` have computed so far."""
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
    for worker, digest in client.run(provenance.source_digest).items():
        if digest != provenance.source_digest():
            raise VfoaError(f"{worker}: runs another version of vfoa; expected the same source as here")


class Cluster:
    """The workers of a Dask scheduler.

    Each must have one thread, run this very program, and see clips, weights and the run's directory at the same paths;
    it works in the folder, and with the ``VFOA_`` variables, of whoever started the run.
    """

    threads = 1

    def __init__(self, client: Client) -> None:
        self._client = client
        self.workers = len(client.nthreads())

    def run(
        self, work: Work[Job, Outcome], jobs: Sequence[Job], progress: Progress, lost: Lost[Job, Outcome]
    ) -> Iterator[Outcome]:
        """As :class:`harness.runs.executors.Executor`."""
        from distributed import KilledWorker

        self._client.subscribe_topic(TOPIC, lambda event: progress(event[1]))
        here = Surroundings()
        futures = [self._client.submit(_on_worker, here, work, job, pure=False) for job in jobs]
        try:
            for job, future in zip(jobs, futures, strict=True):
                try:
                    yield future.result()
                except KilledWorker:
                    yield lost(job, GIVEN_UP)
        finally:
            self._client.cancel(futures)
            self._client.unsubscribe_topic(TOPIC)


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What paths and weights are looked up by."""

    folder: str = field(default_factory=lambda: str(Path.cwd()))
    variables: dict[str, str] = field(
        default_factory=lambda: {name: value for name, value in os.environ.items() if name.startswith("VFOA_")}
    )

    def enter(self) -> None:
        """Make this process's surroundings the same."""
        os.chdir(self.folder)
        for name in [name for name in os.environ if name.startswith("VFOA_") and name not in self.variables]:
            del os.environ[name]
        os.environ.update(self.variables)


def _on_worker(here: Surroundings, work: Callable[[Any, Progress], Any], job: Any) -> Any:
    from distributed import get_worker

    here.enter()
    compute_with(1)
    worker = get_worker()
    return work(job, lambda word: worker.log_event(TOPIC, word))
