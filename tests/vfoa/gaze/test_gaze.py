from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from scripts.measure.mirror import (
    bandage_frame,
    frame_of,
    mirrored,
    mirrored_direction,
    mirrored_head,
    stretched,
    stretched_head,
)
from tests import graphs
from vfoa.gaze.adas import Adas0002, claimed_sigma_rad
from vfoa.geometry import angle_between, direction_from_crop, head_direction_crop, pixel_ray
from vfoa.heads.yunet import YuNet
from vfoa.types import Gaze, Head, HeadPose, Instances, NoGaze, StereoFrame

EYES = {"head_pose_angles": (1, 3), "left_eye_image": (1, 3, 60, 60), "right_eye_image": (1, 3, 60, 60)}
FRAME = frame_of(np.zeros((200, 300, 3), np.uint8))
FACE = {"data": (1, 3, 60, 60)}


def head_at(u: float, v: float, *, roll_deg: float = 0.0) -> Head:
    """A face whose eyes are 24 pixels apart, their middle at (u, v), leaning clockwise."""
    roll = np.radians(roll_deg)
    right, down = np.array([np.cos(roll), np.sin(roll)]), np.array([-np.sin(roll), np.cos(roll)])
    landmarks = [[-12, 0], [12, 0], [0, 14], [-9, 26], [9, 26]] @ np.stack([right, down]) + [u, v]
    box = np.array([u - 30.0, v - 30.0, u + 30.0, v + 50.0])
    return Head(box_px=box, score=1.0, face_box_px=box, landmarks_px=landmarks)


def with_head(folder: Path, weights: str, yaw_deg: float = 0.0, pitch_deg: float = 0.0) -> Adas0002:
    """ADAS with this gaze network, and a head-pose network that answers this yaw and pitch and a roll of 30 degrees."""
    angles = {"angle_y_fc": [[yaw_deg]], "angle_p_fc": [[pitch_deg]], "angle_r_fc": [[30.0]]}
    head_pose = graphs.constant(folder / "head_pose.onnx", FACE, angles)
    return Adas0002(Adas0002.Settings(weights=weights, head_pose_weights=head_pose))


def constant_gaze(folder: Path, vector: tuple[float, float, float]) -> Adas0002:
    return with_head(folder, graphs.constant(folder / "gaze.onnx", EYES, {"gaze_vector": [vector]}))


def angles_as_gaze(folder: Path, yaw_deg: float, pitch_deg: float) -> Adas0002:
    """A gaze network that answers (yaw, pitch, 90) for the head pose it is given, in degrees."""
    from onnx import helper, numpy_helper

    nodes = [
        helper.make_node("Constant", [], ["c"], value=numpy_helper.from_array(np.array([[0, 0, 90]], np.float32))),
        helper.make_node("Add", ["head_pose_angles", "c"], ["gaze_vector"]),
    ]
    weights = graphs.write(folder / "angles.onnx", nodes, EYES, {"gaze_vector": (1, 3)})
    return with_head(folder, weights, yaw_deg, pitch_deg)


def direction(gaze: Gaze | NoGaze | None) -> np.ndarray:
    assert isinstance(gaze, Gaze)
    return gaze.direction


@pytest.mark.parametrize(
    ("vector", "expected"),
    [((0, 0, -1), (0, 0, -1)), ((-0.6, 0, -0.8), (-0.6, 0, -0.8)), ((0, 0.6, -0.8), (0, -0.6, -0.8))],
)
def test_axes_of_the_gaze_vector(
    tmp_path: Path, vector: tuple[float, float, float], expected: tuple[float, float, float]
) -> None:
    model = constant_gaze(tmp_path, vector)
    np.testing.assert_allclose(direction(model.estimate(FRAME, head_at(149.5, 99.5), None)), expected, atol=1e-6)


def test_the_direction_turns_with_the_ray_to_the_eyes(tmp_path: Path) -> None:
    model = constant_gaze(tmp_path, (0.0, 0.0, -2.0))
    for u, v in ((40, 50), (260, 150)):
        found = direction(model.estimate(FRAME, head_at(u, v), None))
        np.testing.assert_allclose(found, -pixel_ray(u, v, FRAME.rig), atol=1e-3)


def test_what_upright_eyes_see_leans_with_the_head(tmp_path: Path) -> None:
    model = constant_gaze(tmp_path, (0.6, 0.0, -0.8))  # to the head's own right side of the picture
    found = direction(model.estimate(FRAME, head_at(149.5, 99.5, roll_deg=90), None))
    np.testing.assert_allclose(found, [0, 0.6, -0.8], atol=1e-6)  # a quarter turn clockwise: down


