from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from harness.cli import app, main
from harness.sources.calibrate.solve import format_calibration, solve
from harness.sources.calibrate.views import BoardView, chessboard, find_views
from harness.sources.calibration_files.read import read_cameras
from harness.sources.media.images import read_rgb
from harness.sources.rectification import RawCalibration
from harness.sources.stereo_folder import StereoFolderClip, StereoFolderSettings
from harness.sources.stereo_pairs import PairFiles
from tests.calibrations import rectified_rows_px, write_opencv
from tests.command import vfoa
from tests.disk import write_bytes, write_image, write_text
from vfoa.errors import VfoaError
from vfoa.types import Image, StereoFrame

BOARD = chessboard(9, 6, 0.025)
SIZE = (640, 480)
K = np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]])
RIGHT_FROM_LEFT, T = np.array([0.01, 0.02, -0.01]), np.array([-0.12, 0.002, 0.001])


def _views(count: int = 8) -> list[BoardView]:
    """A board in known poses before two known cameras, seen without noise."""
    random = np.random.default_rng(3)
    rotation = cv2.Rodrigues(RIGHT_FROM_LEFT)[0]
    views = []
    for number in range(count):
        tilt = cv2.Rodrigues(random.uniform(-0.5, 0.5, 3))[0]
        left = (BOARD.points_m - [0.1, 0.06, 0]) @ tilt.T + [0.05, 0, random.uniform(0.5, 0.9)]
        pixels = [points[:, :2] / points[:, 2:] * 600 + K[:2, 2] for points in (left, left @ rotation.T + T)]
        views.append(BoardView(number=number, points_m=BOARD.points_m, left_px=pixels[0], right_px=pixels[1]))
    return views


def _found(folder: Path) -> tuple[list[BoardView], dict[int, str], tuple[int, int]]:
    pictures = PairFiles(left="left*.jpg", right="right*.jpg").views(folder)
    return find_views(pictures.frames, pictures.read, BOARD)


def _found_in(clip: StereoFolderClip) -> list[BoardView]:
    frames = {number: clip.frame(number) for number in clip.frames}
    return find_views(frames, lambda number: (frames[number].left, _right(frames[number])), BOARD)[0]


def _right(frame: StereoFrame) -> Image:
    assert frame.right is not None
    return frame.right


def test_known_cameras_are_found_and_the_file_brings_them_back(tmp_path: Path) -> None:
    found = solve(_views(), SIZE)
    assert np.allclose(found.K1, K, rtol=1e-2)
    assert np.allclose(found.T.ravel(), T, atol=1e-3)
    write_text(tmp_path / "stereo.yml", format_calibration(found))
    cameras = read_cameras([tmp_path / "stereo.yml"], lambda: (1, 1))
    assert isinstance(cameras, RawCalibration)
    calibration = cameras.rectified()
    assert calibration.baseline_m == pytest.approx(np.linalg.norm(T), rel=1e-2)
    assert calibration.size_px == SIZE


def test_a_view_that_does_not_fit_is_dropped_and_named() -> None:
    views = _views(10)
    views[4] = dataclasses.replace(views[4], right_px=views[4].right_px + np.array([0.0, 25.0]))
    found = solve(views, SIZE)
    assert [*found.dropped] == [4]
    assert "error" in found.dropped[4]


def test_pictures_without_a_board_are_named_and_too_few_are_one_line() -> None:
    blank = np.zeros((48, 64, 3), np.uint8)
    views, dropped, _ = find_views([7], lambda _: (blank, blank), BOARD)
    assert (views, [*dropped]) == ([], [7])
    with pytest.raises(VfoaError, match=r"0 usable views .*3: check --columns and --rows"):
        solve(views, SIZE)


def test_a_board_that_opencv_cannot_find_is_refused() -> None:
    with pytest.raises(VfoaError, match=r"chessboard: found 2 x 6 inner corners.*3"):
        chessboard(2, 6, 0.03)


@pytest.mark.parametrize("side", [1, 2, 9])
def test_a_picture_of_a_few_pixels_has_no_board(side: int) -> None:
    assert chessboard(3, 3, 0.03).find(np.zeros((side, side, 3), np.uint8)) == {}


def test_real_cameras_are_calibrated(shared_data: Path) -> None:
    views, dropped, size_px = _found(shared_data / "chessboard")
    found = solve(views, size_px)
    assert (len(found.errors), dropped, found.dropped) == (13, {}, {})
    assert format_calibration(solve(views, size_px)) == format_calibration(found)
    assert found.rms_px <= 0.5
    assert found.epipolar_px <= 0.25
    assert np.median(np.abs(np.concatenate([rectified_rows_px(found, view) for view in views]))) <= 0.15


