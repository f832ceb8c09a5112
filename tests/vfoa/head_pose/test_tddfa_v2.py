from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from scripts.measure.mirror import (
    bandage_frame,
    frame_of,
    mirrored,
    mirrored_direction,
    mirrored_head,
    read_rgb,
    stretched,
    stretched_head,
)
from tests import graphs
from tests.scenes import square_box
from vfoa.crops import center
from vfoa.errors import VfoaError
from vfoa.geometry import angle_between, head_angles, head_direction_crop, left_from_crop, pixel_ray
from vfoa.head_pose.tddfa_v2 import TddfaV2, claimed_sigma_rad, crop_from_head
from vfoa.heads.yunet import YuNet
from vfoa.types import Float, Head, HeadPose, Image, StereoFrame

INPUT = {"input": (1, 3, 120, 120)}
BLACK = frame_of(np.zeros((200, 300, 3), np.uint8))
SCALE = 5e-4
"""Of the real network's matrices."""


def head_at(u: float, v: float, *, face: bool = True) -> Head:
    return Head(box_px=square_box((u, v), 60), score=1.0, face_box_px=square_box((u, v), 40) if face else None)


def parameters(rotation: Float) -> Float:
    """The network's numbers for a rotation (3, 3) from the face model's axes (y up, z to the camera) to the crop's."""
    matrix = np.column_stack([SCALE * rotation, [60.0, 70.0, -66.0]])
    return np.concatenate([matrix.ravel(), np.ones(50)])


def constant_network(folder: Path, rotation: Float) -> TddfaV2:
    """3DDFA_V2 with a network that always answers this rotation."""
    weights = graphs.constant(folder / "constant.onnx", INPUT, {"param": [parameters(rotation)]})
    return TddfaV2(TddfaV2.Settings(weights=weights))


def axis_of_crop(frame: StereoFrame, head: Head) -> Float:
    """Ray (3,) through the centre of the published crop: 0.14 of the face's mean side below the box's centre."""
    assert head.face_box_px is not None
    u0, v0, u1, v1 = head.face_box_px
    u, v = center(head.face_box_px)
    return pixel_ray(u, v + 0.14 * (u1 - u0 + v1 - v0) / 2, frame.rig)


# Geometry


def test_an_upright_head_without_rotation_looks_into_the_camera_from_anywhere(tmp_path: Path) -> None:
    model = constant_network(tmp_path, np.eye(3))
    for u, v in ((20, 20), (280, 40), (150, 190)):
        head = head_at(u, v)
        pose = model.estimate(BLACK, head)
        assert pose is not None
        np.testing.assert_allclose(pose.direction, -axis_of_crop(BLACK, head), atol=1e-3)
        np.testing.assert_allclose([pose.yaw_rad, pose.pitch_rad, pose.roll_rad], 0, atol=1e-6)


@pytest.mark.parametrize(
    ("axis", "deg", "direction", "angles_deg"),
    [
        ("y", 30, (0.5, 0, -np.sqrt(0.75)), (-30, 0, 0)),  # z towards x: to the image's right
        ("y", -30, (-0.5, 0, -np.sqrt(0.75)), (30, 0, 0)),
        ("y", -90, (-1, 0, 0), None),  # the profile
        ("x", -30, (0, -0.5, -np.sqrt(0.75)), (0, 30, 0)),  # up
        ("z", -40, (0, 0, -1), (0, 0, 40)),  # x towards -y: clockwise, about its own direction
    ],
)
def test_rotations_of_the_face_model_have_the_signs_of_the_crop(
    tmp_path: Path,
    axis: str,
    deg: float,
    direction: tuple[float, float, float],
    angles_deg: tuple[float, float, float] | None,
) -> None:
    head = head_at(149.5, 99.5)
    model = constant_network(tmp_path, Rotation.from_euler(axis, deg, degrees=True).as_matrix())
    pose = model.estimate(BLACK, head)
    assert pose is not None
    seen = pose.direction @ left_from_crop(axis_of_crop(BLACK, head))
    np.testing.assert_allclose(seen, direction, atol=1e-6)
    if angles_deg is not None:
        np.testing.assert_allclose(np.degrees([pose.yaw_rad, pose.pitch_rad, pose.roll_rad]), angles_deg, atol=1e-4)


@given(st.floats(-1.4, 1.4), st.floats(-1.4, 1.4), st.floats(-3, 3))
def test_angles_and_direction_of_a_rotation_agree(yaw: float, pitch: float, roll: float) -> None:
    rotation = Rotation.from_euler("XYZ", [-pitch, yaw, roll]).as_matrix()
    np.testing.assert_allclose(head_angles(rotation), (yaw, pitch, roll), atol=1e-9)
    np.testing.assert_allclose(-rotation[:, 2], head_direction_crop(yaw, pitch), atol=1e-9)


