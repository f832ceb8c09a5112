"""gaze-estimation-adas-0002 of the Open Model Zoo: gaze from the images of both eyes and the head pose.

``left_eye_image`` is the eye on the IMAGE's left, the person's own right eye: the zoo's demo takes landmarks 60 and 64
of 98 there. Both eye images are [1, 3, 60, 60] BGR 0 to 255. ``head_pose_angles`` [1, 3] are yaw, pitch, roll in
degrees, yaw > 0 to the image's right, pitch > 0 down, roll > 0 clockwise. ``gaze_vector`` [1, 3] has x to the image's
right, y up, and z negative towards the camera.
"""

from __future__ import annotations

import math

import numpy as np

from vfoa.crops import CropCamera, reaches_border
from vfoa.geometry import back_project, left_from_crop, sigma_rad, unit
from vfoa.onnx import Model, OnnxSettings, Signature, blob
from vfoa.types import Float, Gaze, Head, HeadPose, Image, NoGaze, StereoFrame

GAZE = Signature(
    inputs={
        "head_pose_angles": (1, 3),
        "left_eye_image": (1, 3, 60, 60),
        "right_eye_image": (1, 3, 60, 60),
    },
    outputs={"gaze_vector": (1, 3)},
)
HEAD_POSE = Signature(
    inputs={"data": (1, 3, 60, 60)}, outputs={"angle_y_fc": (1, 1), "angle_p_fc": (1, 1), "angle_r_fc": (1, 1)}
)

FACE_SIDE = 1.1
"""Side of the head-pose network's square over the longer side of the face's box.

Of the values 0.9 to 1.3, this one gives the most accurate roll on a portrait that is turned by known angles.
"""

EYE_SIDE = 0.85
"""Side of an eye crop over the distance between the eyes.

The zoo's demo takes 1.8 widths of an eye; an eye's width is 0.47 of that distance (30 of 63 mm).
"""

MOST_TURNED_DEG = 40.0
"""Angle of the head from the camera beyond which there is no gaze.

Models of head pose read 44 degrees on a face in profile, and the farther eye is hidden before.
"""

_FRONTAL_DEG, _PER_TURN, _CUT_DEG = 11.0, 0.9, 9.0
_EYEBALL, _SHARP_DETAIL, _NO_DETAIL = 0.19, 0.05, 0.22
"""Radius of an eyeball, and the finest detail of sharp eyes and of eyes blurred away, in distances between the eyes."""


