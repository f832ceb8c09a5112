"""The only loop over frames: read, perceive, reconstruct, attend for each configuration, hand to the sinks.

Each frame is read once and each distinct stage runs once. A configuration that fails is dropped, and the others
continue.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, closing, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from types import TracebackType
from typing import Generic, NamedTuple, Self, TypeVar

from harness.clips.manifest import ClipManifest
from harness.clips.naming import SubjectNames, name_frame
from harness.files.digests import KNOWN
from harness.files.io import ChangedError, UnchangedFiles
from harness.pipeline.cache import ClipCache, Tally
from harness.pipeline.configuration import Configuration
from harness.pipeline.drawn import DrawnClip
from harness.pipeline.frame_measures import FrameMeasures
from harness.pipeline.measures import Measurer
from harness.pipeline.perception import Perception, SharedFrame, one_at_a_time, pose_frames, prefetch
from harness.pipeline.stage_runner import Timings, guarded, timed
from harness.run.directory import Pair, RunDirectory, new_run_id
from harness.run.executors import Progress
from harness.run.frame_sink import FinishedFrame, FrameSink, ResumableSink, SinkContext, SinkFactory
from harness.run.records import to_record
from harness.run.resume import Checkpoint, ResultsSink, is_due, read_checkpoint, write_checkpoint
from harness.sources import Clip, MeasuredClip
from vfoa.bayes import BayesSettings, frames_awaited, smooth
from vfoa.errors import StageError, VfoaError
from vfoa.gaze.temporal import WindowStart
from vfoa.logit import LogitSettings, weigh_again
from vfoa.pipeline import AttendSettings, Memory, attend
from vfoa.types import FrameResult, Percepts, StereoFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipJob:
    """A clip under some configurations. It is pickled, so it holds only settings, paths and factories.

    ``run_id`` is the random id of the run, for its recordings. Finished frames go to the ``sinks`` in their order.
    ``drawn`` holds the shapes drawn on the clip. ``digest`` is that of the clip's content, of which every frame must be
    read (None: not checked), and ``known`` are digests by the stamp of their files. ``cache`` is None if no output of a
    stage is stored. ``ahead`` is the number of frames that one thread reads, and another one perceives, in advance; 0
    for no threads.
    """

    manifest: ClipManifest
    frames: tuple[int, ...]
    configurations: tuple[Configuration, ...]
    directory: RunDirectory
    run_id: str = field(default_factory=new_run_id)
    sinks: tuple[SinkFactory, ...] = ()
    drawn: DrawnClip | None = None
    digest: str | None = None
    known: Mapping[str, str] = field(default_factory=dict)
    cache: ClipCache | None = None
    ahead: int = 0

    @property
    def sink_names(self) -> list[str]:
        """A name for each sink factory: its position and its class."""
        return [f"{place} {type(factory).__name__}" for place, factory in enumerate(self.sinks, start=1)]

    @property
    def pairs(self) -> list[Pair]:
        """The (clip, configuration) pairs of the job."""
        return [(self.manifest.name, configuration.name) for configuration in self.configurations]

    def unchanged(self, clip: Clip | MeasuredClip) -> Callable[[], AbstractContextManager[None]]:
        """The blocks in which the clip is read as it was when the run began (:class:`harness.files.io.UnchangedFiles`).

        Raises
        ------
        VfoaError
            If it has changed already.
        """
        if self.digest is None:
            return nullcontext
        KNOWN.update(self.known)
        return UnchangedFiles(self.manifest.name, clip.digest, self.digest).active

    def outcome(self, errors: Iterable[VfoaError | None], tallies: tuple[Tally, ...] = ()) -> ClipOutcome:
        """The outcome of the job, from each configuration's error in order (None: it is finished)."""
        failures = {pair: error for pair, error in zip(self.pairs, errors, strict=True) if error is not None}
        return ClipOutcome(failures=failures, tallies=tallies)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipOutcome:
    """Outcome of a job: the error of each (clip, configuration) that failed, and the use of the cache."""

    failures: Mapping[Pair, VfoaError]
    tallies: tuple[Tally, ...] = ()


