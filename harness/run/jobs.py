"""Divide a plan into jobs, run them and collect their outcomes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from harness.files.digests import KNOWN
from harness.pipeline.cache import Account, open_cache
from harness.pipeline.cache_store import Store
from harness.pipeline.configuration import Configuration, clouds_of
from harness.pipeline.perception import Perception
from harness.run.directory import Pair, RunDirectory, new_run_id
from harness.run.executors import Executor, Progress, compute_with
from harness.run.frame_sink import lacks_files
from harness.run.loop import ClipJob, ClipResult, perceive_clip, run_clip
from harness.run.plan import Plan, PreparedClip
from harness.run.scene_identity import Keys, paths_of
from harness.run.table_files import answer_tables
from harness.sources import Clip, MeasuredClip
from vfoa.errors import VfoaError
from vfoa.methods import MethodSettings

CLIPS_PER_WORKER = 2
"""With fewer clips than this for each worker, clips are divided."""

PREFETCHED = 2
"""Frames that one thread reads, and another one perceives, in advance."""

STRETCHES_PER_WORKER = 4
"""Stretches per worker in what remains of a clip. Stretches are long at first, so that little is opened and sought, and
short at the end, so that all workers end together (guided self-scheduling, Polychronopoulos and Kuck 1987)."""

LONGEST_STRETCH = 32
"""Most frames of a stretch, so that nobody waits long for it."""


@dataclass(frozen=True, slots=True)
class Results:
    """What the jobs of a run have given: errors, the use of the cache, the keys of scenes, and fitted weights."""

    failures: dict[Pair, VfoaError] = field(default_factory=dict)
    account: Account = field(default_factory=Account)
    keys: dict[Pair, Keys] = field(default_factory=dict)
    fitted: dict[str, MethodSettings] = field(default_factory=dict)

    def add(self, job: ClipJob, outcome: ClipResult) -> None:
        """Add the outcome of a job."""
        self.failures.update(outcome.failures)
        self.account.add(outcome.tallies)
        self.keys.update({(job.manifest.name, name): keys for name, keys in outcome.keys.items()})

    def add_all(self, jobs: Iterable[ClipJob], outcomes: Iterable[ClipResult]) -> None:
        """Add the outcomes of jobs, in their order, as they arrive."""
        for job, outcome in zip(jobs, outcomes, strict=True):
            self.add(job, outcome)

    def left(self, job: ClipJob) -> ClipJob:
        """The job without the configurations that have failed."""
        left = (each for each in job.configurations if (job.manifest.name, each.name) not in self.failures)
        return replace(job, configurations=tuple(left))


def run_jobs(
    plan: Plan,
    directory: RunDirectory,
    *,
    cache: Store | None,
    executor: Executor,
    progress: Progress,
) -> Results:
    """Run the unfinished jobs of a plan.

    If there are enough clips to keep every worker busy, a job is a clip: it is perceived and attended to. Otherwise the
    workers share clips. First they perceive stretches of them through the cache, so that nothing is decoded or computed
    twice, and this process follows them with what needs an order; a clip without images is perceived by one of them.
    Then each attends to some of the configurations. Configurations that lack weights are attended to last, when they
    are fitted to all clips.
    """
    results = Results()
    prefetched = PREFETCHED if executor.threads > 1 else 0
    jobs: list[tuple[ClipJob, PreparedClip]] = []
    run_id = directory.read_manifest().run_id or new_run_id()
    for prepared in plan.clips:
        job = replace(_job(plan, prepared, directory, run_id, cache, results.account), prefetched=prefetched)
        if job.configurations:
            jobs.append((job, prepared))
        else:
            skip(prepared, progress)
    units = [job for job, _ in jobs]
    few = executor.workers > 1 and len(units) < CLIPS_PER_WORKER * executor.workers
    if few:
        measured = [job for job, prepared in jobs if isinstance(prepared.clip, MeasuredClip)]
        others = [(job, prepared) for job, prepared in jobs if not isinstance(prepared.clip, MeasuredClip)]
        shared = [job for job in measured if len(job.configurations) > 1]
        units = _share(others, executor, results, progress) if cache and others else [job for job, _ in others]
        units += _share_measured(shared, executor, results) if shared else []
        units += [job for job in measured if len(job.configurations) == 1]
    results.add_all(units, executor.run(run_clip, units, progress, lost))
    if plan.fit and plan.unfitted:
        pairs = [(prepared.manifest.name, each.name) for prepared in plan.clips for each in plan.unfitted]
        results.fitted.update(plan.fit.weights(plan, _tables(directory, pairs, results), executor))
        fitted = [_with_weights(results.left(job), results.fitted) for job, _ in jobs]
        units = [unit for job in fitted for unit in _dealt(job, executor.workers if few else 1)]
        results.add_all(units, executor.run(run_clip, units, _silent, lost))
    if cache and any(job.cache is None for job, _ in jobs):  # these have not kept to the limit themselves
        cache.trim()
    return results


def lost(job: ClipJob, why: str) -> ClipResult:
    """The outcome of a job that was given up."""
    return ClipResult(failures=dict.fromkeys(job.pairs, VfoaError(why)))


def _tables(directory: RunDirectory, pairs: Iterable[Pair], results: Results) -> dict[Pair, dict[str, Path]]:
    """The tables of the pairs that are perceived, in this run or in the interrupted one that it continues."""
    return {
        pair: paths_of(directory, pair[0], keys) if keys else answer_tables(directory, pair)
        for pair in pairs
        if pair not in results.failures and ((keys := results.keys.get(pair)) or directory.is_finished(pair))
    }


def _with_weights(job: ClipJob, fitted: Mapping[str, MethodSettings]) -> ClipJob:
    """The job of the configurations that lacked weights."""
    weighted = (each.attending(fitted[each.name]) for each in job.configurations if each.name in fitted)
    return replace(job, configurations=tuple(each.for_clip(job.manifest.name) for each in weighted))


def _share(
    jobs: Iterable[tuple[ClipJob, PreparedClip]], executor: Executor, results: Results, progress: Progress
) -> list[ClipJob]:
    """Perceive the frames that the cache lacks, and follow them; return the jobs that remain for the workers."""
    lacking = {job.manifest.name: replace(job, configurations=_lacking(job, prepared.clip)) for job, prepared in jobs}
    parts = [part for part in lacking.values() if part.configurations]
    warm_up = WarmUp(parts, executor, results.account, progress)
    compute_with(executor.threads)
    units, deadly = list[ClipJob](), list[ClipJob]()
    for job, prepared in jobs:
        if not lacking[job.manifest.name].configurations:
            skip(prepared, progress)
            units += _dealt(job, executor.workers)
        elif job.manifest.name not in warm_up.clips:  # its outputs are in the cache
            units.append(job)
        else:
            try:
                results.add(job, perceive_clip(job, _silent, warm_up.frames(job)))
            except GivenUpError:  # a job that kills workers must not run here
                deadly.append(job)
            else:
                units += _dealt(results.left(job), executor.workers)
    warm_up.finish()
    for job in deadly:
        apart = [replace(job, configurations=(each,), sinks=()) for each in job.configurations]
        results.add_all(apart, executor.run(perceive_clip, apart, _silent, lost))
        units.append(results.left(job))  # at once: they share recordings
    return [replace(job, reporters=0) for job in units if job.configurations]


def _share_measured(jobs: Sequence[ClipJob], executor: Executor, results: Results) -> list[ClipJob]:
    """Perceive clips without images; return the jobs that remain for the workers."""
    results.add_all(jobs, executor.run(perceive_clip, jobs, _silent, lost))
    dealt = [_dealt(results.left(job), executor.workers) for job in jobs]
    return [replace(job, reporters=len(of_clip)) for of_clip in dealt for job in of_clip]


def _lacking(job: ClipJob, clip: Clip | MeasuredClip) -> tuple[Configuration, ...]:
    """The configurations of a job that must be perceived."""
    try:
        return job.lacking(job.identities(clip), job.context(clip))
    except VfoaError:  # run_clip will report it
        return job.configurations


def _dealt(job: ClipJob, hands: int) -> list[ClipJob]:
    """Divide the configurations of a clip that is perceived into this many jobs, or fewer."""
    dealt = (replace(job, configurations=job.configurations[hand::hands]) for hand in range(hands))
    return [each for each in dealt if each.configurations]


def _silent(clip: str) -> None:
    """Report no progress: every frame is already reported."""


def skip(clip: PreparedClip, progress: Progress) -> None:
    """Report the progress of frames that are done already."""
    for _ in clip.frames:
        progress(clip.manifest.name)


def _job(
    plan: Plan, prepared: PreparedClip, directory: RunDirectory, run_id: str, store: Store | None, account: Account
) -> ClipJob:
    """Return the job with the unfinished configurations of a clip, with the scenes that the cache has.

    All configurations run again if a sink lacks what it has written of the clip for all of them.
    """
    clip = prepared.manifest.name
    configurations = tuple(each.for_clip(clip) for each in plan.experiment.configurations)
    job = ClipJob(
        manifest=prepared.manifest,
        frames=prepared.frames,
        configurations=configurations,
        directory=directory,
        run_id=run_id,
        sinks=plan.sinks,
        drawn=prepared.drawn,
        clouds=clouds_of(configurations),
        digest=prepared.digest,
        known=dict(KNOWN),
        store=store,
    )
    lacking = (
        pair for pair in job.pairs if not directory.is_finished(pair) or lacks_files(plan.sinks, directory, pair)
    )
    if not (unfinished := [*lacking]):
        return replace(job, configurations=())
    with suppress(VfoaError):  # run_clip will report it
        account.add(job.fetch(prepared.clip))
    if not job.has_scene_files(job.context(prepared.clip)):
        unfinished = job.pairs
        for pair in unfinished:
            directory.unmark(pair)
    job = replace(job, configurations=tuple(each for each in configurations if (clip, each.name) in unfinished))
    if store is None or isinstance(prepared.clip, MeasuredClip):  # poses: nothing to perceive
        return job
    return replace(job, cache=open_cache(store, clip, prepared.clip, job.configurations, prepared.digest))


# The warm-up: with more workers than clips, they perceive a clip in stretches and fill the cache


class GivenUpError(Exception):
    """A frame killed every worker that perceived it."""


class WarmUp:
    """Workers perceive the frames of these jobs that the cache lacks; they begin when the first frame is requested."""

    def __init__(self, jobs: Sequence[ClipJob], executor: Executor, account: Account, progress: Progress) -> None:
        self._account, self._lost = account, set[tuple[str, int]]()
        parts: list[ClipJob] = []
        for job in jobs:
            lacking = job.cache.lacking(job.frames) if job.cache else []
            for _ in range(len(job.frames) - len(lacking)):
                progress(job.manifest.name)
            parts += [replace(job, frames=frames) for frames in stretches(lacking, executor.workers)]
        self._waiting = {(part.manifest.name, frame) for part in parts for frame in part.frames}
        self.clips = {part.manifest.name for part in parts}
        self._arriving = zip(parts, executor.run(warm_clip, parts, progress, lost), strict=True)

    def frames(self, job: ClipJob) -> Iterator[int]:
        """Yield a job's frames, each as soon as it is perceived.

        Raises
        ------
        GivenUpError
            At a stretch that killed its worker every time.
        """
        for number in job.frames:
            while (job.manifest.name, number) in self._waiting:
                self._take(*next(self._arriving))
            if (job.manifest.name, number) in self._lost:
                raise GivenUpError
            yield number

    def finish(self) -> None:
        """Wait for the stretches that nobody requested."""
        for part, outcome in self._arriving:
            self._take(part, outcome)

    def _take(self, part: ClipJob, outcome: ClipResult) -> None:
        self._account.add(outcome.tallies)
        frames = {(part.manifest.name, frame) for frame in part.frames}
        self._waiting -= frames
        if outcome.failures:
            self._lost |= frames


def stretches(frames: Sequence[int], workers: int) -> Iterator[tuple[int, ...]]:
    """Divide frames into stretches for this many workers, which take them one after the other."""
    at = 0
    while at < len(frames):
        length = min(LONGEST_STRETCH, -(-(len(frames) - at) // (STRETCHES_PER_WORKER * workers)))
        yield tuple(frames[at : at + length])
        at += length


Unchanged = Callable[[], AbstractContextManager[None]]

_opened: tuple[object, Perception, Unchanged] | None = None
"""The last job of this process, its perception and the check of its files: the next stretch is usually of that clip."""


def warm_clip(job: ClipJob, progress: Progress) -> ClipResult:
    """Perceive the job's frames, in any order, so that the cache holds the outputs that :func:`run_clip` needs.

    Clip, models and matchers stay open for the next job if it differs only in its frames.
    """
    try:
        perception, unchanged = _open(job)
    except VfoaError:  # run_clip will report it
        return ClipResult(failures={})
    with unchanged():
        for number in job.frames:
            perception.warm(number)
            progress(job.manifest.name)
    return ClipResult(failures={}, tallies=perception.take_tallies())


def _open(job: ClipJob) -> tuple[Perception, Unchanged]:
    global _opened
    wanted = (job.manifest, job.configurations, job.cache, job.drawn, job.directory)
    if _opened is None or _opened[0] != wanted:
        _opened = None  # two sets of models may not fit into memory
        clip = job.manifest.open_images()
        unchanged = job.unchanged(clip)
        _opened = (wanted, Perception(job.configurations, clip, job.cache, drawn=job.drawn), unchanged)
    return _opened[1:]
