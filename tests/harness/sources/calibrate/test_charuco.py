"""A ChArUco board in known poses, drawn as a known pair of pin-hole cameras sees it: the pair must be recovered."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from harness.cli import app
from harness.sources.calibrate.solve import solve
from harness.sources.calibrate.views import charuco_board, find_views
from harness.sources.calibration_files.read import read_cameras
from harness.sources.rectification import RawCalibration
from harness.sources.stereo_pairs import PairFiles
from tests.calibrations import rectified_rows_px
from tests.disk import write_image, write_text
from vfoa.errors import VfoaError
from vfoa.types import Float, Image

COLUMNS, ROWS, SQUARE_M, MARKER_M = 9, 6, 0.03, 0.022
BOARD = charuco_board(COLUMNS, ROWS, SQUARE_M, MARKER_M, "DICT_5X5_100")
ARGUMENTS = ["--columns", "9", "--rows", "6", "--square-mm", "30", "--marker-mm", "22"]
SIZE = (640, 480)
K = np.array([[620.0, 0, 322], [0, 618, 238], [0, 0, 1]])
ROTATION = cv2.Rodrigues(np.array([0.01, -0.02, 0.008]))[0]
TRANSLATION = np.array([-0.09, 0.001, 0.002])
FINE = 60  # pixels of the drawn board in a square


def _drawn(*, begins_with_marker: bool) -> Image:
    """The board as it is printed, with a white margin of one square; OpenCV before 4.6 begins it with a marker."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    board = cv2.aruco.CharucoBoard((COLUMNS, ROWS), SQUARE_M, MARKER_M, dictionary)
    board.setLegacyPattern(begins_with_marker)
    drawn = board.generateImage((COLUMNS * FINE, ROWS * FINE), marginSize=0)
    return cv2.copyMakeBorder(drawn, FINE, FINE, FINE, FINE, cv2.BORDER_CONSTANT, value=255)


DRAWN = _drawn(begins_with_marker=False)


def _seen(rotation: Float, translation: Float, drawn: Image = DRAWN) -> Image:
    """The board at x_camera = rotation x_board + translation, drawn twice as large and averaged down."""
    metres = np.array([[1, 0, 0.5 - FINE], [0, 1, 0.5 - FINE], [0, 0, FINE / SQUARE_M]]) * SQUARE_M / FINE
    double = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])
    plane = np.column_stack([rotation[:, :2], translation])
    width, height = 2 * SIZE[0], 2 * SIZE[1]
    large = cv2.warpPerspective(drawn, double @ K @ plane @ metres, (width, height), borderValue=110)
    return cv2.cvtColor(cv2.resize(large, SIZE, interpolation=cv2.INTER_AREA), cv2.COLOR_GRAY2RGB)


def _pair(tilt: Float, translation: Float) -> tuple[Image, Image]:
    """Both cameras' pictures of the board, whose middle is at ``translation`` of the left camera."""
    rotation = cv2.Rodrigues(tilt)[0]
    corner = translation - rotation @ [COLUMNS * SQUARE_M / 2, ROWS * SQUARE_M / 2, 0]
    return _seen(rotation, corner), _seen(ROTATION @ rotation, ROTATION @ corner + TRANSLATION)


def _pairs(count: int) -> list[tuple[Image, Image]]:
    random = np.random.default_rng(5)
    tilts = random.uniform(-0.45, 0.45, (count, 3))
    places = np.column_stack([random.uniform(0, 0.1, count), random.uniform(-0.05, 0.05, count)])
    depths = random.uniform(0.35, 0.6, count)
    return [_pair(tilt, np.array([*at, depth])) for tilt, at, depth in zip(tilts, places, depths, strict=True)]


PAIRS = _pairs(12)


def _write(folder: Path, pairs: list[tuple[Image, Image]]) -> None:
    for number, (left, right) in enumerate(pairs):
        write_image(folder / f"left{number:02d}.png", left)
        write_image(folder / f"right{number:02d}.png", right)


@pytest.mark.parametrize("begins_with_marker", [False, True])
def test_corners_are_where_the_cameras_see_them(begins_with_marker: bool) -> None:
    rotation, translation = cv2.Rodrigues(np.array([0.2, -0.3, 0.1]))[0], np.array([-0.1, -0.1, 0.5])
    seen = BOARD.find(_seen(rotation, translation, _drawn(begins_with_marker=begins_with_marker)))
    points = BOARD.points_m[list(seen)] @ rotation.T + translation
    assert len(points) == (COLUMNS - 1) * (ROWS - 1)
    pixels = np.array(list(seen.values()))
    assert np.abs(points @ K.T / points[:, 2:] - np.pad(pixels, ((0, 0), (0, 1)), constant_values=1)).max() < 0.25