def checkpoints(job: ClipJob, tell: Callable[[str], None] = lambda line: None) -> dict[str, Checkpoint]:
    """Read the usable checkpoints of a job by configuration name; ``tell`` is called with a line about each."""
    frames = frozenset(job.frames)
    usable: dict[str, Checkpoint] = {}
    for clip, name in job.pairs:
        read, misfit = read_checkpoint(job.directory, (clip, name), frames, job.sink_names)
        if read is not None:
            usable[name] = read
            tell(f"{clip} under {name}: continues after frame {read.frame}")
        elif misfit is not None:
            tell(f"{clip} under {name}: its checkpoint does not fit ({misfit}); it starts again with the first frame")
    return usable


def first_frame(job: ClipJob, resumed: Mapping[str, Checkpoint]) -> int:
    """Return the first frame that a job must read: that of the configuration that is least advanced."""
    begin = min(job.frames, default=0)
    return min(
        resumed[configuration.name].first_read if configuration.name in resumed else begin
        for configuration in job.configurations
    )


def run_clip(job: ClipJob, progress: Progress, numbers: Iterable[int] | None = None) -> ClipOutcome:
    """Run one clip under all configurations of a job, each from its checkpoint if it has one.

    ``progress`` is called with the name of the clip after each frame. ``numbers`` yields the frames of the job, each as
    soon as it may be read; default: the job's own frames.
    """
    try:
        clip = job.manifest.open()
        unchanged = job.unchanged(clip)
    except VfoaError as error:
        return ClipOutcome(failures=dict.fromkeys(job.pairs, error))
    resumed = checkpoints(job)
    first = first_frame(job, resumed)
    for _ in range(sum(number < first for number in job.frames)):
        progress(job.manifest.name)
    chosen = (number for number in (job.frames if numbers is None else numbers) if number >= first)
    if isinstance(clip, MeasuredClip):
        scenes = pose_frames(job.configurations, clip, chosen)
        runners = attend_to(scenes, job, clip.rate_hz, progress, resumed=resumed)
        return job.outcome(runner.error for runner in runners)
    images, truth = one_at_a_time(clip, 2) if job.ahead else (clip, clip)
    begins = {name: checkpoint.frame + 1 for name, checkpoint in resumed.items()}
    starts = {name: checkpoint.window for name, checkpoint in resumed.items() if checkpoint.window}
    perceive = partial(Perception, drawn=job.drawn, parallel=job.ahead > 0, begins=begins, starts=starts)
    with unchanged(), perceive(job.configurations, images, job.cache) as perception:
        frames = prefetch(perception.frames(chosen, job.ahead), job.ahead)
        runners = attend_to(frames, job, clip.rate_hz, progress, measurer=Measurer(truth), resumed=resumed)
    if job.cache:
        job.cache.store.trim()
    return job.outcome((runner.error for runner in runners), perception.take_tallies())


def attend_to(
    frames: Generator[SharedFrame],
    job: ClipJob,
    rate_hz: float | None,
    progress: Progress,
    *,
    measurer: Measurer | None = None,
    resumed: Mapping[str, Checkpoint] | None = None,
) -> list[ConfigurationRunner]:
    """Attend to frames and hand them to the sinks, until they end or every configuration has failed.

    Checkpoints are written from time to time. ``resumed`` holds the states that configurations continue from, by name.
    Configurations are marked finished when the sinks of all are closed: the last one closes the files that they share.
    Returns one runner per configuration of the job, in order, each finished, with its error.
    """
    begun = resumed or {}
    runners = [
        ConfigurationRunner(job, configuration, rate_hz, measurer, resumed=begun.get(configuration.name))
        for configuration in job.configurations
    ]
    began_s = written_s = time.monotonic()
    with closing(frames), ExitStack() as sinks:
        for runner in runners:
            sinks.enter_context(runner)
        try:
            count = 0
            while any(runner.error is None for runner in runners) and (frame := next(frames, None)):
                for runner in runners:
                    runner.attend(frame)
                count, now_s = count + 1, time.monotonic()
                if is_due(now_s - began_s, now_s - written_s, count):
                    written = [runner.checkpoint() for runner in runners]
                    written_s = time.monotonic() if any(written) else written_s
                progress(job.manifest.name)
        except VfoaError as error:  # a frame that cannot be read
            more = f"vfoa clips check {job.manifest.name} --every-frame counts and names all that cannot be read"
            reason = error if isinstance(error, ChangedError) else VfoaError(f"{error}; {more}")
            for runner in runners:
                runner.fail(reason)
    for runner in runners:
        runner.mark_finished()
    return runners


