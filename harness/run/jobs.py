"""Divide a plan into jobs, run them and collect their outcomes.

With more workers than clips, the workers perceive a clip in stretches and fill the cache (the warm-up), and the main
process follows behind them with the steps that need an order.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import replace
from itertools import chain, repeat
from pathlib import Path

from harness.files.digests import KNOWN
from harness.pipeline.cache import Account, open_cache
from harness.pipeline.cache_store import Store
from harness.pipeline.configuration import STAGES, Configuration, clouds_of
from harness.pipeline.perception import Perception
from harness.run.directory import Pair, RunDirectory
from harness.run.executors import Executor, InProcess, Progress, compute_with
from harness.run.frame_sink import SharedFiles, lacks_files
from harness.run.loop import ClipJob, ClipOutcome, run_clip
from harness.run.plan import Plan, PreparedClip
from harness.sources import MeasuredClip
from vfoa.errors import VfoaError

CLIPS_PER_WORKER = 2
"""With fewer clips than this for each worker, clips are divided."""

PREFETCHED = 2
"""Frames that one thread reads, and another one perceives, in advance."""

FOLLOWING = 8
"""Number of configurations that can usually follow one frame in the time of its perception. More would delay the
workers that perceive for them."""

STRETCHES_PER_WORKER = 4
"""Stretches per worker in what remains of a clip. Stretches are long at first, so that little is opened and sought, and
short at the end, so that all workers end together (guided self-scheduling, Polychronopoulos and Kuck 1987)."""

LONGEST_STRETCH = 32
"""Most frames of a stretch, so that nobody waits long for it."""


def run_jobs(
    plan: Plan,
    directory: RunDirectory,
    *,
    cache: Store | None,
    executor: Executor,
    progress: Progress,
) -> tuple[dict[Pair, VfoaError], Account]:
    """Run the unfinished jobs of a plan; return the errors of those that failed, and the use of the cache.

    If there are enough clips to keep every worker busy, a job is a clip. Otherwise the workers share a clip through the
    cache: each perceives stretches of it under all configurations, so that nothing is decoded or computed twice. The
    steps that need an order follow them in this process or, if there are too many configurations for that, are given to
    the workers when all frames are perceived. Configurations that write files together (recordings) stay in one
    process.
    """
    account = Account()
    ahead = PREFETCHED if executor.threads > 1 else 0
    jobs = [replace(_job(plan, prepared, directory, cache), ahead=ahead) for prepared in plan.clips]
    perceived: set[str] = set()
    for prepared, job in zip(plan.clips, jobs, strict=True):
        if not job.configurations:
            skip(job, progress)
            continue
        with suppress(VfoaError):  # run_clip will report it
            account.add(job.fetch(prepared.clip))
            if job.is_perceived(prepared.clip):
                perceived.add(job.manifest.name)
    todo = [job for job in jobs if job.configurations]
    failures: dict[Pair, VfoaError] = {}
    if cache and executor.workers > 1 and len(todo) < CLIPS_PER_WORKER * executor.workers:
        for job in (job for job in todo if job.manifest.name in perceived):
            skip(job, progress)
        todo = _share(todo, perceived, executor, account, progress, failures)
        progress = _silent
    again = zip(_joint_rounds(todo, failures), repeat(_silent))
    for jobs, report in chain(zip(_rounds(todo), repeat(progress)), again):
        for outcome in executor.run(run_clip, jobs, report, _lost):
            failures.update(outcome.failures)
            account.add(outcome.tallies)
    return failures, account


def _share(
    jobs: Sequence[ClipJob],
    perceived: Collection[str],
    executor: Executor,
    account: Account,
    progress: Progress,
    failures: dict[Pair, VfoaError],
) -> list[ClipJob]:
    """Perceive all frames, and at the same time run the jobs that can follow; return the remaining jobs.

    Clips whose names are in ``perceived`` have their scenes.
    """
    to_perceive = [job for job in jobs if job.manifest.name not in perceived]
    warm_up, left = WarmUp(to_perceive, executor, account, progress), list[ClipJob]()
    compute_with(executor.threads)
    for job in jobs:
        can_follow = len(_together(job)) == 1 or len(job.configurations) * (executor.workers - 1) <= FOLLOWING
        if job.manifest.name not in warm_up.clips or not can_follow:
            left += _dealt(job, 1 if _shares_files(job) else executor.workers)
            continue
        try:
            outcome = run_clip(job, _silent, warm_up.frames(job))
        except GivenUpError:  # a job that kills workers must not run here, and one configuration must not kill another
            left += _dealt(job, len(job.configurations))
        else:
            failures.update(outcome.failures)
            account.add(outcome.tallies)
    warm_up.finish()
    return left


def _dealt(job: ClipJob, hands: int) -> list[ClipJob]:
    """Divide the job's configurations into this many jobs, or fewer."""
    groups = _together(job)
    dealt = [
        [configuration for group in groups[hand::hands] for configuration in group]
        for hand in range(min(hands, len(groups)))
    ]
    return [replace(job, configurations=tuple(configurations)) for configurations in dealt]


