from __future__ import annotations

import pickle
from pathlib import Path
from statistics import NormalDist

import numpy as np
import pytest

from scripts.measure.mirror import frame_of
from tests import graphs
from vfoa.errors import VfoaError
from vfoa.gaze import MODELS, TemporalGazeModel
from vfoa.gaze.gaze360 import Gaze360
from vfoa.geometry import pixel_ray
from vfoa.types import Head

FRAME = frame_of(np.zeros((200, 300, 3), np.uint8))
INPUT = {"images": ("batch", 7, 3, 224, 224)}
BLACK = np.zeros((224, 224, 3), np.uint8)


def constant_gaze(folder: Path, theta_rad: float, phi_rad: float, sigma_rad: float = 0.2) -> Gaze360:
    outputs = {"gaze": [[theta_rad, phi_rad]], "sigma": [[sigma_rad]]}
    return Gaze360(Gaze360.Settings(weights=graphs.constant(folder / "gaze.onnx", INPUT, outputs)))


def head_at(u: float, v: float) -> Head:
    return Head(box_px=np.array([u - 20.0, v - 30.0, u + 20.0, v + 30.0]), score=1.0)


def test_is_used_by_name_and_is_temporal() -> None:
    assert MODELS.load("gaze360") is Gaze360
    assert issubclass(Gaze360, TemporalGazeModel)
    assert not issubclass(MODELS.load("l2cs"), TemporalGazeModel)


@pytest.mark.parametrize(
    ("theta_deg", "phi_deg", "expected"),
    [
        (0, 0, (0, 0, -1)),
        (30, 0, (-0.5, 0, -np.sqrt(0.75))),  # to the image's left
        (0, 30, (0, -0.5, -np.sqrt(0.75))),  # up
        (180, 0, (0, 0, 1)),  # seen from behind
        (90, 60, (-0.5, -np.sqrt(0.75), 0)),
    ],
)
def test_known_angles_are_a_known_direction(
    tmp_path: Path, theta_deg: float, phi_deg: float, expected: tuple[float, float, float]
) -> None:
    model = constant_gaze(tmp_path, np.radians(theta_deg), np.radians(phi_deg))
    gaze = model.estimate_sequence([BLACK] * 7, head_at(149.5, 99.5), FRAME.rig)
    np.testing.assert_allclose(gaze.direction, expected, atol=1e-6)


def test_a_gaze_straight_ahead_meets_the_camera_from_anywhere(tmp_path: Path) -> None:
    model = pickle.loads(pickle.dumps(constant_gaze(tmp_path, 0, 0)))
    for u, v in ((20, 30), (280, 60), (150, 180)):
        gaze = model.estimate_sequence([BLACK] * 7, head_at(u, v), FRAME.rig)
        np.testing.assert_allclose(gaze.direction, -pixel_ray(u, v, FRAME.rig), atol=1e-3)


def test_sigma_is_one_standard_deviation_of_the_error_whose_quantiles_were_trained(tmp_path: Path) -> None:
    gaze = constant_gaze(tmp_path, 0, 0, sigma_rad=0.2).estimate_sequence([BLACK] * 7, head_at(150, 100), FRAME.rig)
    assert gaze.sigma_rad is not None
    assert NormalDist(0, gaze.sigma_rad).cdf(0.2) == pytest.approx(0.9)


def test_the_network_sees_seven_crops_in_the_order_of_time(tmp_path: Path) -> None:
    model = Gaze360(Gaze360.Settings(weights=graphs.seven_levels(tmp_path / "levels.onnx")))
    crops = [np.full((224, 224, 3), (level, 77, 200), np.uint8) for level in (3, 1, 4, 15, 9, 2, 6)]
    gaze = model.estimate_sequence(crops, head_at(149.5, 99.5), FRAME.rig)
    x, y, z = gaze.direction
    assert np.arctan2(-x, -z) * 16**4 == pytest.approx(0x314F, abs=0.01)
    assert np.arcsin(-y) * 16**4 == pytest.approx(0x926, abs=0.01)


def test_the_crop_is_the_heads_box_with_15_percent_on_each_side(tmp_path: Path) -> None:
    """A head of 40 x 60 pixels gives a crop of 52 x 78, stretched to a square."""
    image = np.zeros((200, 300, 3), np.uint8)
    image[61:139, 124:176] = (0, 255, 0)
    for row in (61, 136):
        for column in (124, 173):
            image[row : row + 3, column : column + 3] = (255, 0, 0)
    seen = constant_gaze(tmp_path, 0, 0).crop(frame_of(image), head_at(149.5, 99.5))
    assert seen.shape == (224, 224, 3)
    assert (seen[20:-20, 20:-20] == (0, 255, 0)).all()
    corners = seen[[5, 5, -6, -6], [5, -6, 5, -6]]
    assert (corners == (255, 0, 0)).all()


@pytest.mark.parametrize(("rate_hz", "stride"), [(5, 1), (8, 1), (15.9, 1), (16, 2), (24, 3), (30, 3), (60, 7)])
def test_crops_are_an_eighth_of_a_second_apart(tmp_path: Path, rate_hz: float, stride: int) -> None:
    assert constant_gaze(tmp_path, 0, 0).stride(rate_hz) == stride


def test_a_stride_that_is_set_is_taken_and_one_that_nobody_knows_is_refused(tmp_path: Path) -> None:
    model = constant_gaze(tmp_path, 0, 0)
    with pytest.raises(VfoaError, match=r"^gaze\.stride: missing; expected"):
        model.stride(None)
    chosen = Gaze360(Gaze360.Settings(weights=str(tmp_path / "gaze.onnx"), stride=5))
    assert (chosen.stride(None), chosen.stride(30)) == (5, 5)


def test_another_models_graph_is_refused(tmp_path: Path) -> None:
    weights = graphs.mean_color(tmp_path / "other.onnx", "images", (1, 3, 224, 224), "gaze", 1.0)
    model = Gaze360(Gaze360.Settings(weights=weights))
    with pytest.raises(VfoaError, match=r"inputs.*\[any, 7, 3, 224, 224\]"):
        model.estimate_sequence([BLACK] * 7, head_at(150, 100), FRAME.rig)
