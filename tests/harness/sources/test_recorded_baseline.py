"""A baseline from elsewhere for recorded calibrations that have none, or one of the wrong sign: K, D and R are kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from harness.sources.stereo_folder import StereoFolderClip, StereoFolderSettings
from tests.calibrations import write_opencv
from tests.disk import HEIGHT, WIDTH, picture, write_image, write_text
from tests.harness.sources.numbered_recording import open_clip, stamp
from tests.recordings import Camera, Family, rectified_camera, write_pairs
from vfoa.errors import VfoaError

K = [100.0, 0, 31.5, 0, 100, 23.5, 0, 0, 1]
D = (-0.2, 0.05, 0.001, 0.0, 0.0)
TURN: NDArray[np.float64] = np.asarray(cv2.Rodrigues(np.array([0.01, 0.02, 0]))[0])
LENS = Camera(width=WIDTH, height=HEIGHT, k=K, p=[0.0] * 12, d=D)


def _projection(fx: float, tx: float = 0.0) -> list[float]:
    return [fx, 0, 31.5, tx, 0, fx, 23.5, 0, 0, 0, 1, 0]


def _record(path: Path, left: Camera, right: Camera, family: Family = "ros2") -> Path:
    return write_pairs(path, [(stamp(1), picture(1), picture(2), left, right)], family)


def _rectified(image: NDArray[np.uint8], k: list[float], r: NDArray[np.float64], fx: float) -> NDArray[np.uint8]:
    """What OpenCV makes of an image with this K, D, R and a P of this focal length."""
    p = np.array(_projection(fx)).reshape(3, 4)[:, :3]
    maps = cv2.initUndistortRectifyMap(np.array(k).reshape(3, 3), np.array(D), r, p, (WIDTH, HEIGHT), cv2.CV_32FC1)
    return np.asarray(cv2.remap(image, *maps, cv2.INTER_LINEAR), np.uint8)


@pytest.mark.parametrize("family", ["ros2", "protobuf"])
@pytest.mark.parametrize(
    ("tx_left", "tx_right", "fx_right"),
    [(0.0, 0.0, 110.0), (0.0, 15.0, 110.0), (-15.0, 0.0, 110.0), (0.0, 0.0, 110.4), (0.0, -11.0, 109.7)],
)
def test_a_baseline_replaces_the_recorded_one(
    tmp_path: Path, family: Family, tx_left: float, tx_right: float, fx_right: float
) -> None:
    """0 in both, of the wrong sign, and slightly different focal lengths."""
    r = tuple(TURN.ravel().tolist())
    left = replace(LENS, p=_projection(110, tx_left), r=r)
    right = replace(LENS, p=_projection(fx_right, tx_right), r=r)
    path = _record(tmp_path / "a.mcap", left, right, family)
    with pytest.raises(VfoaError, match=r"camera_info.* --baseline METRES"):
        open_clip(path).frame(1)
    clip = open_clip(path, baseline_m=0.25)
    frame = clip.frame(1)
    assert (frame.rig.fx_px, frame.rig.fy_px, frame.rig.cx_px, frame.rig.cy_px) == (110, 110, 31.5, 23.5)
    assert frame.rig.baseline_m == pytest.approx(0.25)
    assert frame.right is not None
    np.testing.assert_array_equal(frame.left, _rectified(picture(1), K, TURN, 110))
    np.testing.assert_array_equal(frame.right, _rectified(picture(2), K, TURN, 110))
    assert clip.notes == ()


@pytest.mark.parametrize("r", [LENS.r, (0.0,) * 9])
def test_zeros_for_p_and_r_are_not_set(tmp_path: Path, r: tuple[float, ...]) -> None:
    right_k = [101.0, 0, 30.5, 0, 101, 23.5, 0, 0, 1]
    left, right = replace(LENS, r=r), replace(LENS, r=r, k=right_k)
    path = _record(tmp_path / "a.mcap", left, right)
    names = "P and R" if not any(r) else "P"
    with pytest.raises(VfoaError, match=rf"right/camera_info: {names}: .* --baseline"):
        open_clip(path).frame(1)
    clip = open_clip(path, baseline_m=0.25)
    frame = clip.frame(1)
    assert (frame.rig.fx_px, frame.rig.baseline_m) == (100, pytest.approx(0.25))
    assert frame.right is not None
    np.testing.assert_array_equal(frame.left, _rectified(picture(1), K, np.eye(3), 100))
    np.testing.assert_array_equal(frame.right, _rectified(picture(2), right_k, np.eye(3), 100))
    (note,) = clip.notes
    assert f"{names}: zeros" in note
    assert ("parallel" in note) == (not any(r))


def test_zeros_for_the_rotation_of_one_camera_are_refused(tmp_path: Path) -> None:
    path = _record(tmp_path / "a.mcap", replace(LENS, r=tuple(TURN.ravel())), replace(LENS, r=(0.0,) * 9))
    with pytest.raises(VfoaError, match="right: R: found zeros"):
        open_clip(path, baseline_m=0.25).frame(1)


def test_images_that_are_rectified_stay_as_they_are(tmp_path: Path) -> None:
    left, right = replace(LENS, p=_projection(110)), replace(LENS, p=_projection(110), r=(0.0,) * 9)
    frame = open_clip(_record(tmp_path / "a.mcap", left, right), rectified=True, baseline_m=0.25).frame(1)
    assert frame.right is not None
    np.testing.assert_array_equal(frame.left, picture(1))
    np.testing.assert_array_equal(frame.right, picture(2))
    assert (frame.rig.fx_px, frame.rig.baseline_m) == (110, pytest.approx(0.25))


def test_a_baseline_replaces_that_of_a_file(tmp_path: Path) -> None:
    path = _record(tmp_path / "a.mcap", LENS, LENS)
    k, d = np.array(K).reshape(3, 3), np.array(D)
    nodes = {"K1": k, "D1": d, "K2": k, "D2": d, "R": np.eye(3), "T": np.array([[-60.0], [0], [0]])}
    write_opencv(tmp_path / "mm.yml", nodes, (WIDTH, HEIGHT))
    assert open_clip(path, calibration="mm.yml", baseline_m=0.06).frame(1).rig.baseline_m == pytest.approx(0.06)


def test_numbers_have_their_own_baseline(tmp_path: Path) -> None:
    path = _record(tmp_path / "a.mcap", LENS, LENS)
    camera = {"fx_px": 100, "cx_px": 31.5, "cy_px": 23.5, "baseline_m": 0.1}
    assert open_clip(path, camera=camera).frame(1).rig.baseline_m == pytest.approx(0.1)
    with pytest.raises(ValueError, match=r"camera\.baseline_m alone"):
        open_clip(path, camera=camera, baseline_m=0.1)


def test_a_rectified_pair_is_read_as_before(tmp_path: Path) -> None:
    left, right = (rectified_camera(WIDTH, HEIGHT, 100, 31.5, 23.5, baseline) for baseline in (0.0, 0.12))
    path = _record(tmp_path / "a.mcap", left, right)
    for baseline_m in (None, 0.12):
        frame = open_clip(path, baseline_m=baseline_m).frame(1)
        np.testing.assert_array_equal(frame.left, picture(1))
        assert frame.rig.baseline_m == pytest.approx(0.12)


@pytest.mark.parametrize(("p", "r"), [([0.0] * 12, (0.0,) * 9), (_projection(110, 15.0), tuple(TURN.ravel().tolist()))])
def test_two_files_of_ros_take_a_baseline_as_a_recording_does(
    tmp_path: Path, p: list[float], r: tuple[float, ...]
) -> None:
    left, right = replace(LENS, p=p if p[3] == 0 else _projection(110), r=r), replace(LENS, p=p, r=r)
    recorded = open_clip(_record(tmp_path / "a.mcap", left, right), baseline_m=0.25).frame(1)
    paths = []
    for side, camera, number in (("left", left, 1), ("right", right, 2)):
        matrices = {"camera_matrix": camera.k, "distortion_coefficients": list(camera.d)}
        matrices |= {"rectification_matrix": list(camera.r), "projection_matrix": camera.p}
        document = {"image_width": WIDTH, "image_height": HEIGHT, "distortion_model": "plumb_bob"}
        write_text(tmp_path / f"{side}.yaml", yaml.safe_dump(document | {k: {"data": v} for k, v in matrices.items()}))
        write_image(tmp_path / side / "0.png", picture(number))
        paths.append(f"{side}.yaml")
    views = {"left": "left", "right": "right", "calibration": paths}
    with pytest.raises(VfoaError, match=r"left\.yaml .*right\.yaml: .* --baseline"):
        StereoFolderClip(StereoFolderSettings.model_validate(views), tmp_path).frame(0)
    frame = StereoFolderClip(StereoFolderSettings.model_validate(views | {"baseline_m": 0.25}), tmp_path).frame(0)
    assert frame.rig == recorded.rig
    np.testing.assert_array_equal(frame.left, recorded.left)


@pytest.mark.parametrize(("fx", "is_noted"), [(30.0, True), (90.0, False)])
def test_what_rectification_takes_of_a_wide_lens_is_noted(tmp_path: Path, fx: float, is_noted: bool) -> None:
    left, right = (replace(LENS, p=_projection(fx, tx)) for tx in (0.0, -0.1 * fx))
    notes = open_clip(_record(tmp_path / "a.mcap", left, right)).notes
    assert [note for note in notes if note.startswith("rectification reduces fx from 100")] == [*notes]
    assert bool(notes) == is_noted
    text = yaml.safe_dump(
        {"K1": K, "D1": [*D], "K2": K, "D2": [*D], "R1": [*LENS.r], "R2": [*LENS.r], "image_size": [WIDTH, HEIGHT]}
        | {"P1": left.p, "P2": right.p}
    )
    write_text(tmp_path / "rig.yml", text)
    assert open_clip(tmp_path / "a.mcap", calibration="rig.yml").notes == notes
