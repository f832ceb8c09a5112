from __future__ import annotations

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from onnx import helper

from scripts.measure.mirror import frame_of, mirrored, mirrored_direction, mirrored_head, read_rgb
from tests import graphs
from vfoa.gaze import MODELS
from vfoa.gaze.l2cs import L2cs
from vfoa.geometry import angle_between, direction_from_crop, pixel_ray
from vfoa.head_pose.tddfa_v2 import TddfaV2
from vfoa.heads.yunet import YuNet
from vfoa.types import Float, Gaze, Head, HeadPose, NoGaze

FRAME = frame_of(np.zeros((200, 300, 3), np.uint8))
INPUT = {"input": ("batch", 3, 448, 448)}


def bin_logits(angle_deg: float) -> np.ndarray:
    """Logits [1, 90] of a distribution over the two bins about an angle, whose mean it is. Bin i is at 4 i - 180."""
    place = (angle_deg + 180) / 4
    below = int(place)
    probabilities = np.full(90, 1e-12)
    probabilities[below], probabilities[below + 1] = 1 - (place - below) + 1e-12, place - below + 1e-12
    return np.log(probabilities)[None]


def constant_gaze(
    folder: Path,
    horizontal_deg: float,
    vertical_deg: float,
    names: tuple[str, str],
    *,
    averaged: bool = False,
    **settings: float,
) -> L2cs:
    outputs = dict(zip(names, (bin_logits(horizontal_deg), bin_logits(vertical_deg)), strict=True))
    weights = graphs.constant(folder / "gaze.onnx", INPUT, outputs)
    return L2cs(L2cs.Settings.model_validate({"weights": weights, "mirrored": averaged, **settings}))


def head_at(u: float, v: float) -> Head:
    box = np.array([u - 20.0, v - 30.0, u + 20.0, v + 30.0])
    return Head(box_px=box, score=1.0, face_box_px=box)


def direction(model: L2cs, u: float = 149.5, v: float = 99.5) -> Float:
    gaze = model.estimate(FRAME, head_at(u, v), None)
    assert isinstance(gaze, Gaze)
    return gaze.direction


def head_turned(turned_deg: float, u: float, v: float) -> HeadPose:
    """A head on the ray of this pixel, turned from the camera to the image's left."""
    turned = np.radians(turned_deg)
    ray = pixel_ray(u, v, FRAME.rig)
    return HeadPose(direction=direction_from_crop([-np.sin(turned), 0, -np.cos(turned)], ray))


def test_is_used_by_name() -> None:
    assert MODELS.load("l2cs") is L2cs


@pytest.mark.parametrize(
    ("horizontal_deg", "vertical_deg", "expected"),
    [
        (0, 0, (0, 0, -1)),
        (30, 0, (-0.5, 0, -np.sqrt(0.75))),  # to the image's left
        (0, 30, (0, -0.5, -np.sqrt(0.75))),  # up
        (-17, 0, (np.sin(np.radians(17)), 0, -np.cos(np.radians(17)))),  # between two bins
        (90, 60, (-0.5, -np.sqrt(0.75), 0)),
    ],
)
@pytest.mark.parametrize("names", [("yaw", "pitch"), ("pitch", "yaw"), ("495", "496")])
def test_known_bins_are_a_known_direction_whatever_the_outputs_are_called(
    tmp_path: Path,
    horizontal_deg: float,
    vertical_deg: float,
    expected: tuple[float, float, float],
    names: tuple[str, str],
) -> None:
    found = direction(constant_gaze(tmp_path, horizontal_deg, vertical_deg, names))
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_a_network_that_sees_the_same_in_both_images_looks_to_neither_side(tmp_path: Path) -> None:
    found = direction(constant_gaze(tmp_path, 30, 20, ("yaw", "pitch"), averaged=True))
    np.testing.assert_allclose(found, (0, -np.sin(np.radians(20)), -np.cos(np.radians(20))), atol=1e-6)


def test_a_gaze_straight_ahead_meets_the_camera_from_anywhere(tmp_path: Path) -> None:
    model = pickle.loads(pickle.dumps(constant_gaze(tmp_path, 0, 0, ("pitch", "yaw"))))
    for u, v in ((20, 30), (280, 60), (150, 180)):
        np.testing.assert_allclose(direction(model, u, v), -pixel_ray(u, v, FRAME.rig), atol=1e-3)


