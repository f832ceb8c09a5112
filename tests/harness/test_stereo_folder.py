from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from harness.adapters.calibration import read_calibration
from harness.adapters.stereo_folder import StereoFolderClip, StereoFolderSettings
from tests.disk import HEIGHT, WIDTH, picture, stereo_pair_folder, write_image, write_text
from vfoa.errors import VfoaError

CAMERA = {"fx_px": 50.0, "cx_px": 31.5, "cy_px": 23.5, "baseline_m": 0.1}
SETTINGS = StereoFolderSettings.model_validate({"left": "left", "right": "right", "camera": CAMERA})


def _projection(fx: float, cx: float, tx: float = 0.0) -> np.ndarray:
    return np.array([[fx, 0, cx, tx], [0, fx, 23.5, 0], [0, 0, 1, 0]], dtype=np.float64)


def _opencv(path: Path, **nodes: object) -> Path:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in nodes.items():
        storage.write(name, value)
    storage.release()
    return path


def _kitti(*matrices: np.ndarray, names: tuple[str, str] = ("P2", "P3")) -> str:
    lines = [
        f"{name}: {' '.join(f'{value:e}' for value in matrix.ravel())}\n"
        for name, matrix in zip(names, matrices, strict=True)
    ]
    return "".join(lines)


def test_pairs_are_joined_by_number_and_gaps_stay(tmp_path: Path) -> None:
    clip = StereoFolderClip(SETTINGS, stereo_pair_folder(tmp_path, (2, 9, 10)))
    assert list(clip.frames) == [2, 9, 10]
    frame = clip.frame(9)
    assert np.array_equal(frame.left, picture(9))
    assert np.array_equal(frame.right, picture(1009))
    assert (frame.index, frame.rig.fy_px, frame.rig.cx_right_px) == (9, 50.0, 31.5)


def test_the_rate_gives_the_times(tmp_path: Path) -> None:
    settings = SETTINGS.model_copy(update={"rate_hz": 25.0})
    clip = StereoFolderClip(settings, stereo_pair_folder(tmp_path))
    assert (clip.rate_hz, clip.frame(3).time_ns) == (25.0, 120_000_000)


@pytest.mark.parametrize(("side", "other"), [("left", "right"), ("right", "left")])
def test_images_without_a_partner_are_left_out_and_said(tmp_path: Path, side: str, other: str) -> None:
    stereo_pair_folder(tmp_path)
    (tmp_path / side / "000002.png").unlink()
    clip = StereoFolderClip(SETTINGS, tmp_path)
    assert clip.frames == (1, 3)
    assert clip.notes == (f"1 {other} images have no {side} one and are left out: frame 2",)
    with pytest.raises(VfoaError, match="no frame 2; expected 1 to 3"):
        clip.frame(2)


def test_sides_without_a_common_number_are_one_line(tmp_path: Path) -> None:
    write_image(tmp_path / "left" / "1.png", picture(1))
    write_image(tmp_path / "right" / "2.png", picture(2))
    with pytest.raises(VfoaError, match=r"no frame number is on both sides: left starts with .*1\.png, right with"):
        StereoFolderClip(SETTINGS, tmp_path)


def test_other_sizes_wrong_folders_and_numbers_are_one_line(tmp_path: Path) -> None:
    stereo_pair_folder(tmp_path)
    write_image(tmp_path / "right" / "000001.png", picture(0, WIDTH + 2, HEIGHT))
    clip = StereoFolderClip(SETTINGS, tmp_path)
    with pytest.raises(
        VfoaError, match=r"right/000001\.png: the right image is 66 x 48 pixels, the left one .* 64 x 48"
    ):
        clip.frame(1)
    with pytest.raises(VfoaError, match="no frame 7; expected 1 to 3"):
        clip.frame(7)
    with pytest.raises(VfoaError, match=r"source\.left: 'lef' matches no file"):
        StereoFolderClip(SETTINGS.model_copy(update={"left": "lef"}), tmp_path)
    with pytest.raises(VfoaError, match="gone: no such folder"):
        StereoFolderClip(SETTINGS, tmp_path / "gone")


def test_the_digest_depends_on_images_calibration_and_rate(tmp_path: Path) -> None:
    stereo_pair_folder(tmp_path)
    wider = SETTINGS.model_copy(update={"camera": SETTINGS.camera.model_copy(update={"baseline_m": 0.2})})  # type: ignore[union-attr]
    faster = SETTINGS.model_copy(update={"rate_hz": 10.0})
    digests = [StereoFolderClip(each, tmp_path).digest() for each in (SETTINGS, SETTINGS, wider, faster)]
    write_image(tmp_path / "left" / "000003.png", picture(8))
    digests.append(StereoFolderClip(SETTINGS, tmp_path).digest())
    assert digests[0] == digests[1]
    assert len(set(digests)) == 4


@pytest.mark.parametrize("both", [{}, {"calibration": "c.txt", "camera": CAMERA}])
def test_exactly_one_calibration_is_asked_for(both: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="expected either calibration"):
        StereoFolderSettings.model_validate({"left": "l", "right": "r", **both})


