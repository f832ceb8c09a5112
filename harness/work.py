"""A plan cut into jobs, and what came of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from harness.cache.account import Account
from harness.cache.identity import identify
from harness.cache.stage import ClipCache
from harness.cache.store import Store
from harness.executors import Progress, work_through
from harness.plan import Plan, PreparedClip
from harness.run import ClipJob, run_clip
from harness.run_directory import Pair, RunDirectory
from harness.signals.saved import owned_slots


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """The errors of what could not be finished, and how the cache served."""

    failures: Mapping[Pair, str]
    account: Account


def work_off(plan: Plan, directory: RunDirectory, *, cache: Store | None, workers: int, progress: Progress) -> Done:
    """Do what is not done of a plan."""
    account = Account()
    jobs = [_job(plan, one, directory, cache, account) for one in plan.clips]
    todo = [job for job in jobs if job.configurations]
    for one, job in zip(plan.clips, jobs, strict=True):
        if not job.configurations:
            skip(one, progress)
    failures: dict[Pair, str] = {}
    for job, outcome in zip(todo, work_through(run_clip, todo, workers, progress), strict=True):
        failures.update(outcome.failures)
        for key, tally in outcome.tallies.items():
            account.add(job.manifest.name, key, tally)
    if cache:
        cache.trim()
    return Done(failures=failures, account=account)


def skip(one: PreparedClip, progress: Progress) -> None:
    """Tell the progress of a clip that is done already."""
    for _ in one.frames:
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
    clip, digest = one.manifest.name, one.clip.digest()
    choices = {choice.key: choice for each in job.configurations for choice in each.choices.values() if choice}
    found = {key: identify(choice, clip, digest) for key, choice in choices.items()}
    identities = {key: identity for key, identity in found.items() if identity is not None}
    for key, identity in identities.items():
        account.open(clip, key, identity, store)
    return ClipCache(store=store, identities=identities)
