"""Corners of a chessboard seen by both cameras, one view per pair of pictures."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from vfoa.types import Float, Image


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """A chessboard: inner corners along and across, and the side of a square in metres."""

    columns: int
    rows: int
    square_m: float

    def points_m(self) -> Float:
        """Its corners (N, 3) in its own plane z = 0, metres, row by row."""
        grid = np.mgrid[: self.columns, : self.rows].T.reshape(-1, 2) * self.square_m
        return np.hstack([grid, np.zeros((len(grid), 1))])


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """The board's corners (N, 2) in both pictures of one frame, pixels, in the order of the board's points."""

    number: int
    left_px: Float
    right_px: Float


@dataclass(frozen=True, slots=True, kw_only=True)
class Dropped:
    """A frame that was not used, and why."""

    number: int
    reason: str


def find_views(pairs: Iterable[tuple[int, Image, Image]], board: Board) -> tuple[list[View], list[Dropped]]:
    """The board in every pair (frame number, left, right: (H, W, 3) RGB), and the pairs that do not show it twice."""
    views, dropped = [], []
    for number, left, right in pairs:
        found = {"left": find_corners(left, board), "right": find_corners(right, board)}
        if missing := [side for side, corners in found.items() if corners is None]:
            dropped.append(Dropped(number=number, reason=f"no board in the {' and the '.join(missing)} image"))
        elif found["left"] is not None and found["right"] is not None:
            views.append(View(number=number, left_px=found["left"], right_px=found["right"]))
    return views, dropped


def find_corners(image: Image, board: Board) -> Float | None:
    """The board's corners (N, 2) in one picture, to a fraction of a pixel; None where it is not seen whole."""
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    seen, corners = cv2.findChessboardCorners(gray, (board.columns, board.rows))
    if not seen:
        return None
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
    return cv2.cornerSubPix(gray, corners, (5, 5), (-1, -1), stop).reshape(-1, 2).astype(np.float64)
