"""Warm-up: workers perceive clips in stretches and fill the cache; the main process follows behind them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace

from harness.run.clip_job import ClipJob, ClipOutcome
from harness.run.executors.contract import Executor, Progress
from harness.stages.cache.stage import Account
from harness.stages.perception import Perception
from vfoa.errors import VfoaError

STRETCHES_PER_WORKER = 4
"""Stretches per worker in what remains of a clip. Stretches are long at first, so that little is opened and sought, and
short at the end, so that all workers end together (guided self-scheduling, Polychronopoulos and Kuck 1987)."""

LONGEST_STRETCH = 32
"""Most frames of a stretch, so that nobody waits long for it."""


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
        _opened = (wanted, job.perception(clip), unchanged)
    return _opened[1:]


class GivenUpError(Exception):
    """A frame killed every worker that perceived it."""


class Perceived:
    """The frames of these jobs that the cache lacks: workers begin to perceive them when the first one is requested.

    ``begun`` are the first needed frames, by clip.
    """

    def __init__(
        self,
        jobs: Sequence[ClipJob],
        begun: Mapping[str, int],
        executor: Executor,
        account: Account,
        progress: Progress,
    ) -> None:
        self._account = account
        self._stretches: list[ClipJob] = []
        self._begins: dict[tuple[str, int], int] = {}
        self._outcomes: list[ClipOutcome] = []
        for job in jobs:
            begin = begun[job.manifest.name]
            needed = [frame for frame in job.frames if frame >= begin]
            lacking = job.cache.lacking(needed) if job.cache else []
            for _ in range(len(job.frames) - len(lacking)):
                progress(job.manifest.name)
            self._cut(job, lacking, executor.workers)
        self._arriving = executor.run(warm_clip, self._stretches, progress, _given_up)

    def _cut(self, job: ClipJob, lacking: Sequence[int], workers: int) -> None:
        for frames in stretches(lacking, workers):
            self._begins[job.manifest.name, frames[0]] = len(self._stretches)
            self._stretches.append(replace(job, frames=frames))

    def lacked(self, job: ClipJob) -> bool:
        """Whether any frame of a job must be perceived."""
        return any(clip == job.manifest.name for clip, _ in self._begins)

    def frames(self, job: ClipJob) -> Iterator[int]:
        """Yield a job's frames, each as soon as it is perceived.

        Raises
        ------
        GivenUpError
            At a stretch that killed its worker every time.
        """
        for number in job.frames:
            stretch = self._begins.get((job.manifest.name, number))
            if stretch is not None and self._outcome(stretch).failures:
                raise GivenUpError
            yield number

    def _outcome(self, stretch: int) -> ClipOutcome:
        while len(self._outcomes) <= stretch:
            self._take(next(self._arriving))
        return self._outcomes[stretch]

    def _take(self, outcome: ClipOutcome) -> None:
        self._account.add(self._stretches[len(self._outcomes)].manifest.name, outcome.tallies)
        self._outcomes.append(outcome)

    def finish(self) -> None:
        """Wait for the stretches that nobody requested."""
        for outcome in self._arriving:
            self._take(outcome)


def stretches(frames: Sequence[int], workers: int) -> Iterator[tuple[int, ...]]:
    """Divide frames into stretches for this many workers, which take them one after the other."""
    at = 0
    while at < len(frames):
        length = min(LONGEST_STRETCH, -(-(len(frames) - at) // (STRETCHES_PER_WORKER * workers)))
        yield tuple(frames[at : at + length])
        at += length


def _given_up(stretch: ClipJob, why: str) -> ClipOutcome:
    return ClipOutcome(failures=dict.fromkeys(stretch.pairs, VfoaError(why)))
