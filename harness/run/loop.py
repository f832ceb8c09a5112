"""The loop over the frames of a clip: read, perceive, follow, write scenes. What it wrote is attended to afterwards.

Each frame is read once and each distinct stage runs once. A configuration that fails is dropped, and the others
continue. A clip whose scenes are whole is not perceived again.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from harness.clips.manifest import ClipManifest
from harness.files.digests import KNOWN
from harness.files.safe_names import vfoa_command
from harness.files.unchanged import ChangedError, UnchangedFiles
from harness.pipeline.cache import ClipCache, StageIdentity, Tally
from harness.pipeline.cache_store import Store
from harness.pipeline.configuration import Configuration
from harness.pipeline.drawn_stage import DrawnClip
from harness.pipeline.measures import Measurer
from harness.pipeline.perception import Perception, SharedFrame, pose_frames
from harness.pipeline.prefetch import one_at_a_time, prefetch
from harness.pipeline.stage_runner import timed
from harness.run.attend import attend_clip
from harness.run.directory import Pair, RunDirectory, new_run_id
from harness.run.executors import GOES_ON, Progress
from harness.run.frame_sink import ClipContext, PictureSinkFactory, SceneSinkFactory, SinkFactory
from harness.run.scene_cache import SceneCache
from harness.run.scene_identity import Identity, Keys, has_scene, identities, keys_of
from harness.run.scenes import SceneWriters
from harness.run.timings import SceneTimes
from harness.sources import Clip, MeasuredClip
from vfoa.errors import VfoaError


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipJob:
    """A clip under some configurations. It is pickled, so it holds only settings, paths and factories.

    ``run_id`` is the random id of the run, for its recordings. Finished frames go to the ``sinks`` in their order.
    ``drawn`` holds the shapes drawn on the clip, ``clouds`` the numbers of points that methods of the run use of a
    target's cloud. ``digest`` is that of the clip's content, of which every frame must be read (None: not checked), and
    ``known`` are digests by the stamp of their files. ``store`` keeps scenes for later runs, and ``cache`` has the
    outputs of stages in it; None: nothing is stored. ``prefetched`` is the number of frames that one thread reads, and
    another one perceives, in advance; 0 for no threads. ``reporters`` is the number of jobs that report the progress of
    the clip, each that of its share of the frames; 0: it is reported already.
    """

    manifest: ClipManifest
    frames: tuple[int, ...]
    configurations: tuple[Configuration, ...]
    directory: RunDirectory
    clouds: tuple[int, ...]
    run_id: str = field(default_factory=new_run_id)
    sinks: tuple[SinkFactory, ...] = ()
    drawn: DrawnClip | None = None
    digest: str | None = None
    known: Mapping[str, str] = field(default_factory=dict)
    store: Store | None = None
    cache: ClipCache | None = None
    prefetched: int = 0
    reporters: int = 1

    @property
    def pairs(self) -> list[Pair]:
        """The (clip, configuration) pairs of the job."""
        return [(self.manifest.name, configuration.name) for configuration in self.configurations]

    def unchanged(self, clip: Clip | MeasuredClip) -> Callable[[], AbstractContextManager[None]]:
        """The blocks in which the clip is read as it was when the run began (:mod:`harness.files.unchanged`).

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

    def context(self, clip: Clip | MeasuredClip) -> ClipContext:
        """The context of the job's sinks."""
        return ClipContext(
            manifest=self.manifest,
            configurations=tuple(configuration.name for configuration in self.configurations),
            frames=self.frames,
            image_frames=() if isinstance(clip, MeasuredClip) else self.frames,
            rate_hz=clip.rate_hz,
            directory=self.directory,
            run_id=self.run_id,
        )

    def scenes(self, decided: Mapping[str, tuple[Identity, Identity]]) -> SceneCache | None:
        """The copies of scenes with these :meth:`identities`; None if there is no cache, or the clip is not known."""
        if self.store is None or self.digest is None:
            return None
        return SceneCache(store=self.store, directory=self.directory, clip=self.manifest.name, decided=decided)

    def fetch(self, clip: Clip | MeasuredClip) -> Iterator[Tally]:
        """Copy scenes of the cache into the run, unless a sink needs the images; yield what was reused.

        Raises
        ------
        VfoaError
            As :meth:`identities`.
        """
        if scenes := self.scenes(self.identities(clip)):
            context = self.context(clip)
            scenes.fetch_pictures(self.image_files, context)
            if self.has_scene_files(context) and scenes.fetch():
                name = self.manifest.name
                identity = StageIdentity(slot="scene", parts={"clip": name, "stage": "tables"}, digest="scene")
                yield Tally(identity, reused={str(number) for number in self.frames})

    def lacking(
        self, decided: Mapping[str, tuple[Identity, Identity]], context: ClipContext
    ) -> tuple[Configuration, ...]:
        """The configurations that must be perceived: all of them if a sink lacks what it has written of the clip."""
        if not self.has_scene_files(context):
            return self.configurations
        keys, clip = keys_of(decided), self.manifest.name
        return tuple(each for each in self.configurations if not has_scene(self.directory, clip, keys[each.name]))

    def has_scene_files(self, context: ClipContext) -> bool:
        """Whether all that sinks have written of the clip is there, for all configurations of the context."""
        return all(factory.is_whole(context) for factory in self.scene_sinks)

    @property
    def scene_sinks(self) -> list[SceneSinkFactory]:
        """The factories of sinks of what is perceived."""
        return [factory for factory in self.sinks if isinstance(factory, SceneSinkFactory)]

    @property
    def image_files(self) -> list[PictureSinkFactory]:
        """Those of them whose files show the images alone."""
        return [factory for factory in self.sinks if isinstance(factory, PictureSinkFactory)]

    def failures(self, errors: Mapping[str, VfoaError]) -> dict[Pair, VfoaError]:
        """The errors by (clip, configuration), from those by configuration."""
        return {pair: errors[pair[1]] for pair in self.pairs if pair[1] in errors}


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipResult:
    """Outcome of a job: the error of each (clip, configuration) that failed, and the use of the cache.

    ``keys`` are those of the scene and directions of each configuration that is perceived, by name.
    """

    failures: Mapping[Pair, VfoaError]
    keys: Mapping[str, Keys] = field(default_factory=dict)
    tallies: tuple[Tally, ...] = ()