def test_the_head_pose_is_told_without_roll(tmp_path: Path) -> None:
    ray = pixel_ray(80, 120, FRAME.rig)
    found = direction(angles_as_gaze(tmp_path, -20, -10).estimate(FRAME, head_at(80, 120), None))
    # the answer's y is up
    np.testing.assert_allclose(found, direction_from_crop(np.array([-20, 10, 90.0]) / np.sqrt(8600), ray), atol=2e-3)


def test_the_networks_left_eye_is_the_eye_on_the_images_left(tmp_path: Path) -> None:
    from onnx import helper

    nodes = [
        helper.make_node("GlobalAveragePool", ["left_eye_image"], ["left"]),
        helper.make_node("GlobalAveragePool", ["right_eye_image"], ["right"]),
        helper.make_node("Neg", ["right"], ["minus"]),
        helper.make_node("Add", ["left", "minus"], ["difference"]),
        helper.make_node("Flatten", ["difference"], ["gaze_vector"]),
    ]
    weights = graphs.write(tmp_path / "sides.onnx", nodes, EYES, {"gaze_vector": (1, 3)})
    image = np.zeros((200, 300, 3), np.uint8)
    image[:, :150] = [10, 20, 200]  # where the person's right eye is
    found = direction(with_head(tmp_path, weights).estimate(frame_of(image), head_at(149.5, 99.5), None))
    expected = np.array([200, -20, 10.0])  # blue, green, red; y is up there
    np.testing.assert_allclose(found, expected / np.linalg.norm(expected), atol=1e-3)


def test_what_was_not_found_gives_no_gaze(tmp_path: Path) -> None:
    model = constant_gaze(tmp_path, (0.0, 0.0, -1.0))
    box = np.array([10.0, 10, 50, 60])
    assert model.estimate(FRAME, Head(box_px=box, score=1.0), None) is None
    assert model.estimate(FRAME, Head(box_px=box, score=1.0, face_box_px=box), None) is None


@pytest.fixture
def detector(shared_models: Path) -> YuNet:
    return YuNet(YuNet.Settings(weights=str(shared_models / "yunet_n_640_640.onnx")))


def adas(shared_models: Path) -> Adas0002:
    gaze, head_pose = "gaze-estimation-adas-0002.onnx", "head-pose-estimation-adas-0001.onnx"
    return Adas0002(
        Adas0002.Settings(weights=str(shared_models / gaze), head_pose_weights=str(shared_models / head_pose))
    )


def mirror_errors_deg(model: Adas0002, detector: YuNet, frames: list[StereoFrame]) -> list[float]:
    """The angle between the gaze of each frame's face and the mirrored gaze of the mirrored frame."""
    errors = []
    for frame in frames:
        (head,) = detector.detect(frame, Instances(ids=np.zeros(frame.left.shape[:2], np.uint16), instances=()))
        gaze = direction(model.estimate(frame, head, None))
        seen = direction(model.estimate(mirrored(frame), mirrored_head(head, frame.rig.width_px), None))
        errors.append(float(np.degrees(angle_between(seen, mirrored_direction(gaze)))))
    return errors


def rolled_and_scaled_photograph() -> list[StereoFrame]:
    """The photograph of scikit-image of a woman who looks into the camera, at five rolls and three scales."""
    data = pytest.importorskip("skimage.data")
    image = data.astronaut()
    height, width = image.shape[:2]
    turns = [cv2.getRotationMatrix2D((224, 110), roll, scale) for roll in range(-20, 21, 10) for scale in (0.7, 1, 1.4)]
    return [frame_of(cv2.warpAffine(image, turn, (width, height), borderMode=cv2.BORDER_REPLICATE)) for turn in turns]


def test_a_mirrored_photograph_gives_mirrored_gazes(shared_models: Path, detector: YuNet) -> None:
    errors = mirror_errors_deg(adas(shared_models), detector, rolled_and_scaled_photograph())
    assert np.median(errors) < 7  # 11 with the eyes exchanged


def test_mirrored_frames_give_mirrored_gazes(shared_data: Path, shared_models: Path, detector: YuNet) -> None:
    model = pickle.loads(pickle.dumps(adas(shared_models)))
    numbers = [*range(1, 7), *range(9, 51, 6)]  # her eyes are shut in 7 and 8
    errors = mirror_errors_deg(model, detector, [bandage_frame(shared_data, number) for number in numbers])
    assert np.median(errors) < 15  # a rendered face near its profile: 18 with the roll of the head-pose network


