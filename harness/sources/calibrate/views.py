"""A calibration board as both cameras see it, one view per pair of pictures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from harness.sources.stereo_views import Views
from vfoa.errors import VfoaError, did_you_mean
from vfoa.types import Float, Image

FEWEST_CORNERS = 3
"""Fewest corners in each direction of a chessboard that OpenCV finds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """Corners found: indices (N,) among the board's points, ascending, and pixels (N, 2)."""

    ids: NDArray[np.int64]
    pixels: Float


class Board(Protocol):
    """A grid of corners in the plane z = 0, row by row."""

    @property
    def corner_columns(self) -> int:
        """Corners in a row of the grid."""
        ...

    def points_m(self) -> Float:
        """All its corners (N, 3) in its own frame, metres."""
        ...

    def find(self, image: Image) -> Seen | None:
        """Find the corners in a picture (H, W, 3) RGB, to a fraction of a pixel; None if there are none."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Chessboard:
    """Columns and rows of inner corners, and the side of a square in metres. The whole board must be visible.

    Raises
    ------
    VfoaError
        If there are fewer than three in either direction.
    """

    columns: int
    rows: int
    square_m: float

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < FEWEST_CORNERS:
            raise VfoaError(
                f"chessboard: found {self.columns} x {self.rows} inner corners; expected at least {FEWEST_CORNERS} "
                "in each direction"
            )

    @property
    def corner_columns(self) -> int:
        """The number of columns."""
        return self.columns

    def points_m(self) -> Float:
        """The inner corners."""
        grid = np.mgrid[: self.columns, : self.rows].T.reshape(-1, 2) * self.square_m
        return np.hstack([grid, np.zeros((len(grid), 1))])

    def find(self, image: Image) -> Seen | None:
        """Find all corners or none."""
        gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        try:
            found, corners = cv2.findChessboardCorners(gray, (self.columns, self.rows))
        except cv2.error:  # a picture of only a few pixels
            return None
        if not found:
            return None
        stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
        corners = cv2.cornerSubPix(gray, corners, (5, 5), (-1, -1), stop).reshape(-1, 2)
        return Seen(ids=np.arange(len(corners)), pixels=corners.astype(np.float64))


@dataclass(frozen=True, slots=True, kw_only=True)
class CharucoBoard:
    """Columns and rows of squares, sides of a square and of a marker in metres, and OpenCV's dictionary of the markers.

    It may be partly visible. ``is_legacy``: boards with an even number of rows as OpenCV printed them before 4.6.

    Raises
    ------
    VfoaError
        If the dictionary is unknown or too small, or the marker does not fit into its square.
    """

    columns: int
    rows: int
    square_m: float
    marker_m: float
    dictionary: str = "DICT_5X5_100"
    is_legacy: bool = False
    _detector: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not 0 < self.marker_m < self.square_m:
            marker_mm, square_mm = self.marker_m * 1000, self.square_m * 1000
            raise VfoaError(f"marker: found {marker_mm:g} mm; expected less than the square's {square_mm:g} mm")
        markers = self.columns * self.rows // 2
        dictionary = _dictionary(self.dictionary)
        if len(dictionary.bytesList) < markers:
            raise VfoaError(
                f"{self.dictionary}: {len(dictionary.bytesList)} markers; expected at least {markers} for "
                f"{self.columns} x {self.rows} squares"
            )
        board = cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_m, self.marker_m, dictionary)
        board.setLegacyPattern(self.is_legacy)
        object.__setattr__(self, "_detector", cv2.aruco.CharucoDetector(board))

    @property
    def corner_columns(self) -> int:
        """One less than the number of squares."""
        return self.columns - 1

    def points_m(self) -> Float:
        """The corners at which four squares meet."""
        return np.asarray(self._detector.getBoard().getChessboardCorners(), dtype=np.float64)

    def find(self, image: Image) -> Seen | None:
        """Find the corners beside markers that were decoded."""
        corners, ids, _, _ = self._detector.detectBoard(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
        if ids is None or not len(ids):
            return None
        order = np.argsort(ids.ravel())
        pixels = np.asarray(corners, dtype=np.float64).reshape(-1, 2)[order]
        return Seen(ids=ids.ravel()[order].astype(np.int64), pixels=pixels)


def _dictionary(name: str) -> Any:
    known = {each for each in dir(cv2.aruco) if each.startswith("DICT_")}
    if name not in known:
        raise VfoaError(f"dictionary {name!r}; {did_you_mean(name, known)}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


REACH = 0.4
"""Length of a profile to each side, in sides of a square: long enough to reach plain black and plain white.

