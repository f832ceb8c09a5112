"""A stage that looks in the cache before it computes."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from harness.adapters import Clip
from harness.cache.identity import Identity, Source, identify
from harness.cache.store import Store
from harness.cache.values import content_digest, decode, encode
from harness.runs.configuration import Configuration
from harness.runs.stages import StageChoice
from vfoa.gaze import TemporalGazeModel
from vfoa.stereo.region import Region
from vfoa.types import Disparity, Gaze, Head, HeadPose, Image, Instances, StereoFrame, StereoRig

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Tally:
    """Which of one stage's results were found, computed, and found damaged, by the names of their files."""

    found: set[str] = field(default_factory=set)
    computed: set[str] = field(default_factory=set)
    damaged: set[str] = field(default_factory=set)

    def __or__(self, other: Tally) -> Tally:
        return Tally(self.found | other.found, self.computed | other.computed, self.damaged | other.damaged)

    def take(self) -> Tally:
        """All that was counted so far; begin anew."""
        taken = Tally() | self
        for names in (self.found, self.computed, self.damaged):
            names.clear()
        return taken


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipCache:
    """The cache as a job on one clip has it: the store, and who is who. It travels to other processes by pickle."""

    store: Store
    identities: Mapping[str, Identity]

    def wrap(self, choice: StageChoice, stage: Any, charge: Charge, tallies: dict[str, Tally]) -> Any:
        """The stage behind the cache; the stage itself where it takes no part. Counts go to ``tallies``."""
        identity = self.identities.get(choice.key)
        if identity is None:
            return stage
        tally = tallies.setdefault(choice.key, Tally())
        cls = CachedTemporalGaze if isinstance(stage, TemporalGazeModel) else CachedStage
        return cls(stage, _Shelf(store=self.store, identity=identity, charge=charge, tally=tally))

    def lacks(self, frame: int) -> bool:
        """Whether something of a frame is not stored, as far as that can be told before anything is read."""
        alone = [
            each
            for each in self.identities.values()
            if each.slot == "segmentation" or (each.slot == "stereo" and not each.is_in_region)
        ]
        return not alone or not all(_place(self.store, each, frame, ()).exists() for each in alone)


def open_cache(store: Store, name: str, clip: Clip, configurations: Iterable[Configuration]) -> ClipCache:
    """The cache for all stages of these configurations on the clip of this name."""
    choices = {choice.key: choice for each in configurations for choice in each.choices.values() if choice}
    source = Source.of(name, clip)
    found = {key: identify(choice, source) for key, choice in choices.items()}
    return ClipCache(store=store, identities={key: each for key, each in found.items() if each is not None})


def _place(store: Store, identity: Identity, frame: int | None, inputs: tuple[object, ...]) -> Path:
    name = "any" if frame is None else f"{frame:06d}"
    return store.folder(identity.slot, identity.digest) / f"{name}-{content_digest(*inputs)}.bin"


Charge = Callable[[str, float], None]
"""Told the stage's slot and the seconds that a result took when it was computed, whenever that was."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shelf:
    """One stage's results on one clip."""

    store: Store
    identity: Identity
    charge: Charge
    tally: Tally
    unwritable: list[str] = field(default_factory=list)

    def get(self, frame: int | None, inputs: tuple[object, ...], compute: Callable[[], Any]) -> Any:
        """What was stored for a frame and for what else the stage is given; else computed, and stored."""
        slot, path = self.identity.slot, _place(self.store, self.identity, frame, inputs)
        data, damaged = self.store.load(path)
        if data is not None:
            seconds, value = decode(data)
            self.tally.found.add(path.name)
        else:
            if damaged:
                self.tally.damaged.add(path.name)
                _log.warning("%s: damaged; its result is computed again", path)
            started = time.perf_counter()
            value = compute()
            seconds = time.perf_counter() - started
            self.tally.computed.add(path.name)
            self._keep(path, (seconds, value))
        self.charge(slot, seconds)
        return value

    def _keep(self, path: Path, content: tuple[float, Any]) -> None:
        if self.unwritable:
            return
        try:
            self.store.describe(self.identity.slot, self.identity.digest, dict(self.identity.parts))
            self.store.save(path, encode(content))
        except (OSError, TypeError) as error:  # a cache that cannot be written to costs time, not the run
            self.unwritable.append(str(error))
            _log.warning("%s: results of %s are not kept: %s", path.parent, self.identity.parts["stage"], error)


@dataclass(frozen=True, slots=True, eq=False)
class CachedStage:
    """A stage of any protocol. The frame counts by its number, all else that the stage is given by its content."""

    stage: Any
    shelf: _Shelf

    def match(self, frame: StereoFrame) -> Disparity:
        """As :class:`vfoa.stereo.StereoMatcher`."""
        return self.shelf.get(frame.index, (), lambda: self.stage.match(frame))

    def match_region(self, frame: StereoFrame, region: Region) -> Disparity:
        """As :class:`vfoa.stereo.RegionMatcher`."""
        return self.shelf.get(frame.index, (region,), lambda: self.stage.match_region(frame, region))

    def segment(self, frame: StereoFrame) -> Instances:
        """As :class:`vfoa.segmentation.Segmenter`."""
        return self.shelf.get(frame.index, (), lambda: self.stage.segment(frame))

    def detect(self, frame: StereoFrame, instances: Instances) -> tuple[Head, ...]:
        """As :class:`vfoa.heads.HeadDetector`."""
        return self.shelf.get(frame.index, (instances,), lambda: self.stage.detect(frame, instances))

    def estimate(self, frame: StereoFrame, *inputs: Head | HeadPose | None) -> Any:
        """As :class:`vfoa.head_pose.HeadPoseModel` or :class:`vfoa.gaze.GazeModel`."""
        return self.shelf.get(frame.index, inputs, lambda: self.stage.estimate(frame, *inputs))


@dataclass(frozen=True, slots=True, eq=False)
class CachedTemporalGaze:
    """A temporal gaze model. Its crops are cut quicker than read; what it makes of seven of them is kept."""

    stage: TemporalGazeModel
    shelf: _Shelf

    def crop(self, frame: StereoFrame, head: Head) -> Image:
        """As :class:`vfoa.gaze.TemporalGazeModel`."""
        return self.stage.crop(frame, head)

    def stride(self, rate_hz: float | None) -> int:
        """As :class:`vfoa.gaze.TemporalGazeModel`."""
        return self.stage.stride(rate_hz)

    def estimate_sequence(self, crops: Sequence[Image], head: Head, rig: StereoRig) -> Gaze:
        """As :class:`vfoa.gaze.TemporalGazeModel`."""
        inputs = (tuple(crops), head, rig)
        return self.shelf.get(None, inputs, lambda: self.stage.estimate_sequence(crops, head, rig))
