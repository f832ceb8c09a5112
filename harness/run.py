"""The only loop over frames.

A run is cut into jobs, one a clip. A job reads each frame once, computes each distinct stage once, and writes one
part file and one recording per configuration, which are moved into place when the clip is done.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TextIO

from harness.annotations import Labels
from harness.executors import Progress
from harness.experiment import Configuration
from harness.manifest import ClipManifest
from harness.naming import SubjectNames, name_frame
from harness.recording import FrameObserver, Observers, Size
from harness.records import to_record
from harness.results import FrameRecord, to_line
from harness.run_directory import Pair, RunDirectory
from harness.sharing import Bill, SharedPipeline, timed
from harness.verdicts import Verdict, judge
from vfoa.errors import VfoaError
from vfoa.pipeline import Memory, attend
from vfoa.types import FrameResult, Percepts, Scene, StereoFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipJob:
    """All that a process needs to run one clip: settings and paths only, since it travels to another process.

    ``recording`` is how much the recordings hold, None for none. ``save_signals``: also save what every stage found.
    """

    manifest: ClipManifest
    frames: tuple[int, ...]
    labels: Labels | None
    configurations: tuple[Configuration, ...]
    directory: RunDirectory
    recording: Size | None
    save_signals: bool = False

    @property
    def pairs(self) -> list[Pair]:
        """The job's (clip, configuration)s."""
        return [(self.manifest.name, configuration.name) for configuration in self.configurations]


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipOutcome:
    """How a job ended; ``error`` is the one line that says why the clip could not be finished, or None."""

    clip: str
    error: str | None


def run_clip(job: ClipJob, progress: Progress) -> ClipOutcome:
    """Run one clip under all its configurations; ``progress`` is told the clip's name after each frame."""
    try:
        clip = job.manifest.open()
        pipeline = SharedPipeline(job.configurations, clip)
        with ExitStack() as stack:
            lanes = [_open_lane(job, configuration, clip.rate_hz, stack) for configuration in job.configurations]
            for shared in pipeline.frames(job.frames):
                for lane in lanes:
                    percepts, scene, bill = shared.by_configuration[lane.configuration.name]
                    lane.step(shared.frame, percepts, scene, bill)
                progress(job.manifest.name)
    except VfoaError as error:
        return ClipOutcome(clip=job.manifest.name, error=str(error))
    return ClipOutcome(clip=job.manifest.name, error=None)


@dataclass(slots=True, kw_only=True)
class _Lane:
    """One configuration on its way through the clip: its memory, and the files its frames go to."""

    job: ClipJob
    configuration: Configuration
    results: TextIO
    timings: TextIO
    observer: FrameObserver
    memory: Memory = field(default_factory=Memory)
    names: SubjectNames = field(default_factory=SubjectNames)

    def step(self, frame: StereoFrame, percepts: Percepts, scene: Scene, bill: Bill) -> None:
        """Take one frame from the scene to the files; ``bill`` is what it has cost so far."""
        with timed(bill, "attention"):
            result, self.memory = attend(scene, self.memory, self.configuration.attend)
        record = self.name(result)
        with timed(bill, "recording"):
            self.observer.log(frame, percepts, result, record, self.judge(record))
        self.results.write(to_line(record))
        for stage, seconds in bill.items():
            self.timings.write(f"{record.clip},{record.configuration},{record.frame},{stage},{1e3 * seconds:.3f}\n")

    def name(self, result: FrameResult) -> FrameRecord:
        """The result with the manifest's names."""
        manifest = self.job.manifest
        names, self.names = name_frame(result, manifest.subjects, manifest.targets, self.names)
        return to_record(manifest.name, self.configuration.name, result, names)

    def judge(self, record: FrameRecord) -> tuple[Verdict, ...]:
        """The verdict on every subject of the manifest."""
        labels = self.job.labels
        subjects = self.job.manifest.subjects
        return tuple(judge(record, name, labels.at(record.frame, name) if labels else None) for name in subjects)


def _open_lane(job: ClipJob, configuration: Configuration, rate_hz: float | None, stack: ExitStack) -> _Lane:
    pair = (job.manifest.name, configuration.name)
    results, timings = stack.enter_context(job.directory.part(pair))
    observers = [*_recorder(job, pair, rate_hz), *_signal_writer(job, configuration)]
    observer = stack.enter_context(Observers(*observers))
    return _Lane(job=job, configuration=configuration, results=results, timings=timings, observer=observer)


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
    )
    return [recorder]


def _signal_writer(job: ClipJob, configuration: Configuration) -> list[FrameObserver]:
    if not job.save_signals:
        return []
    from harness.signals.saved import owned_slots
    from harness.signals.writer import SignalWriter

    slots = owned_slots(configuration, job.configurations)
    root = job.directory.signals / job.manifest.name / configuration.name
    return [SignalWriter(root, slots)] if slots else []