def test_the_pair_is_recovered_also_from_boards_that_are_seen_in_part() -> None:
    views, dropped, size_px = find_views(range(len(PAIRS)), PAIRS.__getitem__, BOARD)
    assert size_px == SIZE
    assert dropped == {}
    assert min(len(view.points_m) for view in views) < (COLUMNS - 1) * (ROWS - 1)
    found = solve(views, SIZE)
    assert found.rms_px < 0.15
    assert found.epipolar_px < 0.1
    assert np.linalg.norm(found.T) == pytest.approx(np.linalg.norm(TRANSLATION), rel=0.01)
    assert np.allclose(found.R, ROTATION, atol=2e-3)
    assert found.K1[[0, 1], [0, 1]] == pytest.approx(K[[0, 1], [0, 1]], rel=0.01)
    assert np.median(np.abs(np.concatenate([rectified_rows_px(found, view) for view in views]))) < 0.1


def test_bad_views_are_dropped_each_with_its_reason() -> None:
    left, right = PAIRS[0]
    seen = BOARD.find(left)
    blank, part = np.full_like(left, 110), left.copy()
    part[:, int(np.percentile([pixel[0] for pixel in seen.values()], 20)) :] = 110
    pairs = {1: (left, right), 2: (left, blank), 3: (blank, blank), 4: (part, right)}
    views, reasons, _ = find_views(pairs, pairs.__getitem__, BOARD)
    assert [view.number for view in views] == [1]
    assert reasons[2] == "no board in the right image"
    assert reasons[3] == "no board in the left and the right image"
    assert re.fullmatch(r"found \d corners in both images \(\d left, \d\d right\); expected at least 8", reasons[4])


def test_corners_in_one_line_are_of_no_use() -> None:
    one_row = dataclasses.replace(BOARD, find=lambda _: {corner: np.zeros(2) for corner in range(BOARD.columns)})
    views, dropped, _ = find_views([4], lambda _: PAIRS[0], one_row)
    assert views == []
    assert dropped[4].startswith("the corners in both images lie in one line")


def test_pictures_that_cannot_be_used_are_said_and_the_rest_is_calibrated(tmp_path: Path) -> None:
    _write(tmp_path, PAIRS)
    (tmp_path / "right03.png").unlink()
    write_text(tmp_path / "left05.png", "no picture")
    for side in ("left", "right"):
        write_image(tmp_path / f"{side}07.png", PAIRS[7][0][:400])
    out = tmp_path / "stereo.yml"
    result = CliRunner().invoke(app, ["calibrate", str(tmp_path), *ARGUMENTS, "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "1 left image has no right one, left out: frame 3" in result.output
    assert "frame 5 dropped: " in result.output
    assert "frame 7 dropped: found images of 640 x 400 pixels; expected 640 x 480" in result.output
    assert "stereo.yml: 9 pairs, RMS 0." in result.output
    cameras = read_cameras([out], lambda: SIZE)
    assert isinstance(cameras, RawCalibration)
    assert cameras.rectified().baseline_m == pytest.approx(np.linalg.norm(TRANSLATION), rel=0.01)


def test_both_views_in_one_picture_serve_as_well(tmp_path: Path) -> None:
    for number, pair in enumerate(PAIRS):
        write_image(tmp_path / f"{number}.png", np.hstack(pair))
    files = PairFiles(layout="images_side_by_side", both="*.png")
    pictures = files.views(tmp_path)
    views, _, size_px = find_views(pictures.frames[::3], pictures.read, BOARD)
    assert size_px == SIZE
    assert [view.number for view in views] == [0, 3, 6, 9]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dictionary": "DICT_5X5_10"}, r"'DICT_5X5_10'.*'DICT_5X5_100'"),
        ({"dictionary": "DICT_5X5_50", "columns": 20}, r"DICT_5X5_50: found 50 markers.*60"),
        ({"marker_m": 0.03}, "marker: found 30 mm"),
    ],
)
def test_boards_that_cannot_be_are_one_line(change: dict[str, object], message: str) -> None:
    board = {"columns": COLUMNS, "rows": ROWS, "square_m": SQUARE_M, "marker_m": MARKER_M, "dictionary": "DICT_5X5_100"}
    with pytest.raises(VfoaError, match=message):
        charuco_board(**{**board, **change})  # type: ignore[arg-type]
