"""Gaze estimation: where the eyes look."""

from __future__ import annotations

from typing import Protocol

from vfoa.registry import Registry
from vfoa.types import Gaze, Head, HeadPose, StereoFrame


class GazeModel(Protocol):
    """Estimates the gaze of a head from one frame. Built as ``Class(settings)``, with ``Class.Settings``."""

    def estimate(self, frame: StereoFrame, head: Head, head_pose: HeadPose | None) -> Gaze | None:
        """Estimate one head's gaze, or None where the model has no answer (eyes not found, say)."""
        ...


MODELS = Registry(
    kind="gaze.model",
    builtin={
        "adas_0002": "vfoa.gaze.adas:Adas0002",
        "l2cs": "vfoa.gaze.l2cs:L2cs",
    },
    group="vfoa.gaze",
)
