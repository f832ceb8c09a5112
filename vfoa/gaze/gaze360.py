"""Gaze360 (Kellnhofer et al., ICCV 2019): gaze from seven pictures of a head, with an uncertainty.

The graph: ``images`` [B, 7, 3, 224, 224] RGB by ImageNet's mean and deviation, in the order of time; ``gaze`` [B, 2],
theta > 0 to the image's left and phi > 0 up, and ``sigma`` [B, 1], all in radians. The head's box is grown by 15 % on
each side and stretched. Sigma was trained with the pinball loss at the quantiles 0.1 and 0.9.
"""

from __future__ import annotations

from collections.abc import Sequence
from statistics import NormalDist

from pydantic import Field, PositiveInt

from vfoa.crops import CropCamera, grow
from vfoa.errors import VfoaError
from vfoa.geometry import gaze_direction_crop
from vfoa.onnx import IMAGENET_MEAN, IMAGENET_SCALE, Model, OnnxSettings, Signature, blob
from vfoa.types import Gaze, Head, Image, StereoFrame, StereoRig

SIDE_PX = 224

SIGNATURE = Signature(
    inputs={"images": (None, 7, 3, SIDE_PX, SIDE_PX)}, outputs={"gaze": (None, 2), "sigma": (None, 1)}
)

DEVIATIONS_PER_SIGMA = NormalDist().inv_cdf(0.9)
"""The network's sigma reaches from the median to the 0.9 quantile: 1.28 standard deviations of a normal error."""


class Gaze360:
    """Gaze of a person who is followed over frames. It needs a head but no face: it also works from behind."""

    class Settings(OnnxSettings):
        """Settings of the crop and of the frames between crops."""

        weights: str = "gaze360.onnx"
        """Path of the network, or a file's name in the folders of weights."""
        margin: float = Field(default=0.15, ge=0)
        """Margin added to the head's box on each side, as a share of its width or height."""
        stride: PositiveInt | None = None
        """Frames from one crop to the next; an eighth of a second if not set, as in the authors' code."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._model = Model(settings.weights, SIGNATURE, settings)

    def crop(self, frame: StereoFrame, head: Head) -> Image:
        """Cut out the head's box with its margin, stretched to (224, 224, 3)."""
        return self._camera(head, frame.rig).image(frame, SIDE_PX)

    def stride(self, rate_hz: float | None) -> int:
        """Frames from one crop to the next: the setting, or max(rate // 8, 1)."""
        if self.settings.stride is not None:
            return self.settings.stride
        if rate_hz is None:
            raise VfoaError(
                "gaze.stride: missing; expected the number of frames between crops, since the clip has "
                "no frame rate to derive it from"
            )
        return max(int(rate_hz // 8), 1)

    def estimate_sequence(self, crops: Sequence[Image], head: Head, rig: StereoRig) -> Gaze:
        """Estimate the gaze in the middle one of seven crops; ``sigma_rad`` is one standard deviation."""
        images = blob(*crops, bgr=False, mean=IMAGENET_MEAN, scale=IMAGENET_SCALE)
        outputs = self._model.run(images=images[None])
        theta, phi = outputs["gaze"][0]
        return Gaze(
            direction=self._camera(head, rig).left_from_crop @ gaze_direction_crop(theta, phi),
            sigma_rad=float(outputs["sigma"][0, 0]) / DEVIATIONS_PER_SIGMA,
        )

    def _camera(self, head: Head, rig: StereoRig) -> CropCamera:
        margin = self.settings.margin
        return CropCamera.at(grow(head.box_px, side=margin, top=margin, bottom=margin), rig)
