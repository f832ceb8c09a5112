"""The layer between the pipeline and a stage: each call is shared, cached, guarded, checked and timed here.

A stage can come from anywhere: an error in one ends the configurations that use it, not the run. Only calls that pass
through :class:`StageRunner` or :func:`guarded` are caught. An error of the harness itself ends the program.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from types import NoneType
from typing import Any, TypeVar

import numpy as np

from harness.pipeline.cache import StoredOutputs
from vfoa.errors import StageError, VfoaError
from vfoa.settings import Settings
from vfoa.stereo.region import Region
from vfoa.types import Disparity, Gaze, Head, HeadPose, Instances, NoGaze

T = TypeVar("T")
Timings = dict[str, float]
"""Seconds per stage. A shared output counts in full for each configuration, as if it ran alone."""

LONGEST_TEXT = 300
"""Longest text of an exception that is quoted in a line."""

NOT_STORED = frozenset({"crop", "stride", "with_people"})
"""Methods that are faster to compute than to read from the cache."""


@contextmanager
def timed(timings: Timings, stage: str) -> Iterator[None]:
    """Add the seconds of a ``with`` block to a stage."""
    started = time.perf_counter()
    yield
    timings[stage] = timings.get(stage, 0.0) + time.perf_counter() - started


class Memo:
    """The outputs of calls on one frame: a call of the same objects is made once.

    Settings, regions and text are compared by value, other arguments by identity. A shared output is the very same
    object, so the calls that follow it are shared as well; no table of dependencies is needed.
    """

    def __init__(self) -> None:
        self.outputs: dict[tuple[object, ...], tuple[Any, float, tuple[object, ...]]] = {}
        self.timings: Timings = {}

    def key(self, function: object, inputs: tuple[object, ...]) -> tuple[object, ...]:
        """The key of a call. Its inputs must be kept: a new object could otherwise get the same id."""
        return (function, *(value if isinstance(value, Settings | Region | str) else id(value) for value in inputs))

    def call(self, stage: str, function: Callable[..., T], *inputs: object) -> T:
        """Return ``function(*inputs)``, computed once; its seconds are charged to ``stage`` each time."""
        return self._computed(stage, self.key(function, inputs), function, inputs)

    def once(self, stage: str, owner: object, function: Callable[..., T], *inputs: object) -> T:
        """As :meth:`call`, for something that takes one step in a frame, whatever the later inputs are: a tracker."""
        return self._computed(stage, (owner,), function, inputs)

    def _computed(
        self, stage: str, key: tuple[object, ...], function: Callable[..., T], inputs: tuple[object, ...]
    ) -> T:
        if key not in self.outputs:
            started = time.perf_counter()
            self.outputs[key] = function(*inputs), time.perf_counter() - started, inputs
        value: T = self.outputs[key][0]
        self.charge(stage, self.outputs[key][1])
        return value

    def charge(self, stage: str, seconds: float) -> None:
        """Add seconds to a stage."""
        self.timings[stage] = self.timings.get(stage, 0.0) + seconds


class StageRunner:
    """A stage of any protocol: it has the methods that the stage has.

    Each call is answered from the frame's memo, from the cache if the stage is cached, or by the stage. An error of the
    stage becomes one line, and its output is checked. The seconds that an output took when it was computed are charged
    to the stage's slot.
    """

    def __init__(
        self, stage: Any, *, slot: str, name: str, memo: Memo | None = None, stored: StoredOutputs | None = None
    ) -> None:
        self.stage = stage
        self._slot, self._name, self._memo, self.stored = slot, name, memo or Memo(), stored

    def __getattr__(self, method: str) -> Any:
        getattr(self.stage, method)  # raises AttributeError for a method that the stage does not have
        return partial(self._call, method)

    def _call(self, method: str, *inputs: Any) -> Any:
        key = self._memo.key((self, method), inputs)
        if key not in self._memo.outputs:
            stored = None if method in NOT_STORED else self.stored
            if stored and (output := stored.load(inputs)):
                seconds, value = output
            else:
                fault, started = None, time.perf_counter()
                try:
                    value = getattr(self.stage, method)(*inputs)
                    seconds = time.perf_counter() - started
                    check_output(value, method, self._slot, inputs)
                except VfoaError:
                    raise
                except Exception as error:
                    fault = _fault(f"{self._name}, {method}", error)
                if fault:  # raised outside of the handler, so that it keeps no object of the stage alive
                    raise fault
                if stored:
                    stored.save(inputs, seconds, value)
            self._memo.outputs[key] = value, seconds, inputs
        value, seconds, _ = self._memo.outputs[key]
        self._memo.charge(self._slot, seconds)
        return value


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
        fault = _fault(what, error)
    raise fault


def _fault(what: str, error: Exception) -> StageError:
    """The error of a stage in one line, with its traceback."""
    words = " ".join(str(traceback.TracebackException.from_exception(error)).split())
    short = words if len(words) <= LONGEST_TEXT else f"{words[:LONGEST_TEXT]}..."
    line = f"{type(error).__name__}: {short}" if short else type(error).__name__
    return StageError(f"{what}: {line}", "".join(traceback.format_exception(error)))


_OUTPUTS: dict[str, tuple[type, ...]] = {
    "match": (Disparity,),
    "match_region": (Disparity,),
    "segment": (Instances,),
    "estimate_sequence": (Gaze,),
    "head_pose.estimate": (HeadPose, NoneType),
    "gaze.estimate": (Gaze, NoGaze, NoneType),
    "detect": (tuple, list),
    "faces": (tuple, list),
    "with_people": (tuple, list),
    "crop": (np.ndarray,),
    "stride": (int, np.integer),
}
"""The kinds of output of each method, or of a slot's method."""


def check_output(value: object, method: str, slot: str, inputs: tuple[Any, ...]) -> None:
    """Check the output of a stage's method: a wrong kind or size would fail far from the stage that made it.

    Raises
    ------
    TypeError, ValueError
        If the kind of value, or the size of a map, is wrong. Outputs of unknown methods are not checked.
    """
    kinds = _OUTPUTS.get(method) or _OUTPUTS.get(f"{slot}.{method}")
    if kinds is None:
        return
    if not isinstance(value, kinds):
        expected = " or ".join(kind.__name__ for kind in kinds).replace("NoneType", "None")
        raise TypeError(f"returned {type(value).__name__}; expected {expected}")
    if isinstance(value, tuple | list) and not all(isinstance(head, Head) for head in value):
        raise TypeError(f"returned a {type(value).__name__} of other values; expected vfoa.Head values alone")
    if isinstance(value, np.ndarray) and (value.dtype != np.uint8 or value.ndim != 3):
        raise TypeError(f"returned an array {value.shape} of {value.dtype}; expected (h, w, 3) of uint8")
    if isinstance(value, int | np.integer) and value <= 0:
        raise TypeError(f"returned {value}; expected a number above 0")
    if isinstance(value, Disparity | Instances):
        shape = value.disparity_px.shape if isinstance(value, Disparity) else value.ids.shape
        rig = inputs[0].rig
        if shape != (rig.height_px, rig.width_px):
            raise ValueError(f"returned a map of {shape}; expected {(rig.height_px, rig.width_px)}")
