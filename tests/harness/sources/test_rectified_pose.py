"""Rectification from the pose between two lenses: rows match, and depths come back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.sources.calibration_files.read import read_cameras
from harness.sources.rectification import RawCamera, Rectifier, rectify_pose
from tests import calibrations
from tests.calibration_formats import FISHEYE, assert_rows_match_and_depths_come_back, points_ahead, size_px
from tests.calibrations import RIG, SIZE, Rig
from tests.disk import write_text
from vfoa.errors import VfoaError


@pytest.mark.parametrize("rig", [RIG, FISHEYE], ids=["plumb bob", "fisheye"])
def test_a_rectified_pair_shows_only_what_both_cameras_saw(rig: Rig) -> None:
    """A white world leaves no black border."""
    bent = tuple(np.array([-0.15, 0.02, 0, 0]) for _ in range(2))
    lenses = (RawCamera(size_px=SIZE, k=k, d=d, model=rig.model) for k, d in zip(rig.k, bent, strict=True))  # type: ignore[arg-type]
    cameras = rectify_pose(*lenses, rig.rotation, rig.translation_m, "rig")
    white = np.full((SIZE[1], SIZE[0], 3), 255, np.uint8)
    for view in Rectifier(cameras).rectify(white, white):
        assert (view[2:-2, 2:-2] == 255).mean() > 0.995


@pytest.mark.parametrize("turned_deg", [(0, 0, 0), (0.3, 0.2, -0.1), (1, 2, 1), (4, 8, -5)])
@pytest.mark.parametrize("translation_m", [(-0.064, 0, 0), (-0.2, 0.02, 0.03)])
def test_the_view_of_wide_fisheye_lenses_is_about_the_axis(
    turned_deg: tuple[float, ...], translation_m: tuple[float, ...]
) -> None:
    """Lenses of 80 degrees and more to each side, as of a RealSense T265, where OpenCV's view is beside the images."""
    k = tuple(calibrations.matrix(fx, fx, *middle) for fx, middle in ((428, (631, 365.0)), (427, (645, 355.0))))
    d = tuple(np.array([k1, 0.0387, -0.0365, 0.0059]) for k1 in (-0.0049, -0.0035))
    turn = np.radians(turned_deg)
    rig = Rig(k=k, d=d, rotation_vector=turn, translation_m=np.array(translation_m), model="equidistant")  # type: ignore[arg-type]
    lenses = (RawCamera(size_px=SIZE, k=k, d=d, model="equidistant") for k, d in zip(rig.k, rig.d, strict=True))
    cameras = rectify_pose(*lenses, rig.rotation, rig.translation_m, "rig")
    found = cameras.rectified()
    assert (found.cx_px, found.cy_px, found.cx_right_px) == ((SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2, (SIZE[0] - 1) / 2)
    assert found.baseline_m == pytest.approx(np.linalg.norm(translation_m))
    assert 0.5 * 428 < found.fx_px < 428
    assert_rows_match_and_depths_come_back(cameras, rig, points_ahead(0) @ cameras.left.r)
    white = np.full((SIZE[1], SIZE[0], 3), 255, np.uint8)
    for view in Rectifier(cameras).rectify(white, white):
        assert (view[2:-2, 2:-2] == 255).mean() > 0.9  # corners lie beyond the middles of the edges


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"left": RawCamera(size_px=SIZE, k=np.zeros((3, 3)), d=RIG.d[0])}, "left: K: found focal lengths"),
        ({"right": RawCamera(size_px=SIZE, k=np.eye(2), d=RIG.d[0])}, "right: K: found shape"),
        ({"right": RawCamera(size_px=SIZE, k=RIG.k[1], d=np.zeros(3))}, "right: D: found 3 "),
        (
            {"right": RawCamera(size_px=SIZE, k=RIG.k[1], d=RIG.d[1], model="equidistant")},
            "left is plumb_bob, right equidistant",
        ),
        ({"rotation": np.ones((3, 3))}, "R: not a rotation"),
        ({"translation": np.zeros(3)}, r"T: found \[0.0, 0.0, 0.0\]"),
        ({"translation": np.array([-0.1, np.nan, 0])}, r"T: found .*nan"),
        ({"translation": np.array([-0.1, 0])}, r"T: found .* three"),
        ({"translation": np.array([0.01, -0.1, 0])}, r"T: .* above each other"),
        ({"translation": np.array([0.01, 0.1, 0])}, r"T: .* above each other"),
        ({"translation": np.array([0.1, 0.01, 0])}, "expected a positive one"),
        ({"translation": np.array([-0.1, 0.02, 0.15])}, r"T: .* one behind the other.*failed"),  # of few boards
    ],
)
def test_cameras_that_are_no_pair_side_by_side_are_refused(changes: dict[str, Any], message: str) -> None:
    left, right = (RawCamera(size_px=SIZE, k=k, d=d) for k, d in zip(RIG.k, RIG.d, strict=True))
    given = {"left": left, "right": right, "rotation": np.eye(3), "translation": RIG.translation_m, **changes}
    with pytest.raises(VfoaError, match=message):
        rectify_pose(**given, where="rig")