def run_clip(job: ClipJob, progress: Progress) -> ClipResult:
    """Perceive one clip under all configurations of a job, unless its scenes are whole, and attend to it.

    Under configurations whose weights are still to be fitted it is only perceived.

    ``progress`` is called with the name of the clip after each frame that is perceived; of a clip without images, which
    takes no time to perceive, after each that is attended to.
    """
    clip, outcome = _perceived(job, progress, None)
    if clip is None:
        return outcome
    perceived = (each for each in job.configurations if each.name in outcome.keys)
    answering = [each for each in perceived if not each.attend.attention.is_unfitted]
    attend_progress = _AttendProgress(job, progress) if isinstance(clip, MeasuredClip) else None
    check = attend_progress or partial(_goes_on, progress)
    errors = attend_clip(clip, job.context(clip), answering, outcome.keys, job.sinks, check)
    if attend_progress:
        attend_progress.finish()
    return replace(outcome, failures={**outcome.failures, **job.failures(errors)})


def _goes_on(progress: Progress, *_: object) -> None:
    """Report no progress, but ask whether the run goes on."""
    progress(GOES_ON)


class _AttendProgress:
    """Reports the progress of a job that attends to a clip: its share of the frames, however often it reads them."""

    def __init__(self, job: ClipJob, progress: Progress) -> None:
        self._clip, self._progress = job.manifest.name, progress
        self._reporters = job.reporters
        self._left = len(job.frames) // job.reporters if job.reporters else 0
        self._read = 0

    def __call__(self, times: int) -> None:
        """Count a frame; the clip is read ``times`` times."""
        self._read += 1
        is_reported = self._left and self._read % (times * self._reporters) == 0
        self._left -= bool(is_reported)
        self._progress(self._clip if is_reported else GOES_ON)

    def finish(self) -> None:
        """Report what is left: frames of configurations that have failed, or that are not attended to."""
        for _ in range(self._left):
            self._progress(self._clip)


def perceive_clip(job: ClipJob, progress: Progress, numbers: Iterable[int] | None = None) -> ClipResult:
    """Perceive one clip as :func:`run_clip` does, without attending to it.

    ``numbers`` yields the frames of the job, each as soon as it may be read; default: the job's own frames.
    """
    return _perceived(job, progress, numbers)[1]


