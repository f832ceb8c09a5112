"""Executors run jobs: in this process, in a pool of spawned processes, or on a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from harness.run.executors.contract import Executor, InProcess, Job, Outcome, Progress, Work
from vfoa.errors import VfoaError


@contextmanager
def executor(
    workers: int,
    scheduler: str | None = None,
    *,
    threads: int = 1,
    modules: tuple[str, ...] = (),
    sees: Path | None = None,
) -> Iterator[Executor]:
    """Yield an executor with this many processes here, or one on the cluster of a Dask scheduler (``tcp://host:port``).

    ``threads`` are those of a single process; several processes have one each. ``modules`` decide the results: workers
    of a cluster that have other code for them refuse the jobs, and so do workers that cannot read the file ``sees``.

    Raises
    ------
    VfoaError
        If the scheduler does not answer, has no workers, or has workers that would compute other results.
    """
    if scheduler is not None:
        from harness.run.executors.cluster import Cluster, connect

        with connect(scheduler) as client:
            yield Cluster(client, modules, sees)
    elif workers == 1:
        yield InProcess(threads)
    else:
        from harness.run.executors.pool import Pool

        with Pool(workers) as pool:
            yield pool


def work_through(work: Work[Job, Outcome], jobs: Sequence[Job], workers: int, progress: Progress) -> Iterator[Outcome]:
    """Yield ``work(job, progress)`` for each job, in the order of the jobs; a lost job is an error."""
    with executor(min(workers, max(len(jobs), 1))) as chosen:
        yield from chosen.run(work, jobs, progress, _lost)


def _lost(job: Any, why: str) -> Any:
    raise VfoaError(why)
