"""The only loop over frames: read, perceive, reconstruct, attend for each configuration, hand to the sinks.

Each frame is read once and each distinct stage runs once. A configuration that fails is dropped, and the others
continue.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, closing, nullcontext
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, NamedTuple, Self

from harness.clips.manifest import ClipManifest
from harness.files.digests import KNOWN
from harness.files.io import ChangedError, UnchangedFiles
from harness.pipeline.cache import ClipCache, Tally
from harness.pipeline.configuration import Configuration, open_method
from harness.pipeline.drawn import DrawnClip
from harness.pipeline.measures import Measurer
from harness.pipeline.perception import Perception, SharedFrame, one_at_a_time, pose_frames, prefetch
from harness.pipeline.stage_runner import Timings, guarded, timed
from harness.run.answers import AnswerWriter, filtered_cues
from harness.run.directory import Pair, RunDirectory, new_run_id
from harness.run.executors import Progress
from harness.run.frame_sink import (
    Camera,
    ClipContext,
    FinishedFrame,
    FrameSink,
    SceneSink,
    SceneSinkFactory,
    SinkContext,
    SinkFactory,
)
from harness.run.records import to_record
from harness.run.scenes import Identity, SceneWriters, identities
from harness.sources import Clip, MeasuredClip
from vfoa.errors import StageError, VfoaError
from vfoa.pipeline import Attending
from vfoa.types import FrameResult


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipJob:
    """A clip under some configurations. It is pickled, so it holds only settings, paths and factories.

    ``run_id`` is the random id of the run, for its recordings. Finished frames go to the ``sinks`` in their order.
    ``drawn`` holds the shapes drawn on the clip, ``clouds`` the numbers of points that methods of the run use of a
    target's cloud. ``digest`` is that of the clip's content, of which every frame must be
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
    clouds: tuple[int, ...] = ()
    digest: str | None = None
    known: Mapping[str, str] = field(default_factory=dict)
    cache: ClipCache | None = None
    ahead: int = 0

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

    def identities(self, clip: Clip | MeasuredClip) -> dict[str, tuple[Identity, Identity]]:
        """What decides the scene and the directions of each configuration.

        Raises
        ------
        VfoaError
            If weights or files of a stage are missing.
        """
        return {
            each.name: identities(
                *(each, clip, self.manifest, self.frames), digest=self.digest, drawn=self.drawn, clouds=self.clouds
            )
            for each in self.configurations
        }

    def context_of(self, clip: Clip | MeasuredClip) -> dict[str, Any]:
        """The fields of a :class:`ClipContext` of the job."""
        return {
            "manifest": self.manifest,
            "configurations": tuple(configuration.name for configuration in self.configurations),
            "rate_hz": clip.rate_hz,
            "directory": self.directory,
            "run_id": self.run_id,
        }

    def open_scene_sinks(self, clip: Clip | MeasuredClip) -> Iterator[SceneSink]:
        """Yield the sinks of what is perceived, in their order, each to be opened before the next."""
        for factory in self.sinks:
            if isinstance(factory, SceneSinkFactory):
                yield factory.open_scenes(ClipContext(**self.context_of(clip)))

    def outcome(self, errors: Iterable[VfoaError | None], tallies: tuple[Tally, ...] = ()) -> ClipOutcome:
        """The outcome of the job, from each configuration's error in order (None: it is finished)."""
        failures = {pair: error for pair, error in zip(self.pairs, errors, strict=True) if error is not None}
        return ClipOutcome(failures=failures, tallies=tallies)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipOutcome:
    """Outcome of a job: the error of each (clip, configuration) that failed, and the use of the cache."""

    failures: Mapping[Pair, VfoaError]
    tallies: tuple[Tally, ...] = ()


def run_clip(job: ClipJob, progress: Progress, numbers: Iterable[int] | None = None) -> ClipOutcome:
    """Run one clip under all configurations of a job.

    ``progress`` is called with the name of the clip after each frame. ``numbers`` yields the frames of the job, each as
    soon as it may be read; default: the job's own frames.
    """
    try:
        clip = job.manifest.open()
        unchanged = job.unchanged(clip)
        decided = job.identities(clip)
    except VfoaError as error:
        return ClipOutcome(failures=dict.fromkeys(job.pairs, error))
    chosen = job.frames if numbers is None else numbers
    if isinstance(clip, MeasuredClip):
        frames = pose_frames(job.configurations, clip, chosen, job.manifest)
        with SceneWriters(job.directory, job.manifest.name, decided) as scenes:
            runners = attend_to(frames, job, clip, progress, scenes)
        return job.outcome(runner.error for runner in runners)
    images, truth = one_at_a_time(clip, 2) if job.ahead else (clip, clip)
    parallel = job.ahead > 0
    with (
        unchanged(),
        Perception(
            job.configurations, images, job.cache, manifest=job.manifest, drawn=job.drawn, parallel=parallel
        ) as perception,
        SceneWriters(job.directory, job.manifest.name, decided, Measurer(truth), job.clouds) as scenes,
    ):
        frames = prefetch(perception.frames(chosen, job.ahead), job.ahead)
        runners = attend_to(frames, job, clip, progress, scenes)
    if job.cache:
        job.cache.store.trim()
    return job.outcome((runner.error for runner in runners), perception.take_tallies())


