"""The measured directions of a clip of measurements, as stages: they give what the source has, and compute nothing."""

from __future__ import annotations

from typing import ClassVar, Never

from harness.sources import Clip
from vfoa.errors import VfoaError
from vfoa.settings import Settings


class MeasuredDirectionSettings(Settings):
    """No setting."""


class _Measured:
    """Stands for what is measured, which the frames of such a clip hold already."""

    Settings = MeasuredDirectionSettings
    slot: ClassVar[str]

    def __init__(self, settings: MeasuredDirectionSettings, clip: Clip) -> Never:
        raise VfoaError(
            f'{self.slot}.model = "measured" (as preset = "measured" sets it): found a clip with images, which has no '
            "measured directions; expected a clip of measurements, or another model"
        )


class MeasuredHeadPose(_Measured):
    """The head as measured."""

    slot = "head_pose"


class MeasuredGaze(_Measured):
    """The gaze as measured."""

    slot = "gaze"