def _perceived(
    job: ClipJob, progress: Progress, numbers: Iterable[int] | None
) -> tuple[Clip | MeasuredClip | None, ClipResult]:
    """Perceive a clip, and return it, if it can be opened."""
    try:
        clip = job.manifest.open()
        unchanged = job.unchanged(clip)
        decided = job.identities(clip)
    except VfoaError as error:
        return None, ClipResult(failures=dict.fromkeys(job.pairs, error))
    if isinstance(clip, MeasuredClip) or not job.reporters:
        progress = partial(_goes_on, progress)
    context, tallies = job.context(clip), tuple[Tally, ...]()
    perceived: dict[str, Keys | VfoaError] = dict(keys_of(decided))
    if lacking := job.lacking(decided, context):
        part = replace(job, configurations=lacking)
        with unchanged(), _perception(part, clip, decided, numbers) as (frames, scenes, take_tallies):
            sinks = job.scene_sinks if lacking == job.configurations else ()  # otherwise, they are whole
            written = _write_scenes(frames, part, sinks, context, progress, scenes)
            tallies = take_tallies()
        perceived |= written
        if kept := job.scenes(decided):
            kept.keep(_without_errors(written), job.image_files, context)
        if job.cache:  # clips of poses store little, and are many
            job.cache.store.trim()
    else:
        for _ in job.frames:
            progress(job.manifest.name)
    errors = {name: each for name, each in perceived.items() if isinstance(each, VfoaError)}
    return clip, ClipResult(failures=job.failures(errors), keys=_without_errors(perceived), tallies=tallies)


def _without_errors(perceived: Mapping[str, Keys | VfoaError]) -> dict[str, Keys]:
    return {name: each for name, each in perceived.items() if not isinstance(each, VfoaError)}


@contextmanager
def _perception(
    job: ClipJob,
    clip: Clip | MeasuredClip,
    decided: Mapping[str, tuple[Identity, Identity]],
    numbers: Iterable[int] | None,
) -> Iterator[tuple[Generator[SharedFrame], SceneWriters, Callable[[], tuple[Tally, ...]]]]:
    """The frames of a clip as they are perceived, the writers of its scenes, and what says how the cache was used."""
    chosen = job.frames if numbers is None else numbers
    name = job.manifest.name
    decided = {each.name: decided[each.name] for each in job.configurations}
    if isinstance(clip, MeasuredClip):
        with SceneWriters(job.directory, name, decided) as scenes:
            yield pose_frames(job.configurations, clip, chosen, job.manifest), scenes, tuple
        return
    images, truth = one_at_a_time(clip) if job.prefetched else (clip, clip)
    options: dict[str, Any] = {"manifest": job.manifest, "drawn": job.drawn, "parallel": job.prefetched > 0}
    with (
        Perception(job.configurations, images, job.cache, **options) as perception,
        SceneWriters(job.directory, name, decided, Measurer(truth), job.clouds) as scenes,
    ):
        yield prefetch(perception.frames(chosen, job.prefetched), job.prefetched), scenes, perception.take_tallies


def _write_scenes(
    frames: Generator[SharedFrame],
    job: ClipJob,
    factories: Iterable[SceneSinkFactory],
    context: ClipContext,
    progress: Progress,
    scenes: SceneWriters,
) -> dict[str, Keys | VfoaError]:
    """Write frames as scenes, and hand them to the sinks of the clip, until they end or every configuration has failed.

    Scenes get their names when all of these sinks are closed: so they are the mark that recordings are whole.
    """
    errors: dict[str, VfoaError] = {}
    try:
        with closing(frames), ExitStack() as opened:
            sinks = [opened.enter_context(factory.open_scenes(context)) for factory in factories]
            times = opened.enter_context(SceneTimes(job.directory, job.pairs))
            while True:
                with _hint_if_unreadable(job.manifest):
                    frame = next(frames, None)
                if frame is None:
                    break
                scenes.write(frame)
                errors = {name: each for name, each in frame.by_configuration.items() if isinstance(each, VfoaError)}
                perceived = [each for each in frame.by_configuration.values() if not isinstance(each, VfoaError)]
                for sink in sinks if perceived else ():
                    with timed(perceived[0].timings, "recording"):
                        sink.write(frame)
                times.write(frame)
                progress(job.manifest.name)
                if not perceived:
                    break
    except VfoaError as error:
        return {each.name: error for each in job.configurations}
    return {each.name: errors.get(each.name) or scenes.finish(each.name) for each in job.configurations}


@contextmanager
def _hint_if_unreadable(manifest: ClipManifest) -> Iterator[None]:
    """Let the error of a frame that cannot be read say how to find all such frames."""
    try:
        yield
    except ChangedError:
        raise
    except VfoaError as error:
        check = vfoa_command("clips", "check", manifest.word, "--every-frame")
        raise VfoaError(f"{error}; {check} counts and names all that cannot be read") from None
