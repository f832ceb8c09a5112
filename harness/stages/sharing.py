"""One clip under many configurations: configurations that agree on a stage share its output.

Stages are called through :class:`harness.stages.stage_runner.StageRunner`, which finds an output of the same frame in
a :class:`harness.stages.stage_runner.StageMemo`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from harness.files.unchanged import ChangedError, read_unchanged
from harness.sources import Clip
from harness.stages.cache.stage import ClipCache, Tally
from harness.stages.configuration import Configuration
from harness.stages.drawn import DrawnClip
from harness.stages.slots import OFF, SLOTS, StageChoice
from harness.stages.stage_runner import Output, StageMemo, StageRunner, Timings, build_stage, guarded, timed
from vfoa.drawn import DrawnSettings
from vfoa.errors import StageError, VfoaError
from vfoa.gaze import TemporalGazeModel
from vfoa.gaze.temporal import HeadWindow, WindowStart, with_gazes
from vfoa.pipeline import Stages, perceive
from vfoa.reconstruction import place_people, place_targets
from vfoa.types import Percepts, Scene, StereoFrame, Target


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedFrame:
    """A frame with the percepts, the scene and the seconds per stage of each configuration, by its name.

    A configuration that has failed, in this frame or an earlier one, has its error instead. A clip of measurements has
    no images and no percepts. ``windows`` hold the start of each temporal gaze window for continuing from this frame.
    """

    index: int
    frame: StereoFrame | None
    by_configuration: Mapping[str, tuple[Percepts | None, Scene, Timings] | VfoaError]
    windows: Mapping[str, WindowStart] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadFrame:
    """A frame and the seconds that reading it took."""

    frame: StereoFrame
    timings: Timings


@dataclass(frozen=True, slots=True, kw_only=True)
class PerceivedFrame(ReadFrame):
    """A frame with the outputs of its stages, except those of a temporal gaze model."""

    outputs: dict[tuple[object, ...], Output]


class UnreadableFrameError(VfoaError):
    """An image that is damaged or missing; ``frame`` is the number of its frame."""

    def __init__(self, line: str, frame: int = 0) -> None:
        super().__init__(line)
        self.frame = frame


def read_frames(clip: Clip, numbers: Iterable[int]) -> Generator[ReadFrame]:
    """Read the frames with these numbers.

    Raises
    ------
    UnreadableFrameError
        If one cannot be read.
    """

    def read(number: int) -> StereoFrame:
        try:
            return clip.frame(number)
        except ChangedError:
            raise
        except VfoaError as error:
            raise UnreadableFrameError(str(error), number) from None

    for number in numbers:
        timings: Timings = {}
        with timed(timings, "decode"):
            frame = read_unchanged(read, number)
        yield ReadFrame(frame=frame, timings=timings)


class SharedPipeline:
    """``perceive`` and ``reconstruct`` for every configuration of one clip.

    All stages are built with it. A stage that cannot be built, or fails on a frame, ends the configurations that use
    it. ``cache`` holds outputs of earlier runs; None for no cache. ``drawn`` are the shapes drawn on the clip; None for
    none. ``parallel`` runs the models of the heads beside the matchers, in a thread of their own, and segmenters with a
    delay in another one. ``begins`` are the first frames of configurations that do not begin with the clip, and
    ``starts`` those of their windows.
    """

    def __init__(
        self,
        configurations: Sequence[Configuration],
        clip: Clip,
        cache: ClipCache | None = None,
        *,
        drawn: DrawnClip | None = None,
        parallel: bool = False,
        begins: Mapping[str, int] | None = None,
        starts: Mapping[str, WindowStart] | None = None,
    ) -> None:
        self._drawn = drawn
        self._drawings: dict[DrawnSettings, StageRunner] = {}
        self._begins, self._starts = begins or {}, starts or {}
        self._beside = ThreadPoolExecutor(1) if parallel else None
        self._segmenting = ThreadPoolExecutor(1) if parallel else None  # of its own: heads must not wait for it
        self._perceive_one = partial(perceive, beside=self._beside)
        self._tallies: dict[str, Tally] = {}
        self._configurations, self._clip, self._cache = configurations, clip, cache
        self._memo = StageMemo()
        self._failed: dict[str, VfoaError] = {}
        self._built: dict[str, StageRunner] = {}
        self._same: dict[tuple[object, ...], Stages] = {}
        self._stages: dict[str, Stages] = {}
        self._windows: dict[str, HeadWindow] = {}
        self._same_windows: dict[tuple[object, ...], HeadWindow] = {}
        for configuration in configurations:
            with self._isolated(configuration.name):
                self._build(configuration)
        self._look_ahead = max((window.look_ahead for window in self._windows.values()), default=0)

    def close(self) -> None:
        """End the threads of the models of the heads and of the segmenters."""
        for executor in (self._beside, self._segmenting):
            if executor:
                executor.shutdown(cancel_futures=True)

    def _build(self, configuration: Configuration) -> None:
        """Build the stages of one configuration, except those already built for another one."""
        keys = {slot: choice.key if choice else OFF for slot, choice in configuration.choices.items()}
        for choice in configuration.choices.values():
            if choice and choice.key not in self._built:
                self._built[choice.key] = self._stage(choice)
        chosen = {slot: self._built.get(key) for slot, key in keys.items()}
        drawing = self._drawing(configuration)
        drawn = configuration.drawn if drawing else None
        built = _stages(chosen, drawing, in_region=configuration.is_in_region)
        stages = self._same.setdefault((*keys.values(), drawn), built)
        self._stages[configuration.name] = stages
        if stages.temporal_gaze:
            tracking = configuration.attend.tracking
            # heads and crops depend on nothing else, so configurations that agree on this have the same gazes
            seen = (keys["segmentation"], keys["heads"], keys["gaze"], drawn, tracking)
            start = self._starts.get(configuration.name)
            if seen not in self._same_windows:
                self._same_windows[seen] = HeadWindow(stages.temporal_gaze, self._clip.rate_hz, tracking, start)
            self._same_windows[seen].begin_by(start)
            self._windows[configuration.name] = self._same_windows[seen]

    def _stage(self, choice: StageChoice) -> StageRunner:
        stored = self._cache.outputs_of(choice, self._tallies) if self._cache else None
        return build_stage(choice, self._clip, self._memo, stored, beside=self._segmenting)

    def _drawing(self, configuration: Configuration) -> StageRunner | None:
        """The drawn shapes as a configuration uses them; their time is charged to the segmentation."""
        settings = configuration.drawn
        if self._drawn is None or not configuration.uses_drawn:
            return None
        if settings not in self._drawings:
            shapes = self._drawn.shapes(settings)
            self._drawings[settings] = StageRunner(shapes, slot="segmentation", name="drawn", memo=self._memo)
        return self._drawings[settings]

    def take_tallies(self) -> dict[str, Tally]:
        """Return the outputs reused and computed since the last call, by the stage's key."""
        return {key: tally.take() for key, tally in self._tallies.items()}

    @contextmanager
    def _isolated(self, name: str, frame: int | None = None) -> Iterator[None]:
        """Let an error of one configuration, in a frame or before the first, end only that configuration."""
        try:
            yield
        except VfoaError as error:
            if isinstance(error, StageError):
                error.frame = frame
            self._failed[name] = error

    def warm(self, numbers: Iterable[int]) -> Iterator[int]:
        """Only perceive frames, in any order, to fill the cache; yield each number when it is done.

        A failure is ignored here; it is raised again where the frame's result is used.
        """
        for number in numbers:
            with suppress(VfoaError):
                frame = read_unchanged(self._clip.frame, number)
                self._memo.outputs = {}
                for stages in self._same.values():
                    with suppress(VfoaError):
                        self._memo.call("perceive", self._perceive_one, frame, stages)
            yield number

    def frames(self, numbers: Iterable[int]) -> Generator[SharedFrame]:
        """Read, perceive and reconstruct frames, in ascending order."""
        return self.reconstruct(self.perceive(read_frames(self._clip, numbers)))

    def perceive(self, frames: Generator[ReadFrame]) -> Generator[PerceivedFrame]:
        """Run every distinct stage on each frame, in ascending order.

        A frame is yielded when all frames that its gaze depends on have been read: at once without a temporal model.
        """
        waiting: deque[PerceivedFrame] = deque()
        with closing(frames):
            for read in frames:
                waiting.append(self._perceive(read))
                while waiting and waiting[0].frame.index + self._look_ahead <= read.frame.index:
                    yield waiting.popleft()
        yield from waiting

    def reconstruct(self, frames: Generator[PerceivedFrame]) -> Generator[SharedFrame]:
        """Place the objects and people of each frame in space, for every configuration that has not failed."""
        with closing(frames):
            for perceived in frames:
                yield self._finish(perceived)

    def _perceive(self, read: ReadFrame) -> PerceivedFrame:
        self._memo.outputs, self._memo.timings = {}, {}
        fed: set[HeadWindow] = set()
        for name in [name for name in self._stages if name not in self._failed]:
            with self._isolated(name, read.frame.index):
                self._feed(name, read.frame, fed)
        return PerceivedFrame(frame=read.frame, timings=read.timings, outputs=self._memo.outputs)

    def _feed(self, name: str, frame: StereoFrame, fed: set[HeadWindow]) -> None:
        percepts = self._memo.call("perceive", self._perceive_one, frame, self._stages[name])
        window = self._windows.get(name)
        if window and window not in fed:
            window.add(percepts)
            fed.add(window)

    def _finish(self, perceived: PerceivedFrame) -> SharedFrame:
        self._memo.outputs = perceived.outputs
        found: dict[str, tuple[Percepts | None, Scene, Timings] | VfoaError] = {}
        index = perceived.frame.index
        for configuration in self._configurations:
            if configuration.name not in self._failed and index >= self._begins.get(configuration.name, index):
                with self._isolated(configuration.name, index):
                    found[configuration.name] = self._run(configuration, perceived)
        windows = {name: window.start() for name, window in self._windows.items() if name in found}
        return SharedFrame(
            index=index, frame=perceived.frame, by_configuration={**self._failed, **found}, windows=windows
        )

    def _run(self, configuration: Configuration, perceived: PerceivedFrame) -> tuple[Percepts, Scene, Timings]:
        call, frame = self._memo.call, perceived.frame
        self._memo.timings = dict(perceived.timings)
        percepts = call("perceive", self._perceive_one, frame, self._stages[configuration.name])
        if window := self._windows.get(configuration.name):
            percepts = call("gaze", with_gazes, percepts, call("gaze", window.gazes, frame.index))
        settings = configuration.reconstruction
        seen = (percepts.disparity, percepts.instances, percepts.rig)
        targets = call("reconstruction", _targets, *seen, settings)
        scene = call("reconstruction", _scene, percepts, targets, settings)
        return percepts, scene, self._memo.timings


def _targets(*seen: Any) -> tuple[Target, ...]:
    return guarded("reconstruction", place_targets, *seen)


def _scene(*found: Any) -> Scene:
    return guarded("reconstruction", place_people, *found)


def _stages(chosen: Mapping[str, Any], drawing: Any, *, in_region: bool) -> Stages:
    matcher, segmenter, heads = chosen["stereo"], chosen["segmentation"], chosen["heads"]
    if matcher is None or segmenter is None or heads is None:
        missing = next(slot for slot in ("stereo", "segmentation", "heads") if chosen[slot] is None)
        raise VfoaError(f'{missing}.{SLOTS[missing].key}: found "none"; a clip with images needs it')
    gaze = chosen["gaze"]
    temporal = gaze is not None and isinstance(gaze.stage, TemporalGazeModel)
    return Stages(
        matcher=matcher,
        segmenter=segmenter,
        heads=heads,
        head_pose=chosen["head_pose"],
        gaze=None if temporal else gaze,
        temporal_gaze=gaze if temporal else None,
        region_matcher=matcher if in_region else None,
        drawing=drawing,
    )
