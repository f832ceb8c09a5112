"""Guided search: a match at half the resolution bounds the search of every pixel at full resolution.

1. The pair is matched at half the resolution, over the whole range of disparities.
2. The right view is warped by this coarse disparity. The remaining disparity is small everywhere.
3. The left view is matched against the warped one over 16 disparities, 8 to either side of the coarse one.

The bound is smooth within a surface and has steps at its edges. It is not rounded to whole pixels: with steps on a
slanted surface, blocks across a step would not match, which costs up to 0.1 px of accuracy.

A pixel is unknown where its match is not unique among the 16 disparities, and where the coarse match is not unique or
not the same in both views. Without the WLS filter, OpenCV makes these checks of the coarse match. The filter needs the
maps of both views: both are matched and compared here. The map of the right view is the enlarged coarse one; it serves
to check the left one.

The bound is unsure where the texture is too fine for half the resolution and few matches are found. There, the whole
range is searched at full resolution. If that is more than half of the region, all of the region is matched in this way,
and the result is bit for bit that of a full search. The same holds if the range is so short that guiding would not save
time (:func:`pays`).

Each pixel, and not each tile, has its own bound because OpenCV's semi-global matching costs about as much per pixel as
44 disparities, whatever its range is (:data:`PIXEL_COST`), and because a tile with near and far objects needs a range
for both. Rectangles with ranges of their own would take 55 to 90 % of the time of a full search on Sintel's bandage_2
and on rendered clips. One level more, at a quarter of the resolution, would save a tenth of the time, and leave 5 %
more of the pixels of bandage_2 unknown. For the filter, taking the coarse right map from the left one would save a
sixth, and leave more wrong pixels among fewer known ones.
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

PASSES_COST = 25
"""Cost per pixel of all that a guided search does beside matching, in disparities."""

REMAINDER = DisparityRange(first_px=-8, count=16)
"""Range that is searched around the coarse disparity."""

COARSE_UNIQUENESS_PERCENT = 15
"""With the WLS filter: how much more the next best coarse match must cost for a pixel to be known."""

MEDIAN_PX = 5
"""Width of the median filter that removes single wrong pixels from the coarse disparity."""

SMOOTHED_PX = 9
"""Width of the window over which the coarse disparity is averaged if it holds no edge."""

EDGE = 24
"""A window whose coarse disparities differ by more sixteenths of a pixel holds an edge."""

MARGIN_PX = 16
"""Margin matched around an area that needs the whole range: semi-global matching depends on more than a block."""


def pays(searched: DisparityRange, *, filtered: bool) -> bool:
    """Whether a guided search saves a tenth or more of matching the whole range, in both views for the filter.

    It depends on the range alone: all costs grow alike with the size of the image.
    """
    views = 2 if filtered else 1
    full = views * (PIXEL_COST + searched.count)
    coarse = views * (PIXEL_COST + searched.shrunk(FACTOR).count) / FACTOR**2
    return coarse + PIXEL_COST + REMAINDER.count + PASSES_COST <= 0.9 * full


@dataclass(frozen=True, slots=True, kw_only=True)
class GuidedSearch:
    """Matches the left view within the bounds of a coarse match.

    ``full`` searches the whole range at full resolution, and ``coarse`` at half of it. ``remainder`` is OpenCV's
    matcher for :data:`REMAINDER`. Coarse disparities of the two views agree if they differ by at most ``left_right_px``
    pixels of the full resolution. In a map of the left view alone, speckles are unknown: regions of fewer than
    ``speckle_size_px`` pixels, whose disparities differ by at most ``speckle_range_px`` between neighbours.
    """

    full: PairMatcher
    coarse: PairMatcher
    remainder: Any
    left_right_px: int
    speckle_size_px: int
    speckle_range_px: int

    def left(self, left: Gray, right: Gray, matched: Region, reached: Region) -> Sixteenths:
        """Disparities of the left view in ``reached`` (see :meth:`PairMatcher.left`)."""
        small = averaged(left, FACTOR), averaged(right, FACTOR)
        coarse_matched = matched.shrunk(FACTOR)
        coarse = self.coarse.left(*small, coarse_matched, coarse_matched)
        known = self._known(coarse)
        origin = coarse_matched.times(FACTOR)
        of_left = self._bounded(left, right, matched, reached, origin, _filled(coarse, known), known)
        if self.speckle_size_px:
            cv2.filterSpeckles(of_left, self._unknown, self.speckle_size_px, self.speckle_range_px * SIXTEENTHS)
        unsure = self._unsure(left, matched, cropped(of_left, reached, matched))
        if unsure is None:
            return self.full.left(left, right, matched, reached)
        for area in unsure:
            margin = area.grown(MARGIN_PX, matched)
            anew = self.full.left(left, right, margin, margin)
            cropped(of_left, reached, area)[:] = cropped(anew, margin, area)
        return of_left

    def both(self, left: Gray, right: Gray, matched: Region, reached: Region) -> tuple[Sixteenths, Sixteenths]:
        """Disparities of both views in ``reached`` (see :meth:`PairMatcher.both`)."""
        small = averaged(left, FACTOR), averaged(right, FACTOR)
        coarse_matched = matched.shrunk(FACTOR)
        coarse_reached = self.coarse.reached(coarse_matched)
        coarse_left, coarse_right = self.coarse.both(*small, coarse_matched, coarse_reached)
        known = self._known(coarse_left)
        coarse_left = _filled(coarse_left, known)
        origin = coarse_reached.times(FACTOR)
        sure = known & self._agree(coarse_left, coarse_right)
        of_left = self._bounded(left, right, matched, reached, origin, coarse_left, sure)
        unsure = self._unsure(left, matched, cropped(of_left, reached, matched))
        if unsure is None:
            return self.full.both(left, right, matched, reached)
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

    def _known(self, coarse: Sixteenths) -> Mask:
        """Whether each pixel (H, W) has a coarse match."""
        return np.asarray(coarse >= self.coarse.searched.first_px * SIXTEENTHS)

    def _agree(self, of_left: Sixteenths, of_right: Sixteenths) -> Mask:
        """Whether the disparity of each pixel (H, W) of the left view agrees with that of its match."""
        columns = np.arange(of_left.shape[1], dtype=np.int32) - _whole_pixels(of_left)
        of_match = _looked_up(of_right, np.maximum(columns, 0))
        agree = np.abs(of_left + of_match) * FACTOR <= self.left_right_px * SIXTEENTHS
        return np.asarray(agree & (columns >= 0))

    def _unsure(self, left: Gray, matched: Region, of_left: Sixteenths) -> list[Region] | None:
        """Areas that need the whole range; None if these are more than half of ``matched``."""
        areas = too_fine_areas(cut(left, matched), of_left >= self.full.searched.first_px * SIXTEENTHS)
        areas = [area.moved(matched.u0, matched.v0) for area in areas]
        return None if 2 * sum(area.size for area in areas) > matched.size else areas

    def _bounded(
        self, left: Gray, right: Gray, matched: Region, reached: Region, origin: Region, coarse: Sixteenths, sure: Mask
    ) -> Sixteenths:
        """Disparities of the left view in ``reached``, near the ``coarse`` ones, where these are ``sure``.

        ``origin`` is the region of the coarse maps, in pixels of the full resolution.
        """
        bound = cropped(_bound(coarse), origin, matched)
        of_left = np.full((reached.v1 - reached.v0, reached.u1 - reached.u0), self._unknown, np.int16)
        around, is_matched = self._around(left, right, matched, bound)
        np.copyto(
            cropped(of_left, reached, matched), around, where=is_matched & cropped(_repeated(sure), origin, matched)
        )
        return of_left

    def _around(self, left: Gray, right: Gray, matched: Region, bound: Map) -> tuple[Sixteenths, Mask]:
        """Disparities of the left view in ``matched``, at most 8 px from a ``bound``, and where there is a match."""
        given = with_edge(matched, self.full.block_size_px, before=REMAINDER.count // 2, after=REMAINDER.count // 2)
        beyond = (matched.v0 - given.v0, given.v1 - matched.v1, matched.u0 - given.u0, given.u1 - matched.u1)
        offsets = np.asarray(cv2.copyMakeBorder(bound, *beyond, cv2.BORDER_REPLICATE), dtype=np.float32)
        in_right = cut(right, Region(u0=0, v0=given.v0, u1=right.shape[1], v1=given.v1))
        columns = np.arange(given.u0, given.u1, dtype=np.float32)
        rows = np.repeat(np.arange(len(offsets), dtype=np.float32)[:, None], len(columns), axis=1)
        warped = _sampled(in_right, columns - offsets * np.float32(1 / SIXTEENTHS), rows)

        remainder = self.remainder.compute(cut(left, given), warped)
        # the column of the match in the warped view, which is moved by the offset there
        found_in = remainder * np.float32(-1 / SIXTEENTHS)
        found_in += columns - np.float32(given.u0)
        moved = _sampled(offsets, found_in, rows)
        of_left = np.asarray(cv2.add(remainder, moved, dtype=cv2.CV_16S), dtype=np.int16)
        searched = self.full.searched
        is_matched = remainder >= REMAINDER.first_px * SIXTEENTHS
        is_matched &= of_left >= searched.first_px * SIXTEENTHS
        is_matched &= of_left < searched.reach_px * SIXTEENTHS
        return cropped(of_left, given, matched), cropped(is_matched, given, matched)


def _bound(coarse: Sixteenths) -> Map:
    """Enlarge a coarse map to full resolution, in sixteenths: smooth within a surface, with steps at its edges."""
    steady = cv2.medianBlur(coarse, MEDIAN_PX).reshape(coarse.shape)
    window = np.ones((SMOOTHED_PX, SMOOTHED_PX), np.uint8)
    has_edge = cv2.dilate(steady, window) - cv2.erode(steady, window) > EDGE
    surface = steady.astype(np.float32)
    smooth = np.where(has_edge, surface, cv2.blur(surface, (SMOOTHED_PX, SMOOTHED_PX)))
    near = np.ones((3, 3), np.uint8)
    edge = (cv2.dilate(steady, near) - cv2.erode(steady, near) > EDGE).astype(np.uint8)
    size = (coarse.shape[1] * FACTOR, coarse.shape[0] * FACTOR)
    bound: Map = cv2.resize(smooth, size, interpolation=cv2.INTER_LINEAR)
    stepped = cv2.resize(smooth, size, interpolation=cv2.INTER_NEAREST)
    np.copyto(bound, stepped, where=cv2.resize(edge, size, interpolation=cv2.INTER_NEAREST) > 0)
    return bound * np.float32(FACTOR)


def _filled(coarse: Sixteenths, known: Mask) -> Sixteenths:
    """Give each unknown pixel (H, W) the farther one of the next known disparities in its row; 0 if there is none.

    Beside an edge, the unknown pixels are those of the background, which the other camera does not see.
    """
    width = coarse.shape[1]
    places = np.arange(width, dtype=np.int32)
    before = np.maximum.accumulate(np.where(known, places, -1), axis=1)
    after = np.minimum.accumulate(np.where(known, places, width)[:, ::-1], axis=1)[:, ::-1]
    none = np.iinfo(np.int16).max
    edged = cv2.copyMakeBorder(coarse, 0, 0, 1, 1, cv2.BORDER_CONSTANT, value=none)
    nearest = np.minimum(_looked_up(edged, before + 1), _looked_up(edged, after + 1))
    return np.asarray(np.where(nearest == none, np.int16(0), nearest))


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