T = TypeVar("T")


class SmoothingBuffer(Generic[T]):
    """Delays results, each with a companion, until smoothing is done; the order stays the same.

    A result is returned at once, unless the settings look ahead. Then it waits for the frames of that time and is
    smoothed with them. Results are returned in blocks of that length, so that one smoothing pass serves a block.
    """

    def __init__(self, settings: AttendSettings) -> None:
        attention = settings.attention
        self._settings = attention if isinstance(attention, BayesSettings | LogitSettings) else None
        self._waiting: list[tuple[FrameResult, T]] = []

    @property
    def oldest(self) -> T | None:
        """The companion of the oldest waiting result; None if none waits."""
        return self._waiting[0][1] if self._waiting else None

    def add(self, result: FrameResult, companion: T) -> Iterator[tuple[FrameResult, T]]:
        """Add a result; yield the results that have waited long enough."""
        self._waiting.append((result, companion))
        awaited = frames_awaited([result for result, _ in self._waiting], self._settings) if self._settings else 0
        if len(self._waiting) > 2 * awaited:
            yield from self._release(len(self._waiting) - awaited)

    def finish(self) -> Iterator[tuple[FrameResult, T]]:
        """Yield the results that still wait, at the end of a clip."""
        yield from self._release(len(self._waiting))

    def _release(self, count: int) -> Iterator[tuple[FrameResult, T]]:
        results = [result for result, _ in self._waiting]
        if results and self._settings is not None and self._settings.frames_awaited:
            again: Callable[..., list[FrameResult]] = (
                weigh_again if isinstance(self._settings, LogitSettings) else smooth
            )
            results = guarded("attention", again, results, self._settings)
        released = [(result, companion) for result, (_, companion) in zip(results, self._waiting, strict=True)][:count]
        del self._waiting[:count]
        yield from released


class _Companion(NamedTuple):
    """The data that goes to the sinks with a result, and the data needed to attend to its frame again."""

    frame: StereoFrame | None
    percepts: Percepts | None
    measures: FrameMeasures | None
    timings: Timings
    memory: Memory
    window: WindowStart | None