def test_rows_of_other_scales_and_not_at_a_right_angle_give_a_rotation() -> None:
    rotation = Rotation.from_euler("xyz", [20, -50, 10], degrees=True).as_matrix()
    np.testing.assert_allclose(
        crop_from_head(parameters(np.diag([1, 1.2, 7]) @ rotation)), crop_from_head(parameters(rotation)), atol=1e-9
    )
    skewed = crop_from_head(parameters(rotation + np.array([[0, 0.05, 0], [0, 0, 0], [0, 0, 0]])))
    np.testing.assert_allclose(skewed @ skewed.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(skewed) == pytest.approx(1)


def test_the_claimed_error_grows_with_the_turn() -> None:
    assert claimed_sigma_rad(0) == pytest.approx(np.radians(5) / np.sqrt(np.pi / 2))
    assert claimed_sigma_rad(90) == pytest.approx(np.radians(np.hypot(5, 9)) / np.sqrt(np.pi / 2))


def test_a_face_that_the_border_cuts_claims_a_larger_error() -> None:
    assert claimed_sigma_rad(0, is_cut=True) == pytest.approx(np.radians(np.hypot(5, 9)) / np.sqrt(np.pi / 2))


# What it takes


def test_the_crop_is_the_published_one_in_blue_green_red(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    weights = graphs.mean_color(tmp_path / "means.onnx", "input", (1, 3, 120, 120), "param", 1.0)
    model = TddfaV2(TddfaV2.Settings(weights=weights))
    seen: list[Float] = []
    run = model._model.run

    def spy(**inputs: np.ndarray) -> dict[str, np.ndarray]:
        seen.append(run(**inputs)["param"][0])
        return {"param": np.array([parameters(np.eye(3))])}

    monkeypatch.setattr(model._model, "run", spy)
    image = np.zeros((200, 300, 3), np.uint8)
    # face 40 x 60: the crop's side is 79, its centre 7 px below the face's
    top, left = 107 - 39, 150 - 39
    image[top : top + 79, left : left + 79] = [255, 127, 0]
    head = Head(box_px=square_box((150, 100), 80), score=1.0, face_box_px=np.array([129.5, 69.5, 169.5, 129.5]))
    assert model.estimate(frame_of(image), head) is not None
    np.testing.assert_allclose(seen[0], (np.array([0, 127, 255]) - 127.5) / 128, atol=0.05)


def test_a_head_without_a_face_has_no_pose(tmp_path: Path) -> None:
    assert constant_network(tmp_path, np.eye(3)).estimate(BLACK, head_at(100, 100, face=False)) is None


def test_an_export_with_a_normalised_output_is_refused(tmp_path: Path) -> None:
    weights = graphs.constant(tmp_path / "normalised.onnx", INPUT, {"output": [parameters(np.eye(3))]})
    with pytest.raises(VfoaError, match=r"outputs.*\[1, any\].*\[1, 62\]"):
        TddfaV2(TddfaV2.Settings(weights=weights)).estimate(BLACK, head_at(100, 100))


# The real network on real faces


@pytest.fixture(scope="module")
def real(shared_models: Path) -> TddfaV2:
    weights = shared_models / "3ddfa_v2" / "mb05_120x120.onnx"
    if not weights.is_file():
        pytest.skip(f"needs 3DDFA_V2: no file {weights}")
    model: TddfaV2 = pickle.loads(pickle.dumps(TddfaV2(TddfaV2.Settings(weights=str(weights)))))
    return model


@pytest.fixture(scope="module")
def yunet(shared_models: Path) -> YuNet:
    return YuNet(YuNet.Settings(weights=str(shared_models / "yunet_n_dynamic.onnx")))


@pytest.mark.parametrize("factor", [0.75, 1.25, 1.5])
def test_pixels_that_are_not_square_give_the_same_pose(
    shared_data: Path, real: TddfaV2, yunet: YuNet, factor: float
) -> None:
    frame = bandage_frame(shared_data, 1)
    (head,) = yunet.faces(frame)
    rows = round(factor * frame.rig.height_px)
    pose = real.estimate(frame, head)
    other = real.estimate(stretched(frame, rows), stretched_head(head, rows / frame.rig.height_px))
    assert pose is not None
    assert other is not None
    assert np.degrees(angle_between(pose.direction, other.direction)) < 1


def both_ways(model: TddfaV2, frame: StereoFrame, head: Head) -> tuple[HeadPose, float]:
    """The pose, and the angle in degrees to the mirrored pose of the mirrored frame."""
    pose, other = model.estimate(frame, head), model.estimate(mirrored(frame), mirrored_head(head, frame.rig.width_px))
    assert pose is not None
    assert other is not None
    return pose, float(np.degrees(angle_between(other.direction, mirrored_direction(pose.direction))))


def test_labelled_faces_up_to_a_turn_of_72_degrees(real: TddfaV2, yunet: YuNet, shared_data: Path) -> None:
    labels = shared_data / "faces" / "pose.json"
    if not labels.is_file():
        pytest.skip(f"needs labelled faces: no file {labels}")
    errors, mirror_errors = [], []
    for name, angles in json.loads(labels.read_text()).items():
        frame = frame_of(read_rgb(labels.parent / f"{name}.jpg"))
        head = max(yunet.faces(frame), key=lambda each: float(np.ptp(each.box_px[[0, 2]])))
        pose, mirror_error = both_ways(real, frame, head)
        yaw, pitch, roll = np.radians([angles[f"{angle}_deg"] for angle in ("yaw", "pitch", "roll")])
        seen = head_direction_crop(pose.yaw_rad, pose.pitch_rad)
        errors.append(np.degrees(angle_between(seen, head_direction_crop(yaw, pitch))))
        mirror_errors.append(mirror_error)
        assert np.degrees(pose.roll_rad) == pytest.approx(np.degrees(roll), abs=5)
    assert len(errors) == 8
    assert np.mean(errors) < 6
    assert max(errors) < 12
    assert np.median(mirror_errors) < 4
    assert max(mirror_errors) < 9


def beside_the_axis(photograph: Image, angle_rad: float) -> tuple[StereoFrame, Float]:
    """A photograph as a camera takes it that is turned away by an angle, and the rotation (3, 3) of directions to it.

    The photograph is taken for one by a camera with a long focal length; the image is cut so that it holds the face.
    """
    import cv2

    seen = frame_of(photograph, fx_px=1500)
    turned = Rotation.from_rotvec([0, angle_rad, 0]).as_matrix()
    fx, cx = 1500 * np.cos(angle_rad), seen.rig.cx_px - 1500 * np.sin(angle_rad)
    rig = replace(seen.rig, fx_px=fx, fy_px=fx, cx_px=cx, cx_right_px=cx)
    seen_from_turned = seen.rig.camera_matrix @ turned.T @ np.linalg.inv(rig.camera_matrix)
    size = photograph.shape[1::-1]
    image = cv2.warpPerspective(photograph, seen_from_turned, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    return replace(seen, left=image, right=image, rig=rig), turned


def test_a_face_far_beside_the_cameras_axis_has_the_pose_that_it_has_on_it(
    real: TddfaV2, yunet: YuNet, shared_data: Path
) -> None:
    """In a crop straight out of the image it is 4.5 degrees off on average."""
    photographs = sorted((shared_data / "faces").glob("*.jpg"))
    if not photographs:
        pytest.skip(f"needs photographs of faces in {shared_data / 'faces'}")
    errors = []
    for photograph in photographs:
        poses = []
        for angle in np.radians([0, -40, 40]):
            frame, turned = beside_the_axis(read_rgb(photograph), angle)
            head = max(yunet.faces(frame), key=lambda each: float(np.ptp(each.box_px[[0, 2]])))
            pose = real.estimate(frame, head)
            assert pose is not None
            poses.append(turned.T @ pose.direction)
        errors += [np.degrees(angle_between(poses[0], pose)) for pose in poses[1:]]
    assert np.mean(errors) < 3


def test_a_face_near_its_profile_is_read_as_one(real: TddfaV2, yunet: YuNet, shared_data: Path) -> None:
    for side in ("left", "right"):
        frame = frame_of(read_rgb(shared_data / "chessboard" / f"{side}06.jpg"))
        pose, mirror_error = both_ways(real, frame, yunet.faces(frame)[0])
        turned = np.degrees(angle_between(head_direction_crop(pose.yaw_rad, pose.pitch_rad), (0, 0, -1)))
        assert 70 < turned < 110
        assert pose.direction[0] < -0.8  # to the image's left
        assert mirror_error < 5


def test_mirrored_frames_give_mirrored_directions(real: TddfaV2, yunet: YuNet, shared_data: Path) -> None:
    errors = []
    for number in range(1, 51, 5):
        frame = bandage_frame(shared_data, number)
        pose, mirror_error = both_ways(real, frame, yunet.faces(frame)[0])
        assert pose.yaw_rad > 0  # the girl looks to the image's left
        errors.append(mirror_error)
    assert np.median(errors) < 4
    assert max(errors) < 8
