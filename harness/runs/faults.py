"""Faults of stages, which may be anybody's: what one of them raises ends the configurations that have it, not the run.

Only calls that pass through here are guarded. An error of the harness itself goes on to the top, with its traceback.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import numpy as np

from harness.adapters import Clip
from harness.runs.stages import SLOTS, StageChoice
from vfoa.errors import StageError, VfoaError
from vfoa.types import Disparity, Gaze, Head, HeadPose, Instances, StereoFrame

T = TypeVar("T")

LONGEST_TEXT = 300
"""Characters of an exception's own words that one line has room for."""

_ONE_OF = {"match": Disparity, "match_region": Disparity, "segment": Instances, "estimate_sequence": Gaze}
_ONE_OR_NONE = {"head_pose": HeadPose, "gaze": Gaze}
_METHODS = (*_ONE_OF, "detect", "estimate", "crop", "stride")


def guarded(what: str, function: Callable[..., T], *inputs: Any) -> T:
    """Return ``function(*inputs)``; ``what`` opens the line that says what went wrong.

    Raises
    ------
    StageError
        For any exception that is not a :class:`VfoaError`; these, and what is no Exception (Ctrl-C), stay as they are.
    """
    try:
        return function(*inputs)
    except VfoaError:
        raise
    except Exception as error:
        fault = StageError(f"{what}: {_in_one_line(error)}", "".join(traceback.format_exception(error)))
    raise fault  # out here, so that it keeps nothing alive of what the stage held


def _in_one_line(error: Exception) -> str:
    words = " ".join(str(traceback.TracebackException.from_exception(error)).split())
    short = words if len(words) <= LONGEST_TEXT else f"{words[:LONGEST_TEXT]}..."
    return f"{type(error).__name__}: {short}" if short else type(error).__name__


def build(choice: StageChoice, clip: Clip) -> GuardedStage:
    """Build a stage for one clip, behind the guard.

    Raises
    ------
    StageError
        If its constructor does not stand it; a :class:`VfoaError` of its own stays as it is.
    """
    slot = SLOTS[choice.slot]
    what = f'{slot.name}.{slot.key} = "{choice.name}"'
    return GuardedStage(guarded(what, slot.build, choice, clip), slot.name, what)


class GuardedStage:
    """A stage of any protocol behind the guard: it has those methods of the protocols that the stage has.

    What a method returns is looked at as well: the wrong kind of value, or a map of another size than the frame, would
    fail far from the stage that made it.
    """

    def __init__(self, stage: Any, slot: str, what: str) -> None:
        for method in _METHODS:
            if hasattr(stage, method):
                setattr(self, method, partial(guarded, f"{what}, {method}", _checked, stage, method, slot))


def _checked(stage: Any, method: str, slot: str, *inputs: Any) -> Any:
    value = getattr(stage, method)(*inputs)
    _check_kind(value, method, slot)
    if isinstance(value, Disparity | Instances):
        _check_size(value, inputs[0])
    return value


def _check_kind(value: object, method: str, slot: str) -> None:
    if method in _ONE_OF:
        expected, is_right = _ONE_OF[method].__name__, isinstance(value, _ONE_OF[method])
    elif method == "estimate":
        expected, is_right = f"{_ONE_OR_NONE[slot].__name__} or None", isinstance(value, _ONE_OR_NONE[slot] | None)
    elif method == "detect":
        heads = isinstance(value, tuple | list) and all(isinstance(each, Head) for each in value)
        expected, is_right = "tuple of Head", heads
    elif method == "crop":
        image = isinstance(value, np.ndarray) and value.dtype == np.uint8 and value.ndim == 3
        expected, is_right = "(h, w, 3) array of uint8", image
    else:
        expected, is_right = "whole number above 0", isinstance(value, int | np.integer) and int(value) > 0
    if not is_right:
        raise TypeError(f"returned {type(value).__name__}; expected {expected}")


def _check_size(found: Disparity | Instances, frame: StereoFrame) -> None:
    shape = found.disparity_px.shape if isinstance(found, Disparity) else found.ids.shape
    if shape != (frame.rig.height_px, frame.rig.width_px):
        raise ValueError(f"returned a map of {shape}; expected {(frame.rig.height_px, frame.rig.width_px)}")