class ConfigurationRunner:
    """Attends to the frames of a clip in order under one configuration, and hands them to the sinks of its job.

    It is a context manager, which opens and closes the sinks. An error ends only this configuration: ``error`` is None
    until then. ``resumed`` is the checkpoint of an earlier run: frames up to it are skipped.
    """

    def __init__(
        self,
        job: ClipJob,
        configuration: Configuration,
        rate_hz: float | None,
        measurer: Measurer | None,
        *,
        resumed: Checkpoint | None = None,
    ) -> None:
        self.error: VfoaError | None = None
        self.written = resumed.written if resumed else 0
        self._resumed = resumed
        self._last = resumed.frame if resumed else None
        self._window = resumed.window if resumed else None
        self._job, self._configuration, self._measurer = job, configuration, measurer
        self._context = SinkContext(
            manifest=job.manifest,
            configuration=configuration.name,
            rate_hz=rate_hz,
            directory=job.directory,
            run_id=job.run_id,
        )
        self._memory, self._names = (resumed.memory, resumed.names) if resumed else (Memory(), SubjectNames())
        self._smoothing: SmoothingBuffer[_Companion] = SmoothingBuffer(configuration.attend)
        self._sinks: dict[str, FrameSink] = {}
        self._open_sinks = ExitStack()

    def __enter__(self) -> Self:
        try:
            states = self._resumed.sinks if self._resumed else {}
            for name, factory in zip(self._job.sink_names, self._job.sinks, strict=True):
                if (sink := factory.open(replace(self._context, resumed=states.get(name)))) is not None:
                    self._sinks[name] = self._open_sinks.enter_context(sink)
        except VfoaError as error:
            self.fail(error)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None and self.error is None:
            try:
                self._hand_over(self._smoothing.finish())
            except VfoaError as late:
                self.fail(late)
        try:
            self._open_sinks.__exit__(kind, error, trace)
        except VfoaError as late:
            self.error = late

    def fail(self, error: VfoaError) -> None:
        """End this configuration. Its sinks are closed; their files stay, so that a later run can continue them."""
        if self.error is None:
            self.error = error
            self._open_sinks.__exit__(type(error), error, error.__traceback__)
            self._open_sinks = ExitStack()

    def mark_finished(self) -> None:
        """Mark the results as finished, unless this configuration has failed; the sinks of all must be closed."""
        for sink in self._sinks.values() if self.error is None else ():
            if isinstance(sink, ResultsSink):
                sink.mark_finished()

    def attend(self, shared: SharedFrame) -> None:
        """Attend to one frame, and hand the frames that are finished now to the sinks: more than one when smoothed."""
        if self.error is not None or (self._resumed and shared.index <= self._resumed.frame):
            return
        perceived = shared.by_configuration[self._configuration.name]
        if isinstance(perceived, VfoaError):
            self.fail(perceived)
            return
        percepts, scene, timings = perceived
        memory = self._memory
        self._window = shared.windows.get(self._configuration.name)
        try:
            with timed(timings, "attention"):
                result, self._memory = guarded("attention", attend, scene, self._memory, self._configuration.attend)
            with timed(timings, "measures"):
                measures = self._measurer.measure(percepts, scene) if self._measurer and percepts else None
            with timed(timings, "attention"):
                companion = _Companion(shared.frame, percepts, measures, timings, memory, self._window)
                ready = list(self._smoothing.add(result, companion))
            self._hand_over(ready)
        except VfoaError as error:
            if isinstance(error, StageError):
                error.frame = shared.index
            self.fail(error)

    def _hand_over(self, ready: Iterable[tuple[FrameResult, _Companion]]) -> None:
        """Name the people and things of frames, and hand them to every sink.

        The time of the sinks counts as ``recording``, except that of the last one.
        """
        manifest = self._job.manifest
        for result, (frame, percepts, measures, timings, _, _) in ready:
            names, self._names = name_frame(result, manifest.subjects, manifest.targets, self._names)
            record = to_record(manifest.name, self._configuration.name, result, names, measures)
            finished = FinishedFrame(frame=frame, percepts=percepts, result=result, record=record, timings=timings)
            for sink in self._sinks.values():
                with timed(timings, "recording"):
                    sink.write(finished)
            self.written += 1
            self._last = record.frame

    def checkpoint(self) -> bool:
        """Write a checkpoint; return False if a sink cannot be continued from here."""
        sinks = {name: sink for name, sink in self._sinks.items() if isinstance(sink, ResumableSink)}
        if self.error is not None or self._last is None or len(sinks) < len(self._sinks):
            return False
        states = {name: state for name, sink in sinks.items() if (state := sink.state()) is not None}
        if len(states) < len(sinks):
            return False
        waiting = self._smoothing.oldest
        checkpoint = Checkpoint(
            frame=self._last,
            written=self.written,
            memory=waiting.memory if waiting else self._memory,
            names=self._names,
            window=waiting.window if waiting else self._window,
            sinks=states,
        )
        write_checkpoint(self._job.directory, (self._job.manifest.name, self._configuration.name), checkpoint)
        return True