def test_the_result_drives_a_clip_whose_corners_lie_on_the_same_rows(shared_data: Path, tmp_path: Path) -> None:
    (tmp_path / "pictures").symlink_to(shared_data / "chessboard")
    views, _, size_px = _found(shared_data / "chessboard")
    found = solve(views, size_px)
    write_text(tmp_path / "stereo.yml", format_calibration(found))
    settings = {"left": "pictures/left*.jpg", "right": "pictures/right*.jpg", "calibration": "stereo.yml"}
    clip = StereoFolderClip(StereoFolderSettings.model_validate(settings), tmp_path)
    views = _found_in(clip)
    assert len(views) >= 10  # rectification may cut a corner off
    rows_apart = np.abs(np.concatenate([view.left_px[:, 1] - view.right_px[:, 1] for view in views]))
    assert np.median(rows_apart) <= 0.15
    assert clip.frame(clip.frames[0]).rig.baseline_m > 0
    assert clip.digest() != StereoFolderClip(clip.Settings(**settings, rectified=True), tmp_path).digest()


def test_opencv_s_two_files_rectify_real_pairs_in_one_picture(shared_data: Path, tmp_path: Path) -> None:
    """intrinsics.yml and extrinsics.yml without R1 to P2: the rectification is computed."""
    views, _, size_px = _found(shared_data / "chessboard")
    found = solve(views, size_px)
    write_opencv(tmp_path / "intrinsics.yml", {"M1": found.K1, "D1": found.D1, "M2": found.K2, "D2": found.D2})
    write_opencv(tmp_path / "extrinsics.yml", {"R": found.R, "T": found.T})
    pictures = PairFiles(left="left*.jpg", right="right*.jpg").views(shared_data / "chessboard")
    for number in pictures.frames:
        write_image(tmp_path / f"{number}.png", np.hstack(pictures.read(number)))
    settings = {"layout": "images_side_by_side", "both": "*.png", "calibration": ["intrinsics.yml", "extrinsics.yml"]}
    clip = StereoFolderClip(StereoFolderSettings.model_validate(settings), tmp_path)
    views = _found_in(clip)
    rows_apart = np.abs(np.concatenate([view.left_px[:, 1] - view.right_px[:, 1] for view in views]))
    assert len(views) >= 10
    assert np.median(rows_apart) <= 0.15
    assert clip.frame(clip.frames[0]).rig.baseline_m == pytest.approx(np.linalg.norm(found.T))


def test_the_verb_writes_the_file_and_a_picture(shared_data: Path, tmp_path: Path) -> None:
    board = ["--columns", "9", "--rows", "6", "--square-mm", "25"]
    for path in (shared_data / "chessboard").glob("*.jpg"):
        side, number = ("L", path.stem.removeprefix("left")) if "left" in path.stem else ("R", path.stem[5:])
        write_bytes(tmp_path / "board" / f"board{number}_{side}.jpg", path.read_bytes())
    out = tmp_path / "stereo.yml"
    result = CliRunner().invoke(app, ["calibrate", str(tmp_path / "board"), *board, "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "13 pairs, RMS" in result.output
    assert isinstance(read_cameras([out], lambda: (1, 1)), RawCalibration)
    assert read_rgb(tmp_path / "stereo.png").shape == (480, 1280, 3)


@pytest.mark.parametrize("name", ["stereo", "stereo.png", "stereo.xml", "stereo.conf"])
def test_a_file_that_would_not_be_read_back_is_not_written(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "sys.argv", ["vfoa", "calibrate", ".", "--columns", "9", "--rows", "6", "--square-mm", "25", "--out", name]
    )
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert f"--out {name}: found the suffix '{Path(name).suffix}'; expected .yml or .yaml" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


BOARD_WORDS = ("--columns", "9", "--rows", "6", "--square-mm", "1000")


def test_what_is_refused_leaves_no_file(
    shared_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The pictures of the right camera as those of the left one."""
    monkeypatch.chdir(tmp_path)
    swapped = ("--left", "right0[1-5].jpg", "--right", "left0[1-5].jpg")
    code, _, said = vfoa(monkeypatch, capsys, "calibrate", str(shared_data / "chessboard"), *BOARD_WORDS, *swapped)
    assert (code, said.count("\n")) == (2, 1)
    assert "left and right swapped?" in said
    assert list(tmp_path.iterdir()) == []