A marker inside the white square adds edges that are as wide as the square's own.
"""

STEP_PX = 0.5


def edge_width_px(image: Image, seen: Seen, corner_columns: int) -> float:
    """Width of the edges between neighbouring corners, pixels: the step's height over its greatest slope.

    The result is the greater of the medians along the two directions of the grid, since motion blurs only one. A sharp
    edge is 1 to 2 pixels wide; under a Gaussian blur, sqrt(2 pi) sigmas. NaN if no two corners are neighbours.
    """
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
    places = {int(id_): pixel for id_, pixel in zip(seen.ids, seen.pixels, strict=True)}
    along = [(i, i + 1) for i in places if i + 1 in places and (i + 1) % corner_columns]
    across = [(i, i + corner_columns) for i in places if i + corner_columns in places]
    widths = [
        float(np.median(_widths(gray, np.array([[places[i], places[j]] for i, j in pairs]))))
        for pairs in (along, across)
        if pairs
    ]
    return max(widths, default=float("nan"))


def _widths(gray: NDArray[np.float32], ends: Float) -> Float:
    """Widths of the edges (N, 2, 2) between two corners each, at their middles."""
    direction = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(direction, axis=1)
    normal = np.stack([-direction[:, 1], direction[:, 0]], axis=1) / length[:, None]
    reach = REACH * length
    steps = int(np.ceil(2 * reach.max() / STEP_PX)) + 1
    offsets = np.linspace(-1, 1, steps)[None, :, None] * reach[:, None, None]
    at = (ends.mean(axis=1)[:, None] + offsets * normal[:, None]).astype(np.float32)
    profiles = cv2.remap(gray, at[..., 0], at[..., 1], cv2.INTER_LINEAR).astype(np.float64)
    slope = np.abs(np.diff(profiles, axis=1)).max(axis=1) / (2 * reach / (steps - 1))
    height = profiles.max(axis=1) - profiles.min(axis=1)
    return np.asarray(height / np.maximum(slope, 1e-6))


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


class Pictures:
    """Pairs (number, left, right) of one size, in order; unusable ones are added to :attr:`dropped` as they are met.

    ``every``: use every Nth frame of a video. ``size_px`` is the (width, height) of the first pair that can be read.

    Raises
    ------
    VfoaError
        If no pair can be read.
    """

    def __init__(self, views: Views, every: int = 1) -> None:
        self._views, self._numbers = views, views.frames[::every]
        self.dropped: list[Dropped] = []
        self.size_px = (0, 0)
        if next(iter(self), None) is None:
            reasons = "; ".join(each.reason for each in self.dropped[:1])
            raise VfoaError(f"none of {len(self._numbers)} pairs of pictures can be read: {reasons}")

    def __iter__(self) -> Iterator[tuple[int, Image, Image]]:
        self.dropped.clear()
        for number in self._numbers:
            try:
                left, right = self._views.read(number)
            except VfoaError as error:
                self.dropped.append(Dropped(number=number, reason=str(error)))
                continue
            size_px = left.shape[1], left.shape[0]
            self.size_px = self.size_px if any(self.size_px) else size_px
            if size_px == self.size_px:
                yield number, left, right
            else:
                reason = f"{size_px} pixels; expected {self.size_px} as in the first pair"
                self.dropped.append(Dropped(number=number, reason=reason))
