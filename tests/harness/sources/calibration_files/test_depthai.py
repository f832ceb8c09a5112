"""Calibrations of OAK cameras."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.sources.calibration_files.read import read_cameras
from harness.sources.rectification import RawCalibration
from tests.calibration_formats import FORMATS, read_raw, size_px
from tests.calibrations import RIG
from tests.disk import write_text
from vfoa.errors import VfoaError


def test_an_oak_whose_extrinsics_were_never_set_is_refused(tmp_path: Path) -> None:
    def unset(found: Any) -> None:
        for number in (1, 2):
            found["cameraData"][number][1]["extrinsics"].update(rotationMatrix=[[0] * 3] * 3, toCameraSocket=0)

    with pytest.raises(VfoaError, match=r"oak\.json: camera 2: extrinsics: found zeros"):
        read_cameras(_depthai(tmp_path, unset), size_px)


def test_an_oak_camera_s_pair_is_rectified_as_its_own_program_does(tmp_path: Path) -> None:
    """Numbers of a BW1098OBC (depthai-core, examples/calib_data_v53.json, July 2021), copied by hand."""
    left = [[858.9890747, 0, 646.7761230], [0, 859.7152710, 411.6924744], [0, 0, 1]]
    right = [[865.6600952, 0, 639.4890747], [0, 866.1361084, 409.4836121], [0, 0, 1]]
    d_left = [-4.8373399, 14.9179058, -0.0004877, -0.0001378, -15.1229658, -4.8896589, 15.1347094, -15.3369112]
    d_right = [28.8575439, -87.7545319, 0.0012091, 0.0011757, 380.5861206, 28.9347706, -90.3639221, 387.0883790]
    right_from_left = [
        [0.9999335408210754, -0.0020758542232215405, 0.011339202523231506],
        [0.0019991763401776552, 0.9999750852584839, 0.006769340950995684],
        [-0.011352972127497196, -0.006746221799403429, 0.9999127984046936],
    ]
    rectified_from_left = [
        [0.9995151162147522, 0.031031876802444458, 0.0025566520635038614],
        [-0.031040119007229805, 0.9995128512382507, 0.0032499704975634813],
        [-0.0024545539636164904, -0.003327753394842148, 0.9999914765357971],
    ]
    rectified_from_right = [
        [0.9994133114814758, 0.03304661810398102, -0.009000386111438274],
        [-0.03307604789733887, 0.9994478821754456, -0.0031408509239554405],
        [0.00889162253588438, 0.003436705330386758, 0.9999545812606812],
    ]
    shift = {"x": -7.459310054779053, "y": -0.24664966762065887, "z": 0.06717608124017715}
    leads = {"rotationMatrix": right_from_left, "toCameraSocket": 2, "translation": shift}
    nowhere = {"rotationMatrix": [], "toCameraSocket": -1, "translation": {"x": 0.0, "y": 0.0, "z": 0.0}}
    size = {"height": 800, "width": 1280}
    cameras = [
        [1, {"distortionCoeff": [*d_left, *[0.0] * 6], "intrinsicMatrix": left, "extrinsics": leads, **size}],
        [2, {"distortionCoeff": [*d_right, *[0.0] * 6], "intrinsicMatrix": right, "extrinsics": nowhere, **size}],
    ]
    path = write_text(tmp_path / "calib.json", json.dumps({"cameraData": cameras}))
    pair = read_cameras([path], lambda: (1280, 800))
    assert isinstance(pair, RawCalibration)
    np.testing.assert_allclose(pair.left.r, rectified_from_left, atol=1e-6)
    np.testing.assert_allclose(pair.right.r, rectified_from_right, atol=1e-6)
    assert pair.rectified().baseline_m == pytest.approx(0.0746, abs=1e-4)
    cut = read_cameras([path], lambda: (640, 360))
    assert isinstance(cut, RawCalibration)
    assert cut.left.size_px == (1280, 720)
    assert cut.left.k[1, 2] == pytest.approx(left[1][2] - 40)


def _depthai(root: Path, change: Callable[[Any], object]) -> list[Path]:
    (path,) = FORMATS["depthai"](root)
    document = json.loads(path.read_text())
    change(document)
    return [write_text(path, json.dumps(document))]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda found: found.update(cameraData=[3]), "cameraData: expected pairs"),
        (lambda found: found["stereoRectificationData"].update(leftCameraSocket=7), r"left camera \(socket 7\)"),
        (lambda found: found["stereoRectificationData"].update(leftCameraSocket=[]), r"left camera \(socket \[\]\)"),
        (lambda found: found["cameraData"][1][1].pop("width"), "camera 1: no width"),
        (lambda found: found["cameraData"][2][1].update(intrinsicMatrix=[1, 2]), "camera 2: intrinsicMatrix: found 2"),
        (lambda found: found["cameraData"][1][1]["extrinsics"].pop("translation"), "extrinsics: no translation"),
        (lambda found: found["cameraData"][1][1]["extrinsics"].update(translation=3), "extrinsics: no x"),
        (lambda found: found["cameraData"][1][1]["extrinsics"].update(toCameraSocket=-1), "no common camera"),
    ],
)
def test_what_is_wrong_in_an_oak_camera_s_file_is_named(
    tmp_path: Path, change: Callable[[Any], object], message: str
) -> None:
    with pytest.raises(VfoaError, match=rf"oak\.json.*{message}"):
        read_cameras(_depthai(tmp_path, change), size_px)


def test_the_ways_of_an_oak_s_cameras_meet_in_a_third_one(tmp_path: Path) -> None:
    """Both lead to the colour camera, as those of later ones do; without a pair in the file, sockets 1 and 2."""
    plain = read_raw(FORMATS["depthai"](tmp_path)).rectified()

    def lead_to_colour(found: Any) -> None:
        del found["stereoRectificationData"]
        right = found["cameraData"][2][1]["extrinsics"]
        shift = RIG.translation_m * 100 + np.array([*right["translation"].values()])
        left = {"rotationMatrix": RIG.rotation.tolist(), "translation": dict(zip("xyz", shift.tolist(), strict=True))}
        found["cameraData"][1][1]["extrinsics"] = {**left, "toCameraSocket": 0}

    met = read_raw(_depthai(tmp_path, lead_to_colour)).rectified()
    assert (met.fx_px, met.baseline_m) == pytest.approx((plain.fx_px, plain.baseline_m))
