from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from onnx import helper
from scipy.spatial.transform import Rotation

from scripts.measure.mirror import frame_of
from tests import graphs
from tests.scenes import square_box
from vfoa.errors import VfoaError
from vfoa.geometry import left_from_crop, pixel_ray
from vfoa.head_pose import MODELS
from vfoa.head_pose.sixdrepnet import SixDRepNet, angles_of
from vfoa.types import Float, Head

INPUT = {"input": ("batch", 3, 224, 224)}
BLACK = frame_of(np.zeros((200, 300, 3), np.uint8))


def head_at(u: float, v: float) -> Head:
    return Head(box_px=square_box((u, v), 60), score=1.0, face_box_px=square_box((u, v), 40))


def rotation(yaw: float, pitch: float, roll: float) -> Float:
    """The matrix of the authors' ``get_rotation_matrix``: about the x axis first, then y, then z."""
    return Rotation.from_euler("xyz", [pitch, yaw, roll]).as_matrix()


def constant_network(folder: Path, matrix: Float) -> SixDRepNet:
    weights = graphs.constant(folder / "constant.onnx", INPUT, {"any_name": matrix[None]})
    return SixDRepNet(SixDRepNet.Settings(weights=weights))


def test_is_used_by_name() -> None:
    assert MODELS.load("6drepnet") is SixDRepNet


@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(-3, 3))
def test_the_angles_are_those_that_the_matrix_was_made_of(yaw: float, pitch: float, roll: float) -> None:
    np.testing.assert_allclose(angles_of(rotation(yaw, pitch, roll)), (yaw, pitch, roll), atol=1e-7)


def test_at_the_profile_the_yaw_is_kept() -> None:
    yaw, pitch, roll = angles_of(rotation(np.pi / 2, 0.2, 0.0))
    assert (yaw, pitch, roll) == pytest.approx((np.pi / 2, 0.2, 0), abs=1e-6)


@pytest.mark.parametrize(
    ("angles_deg", "direction"),
    [
        ((0, 0, 0), (0, 0, -1)),
        ((30, 0, 0), (-0.5, 0, -np.sqrt(0.75))),  # to the image's left
        ((0, 30, 0), (0, -0.5, -np.sqrt(0.75))),  # up
        ((0, 0, 30), (0, 0, -1)),
        ((30, 0, 40), (-0.5, 0, -np.sqrt(0.75))),  # the roll is about the head's own direction
    ],
)
@pytest.mark.parametrize(("u", "v"), [(149.5, 99.5), (20, 30)])
def test_known_angles_are_a_known_direction_wherever_the_head_is(
    tmp_path: Path, angles_deg: tuple[float, float, float], direction: tuple[float, float, float], u: float, v: float
) -> None:
    model = pickle.loads(pickle.dumps(constant_network(tmp_path, rotation(*np.radians(angles_deg)))))
    pose = model.estimate(BLACK, head_at(u, v))
    assert pose is not None
    np.testing.assert_allclose(pose.direction @ left_from_crop(pixel_ray(u, v, BLACK.rig)), direction, atol=1e-3)
    found = np.degrees([pose.yaw_rad, pose.pitch_rad, pose.roll_rad])
    np.testing.assert_allclose(found, angles_deg, atol=1e-4)


def test_the_input_is_the_face_in_rgb_by_imagenets_statistics(tmp_path: Path) -> None:
    """The graph's matrix is [[1, 0, 0], [red, 1, 0], [-blue, 0, 1]]: its roll has the mean red of the input."""
    cells = ("one", "zero", "zero", "red", "one", "zero", "minus_blue", "zero", "one")
    nodes = [
        helper.make_node("GlobalAveragePool", ["input"], ["pooled"]),
        helper.make_node("Flatten", ["pooled"], ["flat"]),
        helper.make_node("Split", ["flat"], ["red", "green", "blue"], axis=1),
        helper.make_node("Neg", ["blue"], ["minus_blue"]),
        graphs.constant_node("one", np.ones((1, 1), np.float32)),
        graphs.constant_node("zero", np.zeros((1, 1), np.float32)),
        helper.make_node("Concat", cells, ["row"], axis=1),
        graphs.constant_node("shape", np.array([1, 3, 3])),
        helper.make_node("Reshape", ["row", "shape"], ["matrix"]),
    ]
    weights = graphs.write(tmp_path / "colour.onnx", nodes, INPUT, {"matrix": (1, 3, 3)})
    image = np.zeros((200, 300, 3), np.uint8)
    image[60:140, 110:190] = [182, 0, 75]  # red 1 deviation above its mean, blue half a deviation below
    pose = SixDRepNet(SixDRepNet.Settings(weights=weights)).estimate(frame_of(image), head_at(149.5, 99.5))
    assert pose is not None
    red, blue = (182 - 123.675) / 58.395, (75 - 103.53) / 57.375
    assert pose.roll_rad == pytest.approx(np.arctan2(red, 1), abs=1e-3)
    assert pose.yaw_rad == pytest.approx(np.arctan2(blue, np.hypot(1, red)), abs=1e-3)


def test_a_head_without_a_face_has_no_pose(tmp_path: Path) -> None:
    head = Head(box_px=square_box((100, 100), 60), score=1.0)
    assert constant_network(tmp_path, np.eye(3)).estimate(BLACK, head) is None


def test_a_graph_that_gives_six_numbers_is_refused(tmp_path: Path) -> None:
    weights = graphs.constant(tmp_path / "six.onnx", INPUT, {"ortho6d": np.zeros((1, 6))})
    with pytest.raises(VfoaError, match=r"six\.onnx: .*\[1, 3, 3\].*\[1, 6\]"):
        SixDRepNet(SixDRepNet.Settings(weights=weights)).estimate(BLACK, head_at(149.5, 99.5))
