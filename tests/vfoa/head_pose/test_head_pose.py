from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from scripts.measure.mirror import bandage_frame, frame_of, mirrored, mirrored_direction, mirrored_head
from tests import graphs
from tests.scenes import square_box
from vfoa.geometry import angle_between, direction_from_crop, head_direction_crop, pixel_ray
from vfoa.head_pose.fsanet import FsaNet
from vfoa.heads.yunet import YuNet
from vfoa.types import Head, Instances

INPUT = {"input": (1, 3, 64, 64)}


def constant_fsanet(folder: Path, *angles_deg: tuple[float, float, float], **settings: object) -> FsaNet:
    """An FSA-Net of one network per triple, which always answers it."""
    weights = [
        graphs.constant(folder / f"fsanet-{n}.onnx", INPUT, {"output": [angles]}) for n, angles in enumerate(angles_deg)
    ]
    return FsaNet(FsaNet.Settings.model_validate({"weights": weights, **settings}))


def head_at(u: float, v: float, *, face: bool = True) -> Head:
    box = square_box((u, v), 40)
    return Head(box_px=square_box((u, v), 60), score=1.0, face_box_px=box if face else None)


BLACK = frame_of(np.zeros((200, 300, 3), np.uint8))


def test_is_the_mean_of_its_networks(tmp_path: Path) -> None:
    model = constant_fsanet(tmp_path, (10, -4, 2), (20, 8, 6))
    pose = model.estimate(BLACK, head_at(149.5, 99.5))
    assert pose is not None
    np.testing.assert_allclose(np.degrees([pose.yaw_rad, pose.pitch_rad, pose.roll_rad]), [15, 2, 4], atol=1e-5)


def test_one_network_is_enough_by_configuration(tmp_path: Path) -> None:
    pose = constant_fsanet(tmp_path, (10, -4, 2)).estimate(BLACK, head_at(149.5, 99.5))
    assert pose is not None
    assert np.degrees(pose.yaw_rad) == pytest.approx(10, abs=1e-5)


@pytest.mark.parametrize(
    ("angles_deg", "expected"),
    [
        ((0, 0, 0), (0, 0, -1)),
        ((30, 0, 0), (-0.5, 0, -np.sqrt(0.75))),  # to the image's left
        ((0, 30, 0), (0, -0.5, -np.sqrt(0.75))),  # up
        ((0, 0, 40), (0, 0, -1)),  # a roll turns the head about its own direction
    ],
)
def test_signs_on_the_optical_axis(
    tmp_path: Path, angles_deg: tuple[float, float, float], expected: tuple[float, float, float]
) -> None:
    pose = constant_fsanet(tmp_path, angles_deg).estimate(BLACK, head_at(149.5, 99.5))
    assert pose is not None
    np.testing.assert_allclose(pose.direction, expected, atol=1e-6)


def test_a_frontal_face_looks_into_the_camera_from_anywhere(tmp_path: Path) -> None:
    model = constant_fsanet(tmp_path, (0, 0, 0))
    for u, v in ((30, 30), (270, 40), (150, 170)):
        pose = model.estimate(BLACK, head_at(u, v))
        assert pose is not None
        np.testing.assert_allclose(pose.direction, -pixel_ray(u, v, BLACK.rig), atol=1e-3)


def test_the_direction_turns_with_the_ray_of_the_head(tmp_path: Path) -> None:
    pose = constant_fsanet(tmp_path, (25, -10, 5)).estimate(BLACK, head_at(30, 160))
    assert pose is not None
    expected = direction_from_crop(head_direction_crop(np.radians(25), np.radians(-10)), pixel_ray(30, 160, BLACK.rig))
    np.testing.assert_allclose(pose.direction, expected, atol=1e-3)


def test_feeds_blue_green_red_about_zero(tmp_path: Path) -> None:
    weights = graphs.mean_color(tmp_path / "fsanet.onnx", "input", (1, 3, 64, 64), "output", 10.0)
    image = np.empty((100, 100, 3), np.uint8)
    image[...] = [255, 127, 0]
    pose = FsaNet(FsaNet.Settings(weights=(weights,))).estimate(frame_of(image), head_at(50, 50))
    assert pose is not None
    expected = 10 * (np.array([0, 127, 255]) - 127.5) / 128
    np.testing.assert_allclose(np.degrees([pose.yaw_rad, pose.pitch_rad, pose.roll_rad]), expected, atol=1e-4)


def test_a_head_without_a_face_has_no_pose(tmp_path: Path) -> None:
    head = head_at(100, 100, face=False)
    assert constant_fsanet(tmp_path, (1, 2, 3)).estimate(BLACK, head) is None


def test_mirrored_frames_give_mirrored_directions(shared_data: Path, shared_models: Path) -> None:
    weights = tuple(str(shared_models / f"fsanet-{kind}-iter-688590.onnx") for kind in ("1x1", "var"))
    model = pickle.loads(pickle.dumps(FsaNet(FsaNet.Settings(weights=weights))))
    detector = YuNet(YuNet.Settings(weights=str(shared_models / "yunet_n_640_640.onnx")))
    errors = []
    for number in range(1, 51, 5):
        frame = bandage_frame(shared_data, number)
        (head,) = detector.detect(frame, Instances(ids=np.zeros(frame.left.shape[:2], np.uint16), instances=()))
        pose = model.estimate(frame, head)
        seen = model.estimate(mirrored(frame), mirrored_head(head, frame.rig.width_px))
        assert pose.yaw_rad > 0 > seen.yaw_rad  # the girl looks to the image's left
        errors.append(np.degrees(angle_between(seen.direction, mirrored_direction(pose.direction))))
    assert np.median(errors) < 5
    assert np.max(errors) < 10
