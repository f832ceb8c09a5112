"""FSA-Net head pose (Yang et al. 2019): the mean of several networks, as headpose-fsanet-pytorch exports them.

Each graph takes ``input`` [1, 3, 64, 64] BGR, (x - 127.5) / 128, and gives ``output`` [1, 3]: yaw, pitch, roll in
degrees; yaw > 0 to the image's left, pitch > 0 up, roll > 0 clockwise.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from vfoa.crops import CropCamera, completed, grow
from vfoa.geometry import head_direction_crop
from vfoa.onnx import Model, RuntimeSettings, Signature, blob
from vfoa.types import Head, HeadPose, StereoFrame

SIGNATURE = Signature(inputs={"input": (1, 3, 64, 64)}, outputs={"output": (1, 3)})


class FsaNet:
    """Head pose as the mean of several FSA-Nets: two by default; the settings may name one or more."""

    needs_face = True

    class Settings(RuntimeSettings):
        """Settings of the networks and the crop.

        Of margins of 0.1 to 0.6, 0.3 has the steadiest yaw on Sintel's bandage_2 (1.6 deg over 25 frames) and the least
        difference between an image and its mirror image (median 3.0 deg; 4.5 at 0.2, 6.3 at 0.1).
        """

        weights: tuple[str, ...] = Field(
            default=("fsanet-1x1-iter-688590.onnx", "fsanet-var-iter-688590.onnx"), min_length=1
        )
        """Paths of the networks, or file names in the folders of weights; their answers are averaged."""
        margin: float = Field(default=0.3, ge=0)
        """Margin added to the face's box on each side, as a share of its width or height."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._models = [Model(weights, SIGNATURE, settings) for weights in settings.weights]

    def estimate(self, frame: StereoFrame, head: Head) -> HeadPose | None:
        """Estimate one head's pose; None for a head without a face, since the networks take every image for a face."""
        if head.face_box_px is None:
            return None
        margin = self.settings.margin
        box = grow(completed(head.face_box_px, frame.left), side=margin, top=margin, bottom=margin)
        camera = CropCamera.at(box, frame.rig)
        image = blob(camera.image(frame, 64), bgr=True, mean=127.5, scale=1 / 128)
        angles_deg = np.mean([model.run(input=image)["output"][0] for model in self._models], axis=0, dtype=np.float64)
        yaw, pitch, roll = np.radians(angles_deg)
        return HeadPose(
            direction=camera.left_from_crop @ head_direction_crop(yaw, pitch),
            yaw_rad=float(yaw),
            pitch_rad=float(pitch),
            roll_rad=float(roll),
        )
