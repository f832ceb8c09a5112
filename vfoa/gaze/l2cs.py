"""L2CS-Net (Abdelrahman et al. 2022) and MobileGaze: gaze from one face, each angle as a distribution over 90 bins.

The graph: [1, 3, 448, 448] RGB by ImageNet's mean and deviation, the face's box stretched; two outputs [1, 90] of
logits: first the horizontal angle (> 0 to the image's left), then the vertical one (> 0 up). Their names are ignored:
the authors call the first one "pitch" in one place and "yaw" in another. An angle is sum p_i (4 i) - 180 degrees.
"""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from vfoa.crops import CropCamera, grow, reaches_border
from vfoa.geometry import angle_between, gaze_direction_crop, sigma_rad
from vfoa.onnx import IMAGENET_MEAN, IMAGENET_SCALE, Model, OnnxSettings, Signature, blob
from vfoa.types import Float, Gaze, Head, HeadPose, Map, NoGaze, StereoFrame

BINS = 90
BIN_DEG = 4.0
FIRST_BIN_DEG = -180.0

SIGNATURE = Signature(
    inputs={"face": (1, 3, 448, 448)},
    outputs={"horizontal": (1, BINS), "vertical": (1, BINS)},
    by_position=True,
)

_FRONTAL_DEG, _PER_TURN, _CUT_DEG = 14.0, 0.3, 15.0


class L2cs:
    """Gaze of one frame from a face, without landmarks or neighbouring frames.

    The answer is the mean of those for the face and for its mirror image, which takes twice the time: MobileOne-S0 65
    ms on one core of a CPU instead of 32 (ADAS-0002: 8). MobileGaze's MobileOne-S0 on 43 labelled faces of two people
    of a TV show, angle in the image between gaze and target, mean and median: 8.6 and 5.6 degrees, 10.7 and 9.2 from
    the face alone; on 16 photographs of AFLW2000-3D of people who look into the camera, mean: 14.2 and 16.3.

    A head turned away by ``most_turned_deg`` has no gaze, if a head pose is known: the head is the better cue there.
    The table gives mean angles in degrees on eight labelled photographs of AFLW2000-3D, and for the near-profile man of
    OpenCV's chessboard pictures (left06, right06), who is at about 90. *Mirror* is the angle between the answer of one
    crop and the mirrored answer for the mirrored photograph; the average has none. *To the head* is the angle between
    the gaze and the labelled head; a median of 13 is usual between people's eyes and heads. *Read* is the angle between
    a direction and the direction to the camera. ``python -m scripts.measure turned_faces`` prints the parts.

    ============================  =====  =====  ====  ========
    turn of the labelled head     to 30  30-60  72    about 90
    ============================  =====  =====  ====  ========
    photographs                   3      4      1     2
    gaze of one crop, mirror      7.6    14.7   6.3   11.4
    averaged gaze, to the head    20.7   19.5   28.8
    averaged gaze, read           18.1   26.1   43.7  44.3
    3DDFA_V2, to the head         4.7    5.5    5.2
    3DDFA_V2, read                9.4    42.6   76.0  82.1
    claimed error of the gaze     14.6   18.6   25.8
    ============================  =====  =====  ====  ========
    """

    needs_face = True

    class Settings(OnnxSettings):
        """Settings of the network, its crop, and the heads that it cannot see."""

        weights: str = "mobileone_s0_gaze.onnx"
        """Path of the network, or a file's name in the folders of weights."""
        margin: float = Field(default=0.0, ge=0)
        """Margin added to the face's box on each side, as a share of its width or height."""
        mirrored: bool = True
        """Average the answer with the one for the mirrored face, in twice the time."""
        most_turned_deg: float = Field(default=60.0, gt=0, le=180)
        """Angle of the head from the camera, degrees, beyond which a face has no gaze and the head is the cue."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._model = Model(settings.weights, SIGNATURE, settings)

    def estimate(self, frame: StereoFrame, head: Head, head_pose: HeadPose | None) -> Gaze | NoGaze | None:
        """Estimate one head's gaze; None without a face, since these networks were trained on faces only.

        A head turned too far from the camera has a :class:`NoGaze`.
        """
        if head.face_box_px is None:
            return None
        margin = self.settings.margin
        box = grow(head.face_box_px, side=margin, top=margin, bottom=margin)
        camera = CropCamera.at(box, frame.rig)
        if head_pose is not None and _turned_deg(head_pose.direction, camera.ray_left) > self.settings.most_turned_deg:
            return NoGaze(cause="face_turned_away")
        face = blob(camera.image(frame, 448), bgr=False, mean=IMAGENET_MEAN, scale=IMAGENET_SCALE)
        theta, phi = self._angles(face)
        if self.settings.mirrored:
            theta_mirrored, phi_mirrored = self._angles(np.ascontiguousarray(face[..., ::-1]))
            theta, phi = (theta - theta_mirrored) / 2, (phi + phi_mirrored) / 2
        direction = camera.left_from_crop @ gaze_direction_crop(theta, phi)
        turned_deg = _turned_deg(direction if head_pose is None else head_pose.direction, camera.ray_left)
        is_cut = reaches_border(head.face_box_px, frame.left)
        return Gaze(direction=direction, sigma_rad=claimed_sigma_rad(turned_deg, is_cut=is_cut))

    def _angles(self, face: Map) -> tuple[float, float]:
        """The horizontal (> 0 to the image's left) and the vertical angle (> 0 up) of a face [1, 3, 448, 448], rad."""
        outputs = self._model.run(face=face)
        return _expected_angle(outputs["horizontal"][0]), _expected_angle(outputs["vertical"][0])


def claimed_sigma_rad(turned_deg: float, *, is_cut: bool = False) -> float:
    """The claimed error per tangent direction for a head that is turned from the camera by an angle.

    The mean angle is the root of 14 degrees squared, as of faces that look into the camera, plus 0.3 of the turn
    squared. At 40 degrees it is 1.3 times that of a frontal face (mirror error: 1.5 times); at 72 degrees it is 26, and
    29 with 13 between eyes and head (measured angle to the head: 30). A face of which the image's border cuts off a
    part adds the square of 15 degrees (``python -m scripts.measure cut_faces``).
    """
    return sigma_rad(math.hypot(_FRONTAL_DEG, _PER_TURN * turned_deg, _CUT_DEG * is_cut))


def _turned_deg(direction: Float, ray: Float) -> float:
    """Angle between a direction (3,) and the direction to the camera from a head on this ray (3,)."""
    return math.degrees(angle_between(direction, -ray))


def _expected_angle(logits: Map) -> float:
    """Mean angle in radians of a distribution given as logits (90,)."""
    weights = np.exp(logits.astype(np.float64) - logits.max())
    angles_deg = FIRST_BIN_DEG + BIN_DEG * np.arange(BINS)
    return float(np.radians(weights @ angles_deg / weights.sum()))
