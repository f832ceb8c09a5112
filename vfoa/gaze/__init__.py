"""Gaze estimation: where the eyes look."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from vfoa.registry import Registry
from vfoa.types import Gaze, Head, HeadPose, Image, StereoFrame, StereoRig


class GazeModel(Protocol):
    """Estimates the gaze of a head from one frame. Built as ``Class(settings)``, with ``Class.Settings``."""

    def estimate(self, frame: StereoFrame, head: Head, head_pose: HeadPose | None) -> Gaze | None:
        """Estimate one head's gaze, or None where the model has no answer (eyes not found, say)."""
        ...


REACH = 3
"""How many crops a temporal model sees before the frame that is asked about, and how many after it."""


@runtime_checkable
class TemporalGazeModel(Protocol):
    """Estimates the gaze of a head from seven crops of one person. Built as a :class:`GazeModel` is.

    The frames before and after are those of the same track: :class:`vfoa.gaze.temporal.HeadWindow` finds them.
    """

    def crop(self, frame: StereoFrame, head: Head) -> Image:
        """Cut out what the model sees of one head: (h, w, 3) uint8 RGB, of one size for every head."""
        ...

    def stride(self, rate_hz: float | None) -> int:
        """Frames from one crop to the next at this frame rate.

        Raises
        ------
        vfoa.errors.VfoaError
            If the frame rate is not known (None) and nothing else says it.
        """
        ...

    def estimate_sequence(self, crops: Sequence[Image], head: Head, rig: StereoRig) -> Gaze:
        """Estimate the gaze in the middle one of 2 ``REACH`` + 1 crops in the order of time, where the head is."""
        ...


MODELS = Registry(
    kind="gaze.model",
    builtin={
        "adas_0002": "vfoa.gaze.adas:Adas0002",
        "gaze360": "vfoa.gaze.gaze360:Gaze360",
        "l2cs": "vfoa.gaze.l2cs:L2cs",
    },
    group="vfoa.gaze",
)
