"""6DRepNet head pose (Hempel et al. 2022), as the networks of github.com/yakhyo/head-pose-estimation export it.

The graph takes [1, 3, 224, 224] RGB by ImageNet's mean and deviation, the face's box with a margin stretched, and gives
[1, 3, 3]: the matrix Rz(roll) Ry(yaw) Rx(pitch) of the angles of 300W-LP, which are those of FSA-Net: yaw > 0 to the
image's left, pitch > 0 up, roll > 0 clockwise. The names of its tensors are ignored. A graph that gives six numbers is
refused.
"""

from __future__ import annotations

import math

from pydantic import Field

from vfoa.crops import CropCamera, grow
from vfoa.geometry import head_direction_crop
from vfoa.onnx import IMAGENET_MEAN, IMAGENET_SCALE, Model, OnnxSettings, Signature, blob
from vfoa.types import Float, Head, HeadPose, StereoFrame

SIDE_PX = 224

SIGNATURE = Signature(
    inputs={"input": (1, 3, SIDE_PX, SIDE_PX)}, outputs={"rotation_matrix": (1, 3, 3)}, by_position=True
)


class SixDRepNet:
    """Head pose by 6DRepNet.

    Never run with genuine weights here: crop, normalisation and angles follow the authors' ``onnx_inference.py`` and
    ``utils/general.py`` (908b709). They publish mean errors on AFLW2000-3D of 4.8 degrees for an angle (ResNet-18),
    4.3 (ResNet-50) and 7.5 (MobileNet v3 small); how these networks read faces near the profile is not known.
    """

    needs_face = True

    class Settings(OnnxSettings):
        """Settings of the network and its crop."""

        weights: str = "resnet18.onnx"
        """Path of the network, or a file's name in the folders of weights."""
        margin: float = Field(default=0.2, ge=0)
        """Margin added to the face's box on each side, as a share of its width or height."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._model = Model(settings.weights, SIGNATURE, settings)

    def estimate(self, frame: StereoFrame, head: Head) -> HeadPose | None:
        """Estimate one head's pose; None for a head without a face, since the network takes every image for a face."""
        if head.face_box_px is None:
            return None
        margin = self.settings.margin
        box = grow(head.face_box_px, side=margin, top=margin, bottom=margin)
        camera = CropCamera.at(box, frame.rig)
        image = blob(camera.image(frame, SIDE_PX), bgr=False, mean=IMAGENET_MEAN, scale=IMAGENET_SCALE)
        yaw, pitch, roll = angles_of(self._model.run(input=image)["rotation_matrix"][0])
        direction = camera.left_from_crop @ head_direction_crop(yaw, pitch)
        return HeadPose(direction=direction, yaw_rad=yaw, pitch_rad=pitch, roll_rad=roll)


def angles_of(rotation: Float) -> tuple[float, float, float]:
    """Yaw, pitch and roll in radians of Rz(roll) Ry(yaw) Rx(pitch) (3, 3)."""
    across = math.hypot(rotation[0, 0], rotation[1, 0])
    yaw = math.atan2(-rotation[2, 0], across)
    if across < 1e-6:  # at the profile, pitch and roll are one
        return yaw, math.atan2(-rotation[1, 2], rotation[1, 1]), 0.0
    return yaw, math.atan2(rotation[2, 1], rotation[2, 2]), math.atan2(rotation[1, 0], rotation[0, 0])