@pytest.mark.parametrize(("yaw_deg", "seen"), [(0, True), (35, True), (45, False), (-60, False)])
def test_a_face_turned_away_has_no_gaze(tmp_path: Path, yaw_deg: float, seen: bool) -> None:
    head = head_at(150, 100)
    ray = pixel_ray(150, 100, FRAME.rig)
    pose = HeadPose(direction=direction_from_crop(head_direction_crop(np.radians(yaw_deg), 0.0), ray))
    found = constant_gaze(tmp_path, (0, 0, -1)).estimate(FRAME, head, pose)
    assert isinstance(found, Gaze if seen else NoGaze)


@pytest.mark.parametrize("factor", [0.75, 1.25, 1.5])
def test_pixels_that_are_not_square_give_the_same_gaze(
    shared_data: Path, shared_models: Path, detector: YuNet, factor: float
) -> None:
    model = adas(shared_models)
    for number in (1, 20, 40):
        frame = bandage_frame(shared_data, number)
        (head,) = detector.detect(frame, Instances(ids=np.zeros(frame.left.shape[:2], np.uint16), instances=()))
        rows = round(factor * frame.rig.height_px)
        gaze = model.estimate(frame, head, None)
        other = model.estimate(stretched(frame, rows), stretched_head(head, rows / frame.rig.height_px), None)
        assert isinstance(gaze, Gaze)
        assert isinstance(other, Gaze)
        assert np.degrees(angle_between(gaze.direction, other.direction)) < 1.5


def test_the_claimed_error_grows_with_the_turn_of_the_head_and_with_blur() -> None:
    frontal, turned, blurred = (claimed_sigma_rad(*each) for each in ((0.0, 0.05), (30.0, 0.05), (0.0, 0.2)))
    assert np.degrees(frontal) * np.sqrt(np.pi / 2) == pytest.approx(11.0)
    assert turned > 1.5 * frontal
    assert blurred > 1.5 * frontal
    assert claimed_sigma_rad(0.0, 0.05, is_cut=True) == pytest.approx(frontal * np.hypot(11, 9) / 11)


def test_a_face_that_the_border_cuts_claims_a_larger_error(tmp_path: Path) -> None:
    model, whole = constant_gaze(tmp_path, (0, 0, -1)), head_at(150, 100)
    assert whole.landmarks_px is not None
    assert whole.face_box_px is not None
    claims = []
    for left in (0, int(whole.face_box_px[0]) + 1):
        image = np.ascontiguousarray(FRAME.left[:, left:])
        rig = replace(FRAME.rig, width_px=image.shape[1], cx_px=FRAME.rig.cx_px - left)
        shift = np.array([left, 0])
        head = replace(
            whole,
            box_px=whole.box_px - np.tile(shift, 2),
            face_box_px=whole.face_box_px - np.tile(shift, 2),
            landmarks_px=whole.landmarks_px - shift,
        )
        gaze = model.estimate(replace(FRAME, left=image, right=image, rig=rig), head, None)
        assert isinstance(gaze, Gaze)
        assert gaze.sigma_rad is not None
        claims.append(gaze.sigma_rad)
    assert claims[1] > 1.05 * claims[0]


def test_eyes_of_few_pixels_or_out_of_focus_claim_a_larger_error(
    tmp_path: Path, shared_data: Path, shared_models: Path, detector: YuNet
) -> None:
    model = with_head(tmp_path, str(shared_models / "gaze-estimation-adas-0002.onnx"))
    frame = bandage_frame(shared_data, 1)
    (head,) = detector.detect(frame, Instances(ids=np.zeros(frame.left.shape[:2], np.uint16), instances=()))
    assert head.face_box_px is not None
    assert head.landmarks_px is not None
    claims = []
    for image, share in ((frame.left, 1.0), (cv2.GaussianBlur(frame.left, (0, 0), 12), 1.0), (frame.left, 0.15)):
        small = cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
        box, face, points = (share * each for each in (head.box_px, head.face_box_px, head.landmarks_px))
        scaled = replace(head, box_px=box, face_box_px=face, landmarks_px=points)
        found = model.estimate(frame_of(small, fx_px=share * 896.0), scaled, None)
        assert isinstance(found, Gaze)
        claims.append(found.sigma_rad or 0.0)
    assert claims[1] > 1.2 * claims[0]
    assert claims[2] > 1.05 * claims[0]
