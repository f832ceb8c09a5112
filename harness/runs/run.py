"""The only loop over frames.

A run is cut into jobs (:mod:`harness.runs.work`). A job reads each frame once, computes each distinct stage once, and
writes one part file and one recording per configuration, which are moved into place when the clip is done. A
configuration that fails is dropped, and the others go on.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, field

from harness.annotations.files import Labels
from harness.cache.stage import ClipCache, Tally
from harness.clips.manifest import ClipManifest
from harness.recording import Size
from harness.runs.ahead import ahead, one_at_a_time
from harness.runs.configuration import Configuration
from harness.runs.directory import Pair, RunDirectory
from harness.runs.executors import Progress
from harness.runs.lane import Lane
from harness.runs.sharing import SharedFrame, SharedPipeline
from harness.scores.measures import Measurer
from vfoa.errors import VfoaError

_AHEAD = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipJob:
    """All that a process needs to run one clip: settings and paths only, since it travels to another process.

    ``recording`` is how much the recordings hold, None for none. ``signals`` are the stages whose output is saved, by
    configuration; ``cache`` is where results of perception are kept, None for nowhere. With several ``threads``, one
    reads and one perceives the next frames while the last ones are attended to and written. ``watched_at`` is the
    address of a Rerun viewer that is shown the frames as they are recorded.
    """

    manifest: ClipManifest
    frames: tuple[int, ...]
    labels: Labels | None
    configurations: tuple[Configuration, ...]
    directory: RunDirectory
    recording: Size | None
    signals: Mapping[str, frozenset[str]] = field(default_factory=dict)
    cache: ClipCache | None = None
    threads: int = 1
    watched_at: str | None = None

    @property
    def ahead(self) -> int:
        """How many frames each thread may be ahead of the next one; 0: there are none."""
        return _AHEAD if self.threads > 1 else 0

    @property
    def pairs(self) -> list[Pair]:
        """The job's (clip, configuration)s."""
        return [(self.manifest.name, configuration.name) for configuration in self.configurations]


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipOutcome:
    """How a job ended: for each (clip, configuration) that could not be finished, the one line that says why.

    ``tallies`` say, by a stage's key, what was taken from the cache and what was computed.
    """

    failures: Mapping[Pair, str]
    tallies: Mapping[str, Tally] = field(default_factory=dict)


_opened: tuple[object, SharedPipeline] | None = None
"""What this process perceived with last, and for which job: the next stretch of a clip is seldom another's."""


def warm_clip(job: ClipJob, progress: Progress) -> ClipOutcome:
    """Perceive the job's frames, in whichever order, so that the cache holds what :func:`run_clip` will look for.

    Clip, models and matchers stay open for the next job that differs in its frames alone.
    """
    try:
        pipeline = _open(job)
    except VfoaError:  # run_clip will say so
        return ClipOutcome(failures={})
    for _ in pipeline.warm(job.frames):
        progress(job.manifest.name)
    return ClipOutcome(failures={}, tallies=pipeline.take_tallies())


def _open(job: ClipJob) -> SharedPipeline:
    global _opened
    wanted = (job.manifest, job.configurations, job.cache, job.directory)
    if _opened is None or _opened[0] != wanted:
        _opened = None  # two sets of models need not fit
        _opened = (wanted, SharedPipeline(job.configurations, job.manifest.open(), job.cache))
    return _opened[1]


def run_clip(job: ClipJob, progress: Progress, frames: Iterable[int] | None = None) -> ClipOutcome:
    """Run one clip under all its configurations; ``progress`` is told the clip's name after each frame.

    ``frames`` are the job's frames, each given as soon as it may be read.
    """
    try:
        clip = job.manifest.open()
    except VfoaError as error:
        return ClipOutcome(failures=dict.fromkeys(job.pairs, str(error)))
    perceived, measured = one_at_a_time(clip, 2) if job.ahead else (clip, clip)
    pipeline = SharedPipeline(job.configurations, perceived, job.cache, ahead=job.ahead)
    measurer = Measurer(measured)
    lanes = [Lane(job, configuration, clip.rate_hz, measurer) for configuration in job.configurations]
    with ExitStack() as stack:
        for lane in lanes:
            stack.enter_context(lane)
        shared = pipeline.frames(job.frames if frames is None else frames)
        _drive(lanes, shared, job, progress)
    if job.cache:
        job.cache.store.trim()
    failures = {pair: lane.error for pair, lane in zip(job.pairs, lanes, strict=True) if lane.error is not None}
    return ClipOutcome(failures=failures, tallies=pipeline.take_tallies())


def _drive(lanes: list[Lane], perceived: Generator[SharedFrame], job: ClipJob, progress: Progress) -> None:
    """Lead every frame through every lane, until no lane is left."""
    try:
        with closing(ahead(perceived, job.ahead)) as frames:
            for shared in frames:
                for lane in lanes:
                    lane.take(shared)
                if all(lane.error is not None for lane in lanes):
                    return
                progress(job.manifest.name)
    except VfoaError as error:  # a frame that cannot be read
        for lane in lanes:
            lane.fail(error)