class Adas0002:
    """Gaze by ADAS-0002. It needs a face with landmarks.

    The eye crops are squares about the eyes, turned upright by the slope of the line between the eyes. The network gets
    a roll of 0, and its answer is turned back. The table gives median angles in degrees. *Mirror* is the angle between
    the gaze in an image and the mirrored gaze in the mirrored image; *camera* is the angle between the gaze and the
    direction to the camera, which the astronaut looks into. Astronaut: scikit-image's photograph at 5 rolls (-20 to 20
    deg) x 3 scales, n = 15. Bandage_2: a rendered face near its profile, n = 20 frames. Crops were cut straight out of
    the image. "Roll" is what turns the crops: the line between the eyes, the roll of the zoo's head-pose network (as in
    the zoo's demo), or nothing (the network gets the roll instead).

    ========================  =========  =====================  =====================  ==================
    left_eye_image            head pose  roll                   astronaut mirror       bandage_2 mirror
                                                                (camera)
    ========================  =========  =====================  =====================  ==================
    the person's own left     own        line                   11.1 (5.5)             8.2
    the person's own left     own        head-pose network      10.6 (5.5)             9.6
    the person's own left     stage      line                   10.8 (5.8)             8.8
    **the image's left**      **own**    **line**               **4.9 (4.2)**          **11.1**
    the image's left          own        head-pose network      3.8 (4.3)              16.7
    the image's left          own        nothing                5.8 (5.1)              10.6
    the image's left          stage      line                   5.1 (5.8)              13.0
    ========================  =========  =====================  =====================  ==================

    ``own`` is head-pose-estimation-adas-0001, ``stage`` is FSA-Net. The line between the eyes is used as roll: the
    network's roll is 1 deg better on the photograph and 6 deg worse on the rendered face.
    """

    needs_face = True

    class Settings(OnnxSettings):
        """The networks."""

        weights: str = "gaze-estimation-adas-0002.onnx"
        """Path of the gaze network, or a file's name in the folders of weights."""
        head_pose_weights: str = "head-pose-estimation-adas-0001.onnx"
        """Path of the head-pose network of ADAS-0002's training, or a file's name in the folders of weights."""

        @property
        def used_weights(self) -> tuple[str, ...]:
            """File names of the networks that these settings run."""
            return self.weights, self.head_pose_weights

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._gaze = Model(settings.weights, GAZE, settings)
        self._head_pose = Model(settings.head_pose_weights, HEAD_POSE, settings)

    def estimate(self, frame: StereoFrame, head: Head, head_pose: HeadPose | None) -> Gaze | NoGaze | None:
        """Estimate one head's gaze; None without a face or its landmarks.

        A head turned too far from the camera has a :class:`NoGaze`.
        """
        if head.face_box_px is None or head.landmarks_px is None:
            return None
        right_eye, left_eye = head.landmarks_px[:2]
        if np.array_equal(right_eye, left_eye):
            return None
        u, v = np.transpose([right_eye, left_eye])
        rays = unit(back_project(u, v, 1, frame.rig))
        axes = left_from_crop(rays.sum(axis=0))
        angles = self._angles(frame, head.face_box_px)
        # the most turned of the two: networks of head pose underestimate
        of_stage = _angles(head_pose, axes)
        turned_deg = max(_turned_deg(*angles), _turned_deg(*of_stage) if of_stage else 0.0)
        if turned_deg > MOST_TURNED_DEG:
            return NoGaze(cause="face_turned_away")
        first, second = rays @ axes
        across = second[:2] / second[2] - first[:2] / first[2]
        roll = math.atan2(across[1], across[0])
        half = EYE_SIDE * float(np.hypot(*across)) / 2
        # the person's own right eye is on the image's left
        eyes = [CropCamera.towards(ray, half).image(frame, 60, roll_rad=roll) for ray in rays]
        detail = max(_detail(eye) for eye in eyes) * EYE_SIDE
        return Gaze(
            direction=axes @ self._look(eyes[0], eyes[1], roll, angles),
            sigma_rad=claimed_sigma_rad(turned_deg, detail, is_cut=reaches_border(head.face_box_px, frame.left)),
        )

    def _look(self, left: Image, right: Image, roll: float, angles_deg: tuple[float, float]) -> Float:
        """Direction (3,) in the crop's axes: the answer for upright eyes at each side of the image, turned back."""
        eyes = {"left_eye_image": blob(left, bgr=True), "right_eye_image": blob(right, bgr=True)}
        outputs = self._gaze.run(head_pose_angles=np.array([[*angles_deg, 0.0]], np.float32), **eyes)
        x, y, z = outputs["gaze_vector"][0].astype(np.float64) * [1, -1, 1]
        cos, sin = math.cos(roll), math.sin(roll)
        return np.array([cos * x - sin * y, sin * x + cos * y, z])

    def _angles(self, frame: StereoFrame, face_box_px: Float) -> tuple[float, float]:
        """Yaw and pitch in degrees, with ADAS's signs, from the model's own head-pose network."""
        camera = CropCamera.at(face_box_px, frame.rig)
        face = CropCamera.towards(camera.ray_left, FACE_SIDE * float(camera.half.max())).image(frame, 60)
        outputs = self._head_pose.run(data=blob(face, bgr=True))
        return float(outputs["angle_y_fc"][0, 0]), float(outputs["angle_p_fc"][0, 0])


def claimed_sigma_rad(turned_deg: float, detail: float, *, is_cut: bool = False) -> float:
    """The claimed error per tangent direction, for a head turned from the camera and eyes with this finest detail.

    ``detail`` is a length in distances between the eyes. The mean angle is the root of the sum of four squares:

    - 11.0 degrees of faces to the camera that look into it.
    - 0.9 of the angle that the head is turned: labelled faces of two people, 16.6 degrees for the frontal one and 36.2
      for the other, worse than the head alone; the slope of gaze over true yaw is 0.7, and the head is underestimated.
    - the angle of an eyeball (radius 12 of 63 mm, 0.19) whose iris is off by half of the detail beyond a sharp eye's.
    - 9 degrees of a face of which the image's border cuts off a part (``python -m scripts.measure cut_faces``).
    """
    unsharp_deg = math.degrees(max(0.0, detail - _SHARP_DETAIL) / 2 / _EYEBALL)
    return sigma_rad(math.hypot(_FRONTAL_DEG, _PER_TURN * turned_deg, unsharp_deg, _CUT_DEG * is_cut))


def _turned_deg(yaw_deg: float, pitch_deg: float) -> float:
    """Angle between a head and the direction to the camera."""
    return math.degrees(math.acos(math.cos(math.radians(yaw_deg)) * math.cos(math.radians(pitch_deg))))


def _detail(eye: Image) -> float:
    """Scale of the finest detail over the width of an eye's crop (h, w, 3): few pixels and blur both enlarge it.

    The standard deviation over the root mean square slope; that of a fully blurred eye for a crop of one colour.
    """
    grey = eye.mean(axis=2)
    down, right = np.gradient(grey)
    slope = float(np.sqrt((right**2 + down**2).mean()))
    return float(grey.std()) / slope / eye.shape[1] if slope > 0 else _NO_DETAIL


def _angles(head_pose: HeadPose | None, axes: Float) -> tuple[float, float] | None:
    """Yaw and pitch in degrees, with ADAS's signs, of a head's direction in a crop's axes (3, 3)."""
    if head_pose is None:
        return None
    x, y, z = head_pose.direction @ axes
    return math.degrees(math.asin(float(np.clip(x, -1, 1)))), math.degrees(math.atan2(y, -z))