def test_a_head_without_a_face_has_no_gaze(tmp_path: Path) -> None:
    head = Head(box_px=np.array([10.0, 10, 50, 60]), score=1.0)
    assert constant_gaze(tmp_path, 0, 0, ("pitch", "yaw")).estimate(FRAME, head, None) is None


@pytest.mark.parametrize(("u", "v"), [(149.5, 99.5), (20.0, 30.0)])
@pytest.mark.parametrize(
    ("settings", "turned_deg", "seen"),
    [({}, 59, True), ({}, 61, False), ({"most_turned_deg": 40}, 41, False), ({"most_turned_deg": 180}, 179, True)],
)
def test_a_head_turned_too_far_has_no_gaze(
    tmp_path: Path, settings: dict[str, float], turned_deg: float, seen: bool, u: float, v: float
) -> None:
    model = constant_gaze(tmp_path, 20, 0, ("yaw", "pitch"), **settings)
    gaze = model.estimate(FRAME, head_at(u, v), head_turned(turned_deg, u, v))
    if seen:
        assert isinstance(gaze, Gaze)
    else:
        assert gaze == NoGaze(cause="face_turned_away")


def test_the_claimed_error_grows_with_the_turn_of_the_head_or_without_one_of_the_gaze(tmp_path: Path) -> None:
    model = constant_gaze(tmp_path, 40, 0, ("yaw", "pitch"))
    claims = []
    for head_pose in (head_turned(0, 149.5, 99.5), head_turned(50, 149.5, 99.5), None):
        gaze = model.estimate(FRAME, head_at(149.5, 99.5), head_pose)
        assert isinstance(gaze, Gaze)
        claims.append(gaze.sigma_rad)
    means = [np.radians(np.hypot(14, 0.3 * turned_deg)) for turned_deg in (0, 50, 40)]
    assert claims == pytest.approx(np.array(means) / np.sqrt(np.pi / 2), rel=1e-5)


@pytest.mark.parametrize(("u", "mean_deg"), [(149.5, 14.0), (19.0, np.hypot(14, 15)), (281.0, np.hypot(14, 15))])
def test_a_face_that_the_border_cuts_claims_a_larger_error(tmp_path: Path, u: float, mean_deg: float) -> None:
    gaze = constant_gaze(tmp_path, 0, 0, ("yaw", "pitch")).estimate(FRAME, head_at(u, 99.5), head_turned(0, u, 99.5))
    assert isinstance(gaze, Gaze)
    assert gaze.sigma_rad == pytest.approx(np.radians(mean_deg) / np.sqrt(np.pi / 2), rel=1e-5)


def test_the_input_is_the_face_in_rgb_by_imagenets_statistics(tmp_path: Path) -> None:
    """The graph's angles are those of the bins at which the mean red and the mean blue of the face point."""
    bins = np.arange(90, dtype=np.float32)[None]
    nodes = [helper.make_node("GlobalAveragePool", ["input"], ["pooled"])]
    for name, channel in (("horizontal", 0), ("vertical", 2)):
        # Bin 45 + 10 x: -|i - 45 - 10 x| as a logit, made steep.
        nodes += [
            graphs.constant_node(f"{name}_index", np.array([channel])),
            helper.make_node("Gather", ["pooled", f"{name}_index"], [f"{name}_x4"], axis=1),
            helper.make_node("Flatten", [f"{name}_x4"], [f"{name}_x"]),
            graphs.constant_node(f"{name}_ten", np.float32(10)),
            helper.make_node("Mul", [f"{name}_x", f"{name}_ten"], [f"{name}_shift"]),
            graphs.constant_node(f"{name}_bins", bins - 45),
            helper.make_node("Sub", [f"{name}_bins", f"{name}_shift"], [f"{name}_off"]),
            helper.make_node("Mul", [f"{name}_off", f"{name}_off"], [f"{name}_square"]),
            helper.make_node("Neg", [f"{name}_square"], [name]),
        ]
    weights = graphs.write(tmp_path / "face.onnx", nodes, INPUT, {"horizontal": (1, 90), "vertical": (1, 90)})
    image = np.zeros((200, 300, 3), np.uint8)
    image[60:140, 120:180] = [182, 0, 75]  # red 1 deviation above its mean, blue half a deviation below
    gaze = L2cs(L2cs.Settings(weights=weights, mirrored=False)).estimate(frame_of(image), head_at(149.5, 99.5), None)
    assert isinstance(gaze, Gaze)
    theta = np.degrees(np.arctan2(-gaze.direction[0], -gaze.direction[2]))
    phi = np.degrees(np.arcsin(-gaze.direction[1]))
    assert theta == pytest.approx(40 * (182 - 123.675) / 58.395, abs=0.5)
    assert phi == pytest.approx(40 * (75 - 103.53) / 57.375, abs=0.5)


