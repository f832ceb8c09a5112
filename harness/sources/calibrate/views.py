"""A calibration board as both cameras see it, one view per pair of pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from harness.sources.calibration import check_size
from vfoa.errors import VfoaError, check_known
from vfoa.types import Float, Image

FEWEST_CORNERS = 3
"""Fewest corners in each direction of a chessboard that OpenCV finds."""

MIN_CORNERS = 8
"""Twice as many as a homography needs, so that a wrong corner shows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """A grid of corners in the plane z = 0, row by row: ``columns`` in a row, all of them ``points_m`` (N, 3), metres.

    ``find`` returns the pixels (2,), to a fraction of a pixel, of the corners in a picture (H, W, 3) RGB by their index
    among the points; none if there is no board.
    """

    columns: int
    points_m: Float
    find: Callable[[Image], dict[int, Float]]


def chessboard(columns: int, rows: int, square_m: float) -> Board:
    """A board of this many inner corners, whose squares have this side in metres. The whole board must be visible.

    Raises
    ------
    VfoaError
        If there are fewer than three corners in either direction.
    """
    if min(columns, rows) < FEWEST_CORNERS:
        raise VfoaError(
            f"chessboard: found {columns} x {rows} inner corners; expected at least {FEWEST_CORNERS} in each direction"
        )

    def find(image: Image) -> dict[int, Float]:
        gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        try:
            is_found, corners = cv2.findChessboardCorners(gray, (columns, rows))
        except cv2.error:  # a picture of only a few pixels
            return {}
        if not is_found:
            return {}
        stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
        corners = cv2.cornerSubPix(gray, corners, (5, 5), (-1, -1), stop)
        return dict(enumerate(corners.reshape(-1, 2).astype(np.float64)))

    grid = np.mgrid[:columns, :rows].T.reshape(-1, 2) * square_m
    return Board(columns=columns, points_m=np.hstack([grid, np.zeros((len(grid), 1))]), find=find)


def charuco_board(columns: int, rows: int, square_m: float, marker_m: float, dictionary: str) -> Board:
    """A board of this many squares, sides of a square and of a marker in metres, with markers of OpenCV's dictionary.

    It may be partly visible; the corners beside decoded markers are found. Boards with an even number of rows are found
    in both of their patterns: OpenCV before 4.6 and some generators begin them with a marker, not with a black square.

    Raises
    ------
    VfoaError
        If the dictionary is unknown or too small, or the marker does not fit into its square.
    """
    if not 0 < marker_m < square_m:
        raise VfoaError(f"marker: found {marker_m * 1000:g} mm; expected less than the square's {square_m * 1000:g} mm")
    known = {name for name in dir(cv2.aruco) if name.startswith("DICT_")}
    check_known(dictionary, known, "dictionary")
    markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    if (count := len(markers.bytesList)) < columns * rows // 2:
        raise VfoaError(
            f"{dictionary}: found {count} markers; expected at least {columns * rows // 2} for {columns} x {rows} "
            "squares"
        )
    board = cv2.aruco.CharucoBoard((columns, rows), square_m, marker_m, markers)
    detectors = [cv2.aruco.CharucoDetector(board)]
    if rows % 2 == 0:
        older = cv2.aruco.CharucoBoard((columns, rows), square_m, marker_m, markers)
        older.setLegacyPattern(True)
        detectors.append(cv2.aruco.CharucoDetector(older))

    def find(image: Image) -> dict[int, Float]:
        gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        for detector in detectors:
            corners, ids, _, _ = detector.detectBoard(gray)
            if ids is not None:
                return dict(zip(ids.ravel().tolist(), np.asarray(corners, np.float64).reshape(-1, 2), strict=True))
        return {}

    return Board(columns=columns - 1, points_m=np.asarray(board.getChessboardCorners(), np.float64), find=find)


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardView:
    """Corners that both pictures of a frame show: the board's points (N, 3), metres, and pixels (N, 2)."""

    number: int
    points_m: Float
    left_px: Float
    right_px: Float


def find_views(
    numbers: Iterable[int], read: Callable[[int], tuple[Image, Image]], board: Board
) -> tuple[list[BoardView], dict[int, str], tuple[int, int]]:
    """Find the board in pairs of pictures of one size, that of the first one that can be read.

    Parameters
    ----------
    numbers
        The frames.
    read
        Reads left and right (H, W, 3) RGB of a frame.
    board
        The board to find.

    Returns
    -------
    tuple
        The views, the reason of each frame without one, and (width, height) of the pictures.
    """
    views, dropped, size_px = list[BoardView](), dict[int, str](), (0, 0)
    for number in numbers:
        try:
            left, right = read(number)
            own_px = left.shape[1], left.shape[0]
            size_px = size_px if any(size_px) else own_px
            check_size(own_px, size_px, "found images", "as in the first pair")
            views.append(_view(number, left, right, board))
        except VfoaError as error:
            dropped[number] = str(error)
    return views, dropped, size_px


def _view(number: int, left: Image, right: Image, board: Board) -> BoardView:
    corners = {"left": board.find(left), "right": board.find(right)}
    if missing := [side for side, pixels in corners.items() if not pixels]:
        raise VfoaError(f"no board in the {' and the '.join(missing)} image")
    shared = sorted(corners["left"].keys() & corners["right"].keys())
    if len(shared) < MIN_CORNERS:
        counts = ", ".join(f"{len(pixels)} {side}" for side, pixels in corners.items())
        raise VfoaError(f"found {len(shared)} corners in both images ({counts}); expected at least {MIN_CORNERS}")
    points_m = board.points_m[shared]
    grid = np.stack(np.divmod(shared, board.columns), axis=1)
    if np.linalg.matrix_rank(grid - grid.mean(axis=0)) < 2:
        raise VfoaError("the corners in both images lie in one line; expected two rows and two columns of the board")
    left_px, right_px = (np.array([pixels[corner] for corner in shared]) for pixels in corners.values())
    return BoardView(number=number, points_m=points_m, left_px=left_px, right_px=right_px)
