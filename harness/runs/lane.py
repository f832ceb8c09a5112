"""One configuration on its way through a clip: its memory, and the files its frames go to."""

from __future__ import annotations

from contextlib import ExitStack
from types import TracebackType
from typing import TYPE_CHECKING, Self

from harness.clips.naming import SubjectNames, name_frame
from harness.files import atomic_write
from harness.recording import FrameObserver, Observers, ShownFrame
from harness.runs.configuration import Configuration
from harness.runs.directory import Pair
from harness.runs.faults import guarded
from harness.runs.hindsight import Hindsight
from harness.runs.ledger import Bill, timed
from harness.runs.parts import Part
from harness.runs.records import to_record
from harness.runs.results import FrameMeasures, FrameRecord, to_line
from harness.runs.sharing import SharedFrame
from harness.scores.measures import Measurer
from harness.scores.verdicts import Verdict, judge
from vfoa.errors import StageError, VfoaError
from vfoa.pipeline import Memory, attend
from vfoa.types import FrameResult, Percepts, Scene, StereoFrame

if TYPE_CHECKING:
    from harness.runs.run import ClipJob

_Seen = tuple[StereoFrame, Percepts, FrameMeasures | None, Bill]
"""What goes with a result to the files."""


class Lane:
    """Takes a clip's frames in order under one configuration, as a context manager.

    What goes wrong with a frame ends this lane alone: ``error`` is the one line that says why, None while all is well.
    The traceback of a fault of a stage is kept beside the lane's results. ``keeps`` is for frames that do not come
    again: those that were done before an error are all there will be, and their files are finished.
    """

    def __init__(
        self,
        job: ClipJob,
        configuration: Configuration,
        rate_hz: float | None,
        measurer: Measurer,
        *,
        keeps: bool = False,
    ) -> None:
        self.error: str | None = None
        self.written = 0
        self._keeps = keeps
        self._job, self._configuration, self._rate_hz = job, configuration, rate_hz
        self._measurer = measurer
        self._memory, self._names = Memory(), SubjectNames()
        self._hindsight: Hindsight[_Seen] = Hindsight(configuration.attend)
        self._files = ExitStack()
        self._part: Part
        self._observer: FrameObserver

    @property
    def name(self) -> str:
        """The configuration's name."""
        return self._configuration.name

    @property
    def _pair(self) -> Pair:
        return self._job.manifest.name, self.name

    def __enter__(self) -> Self:
        pair = self._pair
        try:
            self._job.directory.traceback(pair).unlink(missing_ok=True)  # of an earlier try
            self._part = self._files.enter_context(self._job.directory.part(pair))
            observers = [
                _still_writer(self._job, pair),
                *_recorder(self._job, pair, self._rate_hz),
                *_signal_writer(self._job, self.name),
            ]
            self._observer = self._files.enter_context(Observers(*observers))
        except VfoaError as error:
            self.fail(error)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None and self.error is None:
            try:
                for waited in self._hindsight.finish():
                    self._write(*waited)
            except VfoaError as late:
                self.fail(late)
        try:
            self._files.__exit__(kind, error, trace)
        except VfoaError as late:
            self.error = str(late)

    def fail(self, error: VfoaError) -> None:
        """End the lane; what was written stays, to go on with if it is not kept as it is."""
        if self.error is None:
            self.error = str(error)
            if isinstance(error, StageError):
                atomic_write(self._job.directory.traceback(self._pair), error.trace)
            finished = self._keeps and self.written > 0
            self._files.__exit__(*((None,) * 3 if finished else (type(error), error, error.__traceback__)))
            self._files = ExitStack()

    def take(self, shared: SharedFrame) -> None:
        """Take one frame from the scene to the files, unless the lane has ended."""
        found = shared.by_configuration[self.name]
        if self.error is not None:
            return
        if isinstance(found, VfoaError):
            self.fail(found)
            return
        try:
            self._step(shared.frame, *found)
        except VfoaError as error:
            if isinstance(error, StageError):
                error.frame = shared.frame.index
            self.fail(error)

    def _step(self, frame: StereoFrame, percepts: Percepts, scene: Scene, bill: Bill) -> None:
        with timed(bill, "attention"):
            result, self._memory = guarded("attention", attend, scene, self._memory, self._configuration.attend)
        with timed(bill, "measures"):
            measures = self._measurer.measure(percepts, scene)
        with timed(bill, "attention"):
            ready = list(self._hindsight.add(result, (frame, percepts, measures, bill)))
        for waited in ready:
            self._write(*waited)

    def _write(self, result: FrameResult, seen: _Seen) -> None:
        frame, percepts, measures, bill = seen
        record = self._record(result, measures)
        with timed(bill, "recording"):
            verdicts = self._judge(record)
            self._observer.log(
                ShownFrame(frame=frame, percepts=percepts, result=result, record=record, verdicts=verdicts)
            )
        milliseconds = {stage: 1e3 * seconds for stage, seconds in bill.items()}
        self._part.write(to_line(record), milliseconds, f"{record.clip},{record.configuration},{record.frame}")
        self.written += 1

    def _record(self, result: FrameResult, measures: FrameMeasures | None) -> FrameRecord:
        """The result with the manifest's names."""
        manifest = self._job.manifest
        names, self._names = name_frame(result, manifest.subjects, manifest.targets, self._names)
        return to_record(manifest.name, self.name, result, names, measures)

    def _judge(self, record: FrameRecord) -> tuple[Verdict, ...]:
        """The verdict on every subject of the manifest."""
        labels = self._job.labels
        subjects = self._job.manifest.subjects
        return tuple(judge(record, name, labels.at(record.frame, name) if labels else None) for name in subjects)


def _still_writer(job: ClipJob, pair: Pair) -> FrameObserver:
    from harness.stills.writer import StillWriter

    return StillWriter(job.directory.path, *pair)


def _recorder(job: ClipJob, pair: Pair, rate_hz: float | None) -> list[FrameObserver]:
    if job.recording is None:
        return []
    from harness.recording.recorder import Recorder

    recorder = Recorder(
        job.directory.recording(pair),
        clip=pair[0],
        configuration=pair[1],
        rate_hz=rate_hz,
        size=job.recording,
        subjects=tuple(job.manifest.subjects),
        targets=tuple(job.manifest.targets),
        watched_at=job.watched_at,
    )
    return [recorder]


def _signal_writer(job: ClipJob, configuration: str) -> list[FrameObserver]:
    slots = job.signals.get(configuration)
    if not slots:
        return []
    from harness.signals.writer import SignalWriter

    return [SignalWriter(job.directory.signals / job.manifest.name / configuration, slots)]
