"""What one frame's stages gave and cost, so that nothing is computed twice.

An output is known by the stage and the identity of its inputs: a stage that shares its inputs hands on the very same
object, so agreement upstream carries downstream without a word about which stage reads what.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, TypeVar

from vfoa.settings import Settings
from vfoa.stereo.region import Region

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
class Output:
    """What a stage gave, what it cost, and what it was made from."""

    value: Any
    bill: Bill
    inputs: tuple[object, ...]  # kept alive, so that no new object can take over their identity


@dataclass(slots=True)
class Ledger:
    """The outputs of one frame's stages, and the bill of whoever asks now.

    A shared output is billed in full to everyone who uses it: a bill says what a configuration costs by itself.
    """

    outputs: dict[tuple[object, ...], Output] = field(default_factory=dict)
    bill: Bill = field(default_factory=dict)

    def call(self, name: str, function: Callable[..., T], *inputs: object) -> T:
        """Return ``function(*inputs)``, computed once; settings and regions count by value, all else by identity.

        The time is billed under ``name``, or, where the function made calls of its own, under theirs.
        """
        key = (name, function, *(value if isinstance(value, Settings | Region) else id(value) for value in inputs))
        if key not in self.outputs:
            outer, self.bill = self.bill, {}
            started = time.perf_counter()
            value = function(*inputs)
            bill = self.bill or {name: time.perf_counter() - started}
            self.bill = outer
            self.outputs[key] = Output(value, bill, inputs)
        output = self.outputs[key]
        for stage, seconds in output.bill.items():
            self.charge(stage, seconds)
        return output.value

    def charge(self, stage: str, seconds: float) -> None:
        """Bill the seconds that something took, now or when it was computed."""
        self.bill[stage] = self.bill.get(stage, 0.0) + seconds