def _rounds(jobs: Sequence[ClipJob]) -> list[list[ClipJob]]:
    """The jobs in groups to run at the same time; no two jobs of a group write the same files."""
    rounds: list[list[ClipJob]] = []
    for job in jobs:
        busy = {clip_job.manifest.name for clip_job in rounds[-1]} if rounds else set[str]()
        if not rounds or (_shares_files(job) and job.manifest.name in busy):
            rounds.append([])
        rounds[-1].append(job)
    return rounds


def _joint_rounds(jobs: Sequence[ClipJob], failures: Mapping[Pair, VfoaError]) -> Iterator[list[ClipJob]]:
    """Yield jobs that write the shared files of clips again whose configurations ran apart, with all that did not fail.

    ``failures`` are read when the first of them is requested: after the jobs themselves.
    """
    by_clip: dict[str, list[ClipJob]] = {}
    for job in filter(_shares_files, jobs):
        by_clip.setdefault(job.manifest.name, []).append(job)
    for apart in (apart for apart in by_clip.values() if len(apart) > 1):
        finished = tuple(c for job in apart for c in job.configurations if (job.manifest.name, c.name) not in failures)
        joint = replace(apart[0], configurations=finished)
        if len(finished) > 1:
            for pair in joint.pairs:
                joint.directory.unmark(pair)
            yield [joint]


def _shares_files(job: ClipJob | Plan) -> bool:
    return any(isinstance(factory, SharedFiles) for factory in job.sinks)


def _together(job: ClipJob) -> list[list[Configuration]]:
    """Group the configurations: each by itself, but together if they share a temporal gaze model."""
    groups: dict[str, list[Configuration]] = {}
    for configuration in job.configurations:
        gaze = configuration.choices["gaze"]
        temporal = gaze is not None and STAGES["gaze"].is_temporal(gaze)
        groups.setdefault(gaze.key if gaze and temporal else configuration.name, []).append(configuration)
    return list(groups.values())


def _lost(job: ClipJob, why: str) -> ClipOutcome:
    return ClipOutcome(failures=dict.fromkeys(job.pairs, VfoaError(why)))


def _silent(clip: str) -> None:
    """Report no progress: every frame is already reported."""


def skip(clip: PreparedClip | ClipJob, progress: Progress) -> None:
    """Report the progress of a clip whose frames are done already."""
    for _ in clip.frames:
        progress(clip.manifest.name)


def _job(plan: Plan, prepared: PreparedClip, directory: RunDirectory, store: Store | None) -> ClipJob:
    """Return the job with the unfinished configurations of a clip; with all of them if they share files."""
    clip, configurations = prepared.manifest.name, plan.experiment.configurations
    unfinished = [
        configuration
        for configuration in configurations
        if not directory.is_finished(pair := (clip, configuration.name)) or lacks_files(plan.sinks, directory, pair)
    ]
    if unfinished and _shares_files(plan):
        for configuration in configurations:
            directory.unmark((clip, configuration.name))
        unfinished = list(configurations)
    todo = [configuration.for_clip(clip) for configuration in unfinished]
    cache = None
    if store is not None and not isinstance(prepared.clip, MeasuredClip):  # poses: nothing to perceive
        cache = open_cache(store, clip, prepared.clip, tuple(todo), prepared.digest)
    return ClipJob(
        manifest=prepared.manifest,
        frames=prepared.frames,
        configurations=tuple(todo),
        directory=directory,
        run_id=directory.read_manifest()["run_id"],
        sinks=plan.sinks,
        drawn=prepared.drawn,
        clouds=clouds_of(configuration.for_clip(clip) for configuration in configurations),
        digest=prepared.digest,
        known=dict(KNOWN),
        store=store,
        cache=cache,
    )


Unchanged = Callable[[], AbstractContextManager[None]]

_opened: tuple[object, Perception, Unchanged] | None = None
"""The last job of this process, its perception and the check of its files: the next stretch is usually of that clip."""


def warm_clip(job: ClipJob, progress: Progress) -> ClipOutcome:
    """Perceive the job's frames, in any order, so that the cache holds the outputs that :func:`run_clip` needs.

    Clip, models and matchers stay open for the next job if it differs only in its frames.
    """
    try:
        perception, unchanged = _open(job)
    except VfoaError:  # run_clip will report it
        return ClipOutcome(failures={})
    with unchanged():
        for number in job.frames:
            perception.warm(number)
            progress(job.manifest.name)
    return ClipOutcome(failures={}, tallies=perception.take_tallies())


def _open(job: ClipJob) -> tuple[Perception, Unchanged]:
    global _opened
    wanted = (job.manifest, job.configurations, job.cache, job.drawn, job.directory)
    if _opened is None or _opened[0] != wanted:
        _opened = None  # two sets of models may not fit into memory
        clip = job.manifest.open_images()
        unchanged = job.unchanged(clip)
        _opened = (wanted, Perception(job.configurations, clip, job.cache, drawn=job.drawn), unchanged)
    return _opened[1:]


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
        self._arriving = zip(parts, executor.run(warm_clip, parts, progress, _lost), strict=True)

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

    def _take(self, part: ClipJob, outcome: ClipOutcome) -> None:
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
