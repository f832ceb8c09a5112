"""3DDFA_V2 head pose (Guo et al. 2020): a 3D face model is fitted to a face, up to its profile.

The graph takes ``input`` [1, 3, 120, 120] BGR, (x - 127.5) / 128, and gives ``param`` [1, 12 or more]. Its first 12
numbers are a matrix (3, 4) from the face model to the crop: scale times rotation, and translation, with x right, y up
and z towards the camera in both. ``param`` is in these units: a graph whose output is normalised (the authors' own
export, ``output``) is refused by that name.
"""

from __future__ import annotations

import math

import numpy as np

from vfoa.crops import CropCamera, reaches_border
from vfoa.geometry import angle_between, head_angles, sigma_rad, unit
from vfoa.onnx import Model, OnnxSettings, Signature, blob
from vfoa.types import Float, Head, HeadPose, StereoFrame

SIGNATURE = Signature(inputs={"input": (1, 3, 120, 120)}, outputs={"param": (1, None)})

_SIDE, _DOWN = 1.58, 0.14
"""Side of the crop, and how far its centre is below that of the face's box, over the mean of the box's sides.

As ``parse_roi_box_from_bbox`` in ``utils/functions.py`` of github.com/cleardusk/3DDFA_V2.
"""
_FRONTAL_DEG, _PER_TURN, _CUT_DEG = 5.0, 0.1, 9.0
_TO_CAMERA = (0.0, 0.0, -1.0)
_Y_AND_Z = np.array([1.0, -1.0, -1.0])


class TddfaV2:
    """Head pose from 3DDFA_V2's MobileNet.

    The table gives angles in degrees between an estimated direction and that of the labels, on eight photographs of
    AFLW2000-3D (faces and boxes of YuNet), by how far the head is turned from the camera. *Mirror* is the median angle
    between the direction in an image and the mirrored direction in the mirrored image: on the same photographs, and on
    25 frames of Sintel's bandage_2. *Profile* is the turn read from the near-profile man of OpenCV's chessboard
    pictures (left06, right06), who is at about 90.

    =============================  =====  ======  =====  =====  ==========  ===========  ==========
    mean angle at a turn of        to 30  30-60   72     all    mirror      bandage_2    profile
    =============================  =====  ======  =====  =====  ==========  ===========  ==========
    photographs                    3      4       1      8      8           25           2
    FSA-Net, two networks          6.3    7.4     6.8    6.9    2.9         3.2          46, 53
    **3DDFA_V2**                   4.7    5.5     5.2    5.2    2.7         3.2          82, 82
    =============================  =====  ======  =====  =====  ==========  ===========  ==========

    One inference takes 4 ms on one core of a CPU, those of FSA-Net 5 ms. The average with the mirrored face is no
    better (5.7 degrees against 5.2), so one crop is used. Near the profile, pitch and roll are not
    well defined; the direction is.
    """

    needs_face = True

    class Settings(OnnxSettings):
        """The network."""

        weights: str = "mb05_120x120.onnx"
        """Path of the network, or a file's name in the folders of weights."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._model = Model(settings.weights, SIGNATURE, settings)

    def estimate(self, frame: StereoFrame, head: Head) -> HeadPose | None:
        """Estimate one head's pose; None for a head without a face, since the network takes every image for a face."""
        if head.face_box_px is None:
            return None
        face = CropCamera.at(head.face_box_px, frame.rig)
        half = float(face.half.mean())
        camera = CropCamera.towards(face.left_from_crop @ [0, 2 * _DOWN * half, 1], _SIDE * half)
        image = blob(camera.image(frame, 120), bgr=True, mean=127.5, scale=1 / 128)
        rotation = crop_from_head(self._model.run(input=image)["param"][0])
        yaw, pitch, roll = head_angles(rotation)
        direction = -rotation[:, 2]
        return HeadPose(
            direction=camera.left_from_crop @ direction,
            yaw_rad=yaw,
            pitch_rad=pitch,
            roll_rad=roll,
            sigma_rad=claimed_sigma_rad(
                math.degrees(angle_between(direction, _TO_CAMERA)), is_cut=reaches_border(head.face_box_px, frame.left)
            ),
        )


def crop_from_head(parameters: Float) -> Float:
    """Rotation (3, 3) of a head in its crop (see :func:`vfoa.geometry.head_angles`) from the parameters (12 or more).

    Rows 1 and 2 of the matrix have a scale each, and row 3 is not used: as ``P2sRt`` in ``utils/pose.py`` of 3DDFA_V2.
    The nearest rotation is taken, since the two rows are not quite at a right angle.
    """
    right, up = unit(np.asarray(parameters[:12], dtype=np.float64).reshape(3, 4)[:2, :3])
    before, _, after = np.linalg.svd(np.array([right, up, np.cross(right, up)]))
    return (before @ after) * np.outer(_Y_AND_Z, _Y_AND_Z)


def claimed_sigma_rad(turned_deg: float, *, is_cut: bool = False) -> float:
    """The claimed error per tangent direction for a head that is turned from the camera by an angle.

    The mean angle is the root of 5.0 degrees squared plus a tenth of the turn squared: the mean over the eight labelled
    faces is 6.3 then, which is what 16 faces of the same set had. A face of which the image's border cuts off a part
    adds the square of 9 degrees (``python -m scripts.measure cut_faces``).
    """
    return sigma_rad(math.hypot(_FRONTAL_DEG, _PER_TURN * turned_deg, _CUT_DEG * is_cut))