# measured: 8.3 and .05; the network's own two answers differ
@pytest.mark.parametrize(("averaged", "most_deg"), [(False, 15), (True, 0.1)])
def test_mobilegaze_looks_where_real_heads_point_and_the_other_way_in_a_mirror(
    averaged: bool, most_deg: float, shared_models: Path, shared_data: Path
) -> None:
    weights = shared_models / "mobilegaze" / "mobileone_s0_gaze.onnx"
    photographs = sorted((shared_data / "faces").glob("*.jpg"))
    if not weights.is_file() or not photographs:
        pytest.skip(f"needs {weights} and photographs of faces in {shared_data / 'faces'}")
    poses = json.loads((shared_data / "faces" / "pose.json").read_text())
    yunet = YuNet(YuNet.Settings(weights=str(shared_models / "yunet_n_dynamic.onnx")))
    model = L2cs(L2cs.Settings(weights=str(weights), mirrored=averaged))
    from_head_deg, from_mirrored_deg = [], []
    for photograph in photographs:
        frame = frame_of(read_rgb(photograph))
        head = yunet.faces(frame)[0]
        gaze = model.estimate(frame, head, None)
        in_mirror = model.estimate(mirrored(frame), mirrored_head(head, frame.rig.width_px), None)
        assert isinstance(gaze, Gaze)
        assert isinstance(in_mirror, Gaze)
        yaw, pitch = (np.radians(poses[photograph.stem][f"{angle}_deg"]) for angle in ("yaw", "pitch"))
        head_direction = [-np.sin(yaw), -np.sin(pitch) * np.cos(yaw), -np.cos(pitch) * np.cos(yaw)]
        from_head_deg.append(np.degrees(angle_between(gaze.direction, head_direction)))
        from_mirrored_deg.append(np.degrees(angle_between(gaze.direction, mirrored_direction(in_mirror.direction))))
    assert np.median(from_head_deg) < 26  # measured: 22; with the two outputs exchanged, more than 40
    assert np.median(from_mirrored_deg) < most_deg
    assert averaged or np.median(from_mirrored_deg) > 5


def test_the_near_profile_man_of_the_chessboard_is_left_to_his_head(shared_models: Path, shared_data: Path) -> None:
    """Head models read him as turned by 82 degrees, MobileGaze's gaze by 39; he is at about 90."""
    weights = shared_models / "mobilegaze" / "mobileone_s0_gaze.onnx"
    head_weights = shared_models / "3ddfa_v2" / "mb05_120x120.onnx"
    photograph = shared_data / "chessboard" / "left06.jpg"
    if not all(path.is_file() for path in (weights, head_weights, photograph)):
        pytest.skip(f"needs {weights}, {head_weights} and {photograph}")
    frame = frame_of(read_rgb(photograph))
    (head,) = YuNet(YuNet.Settings(weights=str(shared_models / "yunet_n_dynamic.onnx"))).faces(frame)
    head_pose = TddfaV2(TddfaV2.Settings(weights=str(head_weights))).estimate(frame, head)
    model = L2cs(L2cs.Settings(weights=str(weights)))
    assert model.estimate(frame, head, head_pose) == NoGaze(cause="face_turned_away")
    gaze = model.estimate(frame, head, None)
    assert isinstance(gaze, Gaze)
    assert gaze.direction @ [0, 0, -1] > np.cos(np.radians(60))
