"""A whole run: everything checked first, then the jobs, then the tables."""

from __future__ import annotations

import errno
import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from harness.files.digests import KNOWN, used_digests
from harness.files.folders import check_writable, read_value, write_value
from harness.pipeline.cache import cache_lines
from harness.pipeline.cache_store import Store
from harness.run.directory import RunDirectory, locked, missing_of, new_run_id, removed_if_refused
from harness.run.executors import Executor, InProcess, Progress
from harness.run.frame_sink import lacks_files
from harness.run.jobs import Results, run_jobs, skip
from harness.run.manifest import RunManifest, differences
from harness.run.plan import Plan, describe, host, prepare, source_commit
from harness.run.scenes import remove_unused
from harness.run.timings import join_timings
from vfoa.errors import VfoaError

__all__ = ["prepare", "run_plan"]

_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""Errors of a full disk, which name no file where a file that is open cannot grow."""


def run_plan(
    plan: Plan,
    out: Path,
    *,
    workers: int,
    progress: Progress,
    threads: int = 1,
    scheduler: str | None = None,
    cache: Store | None = None,
    tell: Callable[[str], None] = lambda line: None,
    next_free: bool = False,
    retry_failed: bool = False,
) -> RunDirectory:
    """Run a plan into a directory, and write its tables of frames; results of an earlier run of the plan are reused.

    A (clip, configuration) that fails does not stop the others; the manifest's ``failed`` lists it with its error, and
    its ``cache`` lists what was reused and what was computed, and why.

    Parameters
    ----------
    workers
        Processes on this machine.
    threads
        Threads of a single process; several processes have one each.
    scheduler
        The address of a Dask scheduler, whose workers run the jobs instead.
    cache
        Store of perception outputs; None for no cache.
    tell
        Called with a line about what was reused and computed, and about the run's directory, if it is not ``out``.
    next_free
        If ``out`` holds another run, use ``out-2``, ``out-3`` ... instead: the first that is free, or holds this run.
    retry_failed
        Repeat what failed in an earlier run of the same plan. By default, its failures are kept.

    Raises
    ------
    VfoaError
        If the directory holds another run, or one in progress, or nothing could be finished, or weights are to be
        fitted and the plan has no ``fit``. A run that is refused before a clip is perceived leaves no directory.
    OSError
        If a file cannot be written; of a full disk it names the directory if not the file.
    KeyboardInterrupt
        If the run is interrupted, after ``tell`` was called with what is kept.
    """
    if scheduler is not None:
        from harness.run.executors.cluster import check_address

        check_address(scheduler)  # also for a finished run, which does not connect
    if plan.fit is None and plan.unfitted:
        raise VfoaError(
            f"{plan.experiment.name}: {plan.unfitted[0].name}: its weights are not fitted yet; expected `vfoa run`, "
            "which fits them"
        )
    for candidate in itertools.takewhile(lambda directory: not directory.is_new(), _candidates(RunDirectory(out))):
        KNOWN.update(read_value(candidate.noted_inputs, dict[str, str]) or {})
    with used_digests() as inputs:
        identity = describe(plan)
    directory = _choose(RunDirectory(out), identity, next_free)
    if directory.path != out:
        different = _differences(RunDirectory(out), identity)
        tell(f"{out} holds another run (different: {different}); this one is in {directory.path}")
    if _is_done(plan, directory, retry_failed):
        for prepared in plan.clips:
            skip(prepared, progress)
        unused = "" if scheduler is None else f", and {scheduler} was not asked"
        tell(f"{directory.path}: finished already; nothing was computed{unused}")
        return directory
    made = missing_of(directory.path)
    with locked(directory.path, tell), removed_if_refused(directory, made):
        _choose(directory, identity, next_free=False)  # again: another run may have begun here before the lock
        earlier = RunManifest() if directory.is_new() else directory.read_manifest()
        for pair in earlier.failed_pairs:  # a repaired input may give another result
            directory.discard(pair)
        started = _now()
        of_run = identity.model_copy(update={"run_id": earlier.run_id or new_run_id()})
        directory.write_manifest(of_run)
        write_value(directory.noted_inputs, inputs)
        if cache:
            check_writable(cache.root)
        modules, shared_file = plan.deciding_modules, directory.manifest
        with _saying_what_is_kept(directory, cache, tell):
            with executor(workers, scheduler, threads=threads, modules=modules, shared_file=shared_file) as chosen:
                results = run_jobs(plan, directory, cache=cache, executor=chosen, progress=progress)
            _finish(plan, directory, of_run, results, started)
    for line in cache_lines(results.account.rows()):
        tell(line)
    return directory


@contextmanager
def _saying_what_is_kept(directory: RunDirectory, cache: Store | None, tell: Callable[[str], None]) -> Iterator[None]:
    """Say what an interrupted run keeps, or one that can write no more: ``tell`` is called, or the error says it."""
    try:
        yield
    except KeyboardInterrupt:
        perceived = ", and stage outputs in the cache" if cache else ""
        tell(f"interrupted: finished clips are kept in {directory.path}{perceived}; the same command continues")
        raise
    except OSError as error:
        if error.errno not in _NO_ROOM and error.filename is None:
            raise
        reason = f"{error.strerror}; finished clips are kept, and the same command continues"
        raise OSError(error.errno, reason, error.filename or str(directory.path)) from error


def _is_done(plan: Plan, directory: RunDirectory, retry_failed: bool) -> bool:
    """Whether this run is finished, with all of its recordings; if so, remove its partial results."""
    manifest = RunManifest() if directory.is_new() else directory.read_manifest()
    failed = manifest.failed_pairs
    if not manifest.finished or (retry_failed and failed):
        return False
    if any(lacks_files(plan.sinks, directory, pair) for pair in plan.pairs if pair not in failed):
        return False
    if not failed:
        directory.remove_partial()
    return True


def _finish(plan: Plan, directory: RunDirectory, of_run: RunManifest, results: Results, started: str) -> None:
    """Join the times of the stages, and write the manifest that marks the run as finished.

    Raises
    ------
    VfoaError
        If no configuration could be finished on any clip.
    """
    failures = results.failures
    failed = [directory.failure(pair, failures[pair]) for pair in plan.pairs if pair in failures]
    finished = [pair for pair in plan.pairs if pair not in failures]
    if not finished:
        others = f" (and {len(failed) - 1} more failed)" if len(failed) > 1 else ""
        raise VfoaError(f"{directory.line_of(failed[0])}{others}")
    join_timings(directory, finished)
    of_results = {
        "failed": failed,
        "cache": results.account.rows(),
        "fitted": {name: attention.model_dump(mode="json") for name, attention in results.fitted.items()},
        "labels_sha256": {
            prepared.manifest.name: prepared.manifest.annotations.digest(plan.experiment.annotator)
            for prepared in plan.clips
        },
        "commit": source_commit(),
        "host": host(),
        "started": started,
        "finished": _now(),
    }
    directory.write_manifest(of_run.model_copy(update=of_results))
    remove_unused(directory)
    if not failed:
        directory.remove_partial()


def _candidates(first: RunDirectory) -> Iterator[RunDirectory]:
    """``first``, and the directories beside it: out, out-2, out-3 ..."""
    yield first
    for number in itertools.count(2):
        yield RunDirectory(first.path.with_name(f"{first.path.name}-{number}"))


def _choose(first: RunDirectory, identity: RunManifest, next_free: bool) -> RunDirectory:
    """Choose the directory to run in: one without a run, or with this very run."""
    for directory in _candidates(first):
        if directory.is_new():
            return directory
        differing = _differences(directory, identity)
        if not differing:
            return directory
        if not next_free:
            raise VfoaError(
                f"{directory.path}: holds another run (different: {differing}); "
                "expected an empty directory, or the same run to continue: choose another --out"
            )
    raise AssertionError("counting has no end")


def _differences(directory: RunDirectory, identity: RunManifest) -> str:
    return differences(directory.read_manifest().plain(), identity.plain())


def _now() -> str:
    """The current time, in the manifest's format."""
    return datetime.now(UTC).isoformat(timespec="seconds")


@contextmanager
def executor(
    workers: int,
    scheduler: str | None = None,
    *,
    threads: int = 1,
    modules: tuple[str, ...] = (),
    shared_file: Path | None = None,
) -> Iterator[Executor]:
    """Yield an executor with this many processes here, or one on the cluster of a Dask scheduler (``tcp://host:port``).

    ``threads`` are those of a single process; several processes have one each. ``modules`` decide the results: workers
    of a cluster that have other code for them refuse the jobs, and so do workers that cannot read ``shared_file``.

    Raises
    ------
    VfoaError
        If the scheduler does not answer, has no workers, or has workers that would compute other results.
    """
    if scheduler is not None:
        from harness.run.executors.cluster import Cluster, connect

        with connect(scheduler) as client, Cluster(client, modules, shared_file) as cluster:
            yield cluster
    elif workers == 1:
        yield InProcess(threads)
    else:
        from harness.run.executors.pool import Pool

        with Pool(workers) as pool:
            yield pool
