"""One configuration on a clip: its memory, its names, its smoothing and its sinks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from types import TracebackType
from typing import Generic, NamedTuple, Self, TypeVar

from harness.clips.naming import SubjectNames, name_frame
from harness.run.checkpoint import Checkpoint, SinkState, write_checkpoint
from harness.run.clip_job import ClipJob
from harness.run.frame_sink import FinishedFrame, FrameSink, ResumableSink, SinkContext
from harness.run.records import to_record
from harness.stages.configuration import Configuration
from harness.stages.frame_measures import FrameMeasures
from harness.stages.measures import Measurer
from harness.stages.sharing import SharedFrame
from harness.stages.stage_runner import Timings, guarded, timed
from vfoa.bayes import BayesSettings, frames_awaited, smooth
from vfoa.errors import StageError, VfoaError
from vfoa.gaze.temporal import WindowStart
from vfoa.logit import LogitSettings, weigh_again
from vfoa.pipeline import AttendSettings, Memory, attend
from vfoa.types import FrameResult, Percepts, StereoFrame

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
        awaited = frames_awaited([each for each, _ in self._waiting], self._settings) if self._settings else 0
        if len(self._waiting) > 2 * awaited:
            yield from self._release(len(self._waiting) - awaited)

    def finish(self) -> Iterator[tuple[FrameResult, T]]:
        """Yield the results that still wait, at the end of a clip."""
        yield from self._release(len(self._waiting))

    def _release(self, count: int) -> Iterator[tuple[FrameResult, T]]:
        results = [result for result, _ in self._waiting]
        if results and self._settings is not None and self._settings.frames_awaited:
            if isinstance(self._settings, LogitSettings):
                results = guarded("attention", weigh_again, results, self._settings)
            else:
                results = guarded("attention", smooth, results, self._settings)
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
        rehearsal: bool = False,
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
            labels=job.labels,
            configuration=configuration.name,
            rate_hz=rate_hz,
            directory=job.directory,
            run_id=job.run_id,
            rehearsal=rehearsal,
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
                for result, companion in self._smoothing.finish():
                    self.hand_over(self._finished(result, companion))
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
            complete = self._job.keeps and self.written > 0
            self._open_sinks.__exit__(*((None,) * 3 if complete else (type(error), error, error.__traceback__)))
            self._open_sinks = ExitStack()

    def attend(self, shared: SharedFrame) -> list[FinishedFrame]:
        """Attend to one frame; return the frames that are finished now: this one, unless smoothing looks ahead."""
        if self.error is not None or (self._resumed and shared.index <= self._resumed.frame):
            return []
        found = shared.by_configuration[self._configuration.name]
        if isinstance(found, VfoaError):
            self.fail(found)
            return []
        percepts, scene, timings = found
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
            return [self._finished(*each) for each in ready]
        except VfoaError as error:
            if isinstance(error, StageError):
                error.frame = shared.index
            self.fail(error)
            return []

    def hand_over(self, finished: FinishedFrame) -> None:
        """Hand one frame to every sink. Their time counts as ``recording``, except that of the last one."""
        try:
            for sink in self._sinks.values():
                with timed(finished.timings, "recording"):
                    sink.write(finished)
            self.written += 1
            self._last = finished.record.frame
        except VfoaError as error:
            self.fail(error)

    def checkpoint(self) -> bool:
        """Write a checkpoint; return False if a sink cannot be continued from here."""
        sinks = {name: sink for name, sink in self._sinks.items() if isinstance(sink, ResumableSink)}
        if self.error is not None or self._last is None or len(sinks) < len(self._sinks):
            return False
        states: dict[str, SinkState] = {}
        for name, sink in sinks.items():
            state = sink.state()
            if state is None:
                return False
            states[name] = state
        waiting = self._smoothing.oldest
        found = Checkpoint(
            frame=self._last,
            written=self.written,
            memory=waiting.memory if waiting else self._memory,
            names=self._names,
            window=waiting.window if waiting else self._window,
            sinks=states,
        )
        write_checkpoint(self._job.directory, (self._job.manifest.name, self._configuration.name), found)
        return True

    def _finished(self, result: FrameResult, companion: _Companion) -> FinishedFrame:
        """A result with the names of the clip's manifest."""
        manifest = self._job.manifest
        names, self._names = name_frame(result, manifest.subjects, manifest.targets, self._names)
        record = to_record(manifest.name, self._configuration.name, result, names, companion.measures)
        return FinishedFrame(
            frame=companion.frame,
            percepts=companion.percepts,
            result=result,
            record=record,
            timings=companion.timings,
        )
