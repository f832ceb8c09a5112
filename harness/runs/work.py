"""A plan cut into jobs, and what came of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from harness.cache.account import Account
from harness.cache.stage import ClipCache, open_cache
from harness.cache.store import Store
from harness.runs.directory import Pair, RunDirectory
from harness.runs.executors import Executor, Progress
from harness.runs.experiment import Configuration
from harness.runs.plan import Plan, PreparedClip
from harness.runs.run import ClipJob, ClipOutcome, run_clip, warm_clip
from harness.runs.stages import SLOTS
from harness.signals.saved import owned_slots

CLIPS_PER_WORKER = 2
"""With fewer clips than this for each worker, clips are cut."""

STRETCHES_PER_WORKER = 4
"""Into how many stretches a clip is cut for each worker: few enough to open models seldom, enough to end together."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """The errors of what could not be finished, and how the cache served."""

    failures: Mapping[Pair, str]
    account: Account


def work_off(
    plan: Plan, directory: RunDirectory, *, cache: Store | None, executor: Executor, progress: Progress
) -> Done:
    """Do what is not done of a plan.

    Where there are clips enough to keep every worker at work, a job is a clip. Else workers help each other through
    the cache: first all perceive, a stretch of a clip each under all its configurations, so that nothing is decoded or
    computed twice; then a job is a (clip, configuration).
    """
    account = Account()
    jobs = [replace(_job(plan, one, directory, cache, account), threads=executor.threads) for one in plan.clips]
    for job in jobs:
        if not job.configurations:
            skip(job, progress)
    todo = [job for job in jobs if job.configurations]
    if cache and not plan.save_signals and executor.workers > 1 and len(todo) < CLIPS_PER_WORKER * executor.workers:
        _perceive(todo, executor, account, progress)
        todo, progress = [each for job in todo for each in _by_configuration(job)], _silent
    failures: dict[Pair, str] = {}
    for job, outcome in zip(todo, executor.run(run_clip, todo, progress, _lost), strict=True):
        failures.update(outcome.failures)
        account.add(job.manifest.name, outcome.tallies)
    return Done(failures=failures, account=account)


def _perceive(jobs: Sequence[ClipJob], executor: Executor, account: Account, progress: Progress) -> None:
    """Fill the cache with what it lacks of the jobs' frames."""
    stretches: list[ClipJob] = []
    for job in jobs:
        lacking = [frame for frame in job.frames if job.cache and job.cache.lacks(frame)]
        skip(job, progress, len(job.frames) - len(lacking))
        length = max(1, -(-len(lacking) // (STRETCHES_PER_WORKER * executor.workers)))
        stretches += [replace(job, frames=tuple(lacking[at : at + length])) for at in range(0, len(lacking), length)]
    for stretch, outcome in zip(stretches, executor.run(warm_clip, stretches, progress, _given_up), strict=True):
        account.add(stretch.manifest.name, outcome.tallies)


def _by_configuration(job: ClipJob) -> list[ClipJob]:
    """A job for each configuration; those that share a temporal gaze stay together, since it is not perceived alone."""
    groups: dict[str, list[Configuration]] = {}
    for each in job.configurations:
        gaze = each.choices["gaze"]
        temporal = gaze is not None and SLOTS["gaze"].is_temporal(gaze)
        groups.setdefault(gaze.key if gaze and temporal else each.name, []).append(each)
    return [replace(job, configurations=tuple(group)) for group in groups.values()]


def _lost(job: ClipJob, why: str) -> ClipOutcome:
    return ClipOutcome(failures=dict.fromkeys(job.pairs, why))


def _given_up(job: ClipJob, why: str) -> ClipOutcome:
    return ClipOutcome(failures={})  # whoever wants a frame's result computes it, and fails as loudly


def _silent(clip: str) -> None:
    """Every frame has been told of already."""


def skip(one: PreparedClip | ClipJob, progress: Progress, frames: int | None = None) -> None:
    """Tell the progress of frames, all of a clip's if not given, that are done already."""
    for _ in range(len(one.frames) if frames is None else frames):
        progress(one.manifest.name)


def _job(plan: Plan, one: PreparedClip, directory: RunDirectory, store: Store | None, account: Account) -> ClipJob:
    """What is left to do on a clip."""
    clip, everyone = one.manifest.name, plan.experiment.configurations
    todo = [each.for_clip(clip) for each in everyone if not directory.has_part((clip, each.name))]
    job = ClipJob(
        manifest=one.manifest,
        frames=one.frames,
        labels=one.labels,
        configurations=tuple(todo),
        directory=directory,
        recording=plan.recording,
        signals={each.name: owned_slots(each, everyone) for each in everyone} if plan.save_signals else {},
    )
    return replace(job, cache=_clip_cache(one, job, store, account)) if store else job


def _clip_cache(one: PreparedClip, job: ClipJob, store: Store, account: Account) -> ClipCache:
    cache = open_cache(store, one.manifest.name, one.clip.digest(), job.configurations)
    for key, identity in cache.identities.items():
        account.open(one.manifest.name, key, identity, store)
    return cache
