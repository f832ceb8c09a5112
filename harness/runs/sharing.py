"""One clip under many configurations, with nothing computed twice in a frame.

Configurations that agree on a stage share its output, by way of a :class:`harness.runs.ledger.Ledger`.

A frame leaves when all that its gaze is estimated from has been read: at once, unless a configuration has a temporal
gaze model. Until then it waits with its outputs.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from typing import Any

from harness.adapters import Clip
from harness.cache.stage import ClipCache, Tally
from harness.runs.ahead import ahead
from harness.runs.configuration import Configuration
from harness.runs.faults import build, guarded
from harness.runs.ledger import Bill, Ledger, Output, timed
from harness.runs.stages import OFF, StageChoice
from vfoa.errors import StageError, VfoaError
from vfoa.gaze import TemporalGazeModel
from vfoa.gaze.temporal import HeadWindow, with_gazes
from vfoa.pipeline import Stages, perceive
from vfoa.reconstruction import place_people, place_targets
from vfoa.tracking import TrackingSettings
from vfoa.types import Percepts, Scene, StereoFrame, Target


@dataclass(frozen=True, slots=True, eq=False)
class _Shared:
    """A stage of any protocol, called through the ledger."""

    slot: str
    stage: Any
    ledger: Ledger

    def match(self, *inputs: object) -> Any:
        return self.ledger.call(self.slot, self.stage.match, *inputs)

    def match_region(self, *inputs: object) -> Any:
        return self.ledger.call(self.slot, self.stage.match_region, *inputs)

    def segment(self, *inputs: object) -> Any:
        return self.ledger.call(self.slot, self.stage.segment, *inputs)

    def detect(self, *inputs: object) -> Any:
        return self.ledger.call(self.slot, self.stage.detect, *inputs)

    def estimate(self, *inputs: object) -> Any:
        return self.ledger.call(self.slot, self.stage.estimate, *inputs)

    def crop(self, *inputs: object) -> Any:
        return self.ledger.call(self.slot, self.stage.crop, *inputs)

    # what a window asks its model; the window's own answer goes through the ledger

    def stride(self, rate_hz: float | None) -> int:
        return int(self.stage.stride(rate_hz))

    def estimate_sequence(self, *inputs: Any) -> Any:
        return self.stage.estimate_sequence(*inputs)


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedFrame:
    """One frame with what each configuration, by name, made of it: percepts, scene, and the seconds per stage.

    A configuration that has failed, in this frame or in one that was read before, has its error instead.
    """

    frame: StereoFrame
    by_configuration: Mapping[str, tuple[Percepts, Scene, Bill] | VfoaError]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Waiting:
    """A frame whose gazes are not known yet, the outputs of its stages, and what it has cost to read."""

    frame: StereoFrame
    outputs: dict[tuple[object, ...], Output]
    decoding: Bill


class SharedPipeline:
    """``perceive`` and ``reconstruct`` for every configuration of one clip.

    All stages are built with it, behind a guard (:mod:`harness.runs.faults`) and the ``cache`` if there is one. A stage
    that cannot be built, or fails on a frame, ends the configurations that have it. ``ahead`` is how many frames a
    thread reads before they are perceived; 0 for none.
    """

    def __init__(
        self, configurations: Sequence[Configuration], clip: Clip, cache: ClipCache | None = None, *, ahead: int = 0
    ) -> None:
        self._tallies: dict[str, Tally] = {}
        self._ahead = ahead
        self._configurations, self._clip, self._cache = configurations, clip, cache
        self._ledger = Ledger()
        self._failed: dict[str, VfoaError] = {}
        self._built: dict[str, _Shared] = {}
        self._same: dict[tuple[str, ...], Stages] = {}
        self._stages: dict[str, Stages] = {}
        self._windows: dict[str, HeadWindow] = {}
        self._same_windows: dict[tuple[str | TrackingSettings, ...], HeadWindow] = {}
        for configuration in configurations:
            with self._isolated(configuration.name):
                self._build(configuration)
        self._look_ahead = max((window.look_ahead for window in self._windows.values()), default=0)

    def _build(self, configuration: Configuration) -> None:
        """Build the stages of one configuration, but for those that another one has."""
        keys = {slot: choice.key if choice else OFF for slot, choice in configuration.choices.items()}
        for slot, choice in configuration.choices.items():
            if choice and choice.key not in self._built:
                self._built[choice.key] = _Shared(slot, self._stage(choice), self._ledger)
        chosen = {slot: self._built.get(key) for slot, key in keys.items()}
        stages = self._same.setdefault(tuple(keys.values()), _stages(chosen, in_region=configuration.is_in_region))
        self._stages[configuration.name] = stages
        if stages.temporal_gaze:
            tracking = configuration.attend.tracking
            # heads and crops depend on no more than this, so whoever agrees on it has the same gazes
            seen = (keys["segmentation"], keys["heads"], keys["gaze"], tracking)
            if seen not in self._same_windows:
                self._same_windows[seen] = HeadWindow(stages.temporal_gaze, self._clip.rate_hz, tracking)
            self._windows[configuration.name] = self._same_windows[seen]

    def _stage(self, choice: StageChoice) -> Any:
        """A stage, behind the cache where there is one."""
        stage = build(choice, self._clip)
        return self._cache.wrap(choice, stage, self._ledger.charge, self._tallies) if self._cache else stage

    def take_tallies(self) -> dict[str, Tally]:
        """What the cache gave and what was computed since this was last asked, by the stage's key."""
        return {key: tally.take() for key, tally in self._tallies.items()}

    @contextmanager
    def _isolated(self, name: str, frame: int | None = None) -> Iterator[None]:
        """Keep what goes wrong with one configuration, in a frame or before the first, from the others."""
        try:
            yield
        except VfoaError as error:
            if isinstance(error, StageError):
                error.frame = frame
            self._failed[name] = error

    def warm(self, numbers: Iterable[int]) -> Iterator[int]:
        """Only perceive frames, in any order, for what the cache keeps of it; yield each number when it is done.

        What fails here fails again, and is said, where the frame's result is wanted.
        """
        for number in numbers:
            with suppress(VfoaError):
                frame = self._clip.frame(number)
                self._ledger.outputs = {}
                for stages in self._same.values():
                    with suppress(VfoaError):
                        self._ledger.call("perceive", perceive, frame, stages)
            yield number

    def frames(self, numbers: Iterable[int]) -> Generator[SharedFrame]:
        """Read frames, in ascending order, and run every configuration on each; they come in the same order."""
        waiting: deque[_Waiting] = deque()
        with closing(ahead(self._read(numbers), self._ahead)) as read:
            for frame, decoding in read:
                waiting.append(self._perceive(frame, decoding))
                while waiting and waiting[0].frame.index + self._look_ahead <= frame.index:
                    yield self._finish(waiting.popleft())
        while waiting:
            yield self._finish(waiting.popleft())

    def _read(self, numbers: Iterable[int]) -> Generator[tuple[StereoFrame, Bill]]:
        for number in numbers:
            decoding: Bill = {}
            with timed(decoding, "decode"):
                frame = self._clip.frame(number)
            yield frame, decoding

    def _perceive(self, frame: StereoFrame, decoding: Bill) -> _Waiting:
        self._ledger.outputs, self._ledger.bill = {}, {}
        fed: set[HeadWindow] = set()
        for name in [name for name in self._stages if name not in self._failed]:
            with self._isolated(name, frame.index):
                self._feed(name, frame, fed)
        return _Waiting(frame=frame, outputs=self._ledger.outputs, decoding=decoding)

    def _feed(self, name: str, frame: StereoFrame, fed: set[HeadWindow]) -> None:
        percepts = self._ledger.call("perceive", perceive, frame, self._stages[name])
        window = self._windows.get(name)
        if window and window not in fed:
            window.add(percepts)
            fed.add(window)

    def _finish(self, waiting: _Waiting) -> SharedFrame:
        self._ledger.outputs = waiting.outputs
        found: dict[str, tuple[Percepts, Scene, Bill] | VfoaError] = {}
        for configuration in self._configurations:
            if configuration.name not in self._failed:
                with self._isolated(configuration.name, waiting.frame.index):
                    found[configuration.name] = self._run(configuration, waiting)
        return SharedFrame(frame=waiting.frame, by_configuration={**self._failed, **found})

    def _run(self, configuration: Configuration, waiting: _Waiting) -> tuple[Percepts, Scene, Bill]:
        call, frame = self._ledger.call, waiting.frame
        self._ledger.bill = dict(waiting.decoding)
        percepts = call("perceive", perceive, frame, self._stages[configuration.name])
        if window := self._windows.get(configuration.name):
            percepts = call("gaze", with_gazes, percepts, call("gaze", window.gazes, frame.index))
        settings = configuration.reconstruction
        seen = (percepts.disparity, percepts.instances, percepts.rig)
        targets = call("reconstruction", _targets, *seen, settings)
        scene = call("reconstruction", _scene, percepts, targets, settings)
        return percepts, scene, self._ledger.bill


def _targets(*seen: Any) -> tuple[Target, ...]:
    return guarded("reconstruction", place_targets, *seen)


def _scene(*found: Any) -> Scene:
    return guarded("reconstruction", place_people, *found)


def _stages(chosen: Mapping[str, _Shared | None], *, in_region: bool) -> Stages:
    matcher, segmenter, heads = chosen["stereo"], chosen["segmentation"], chosen["heads"]
    if matcher is None or segmenter is None or heads is None:
        raise AssertionError("only head pose and gaze can be switched off")
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
    )
