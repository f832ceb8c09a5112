"""The layer between the pipeline and a stage: each call is shared, cached, guarded, checked and timed.

A stage can come from anywhere: an error in one ends the configurations that use it, not the run. Only calls that pass
through :func:`guarded` are caught. An error of the harness itself ends the program.

Configurations that use the same stage share its outputs in a frame (:class:`StageMemo`). An output is looked up by the
stage and the identity of its inputs. A shared stage returns the very same object, so its followers are shared as well;
no table of dependencies between stages is needed.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

import numpy as np

from harness.sources import Clip
from harness.stages.cache.stage import StoredOutputs
from harness.stages.slots import SLOTS, StageChoice
from vfoa.errors import StageError, VfoaError
from vfoa.settings import Settings
from vfoa.stereo.region import Region
from vfoa.types import Disparity, Gaze, Head, HeadPose, Instances, NoGaze, StereoFrame

T = TypeVar("T")
Timings = dict[str, float]
"""Seconds per stage."""

LONGEST_TEXT = 300
"""Longest text of an exception that is quoted in a line."""

_ONE_OF = {"match": Disparity, "match_region": Disparity, "segment": Instances, "estimate_sequence": Gaze}
_ONE_OR_NONE = {"head_pose": (HeadPose,), "gaze": (Gaze, NoGaze)}


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
    inputs: tuple[object, ...]  # kept alive, since a new object could otherwise get the same id


@dataclass(slots=True)
class StageMemo:
    """The outputs of one frame's stages, and the timings of the configuration that is calling.

    A shared output counts in full for every configuration that uses it: timings say what a configuration costs alone.
    """

    outputs: dict[tuple[object, ...], Output] = field(default_factory=dict)
    _timings: ContextVar[Timings] = field(default_factory=lambda: ContextVar("timings"))

    @property
    def timings(self) -> Timings:
        """Timings of the caller. A thread that works for it has a copy of its context, and adds to the same timings."""
        return self._timings.get({})

    @timings.setter
    def timings(self, timings: Timings) -> None:
        self._timings.set(timings)

    def call(self, name: str, function: Callable[..., T], *inputs: object) -> T:
        """Return ``function(*inputs)``, computed once.

        Settings, regions and text are compared by value, other arguments by identity. The time is added to ``name`` or,
        if the function makes calls of its own, to theirs.
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
        """Add seconds to a stage: its own, or those of a shared or stored output."""
        self.timings[stage] = self.timings.get(stage, 0.0) + seconds


def guarded(what: str, function: Callable[..., T], *inputs: Any) -> T:
    """Return ``function(*inputs)``; ``what`` opens the message of an error.

    Raises
    ------
    StageError
        For any exception that is not a :class:`VfoaError`. A VfoaError, and anything that is no Exception (Ctrl-C), is
        raised unchanged.
    """
    try:
        return function(*inputs)
    except VfoaError:
        raise
    except Exception as error:
        fault = StageError(f"{what}: {_in_one_line(error)}", "".join(traceback.format_exception(error)))
    raise fault  # raised outside of the handler, so that it keeps no object of the stage alive


def _in_one_line(error: Exception) -> str:
    words = " ".join(str(traceback.TracebackException.from_exception(error)).split())
    short = words if len(words) <= LONGEST_TEXT else f"{words[:LONGEST_TEXT]}..."
    return f"{type(error).__name__}: {short}" if short else type(error).__name__


def check_output(value: object, method: str, slot: str, inputs: tuple[Any, ...]) -> None:
    """Check the output of a stage's method: a wrong kind or size would fail far from the stage that made it.

    Raises
    ------
    TypeError, ValueError
        If the kind of value, or the size of a map, is wrong. Outputs of unknown methods are not checked.
    """
    _check_kind(value, method, slot)
    if isinstance(value, Disparity | Instances):
        _check_size(value, inputs[0])


def _check_kind(value: object, method: str, slot: str) -> None:
    if method in _ONE_OF:
        expected, is_right = _ONE_OF[method].__name__, isinstance(value, _ONE_OF[method])
    elif method == "estimate":
        kinds = _ONE_OR_NONE[slot]
        expected, is_right = f"{kinds[0].__name__} or None", value is None or isinstance(value, kinds)
    elif method in ("detect", "faces", "with_people"):
        heads = isinstance(value, tuple | list) and all(isinstance(each, Head) for each in value)
        expected, is_right = "tuple of Head", heads
    elif method == "crop":
        image = isinstance(value, np.ndarray) and value.dtype == np.uint8 and value.ndim == 3
        expected, is_right = "(h, w, 3) array of uint8", image
    elif method == "stride":
        expected, is_right = "whole number above 0", isinstance(value, int | np.integer) and int(value) > 0
    else:
        return
    if not is_right:
        raise TypeError(f"returned {type(value).__name__}; expected {expected}")


def _check_size(found: Disparity | Instances, frame: StereoFrame) -> None:
    shape = found.disparity_px.shape if isinstance(found, Disparity) else found.ids.shape
    if shape != (frame.rig.height_px, frame.rig.width_px):
        raise ValueError(f"returned a map of {shape}; expected {(frame.rig.height_px, frame.rig.width_px)}")


NOT_STORED = frozenset({"crop", "stride", "with_people"})
"""Methods that are faster to compute than to read from the cache."""


class StageRunner:
    """A stage of any protocol: it has the methods that the stage has.

    Each call is answered from the frame's memo, from the cache if the stage is cached, or by the stage. An error of the
    stage becomes one line, and its output is checked. The seconds that an output took when it was computed are charged
    to the stage's slot.
    """

    def __init__(
        self, stage: Any, *, slot: str, name: str, memo: StageMemo, stored: StoredOutputs | None = None
    ) -> None:
        self.stage = stage
        self._slot, self._name, self._memo, self._stored = slot, name, memo, stored

    def __getattr__(self, method: str) -> Any:
        getattr(self.stage, method)  # raises AttributeError for a method that the stage does not have
        return partial(self._memo.call, self._slot, self._answer, method)

    def _answer(self, method: str, *inputs: Any) -> Any:
        """Call a method, or find its output in the cache."""
        stored = None if method in NOT_STORED else self._stored
        found = stored.load(inputs) if stored else None
        if found is None:
            started = time.perf_counter()
            value = guarded(f"{self._name}, {method}", getattr(self.stage, method), *inputs)
            guarded(f"{self._name}, {method}", check_output, value, method, self._slot, inputs)
            found = time.perf_counter() - started, value
            if stored:
                stored.save(inputs, *found)
        seconds, value = found
        self._memo.charge(self._slot, seconds)
        return value


def build_stage(
    choice: StageChoice,
    clip: Clip,
    memo: StageMemo,
    stored: StoredOutputs | None = None,
    *,
    beside: Executor | None = None,
) -> StageRunner:
    """Build a stage for one clip; ``beside`` as for :meth:`harness.stages.slots.Slot.build`.

    Raises
    ------
    StageError
        If its constructor raises anything but a :class:`VfoaError`, which is raised unchanged.
    """
    slot = SLOTS[choice.slot]
    name = f'{slot.name}.{slot.key} = "{choice.name}"'
    stage = guarded(name, slot.build, choice, clip, beside)
    return StageRunner(stage, slot=slot.name, name=name, memo=memo, stored=stored)