@pytest.mark.parametrize("along_m", [-0.01, 0.01])
def test_fisheye_lenses_above_each_other_are_refused(along_m: float) -> None:
    """OpenCV would turn their images by a quarter."""
    left, right = (RawCamera(size_px=SIZE, k=k, d=d, model="equidistant") for k, d in zip(RIG.k, RIG.d, strict=True))
    with pytest.raises(VfoaError, match=r"T: .* above each other"):
        rectify_pose(left, right, np.eye(3), np.array([along_m, -0.1, 0]), "rig")


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("c.yml", lambda path, rig: calibrations.write_opencv(path, calibrations.opencv_nodes(rig))),
        ("c.json", calibrations.write_matlab),
        ("c.json", calibrations.write_matlab_for_opencv),
        ("Calib_Results_stereo.mat", calibrations.write_toolbox),
        ("K.txt", lambda path, rig: write_text(path, " ".join(map(str, rig.k[1].ravel())) + "\n0.12\n")),
    ],
)
def test_oblique_axes_are_refused_because_opencv_ignores_them(
    tmp_path: Path, name: str, write: Callable[[Path, calibrations.Rig], Path]
) -> None:
    skew = np.array([[0.0, 8, 0], [0, 0, 0], [0, 0, 0]])
    path = write(tmp_path / name, replace(RIG, k=(RIG.k[0], RIG.k[1] + skew)))
    with pytest.raises(VfoaError, match=rf"{name}.*skew of 8 px"):
        read_cameras([path], size_px)


small = st.floats(-0.03, 0.03)


@given(
    rotation=st.tuples(small, small, small),
    shift=st.tuples(st.floats(-0.6, -0.05), small.map(lambda x: x / 3), small.map(lambda x: x / 3)),
    radial=st.tuples(st.floats(-0.2, 0.05), st.floats(-0.02, 0.05)),
    focal=st.floats(600, 900),
    seed=st.integers(0, 1000),
    is_fisheye=st.booleans(),
)
def test_any_rig_is_rectified(
    rotation: tuple[float, ...],
    shift: tuple[float, ...],
    radial: tuple[float, float],
    focal: float,
    seed: int,
    is_fisheye: bool,
) -> None:
    model: Any = "equidistant" if is_fisheye else "plumb_bob"
    k = calibrations.matrix(focal, focal * 1.01, 650, 350), calibrations.matrix(focal * 0.99, focal, 630, 365)
    d = np.array([*radial, 0.0003, -0.0002]), np.array([radial[0] * 0.9, radial[1], -0.0004, 0.0001])
    rig = Rig(k=k, d=d, rotation_vector=np.array(rotation), translation_m=np.array(shift), model=model)
    lenses = (RawCamera(size_px=SIZE, k=k_, d=d_, model=model) for k_, d_ in zip(k, d, strict=True))
    cameras = rectify_pose(*lenses, rig.rotation, rig.translation_m, "rig")
    assert_rows_match_and_depths_come_back(cameras, rig, points_ahead(seed))
