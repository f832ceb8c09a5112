"""OpenCV's matchers of both views of a pair, at one resolution and in one range of disparities."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vfoa.stereo.cut import cropped, cut
from vfoa.stereo.region import Region
from vfoa.stereo.search import DisparityRange

Gray = NDArray[np.uint8]
Sixteenths = NDArray[np.int16]

SIXTEENTHS = 16
"""OpenCV's matchers return int16 disparities in sixteenths of a pixel."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairMatcher:
    """OpenCV's matcher of the left view and, if needed, its matcher of the right view.

    Disparities are int16 in sixteenths of a pixel. Pixels without a match have a value below the range.
    """

    left_matcher: Any
    right_matcher: Any
    searched: DisparityRange
    block_size_px: int

    def left(self, left: Gray, right: Gray, matched: Region, reached: Region) -> Sixteenths:
        """Return disparities of the left view in ``reached``; only those in ``matched`` are computed.

        OpenCV does not match the first columns, as many as the range of its search; the image is extended by as many.
        """
        given = with_edge(matched, self.block_size_px, before=self.searched.reach_px)
        of_left = self.left_matcher.compute(cut(left, given), cut(right, given))
        return np.ascontiguousarray(cropped(of_left, given, reached))

    def right(self, left: Gray, right: Gray, reached: Region) -> Sixteenths:
        """Return disparities of the right view, which are negative. Here OpenCV does not match the last columns."""
        given = with_edge(reached, self.block_size_px, after=self.searched.reach_px)
        of_right = self.right_matcher.compute(cut(right, given), cut(left, given))
        return np.ascontiguousarray(cropped(of_right, given, reached))

    def both(self, left: Gray, right: Gray, matched: Region, reached: Region) -> tuple[Sixteenths, Sixteenths]:
        """Return disparities of both views, computed in parallel if this process may use several threads."""
        if cv2.getNumThreads() == 1:
            return self.left(left, right, matched, reached), self.right(left, right, reached)
        with ThreadPoolExecutor(1) as pool:
            of_right = pool.submit(self.right, left, right, reached)
            return self.left(left, right, matched, reached), of_right.result()

    def reached(self, matched: Region) -> Region:
        """Return a region extended by the columns to its left in which its matches may lie."""
        return matched.from_column(max(matched.u0 - self.searched.reach_px, 0))


def with_edge(region: Region, block_size_px: int, *, before: int = 0, after: int = 0) -> Region:
    """Return a region with all pixels that its matches depend on, and extra columns before or after it.

    The matches depend on half a block around the region, and on one pixel more for OpenCV's gradient. For an odd number
    of rows OpenCV skips the last row of that gradient: the number is made even.
    """
    edge_px = block_size_px // 2 + 1
    odd = (region.v1 - region.v0) % 2
    return Region(
        u0=region.u0 - edge_px - before,
        v0=region.v0 - edge_px,
        u1=region.u1 + edge_px + after,
        v1=region.v1 + edge_px + odd,
    )