def test_kitti_s_baseline_is_the_difference_of_the_fourth_columns(shared_data: Path) -> None:
    calibration = read_calibration(shared_data / "kitti_pair" / "calib.txt")
    assert calibration.baseline_m == pytest.approx(0.532, abs=0.002)
    assert calibration.fx_px == 721.5377
    assert calibration.cx_px == calibration.cx_right_px == 609.5593
    gray = read_calibration(shared_data / "kitti_pair" / "calib.txt", kitti_cameras=(0, 1))
    assert gray.baseline_m == pytest.approx(0.537, abs=0.001)


def test_kitti_s_raw_recordings_name_and_size_theirs(tmp_path: Path) -> None:
    text = _kitti(_projection(50, 30), _projection(50, 32, -10), names=("P_rect_02", "P_rect_03"))
    path = write_text(tmp_path / "c.txt", f"calib_time: 09-Jan-2012 13:57:47\nS_rect_02: 6.4e1 4.8e1\n{text}")
    calibration = read_calibration(path)
    assert (calibration.baseline_m, calibration.cx_px, calibration.cx_right_px) == (0.2, 30.0, 32.0)
    assert calibration.size_px == (64, 48)


def test_opencv_s_projections_are_read(tmp_path: Path) -> None:
    path = _opencv(tmp_path / "c.yml", P1=_projection(50, 30), P2=_projection(50, 33, -5.0), D1=np.zeros((1, 5)))
    calibration = read_calibration(path)
    assert (calibration.baseline_m, calibration.cx_px, calibration.cx_right_px) == (0.1, 30.0, 33.0)


def test_what_stereo_rectify_returns_is_read_back(tmp_path: Path) -> None:
    K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    rotation, _ = cv2.Rodrigues(np.array([0.01, 0.02, -0.01]))
    translation = np.array([[-0.12], [0.001], [0.002]])
    R1, R2, P1, P2, *_ = cv2.stereoRectify(K, np.zeros(5), K, np.zeros(5), (640, 480), rotation, translation)
    path = _opencv(tmp_path / "extrinsics.yml", R=rotation, T=translation, R1=R1, R2=R2, P1=P1, P2=P2)
    with pytest.raises(VfoaError, match=r"extrinsics\.yml: holds R and T of an unrectified pair.*rectified = true"):
        read_calibration(path)
    calibration = read_calibration(path, rectified=True)
    assert calibration.baseline_m == pytest.approx(np.linalg.norm(translation))


@pytest.mark.parametrize(
    ("matrices", "message"),
    [
        ((_projection(50, 30), _projection(50, 30, 5)), r"baseline is -0\.1 m; expected a positive one"),
        ((_projection(50, 30), _projection(50, 30)), "baseline is 0 m"),
        ((_projection(50, 30), _projection(51, 30, -5)), "fx is 50 left and 51 right"),
        ((_projection(-50, 30), _projection(-50, 30, -5)), "positive focal lengths"),
    ],
)
def test_matrices_of_no_rectified_pair_are_refused(
    tmp_path: Path, matrices: tuple[np.ndarray, np.ndarray], message: str
) -> None:
    with pytest.raises(VfoaError, match=message):
        read_calibration(write_text(tmp_path / "c.txt", _kitti(*matrices)))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("c.txt", "P2: 1 2 3\n", r"c\.txt:1: found 3 numbers; expected 12"),
        ("c.txt", "P0: 1\nP2: 1 x\n", r"c\.txt:2: could not convert string to float"),
        ("c.txt", "nothing\n", r"no line P2: or P_rect_02:"),
        ("c.yml", "%YAML:1.0\n---\na: 1\n", r"P1: no such matrix; expected the \(3, 4\) matrix of stereoRectify"),
        ("c.yml", "a: [1,\n", r"c\.yml: "),
        ("c.yml", "", r"c\.yml: "),
    ],
)
def test_files_that_are_no_calibration_are_one_line(tmp_path: Path, name: str, content: str, message: str) -> None:
    with pytest.raises(VfoaError, match=message) as error:
        read_calibration(write_text(tmp_path / name, content))
    assert "\n" not in str(error.value)


def test_a_missing_calibration_is_named(tmp_path: Path) -> None:
    stereo_pair_folder(tmp_path)
    settings = StereoFolderSettings(left="left", right="right", calibration="gone.yml")
    with pytest.raises(VfoaError, match=r"gone\.yml: no such file"):
        StereoFolderClip(settings, tmp_path)


def test_a_calibration_for_another_size_is_refused(tmp_path: Path) -> None:
    stereo_pair_folder(tmp_path)
    nodes = {"P1": _projection(50, 30), "P2": _projection(50, 30, -5.0)}
    _opencv(tmp_path / "c.yml", image_width=128, image_height=96, **nodes)
    clip = StereoFolderClip(StereoFolderSettings(left="left", right="right", calibration="c.yml"), tmp_path)
    with pytest.raises(
        VfoaError, match=r"000001\.png: the calibration is for \(128, 96\) pixels, the images .*\(64, 48\)"
    ):
        clip.frame(1)
