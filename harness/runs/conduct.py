"""A whole run: everything checked first, then the jobs, then the tables."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from harness.cache.account import cache_lines
from harness.cache.store import Store
from harness.files import digest_files
from harness.runs import provenance
from harness.runs.differences import differences
from harness.runs.directory import RunDirectory
from harness.runs.executors import Progress, executor
from harness.runs.experiment import Experiment
from harness.runs.plan import Plan, PreparedClip, describe, prepare
from harness.runs.work import skip, work_off
from harness.signals.saved import write_experiment
from vfoa.errors import VfoaError

__all__ = ["conduct", "prepare"]


def conduct(
    plan: Plan,
    out: Path,
    *,
    workers: int,
    progress: Progress,
    threads: int = 1,
    scheduler: str | None = None,
    cache: Store | None = None,
    tell: Callable[[str], None] = lambda line: None,
    beside: bool = False,
    retry_failed: bool = False,
) -> RunDirectory:
    """Run a plan into a directory, and join its results. What an earlier run of the same plan finished is taken over.

    A (clip, configuration) that fails does not stop the others; the manifest's ``failed`` lists it with its error, and
    its ``cache`` what was reused and what was computed, and why.

    Parameters
    ----------
    workers
        Processes on this machine.
    threads
        Those of a single process; several have one each.
    scheduler
        The address of a Dask scheduler, whose workers do the work instead.
    cache
        Where results of perception are kept; None for nowhere.
    tell
        Told, a line each, what was taken over, reused and computed, and where the run is, if not in ``out``.
    beside
        Where ``out`` holds another run, take ``out-2``, ``out-3`` ... instead: the first that is free, or this run's.
    retry_failed
        Try again what failed in an earlier run of the same plan; without it, its failures stand.

    Raises
    ------
    VfoaError
        If the directory holds another run, or nothing at all could be finished.
    """
    identity = describe(plan)
    directory, found = _choose(RunDirectory(out), identity, beside)
    if directory.path != out:
        different = differences(RunDirectory(out).read_manifest(), identity)
        tell(f"{out} holds another run (different: {different}); this one is in {directory.path}")
    if found and "finished" in found and not (retry_failed and found.get("failed")):
        if not found.get("failed"):
            directory.remove_parts()
        for one in plan.clips:
            skip(one, progress)
        tell(f"{directory.path}: finished before; nothing was computed")
        return directory
    for failure in (found or {}).get("failed", ()):  # what is mended need not find what it found before
        directory.begin_anew((failure["clip"], failure["configuration"]))
    started = now()
    directory.write_manifest(identity)
    with executor(workers, scheduler, threads=threads) as chosen:
        done = work_off(plan, directory, cache=cache, executor=chosen, progress=progress)
    failed = [directory.failure(pair, done.failures[pair]) for pair in plan.pairs if pair in done.failures]
    finished = [pair for pair in plan.pairs if pair not in done.failures]
    if not finished:
        others = f" (and {len(failed) - 1} more failed)" if len(failed) > 1 else ""
        raise VfoaError(f"{directory.told(failed[0])}{others}")
    if plan.save_signals and not failed:
        partial = any(len(one.frames) < len(one.clip.frames) for one in plan.clips)
        write_experiment(directory.signals, plan.experiment, partial=partial)
    directory.join(finished)
    directory.write_manifest(
        {**identity, "failed": failed, "cache": done.account.rows(), **circumstances(plan, started)}
    )
    if not failed:
        directory.remove_parts()
    for line in cache_lines(done.account.rows()):
        tell(line)
    return directory


def _choose(first: RunDirectory, identity: dict[str, Any], beside: bool) -> tuple[RunDirectory, dict[str, Any] | None]:
    """The directory to run in, and the manifest of this very run where it stands there already."""
    for number in itertools.count(1):
        directory = RunDirectory(first.path.with_name(f"{first.path.name}-{number}")) if number > 1 else first
        if directory.is_new():
            return directory, None
        found = directory.read_manifest()
        differing = differences(found, identity)
        if not differing:
            return directory, found
        if not beside:
            raise VfoaError(
                f"{directory.path}: holds another run (different: {differing}); "
                "expected an empty directory, or the same run to go on with: choose another --out"
            )
    raise AssertionError("counting has no end")


def circumstances(plan: Plan, started: str) -> dict[str, Any]:
    """What is worth knowing of a finished run, but does not make it another one."""
    return {
        "labels_sha256": {one.manifest.name: _labels_digest(one, plan.experiment) for one in plan.clips},
        "commit": provenance.source_commit(),
        "host": provenance.host(),
        "started": started,
        "finished": now(),
    }


def _labels_digest(one: PreparedClip, experiment: Experiment) -> str | None:
    labels = one.manifest.annotations.find(experiment.annotator)
    return digest_files([("labels", labels)]) if labels else None


def now() -> str:
    """The time, as a manifest has it."""
    return datetime.now(UTC).isoformat(timespec="seconds")
