"""Gaze estimation: the direction in which the eyes look."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from vfoa.errors import VfoaError
from vfoa.registry import Registry
from vfoa.types import Gaze, Head, HeadPose, Image, NoGaze, StereoFrame, StereoRig
from vfoa.weights import check_located, weights_of


class GazeModel(Protocol):
    """Estimates the gaze of a head from one frame. Built as ``Class(settings)``, with ``Class.Settings``.

    ``Class.needs_face = True`` says that it has no answer for a head without a face.
    """

    def estimate(self, frame: StereoFrame, head: Head, head_pose: HeadPose | None) -> Gaze | NoGaze | None:
        """Return one head's gaze in the camera frame; None if the model has no answer (for example, it finds no eyes).

        A :class:`NoGaze` states the cause.
        """
        ...


REACH = 3
"""Number of crops that a temporal model gets before the frame in question, and after it."""


@runtime_checkable
class TemporalGazeModel(Protocol):
    """Estimates the gaze of a head from seven crops of one person. Built like a :class:`GazeModel`.

    The crops before and after are of the same track: :class:`vfoa.gaze.temporal.HeadWindow` finds them.
    """

    def crop(self, frame: StereoFrame, head: Head) -> Image:
        """Return the model's input for one head: (h, w, 3) uint8 RGB, of one size for every head."""
        ...

    def stride(self, rate_hz: float | None) -> int:
        """Return the number of frames from one crop to the next at this frame rate.

        Raises
        ------
        vfoa.errors.VfoaError
            If the frame rate is not known (None) and the settings do not give the stride.
        """
        ...

    def estimate_sequence(self, crops: Sequence[Image], head: Head, rig: StereoRig) -> Gaze:
        """Return the gaze in the middle frame of 2 ``REACH`` + 1 crops in order of time; ``head`` is the one there."""
        ...


def choose_model() -> str:
    """MobileGaze (``l2cs``) if its network is on this machine, since its terms were accepted then; else ``adas_0002``.

    MobileGaze is more exact on faces that turn, ADAS-0002 by a few degrees on frontal ones; the terms of MobileGaze's
    data allow no commercial use.
    """
    try:
        check_located(weights_of(MODELS.load("l2cs").Settings()))
    except VfoaError:
        return "adas_0002"
    return "l2cs"


MODELS = Registry(
    kind="gaze.model",
    builtin={
        "adas_0002": "vfoa.gaze.adas:Adas0002",
        "gaze360": "vfoa.gaze.gaze360:Gaze360",
        "l2cs": "vfoa.gaze.l2cs:L2cs",
    },
    group="vfoa.gaze",
    choose=choose_model,
)
