"""Guided search: a match at half the resolution bounds the search of every pixel at full resolution.

1. Both views are matched at half the resolution, over the whole range of disparities.
2. The right view is warped by this coarse disparity. The remaining disparity is small everywhere.
3. The left view is matched against the warped one over 16 disparities, 8 to either side of the coarse one. Without the
   WLS filter it is 32: uniqueness among few disparities says too little where there is no texture, and there the filter
   rejects what is left.

The bound is smooth within a surface and has steps at its edges. It is not rounded to whole pixels: with steps on a
slanted surface, blocks across a step would not match, which costs up to 0.1 px of accuracy.

A pixel is unknown where the coarse maps of the two views disagree, and where its match is not unique in the remaining
range. The map of the right view is the enlarged coarse one; it serves to check the left one.

The bound is unsure where the texture is too fine for half the resolution. There, both views are matched over the whole
range at full resolution. If that is more than half of the region, all of the region is matched in this way, and the
result is bit for bit that of a full search.

Each pixel, and not each tile, has its own bound because OpenCV's semi-global matching costs about as much per pixel as
44 disparities, whatever its range is (:data:`PIXEL_COST`), and because a tile with near and far objects needs a range
for both. Rectangles with ranges of their own would take 55 to 90 % of the time of a full search on Sintel's bandage_2
and on rendered clips. The same cost decides whether guiding pays (:func:`pays`). One level more, at a quarter of the
resolution, would save a tenth of the time, and leave 5 % more of the pixels of bandage_2 unknown. Taking the coarse
right map from the left one would save a sixth, and leave more wrong pixels among fewer known ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vfoa.stereo.cut import averaged, cropped, cut, enlarged
from vfoa.stereo.fine_texture import too_fine_areas
from vfoa.stereo.opencv_pair import SIXTEENTHS, Gray, PairMatcher, Sixteenths, with_edge
from vfoa.stereo.region import Region
from vfoa.stereo.search import DisparityRange
from vfoa.types import Map, Mask

FACTOR = 2
"""Factor by which the coarse match has fewer rows and columns."""

PIXEL_COST = 44
"""Cost of a pixel in OpenCV's semi-global matching beside that of its range, in disparities."""

PASSES_COST = 20
"""Cost per pixel of all that a guided search does beside matching, in disparities."""

MEDIAN_PX = 5
"""Width of the median filter that removes single wrong pixels from the coarse disparity."""

SMOOTHED_PX = 9
"""Width of the window over which the coarse disparity is averaged if it holds no edge."""

EDGE = 24
"""A window whose coarse disparities differ by more sixteenths of a pixel holds an edge."""

MARGIN_PX = 16
"""Margin matched around an area that needs the whole range: semi-global matching depends on more than a block."""


def remainder_range(*, filtered: bool) -> DisparityRange:
    """Return the range that is searched around the coarse disparity, with or without the WLS filter after it."""
    reach_px = 8 if filtered else 16
    return DisparityRange(first_px=-reach_px, count=2 * reach_px)


def pays(searched: DisparityRange, *, filtered: bool) -> bool:
    """Whether a guided search costs less than matching the whole range, in both views if a filter compares them.

    It depends on the range alone: all costs grow alike with the size of the image.
    """
    full = (2 if filtered else 1) * (PIXEL_COST + searched.count)
    coarse = 2 * (PIXEL_COST + searched.shrunk(FACTOR).count) / FACTOR**2
    return coarse + PIXEL_COST + remainder_range(filtered=filtered).count + PASSES_COST < full


