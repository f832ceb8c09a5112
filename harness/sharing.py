"""One clip under many configurations, with nothing computed twice in a frame.

Configurations that agree on a stage share its output. An output is known by the stage and the identity of its
inputs: a stage that shares its inputs hands on the very same object, so agreement upstream carries downstream
without a word about which stage reads what.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, TypeVar

from harness.adapters import Clip
from harness.experiment import Configuration
from harness.stages import SLOTS
from vfoa.pipeline import Stages, perceive, reconstruct
from vfoa.settings import Settings
from vfoa.types import Percepts, Scene, StereoFrame

T = TypeVar("T")
Bill = dict[str, float]
"""Seconds per stage."""


@contextmanager
def timed(bill: Bill, stage: str) -> Iterator[None]:
    """Bill the seconds of a ``with`` block."""
    started = time.perf_counter()
    yield
    bill[stage] = bill.get(stage, 0.0) + time.perf_counter() - started


@dataclass(frozen=True, slots=True)
class _Output:
    value: Any
    bill: Bill
    inputs: tuple[object, ...]  # kept alive, so that no new object can take over their identity


@dataclass(slots=True)
class Ledger:
    """The outputs of one frame's stages, and the bill of whoever asks now.

    A shared output is billed in full to everyone who uses it: a bill says what a configuration costs by itself.
    """

    outputs: dict[tuple[object, ...], _Output] = field(default_factory=dict)
    bill: Bill = field(default_factory=dict)

    def call(self, name: str, function: Callable[..., T], *inputs: object) -> T:
        """Return ``function(*inputs)``, computed once; settings are told apart by value, all else by identity.

        The time is billed under ``name``, or, where the function made calls of its own, under theirs.
        """
        key = (name, function, *(value if isinstance(value, Settings) else id(value) for value in inputs))
        if key not in self.outputs:
            outer, self.bill = self.bill, {}
            started = time.perf_counter()
            value = function(*inputs)
            bill = self.bill or {name: time.perf_counter() - started}
            self.bill = outer
            self.outputs[key] = _Output(value, bill, inputs)
        output = self.outputs[key]
        for stage, seconds in output.bill.items():
            self.bill[stage] = self.bill.get(stage, 0.0) + seconds
        return output.value


@dataclass(frozen=True, slots=True, eq=False)
class _Shared:
    """A stage of any protocol, called through the ledger."""

    slot: str
    stage: Any
    ledger: Ledger

    def match(self, *inputs: object) -> Any:
        return self.ledger.call(self.slot, self.stage.match, *inputs)

    def segment(self, *inputs: object) -> Any:
        return self.ledger.call(self.slot, self.stage.segment, *inputs)

    def detect(self, *inputs: object) -> Any:
        return self.ledger.call(self.slot, self.stage.detect, *inputs)

    def estimate(self, *inputs: object) -> Any:
        return self.ledger.call(self.slot, self.stage.estimate, *inputs)


class SharedPipeline:
    """``perceive`` and ``reconstruct`` for every configuration of one clip.

    All models are opened when it is built, so that a missing one is said before any work.
    """

    def __init__(self, configurations: Sequence[Configuration], clip: Clip) -> None:
        self._ledger = Ledger()
        built: dict[str, _Shared] = {}
        same: dict[tuple[str, ...], Stages] = {}
        self._stages: dict[str, Stages] = {}
        for configuration in configurations:
            keys = {
                slot: f"{slot} {choice.plain() if choice else None}" for slot, choice in configuration.choices.items()
            }
            for slot, choice in configuration.choices.items():
                if choice and keys[slot] not in built:
                    built[keys[slot]] = _Shared(slot, SLOTS[slot].build(choice, clip), self._ledger)
            chosen = {slot: built.get(key) for slot, key in keys.items()}
            self._stages[configuration.name] = same.setdefault(tuple(keys.values()), _stages(chosen))

    def start_frame(self) -> None:
        """Forget the outputs of the frame before."""
        self._ledger.outputs.clear()

    def run(self, configuration: Configuration, frame: StereoFrame) -> tuple[Percepts, Scene, Bill]:
        """Perceive and reconstruct one frame; the third value is the seconds per stage."""
        self._ledger.bill = {}
        percepts = self._ledger.call("perceive", perceive, frame, self._stages[configuration.name])
        scene = self._ledger.call("reconstruction", reconstruct, percepts, configuration.reconstruction)
        return percepts, scene, self._ledger.bill


def _stages(chosen: Mapping[str, _Shared | None]) -> Stages:
    matcher, segmenter, heads = chosen["stereo"], chosen["segmentation"], chosen["heads"]
    if matcher is None or segmenter is None or heads is None:
        raise AssertionError("only head pose and gaze can be switched off")
    return Stages(matcher=matcher, segmenter=segmenter, heads=heads, head_pose=chosen["head_pose"], gaze=chosen["gaze"])
