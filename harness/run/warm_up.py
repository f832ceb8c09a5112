"""The warm-up: with more workers than clips, they perceive a clip in stretches and fill the cache.

The main process follows behind them with the steps that need an order (:mod:`harness.run.jobs`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace

from harness.pipeline.cache import Account
from harness.pipeline.perception import Perception
from harness.run.executors import Executor, Progress
from harness.run.loop import ClipJob, ClipResult
from vfoa.errors import VfoaError

STRETCHES_PER_WORKER = 4
"""Stretches per worker in what remains of a clip. Stretches are long at first, so that little is opened and sought, and
short at the end, so that all workers end together (guided self-scheduling, Polychronopoulos and Kuck 1987)."""

LONGEST_STRETCH = 32
"""Most frames of a stretch, so that nobody waits long for it."""

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


def lost(job: ClipJob, why: str) -> ClipResult:
    """The outcome of a job that was given up."""
    return ClipResult(failures=dict.fromkeys(job.pairs, VfoaError(why)))


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