def attend_to(
    frames: Generator[SharedFrame],
    job: ClipJob,
    clip: Clip | MeasuredClip,
    progress: Progress,
    scenes: SceneWriters,
) -> list[ConfigurationRunner]:
    """Write the scenes, attend to frames and hand them to the sinks, until they end or every configuration has failed.

    Configurations are marked finished when the sinks of all are closed: the last one closes the files that they share.
    Returns one runner per configuration of the job, in order, each finished, with its error.
    """
    runners = [
        ConfigurationRunner(job, configuration, clip, scenes.keys(configuration.name))
        for configuration in job.configurations
    ]
    try:
        with closing(_readable(frames, job.manifest.name)) as readable, ExitStack() as sinks:
            shared = [sinks.enter_context(sink) for sink in job.open_scene_sinks(clip)]
            for runner in runners:
                sinks.enter_context(runner)
            for frame in readable:
                perceived = [each for each in frame.by_configuration.values() if not isinstance(each, VfoaError)]
                scenes.write(frame)
                for sink in shared if perceived else ():
                    with timed(perceived[0].timings, "recording"):
                        sink.write(frame)
                for runner in runners:
                    runner.attend(frame)
                progress(job.manifest.name)
                if not perceived:
                    break
    except VfoaError as error:
        for runner in runners:
            runner.fail(error)
    for runner in (each for each in runners if each.error is None):
        runner.finish(scenes.finish(runner.name))
    return runners


def _readable(frames: Generator[SharedFrame], clip: str) -> Generator[SharedFrame]:
    """Yield the frames. The error of one that cannot be read says how to find all such frames."""
    try:
        with closing(frames):
            yield from frames
    except ChangedError:
        raise
    except VfoaError as error:
        more = f"vfoa clips check {clip} --every-frame counts and names all that cannot be read"
        raise VfoaError(f"{error}; {more}") from None


class _Companion(NamedTuple):
    """The data that goes to the sinks with a frame's result, which may come later."""

    camera: Camera | None
    timings: Timings


class ConfigurationRunner:
    """Attends to the frames of a clip in order under one configuration, and hands them to the sinks of its job.

    It is a context manager, which opens and closes the sinks. An error ends only this configuration: ``error`` is None
    until then.
    """

    def __init__(
        self,
        job: ClipJob,
        configuration: Configuration,
        clip: Clip | MeasuredClip,
        keys: Mapping[str, str],
    ) -> None:
        self.error: VfoaError | None = None
        self.name = configuration.name
        self._job, self._configuration = job, configuration
        self._context = SinkContext(**job.context_of(clip), configuration=configuration.name)
        self._clip = clip
        self._attending: Attending
        self._companions: deque[_Companion] = deque()
        filtered = filtered_cues(configuration.plain())
        self._answers = AnswerWriter(job.directory, (job.manifest.name, configuration.name), keys, filtered)
        self._sinks: list[FrameSink] = []
        self._open_sinks = ExitStack()

    def __enter__(self) -> Self:
        attend, manifest = self._configuration.attend, self._job.manifest
        try:
            self._attending = Attending(attend, open_method(attend.attention, manifest, self._clip))
            for factory in self._job.sinks:
                if (sink := factory.open(self._context)) is not None:
                    self._sinks.append(self._open_sinks.enter_context(sink))
            self._sinks.append(self._open_sinks.enter_context(self._answers))
        except VfoaError as error:
            self.fail(error)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None and self.error is None:
            try:
                self._hand_over(guarded("attention", self._attending.finish))
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

    def finish(self, keys: Mapping[str, str]) -> None:
        """Mark the answers as finished, when the sinks of all configurations are closed.

        ``keys`` are the final ones of the scene and of the directions.
        """
        self._answers.finish(**keys)

    def attend(self, shared: SharedFrame) -> None:
        """Attend to one frame, and hand the frames that are finished now to the sinks: more than one when smoothed."""
        if self.error is not None:
            return
        perceived = shared.by_configuration[self._configuration.name]
        if isinstance(perceived, VfoaError):
            self.fail(perceived)
            return
        _, scene, tracked, names, timings = perceived
        try:
            with timed(timings, "attention"):
                ready = guarded("attention", self._attending.step, scene, tracked, names.subjects)
            self._companions.append(_Companion(Camera.of(shared.frame), timings))
            self._hand_over(ready)
        except VfoaError as error:
            if isinstance(error, StageError):
                error.frame = shared.index
            self.fail(error)

    def _hand_over(self, ready: Iterable[FrameResult]) -> None:
        """Hand frames to every sink, with their records.

        The time of the sinks counts as ``recording``, except that of the last one.
        """
        for result in ready:
            camera, timings = self._companions.popleft()
            fx_px = camera.rig.fx_px if camera else None
            record = to_record(self._context.manifest.name, self._configuration.name, result, fx_px)
            finished = FinishedFrame(camera=camera, result=result, record=record, timings=timings)
            for sink in self._sinks:
                with timed(timings, "recording"):
                    sink.write(finished)
