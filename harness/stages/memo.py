"""The outputs of one frame's stages, so that configurations that agree on a stage share its output, and their times.

An output is found again by the stage and the identity of its inputs. A shared stage returns the very same object, so
sharing continues downstream: no table says which stage reads what.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any, TypeVar

from vfoa.settings import Settings
from vfoa.stereo.region import Region

T = TypeVar("T")
Timings = dict[str, float]
"""Seconds per stage."""


@contextmanager
def timed(timings: Timings, stage: str) -> Iterator[None]:
    """Add the seconds of a ``with`` block to a stage."""
    started = time.perf_counter()
    yield
    timings[stage] = timings.get(stage, 0.0) + time.perf_counter() - started


@dataclass(frozen=True, slots=True)
class Output:
    """The output of a stage, its timings and its inputs."""

    value: Any
    timings: Timings
    inputs: tuple[object, ...]  # kept alive: a new object could otherwise get the same id


@dataclass(slots=True)
class StageMemo:
    """The outputs of one frame's stages, and the timings of the configuration that calls now.

    A shared output counts in full for every configuration that uses it: timings say what a configuration costs alone.
    """

    outputs: dict[tuple[object, ...], Output] = field(default_factory=dict)
    _timings: ContextVar[Timings] = field(default_factory=lambda: ContextVar("timings"))

    @property
    def timings(self) -> Timings:
        """Of the caller: a thread that works for it has a copy of its context, and adds to the same timings."""
        return self._timings.get({})

    @timings.setter
    def timings(self, timings: Timings) -> None:
        self._timings.set(timings)

    def call(self, name: str, function: Callable[..., T], *inputs: object) -> T:
        """Return ``function(*inputs)``, computed once.

        Settings, regions and text are compared by value, other arguments by identity. The time is added to
        ``name``, or, where the function makes calls of its own, to theirs.
        """
        key = (
            name,
            function,
            *(each if isinstance(each, Settings | Region | str) else id(each) for each in inputs),
        )
        if key not in self.outputs:
            outer, self.timings = self.timings, {}
            started = time.perf_counter()
            value = function(*inputs)
            timings = self.timings or {name: time.perf_counter() - started}
            self.timings = outer
            self.outputs[key] = Output(value, timings, inputs)
        output = self.outputs[key]
        for stage, seconds in output.timings.items():
            self.charge(stage, seconds)
        return output.value

    def charge(self, stage: str, seconds: float) -> None:
        """Add seconds to a stage, spent now or when its output was computed."""
        self.timings[stage] = self.timings.get(stage, 0.0) + seconds