@dataclass(frozen=True, slots=True, kw_only=True)
class GuidedSearch:
    """Matches the left view within the bounds of a coarse match.

    ``full`` searches the whole range at full resolution, and ``coarse`` at half of it. ``remainder_matcher`` is
    OpenCV's matcher for the ``remainder``, the range around the coarse disparity. Coarse disparities of the two views
    agree if they differ by at most ``left_right_px`` pixels of the full resolution.
    """

    full: PairMatcher
    coarse: PairMatcher
    remainder_matcher: Any
    remainder: DisparityRange
    left_right_px: int

    def both(self, left: Gray, right: Gray, matched: Region, reached: Region) -> tuple[Sixteenths, Sixteenths]:
        """Disparities of both views in ``reached`` (see :meth:`PairMatcher.both`)."""
        coarse_matched = matched.shrunk(FACTOR)
        coarse_reached = self.coarse.reached(coarse_matched)
        small = averaged(left, FACTOR), averaged(right, FACTOR)
        coarse_left, coarse_right = self.coarse.both(*small, coarse_matched, coarse_reached)

        origin = coarse_reached.times(FACTOR)
        sure = cropped(_repeated(self._agree(coarse_left, coarse_right)), origin, matched)
        unsure = [area.moved(matched.u0, matched.v0) for area in too_fine_areas(cut(left, matched), sure)]
        if 2 * sum(area.size for area in unsure) > matched.size:
            return self.full.both(left, right, matched, reached)

        bound = cropped(_bound(coarse_left), origin, matched)
        of_left = np.full((reached.v1 - reached.v0, reached.u1 - reached.u0), self._unknown, np.int16)
        np.copyto(cropped(of_left, reached, matched), self._around(left, right, matched, bound), where=sure)
        of_right = np.ascontiguousarray(cropped(enlarged(coarse_right, FACTOR), origin, reached))
        for area in unsure:
            margin = area.grown(MARGIN_PX, matched)
            columns = self.full.reached(margin)
            anew_left, anew_right = self.full.both(left, right, margin, columns)
            cropped(of_left, reached, area)[:] = cropped(anew_left, columns, area)
            seen = area.from_column(columns.u0)
            cropped(of_right, reached, seen)[:] = cropped(anew_right, columns, seen)
        return of_left, of_right

    @property
    def _unknown(self) -> int:
        """The disparity, in sixteenths, that OpenCV gives to a pixel without a match."""
        return (self.full.searched.first_px - 1) * SIXTEENTHS

    def _agree(self, of_left: Sixteenths, of_right: Sixteenths) -> Mask:
        """Whether the disparity of each pixel (H, W) of the left view agrees with that of its match."""
        columns = np.arange(of_left.shape[1], dtype=np.int32) - _whole_pixels(of_left)
        of_match = _looked_up(of_right, np.maximum(columns, 0))
        agree = np.abs(of_left + of_match) * FACTOR <= self.left_right_px * SIXTEENTHS
        return np.asarray(agree & (columns >= 0))

    def _around(self, left: Gray, right: Gray, matched: Region, bound: Map) -> Sixteenths:
        """Disparities of the left view in ``matched``, within the remainder around a ``bound`` in pixels."""
        reach_px = self.remainder.count // 2
        given = with_edge(matched, self.full.block_size_px, before=reach_px, after=reach_px)
        beyond = (matched.v0 - given.v0, given.v1 - matched.v1, matched.u0 - given.u0, given.u1 - matched.u1)
        offsets = np.asarray(cv2.copyMakeBorder(bound, *beyond, cv2.BORDER_REPLICATE), dtype=np.float32)
        in_right = cut(right, Region(u0=0, v0=given.v0, u1=right.shape[1], v1=given.v1))
        columns = np.arange(given.u0, given.u1, dtype=np.float32)
        rows = np.repeat(np.arange(len(offsets), dtype=np.float32)[:, None], len(columns), axis=1)
        warped = _sampled(in_right, columns - offsets, rows)

        remainder = self.remainder_matcher.compute(cut(left, given), warped)
        # the column of the match in the warped view, which is moved by the offset there
        found_in = remainder * np.float32(-1 / SIXTEENTHS)
        found_in += columns - np.float32(given.u0)
        moved = _sampled(offsets, found_in, rows)
        moved *= np.float32(SIXTEENTHS)
        found = remainder + np.rint(moved, out=moved).astype(np.int16)
        unmatched = remainder < self.remainder.first_px * SIXTEENTHS
        unmatched |= found < self.full.searched.first_px * SIXTEENTHS
        unmatched |= found >= self.full.searched.reach_px * SIXTEENTHS
        np.copyto(found, self._unknown, where=unmatched)
        return cropped(found, given, matched)


def _bound(coarse: Sixteenths) -> Map:
    """Enlarge a coarse map to full resolution, in pixels: smooth within a surface, with steps at its edges."""
    steady = cv2.medianBlur(coarse, MEDIAN_PX).reshape(coarse.shape)
    window = np.ones((SMOOTHED_PX, SMOOTHED_PX), np.uint8)
    has_edge = cv2.dilate(steady, window) - cv2.erode(steady, window) > EDGE
    surface = steady.astype(np.float32)
    smooth = np.where(has_edge, surface, cv2.blur(surface, (SMOOTHED_PX, SMOOTHED_PX)))
    near = np.ones((3, 3), np.uint8)
    edge = (cv2.dilate(steady, near) - cv2.erode(steady, near) > EDGE).astype(np.uint8)
    size = (coarse.shape[1] * FACTOR, coarse.shape[0] * FACTOR)
    found: Map = cv2.resize(smooth, size, interpolation=cv2.INTER_LINEAR)
    stepped = cv2.resize(smooth, size, interpolation=cv2.INTER_NEAREST)
    np.copyto(found, stepped, where=cv2.resize(edge, size, interpolation=cv2.INTER_NEAREST) > 0)
    return found * np.float32(FACTOR / SIXTEENTHS)


def _sampled(values: NDArray[Any], columns: Map, rows: Map) -> NDArray[Any]:
    """Values interpolated linearly at other places (H, N); beyond the last one its value is repeated."""
    return np.asarray(cv2.remap(values, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def _whole_pixels(disparities: Sixteenths) -> NDArray[np.int32]:
    """Round disparities in sixteenths to whole pixels."""
    return np.floor_divide(disparities + np.int16(SIXTEENTHS // 2), SIXTEENTHS, dtype=np.int32)


def _looked_up(values: NDArray[Any], columns: NDArray[np.int32]) -> NDArray[Any]:
    """Values (H, W) of the same row at other columns (H, N)."""
    first = np.arange(len(values), dtype=np.int32)[:, None] * values.shape[1]
    return np.take(values, columns + first)


def _repeated(mask: Mask) -> Mask:
    """Enlarge a coarse mask to full resolution."""
    return np.repeat(np.repeat(mask, FACTOR, axis=0), FACTOR, axis=1)
