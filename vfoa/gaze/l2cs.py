"""L2CS-Net (Abdelrahman et al. 2022) and MobileGaze: gaze from one face, each angle as a distribution over 90 bins.

The graph: [1, 3, 448, 448] RGB by ImageNet's mean and deviation, the face's box stretched; two outputs [1, 90] of
logits: first the horizontal angle (> 0 to the image's left), then the vertical one (> 0 up). Their names are ignored:
the authors call the first one "pitch" in one place and "yaw" in another. An angle is sum p_i (4 i) - 180 degrees.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from vfoa.crops import center, crop, grow
from vfoa.geometry import direction_from_crop, gaze_direction_crop, pixel_ray
from vfoa.onnx import IMAGENET_MEAN, IMAGENET_SCALE, Model, OnnxSettings, Signature, blob
from vfoa.types import Gaze, Head, HeadPose, Map, StereoFrame

BINS = 90
BIN_DEG = 4.0
FIRST_BIN_DEG = -180.0

SIGNATURE = Signature(
    inputs={"face": (1, 3, 448, 448)},
    outputs={"horizontal": (1, BINS), "vertical": (1, BINS)},
    by_position=True,
)


class L2cs:
    """Gaze of one frame from a face, without head pose, landmarks or neighbouring frames.

    The answer is the mean of those for the face and for its mirror image, which takes twice the time. MobileGaze's
    MobileOne-S0 on 43 labelled faces of two people of a TV show, angle in the image between gaze and target, mean and
    median: 8.6 and 5.6 degrees, 10.7 and 9.2 from the face alone; on 16 photographs of AFLW2000-3D of people who look
    into the camera, mean: 14.2 and 16.3. On eight photographs the answers for a face and for its mirror image differ by
    9.9 degrees in the mean, and by at most 0.15 once they are averaged.
    """

    needs_face = True

    class Settings(OnnxSettings):
        """Settings of the crop. ``margin``: added to the face's box on each side, as a share of its width or height."""

        weights: str = "resnet34_gaze.onnx"
        """Path of the network, or a file's name in the folders of weights."""
        margin: float = Field(default=0.0, ge=0)
        """Margin added to the face's box on each side, as a share of its width or height."""

        mirrored: bool = True
        """Average the answer with the one for the mirrored face, in twice the time."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._model = Model(settings.weights, SIGNATURE, settings)

    def estimate(self, frame: StereoFrame, head: Head, head_pose: HeadPose | None) -> Gaze | None:
        """Estimate one head's gaze; None without a face, since these networks were trained on faces only."""
        if head.face_box_px is None:
            return None
        margin = self.settings.margin
        box = grow(head.face_box_px, side=margin, top=margin, bottom=margin)
        face = blob(crop(frame.left, box, 448), bgr=False, mean=IMAGENET_MEAN, scale=IMAGENET_SCALE)
        theta, phi = self._angles(face)
        if self.settings.mirrored:
            theta_mirrored, phi_mirrored = self._angles(np.ascontiguousarray(face[..., ::-1]))
            theta, phi = (theta - theta_mirrored) / 2, (phi + phi_mirrored) / 2
        u, v = center(box)
        return Gaze(direction=direction_from_crop(gaze_direction_crop(theta, phi), pixel_ray(u, v, frame.rig)))

    def _angles(self, face: Map) -> tuple[float, float]:
        """The horizontal (> 0 to the image's left) and the vertical angle (> 0 up) of a face [1, 3, 448, 448], rad."""
        outputs = self._model.run(face=face)
        return _expected_angle(outputs["horizontal"][0]), _expected_angle(outputs["vertical"][0])


def _expected_angle(logits: Map) -> float:
    """Mean angle in radians of a distribution given as logits (90,)."""
    weights = np.exp(logits.astype(np.float64) - logits.max())
    angles_deg = FIRST_BIN_DEG + BIN_DEG * np.arange(BINS)
    return float(np.radians(weights @ angles_deg / weights.sum()))
