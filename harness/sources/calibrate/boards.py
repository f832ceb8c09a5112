"""Calibration boards, and their corners in a picture."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

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
