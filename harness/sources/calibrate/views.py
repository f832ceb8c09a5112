"""A board seen by both cameras at once, one view per pair of pictures; pairs that do not show it well are dropped."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.sources.calibrate.boards import Board
from harness.sources.calibrate.sharpness import edge_width_px
from vfoa.types import Float, Image

MIN_CORNERS = 8
"""Twice as many as a homography needs, so that a wrong corner shows."""

MAX_EDGE_PX = 4.0
"""Wider edges count as blurred: OpenCV's sample pictures have 2.1 to 3.0; under a Gaussian of 1.5 px, 4.4 to 4.8."""


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """Corners that both pictures of a frame show: the board's points (N, 3), metres, and pixels (N, 2)."""

    number: int
    points_m: Float
    left_px: Float
    right_px: Float


@dataclass(frozen=True, slots=True, kw_only=True)
class Dropped:
    """A frame that was not used, and the reason."""

    number: int
    reason: str


def find_views(
    pairs: Iterable[tuple[int, Image, Image]], board: Board, max_edge_px: float = MAX_EDGE_PX
) -> tuple[list[View], list[Dropped]]:
    """Find the board in every pair (frame number, left, right: (H, W, 3) RGB); also return the unusable pairs."""
    views, dropped = [], []
    for number, left, right in pairs:
        found = _view(number, left, right, board, max_edge_px)
        if isinstance(found, View):
            views.append(found)
        else:
            dropped.append(Dropped(number=number, reason=found))
    return views, dropped


def _view(number: int, left: Image, right: Image, board: Board, max_edge_px: float) -> View | str:
    """Return the view, or the reason why there is none."""
    seen_left, seen_right = board.find(left), board.find(right)
    if seen_left is None or seen_right is None:
        missing = [side for side, seen in (("left", seen_left), ("right", seen_right)) if seen is None]
        return f"no board in the {' and the '.join(missing)} image"
    shared, at_left, at_right = np.intersect1d(seen_left.ids, seen_right.ids, return_indices=True)
    if len(shared) < MIN_CORNERS:
        counts = f"{len(seen_left.ids)} left, {len(seen_right.ids)} right"
        return f"{len(shared)} corners are in both images ({counts}); expected at least {MIN_CORNERS}"
    if _are_in_line(shared, board.corner_columns):
        return "the corners in both images lie in one line; expected two rows and two columns of the board"
    for side, image, seen in (("left", left, seen_left), ("right", right, seen_right)):
        if (width := edge_width_px(image, seen, board.corner_columns)) > max_edge_px:
            return f"blurred in the {side} image: edges are {width:.1f} px wide; expected at most {max_edge_px:g}"
    return View(
        number=number,
        points_m=board.points_m()[shared],
        left_px=seen_left.pixels[at_left],
        right_px=seen_right.pixels[at_right],
    )


def _are_in_line(ids: NDArray[np.int64], columns: int) -> bool:
    """Whether the corners are collinear, so that they give no homography."""
    grid = np.stack([ids // columns, ids % columns], axis=1).astype(np.float64)
    return bool(np.linalg.matrix_rank(grid - grid.mean(axis=0)) < 2)
