"""OpenCV's block matching (Konolige 1998) and semi-global matching (Hirschmüller 2008), with or without WLS.

At half resolution the pair is averaged over 2 x 2 pixels and matched. Columns u of the half-size images are columns 2 u
+ 0.5 of the pair, on both sides, so that a disparity is exactly half as large. The WLS filter takes the full-size image
as its guide and returns a full-size map, doubled, with edges as in that image. Without WLS, each match stands for its 2
x 2 pixels. In both cases the result is in pixels of the full-size pair.

In a region, only its rows and columns (and a margin) are matched, against all columns of the right view that can hold
their match. A block match is the same there as in the whole frame. Semi-global matching, the WLS filter, the speckle
check and the left-right check depend on pixels beyond a block, but less with distance: with a margin their result is
nearly the same.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from threading import Lock
from typing import Any, ClassVar, Generic, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from vfoa.errors import VfoaError
from vfoa.geometry import disparity_from_depth
from vfoa.stereo.block_matching_settings import BlockMatcherSettings, SemiGlobalMatcherSettings
from vfoa.stereo.cut import both_views, cropped, cut, enlarged, gray, in_frame
from vfoa.stereo.region import Region, whole
from vfoa.types import Disparity, Image, Map, StereoFrame, StereoRig

SGBM_MODES = {
    "sgbm": cv2.STEREO_SGBM_MODE_SGBM,
    "3way": cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    "hh": cv2.STEREO_SGBM_MODE_HH,
}
NO_LIMIT = 1_000_000
Gray = NDArray[np.uint8]
Sixteenths = NDArray[np.int16]
MatcherSettings = TypeVar("MatcherSettings", bound=BlockMatcherSettings | SemiGlobalMatcherSettings)

SIXTEENTHS = 16
"""OpenCV's matchers return int16 disparities in sixteenths of a pixel."""
CONFIDENCE_SCALE = 255.0
"""OpenCV's confidence runs from 0 to 255."""
MOST_CHECKED_PX, MOST_CHECKED_CAP = 21, 31
"""Greatest block, and cap of gradients, with which OpenCV can check a block match from the right view. With larger ones
it writes sums of 32 bits and reads 16 (stereobm.cpp of 4.x and 5.0): the check would depend on what was in memory."""
PARTS = 2
"""OpenCV divides the image among its threads, and pixels beside a division differ by a sixteenth: it is always two."""


class _Matcher(ABC, Generic[MatcherSettings]):
    """The steps of both matchers. Subclasses build OpenCV's object, which is kept until the rig changes."""

    discontinuity_blocks: ClassVar[float]
    speckle_steps: ClassVar[int]
    """Number of OpenCV's steps in a pixel of the range of speckles."""

    def __init__(self, settings: MatcherSettings) -> None:
        self._settings = settings
        self._factor = 2 if settings.resolution == "half" else 1
        self._rig: StereoRig | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle only the settings: OpenCV's objects cannot be pickled and are built again for the first frame."""
        return type(self), (self._settings,)

    @abstractmethod
    def _build(self, disparities: DisparityRange) -> Any:
        """Return OpenCV's matcher of one view, which keeps every match."""

    def _let_check(self, matcher: Any) -> None:
        """Let OpenCV's matcher drop what is matched otherwise from the right view, and speckles."""
        matcher.setDisp12MaxDiff(self._settings.left_right_px)
        matcher.setSpeckleWindowSize(self._settings.speckle_size_px)
        matcher.setSpeckleRange(self.speckle_steps * self._settings.speckle_range_px)

    def _create(self, disparities: DisparityRange) -> Any:
        """Return OpenCV's matcher of the left view."""
        matcher = self._build(disparities)
        if not self._settings.wls:
            matcher.setUniquenessRatio(self._settings.uniqueness_percent)
            self._let_check(matcher)
        return matcher

    def _checked(self, left: Gray, right: Gray, matched: Region, reached: Region) -> Sixteenths:
        """Return the disparities of the left view that pass all checks."""
        return self._pair.left(left, right, matched, reached)

    def match(self, frame: StereoFrame) -> Disparity:
        """Match one pair (see :class:`vfoa.stereo.StereoMatcher`).

        Pixels are unknown without a match, with a match outside the right image, and with a low confidence.
        """
        return self._match_if_there_is_room(frame, whole(frame.rig))

    def match_region(self, frame: StereoFrame, region: Region) -> Disparity:
        """Match a region, and a margin, of one pair (see :class:`vfoa.stereo.RegionMatcher`)."""
        return self._match_if_there_is_room(frame, region.grown(self._settings.region_margin_px, whole(frame.rig)))

    def _match_if_there_is_room(self, frame: StereoFrame, region: Region) -> Disparity:
        try:
            return self._match(frame, region)
        except cv2.error as error:
            if error.code != cv2.Error.StsNoMem:
                raise
            size = f"{region.u1 - region.u0} x {region.v1 - region.v0} pixels"
            raise VfoaError(
                f"frame {frame.index}: no memory for matching {size} with {self._pair.searched.count} disparities; "
                'expected a greater stereo.min_depth_m, stereo.resolution = "half", stereo.region = "needed" or, of '
                'sgbm, stereo.mode = "3way"'
            ) from None

    def _match(self, frame: StereoFrame, region: Region) -> Disparity:
        if region.is_empty:
            return in_frame(np.empty((0, 0), np.float32), None, region, frame.rig)
        if frame.rig != self._rig:
            self._prepare(frame.rig)
        left, right = (gray(image, self._factor) for image in both_views(frame))
        matched = region.shrunk(self._factor)
        # the WLS filter compares both views in this region
        reached = self._pair.reached(matched, whole(frame.rig).shrunk(self._factor))
        if self._settings.wls:
            guide = cut(frame.left, reached.times(self._factor))
            sixteenths, confidence = self._wls.filter(*self._pair.both(left, right, matched, reached), guide)
        else:
            sixteenths, confidence = enlarged(self._checked(left, right, matched, reached), self._factor), None
        origin = reached.times(self._factor)
        disparity: Map = np.divide(cropped(sixteenths, origin, region), SIXTEENTHS, dtype=np.float32)
        known = disparity > self._range.first_px
        columns_right = np.arange(region.u0, region.u1, dtype=np.float32) - disparity
        known &= (columns_right >= 0) & (columns_right <= frame.rig.width_px - 1)
        if confidence is not None:
            confidence = cropped(confidence, origin, region)
            known &= confidence >= self._settings.min_confidence
        np.copyto(disparity, np.nan, where=~known)
        return in_frame(disparity, confidence, region, frame.rig)

    def _prepare(self, rig: StereoRig) -> None:
        settings = self._settings
        self._range = disparity_range(rig, settings.min_depth_m)
        searched = self._range.shrunk(self._factor)
        self._pair = PairMatcher(
            left_matcher=self._create(searched),
            right_matcher=self._build(searched.of_right_view),
            searched=searched,
            block_size_px=settings.block_size_px,
        )
        if settings.wls:
            self._wls = WlsFilter(
                smoothness=settings.wls_lambda,
                sigma_color=settings.wls_sigma,
                discontinuity_radius_px=math.ceil(self.discontinuity_blocks * settings.block_size_px),
            )
        self._rig = rig


class BlockMatcher(_Matcher[BlockMatcherSettings]):
    """Block matching (``"bm"``): OpenCV's StereoBM, after Konolige 1998."""

    Settings = BlockMatcherSettings
    discontinuity_blocks = 0.33
    speckle_steps = SIXTEENTHS

    def _build(self, disparities: DisparityRange) -> Any:
        settings = self._settings
        matcher = cv2.StereoBM.create(disparities.count, settings.block_size_px)
        matcher.setMinDisparity(disparities.first_px)
        matcher.setPreFilterCap(settings.pre_filter_cap)
        matcher.setTextureThreshold(0)
        matcher.setUniquenessRatio(0)
        return matcher

    def _let_check(self, matcher: Any) -> None:
        matcher.setTextureThreshold(self._settings.texture_threshold)
        if self._opencv_checks:
            super()._let_check(matcher)

    @property
    def _opencv_checks(self) -> bool:
        settings = self._settings
        return settings.block_size_px <= MOST_CHECKED_PX and settings.pre_filter_cap <= MOST_CHECKED_CAP

    def _checked(self, left: Gray, right: Gray, matched: Region, reached: Region) -> Sixteenths:
        if self._opencv_checks:
            return super()._checked(left, right, matched, reached)
        settings = self._settings
        agreeing = self._pair.agreeing(*self._pair.both(left, right, matched, reached), settings.left_right_px)
        speckles = settings.speckle_size_px, self.speckle_steps * settings.speckle_range_px
        return np.asarray(cv2.filterSpeckles(agreeing, self._pair.searched.unknown, *speckles)[0])


class SemiGlobalMatcher(_Matcher[SemiGlobalMatcherSettings]):
    """Semi-global matching (``"sgbm"``): OpenCV's StereoSGBM, after Hirschmüller 2008, on gray images."""

    Settings = SemiGlobalMatcherSettings
    discontinuity_blocks = 0.5
    speckle_steps = 1

    def _build(self, disparities: DisparityRange) -> Any:
        settings = self._settings
        area = settings.block_size_px**2
        return cv2.StereoSGBM.create(
            minDisparity=disparities.first_px,
            numDisparities=disparities.count,
            blockSize=settings.block_size_px,
            P1=settings.p1 * area,
            P2=settings.p2 * area,
            disp12MaxDiff=NO_LIMIT,
            preFilterCap=settings.pre_filter_cap,
            mode=SGBM_MODES[settings.mode],
        )


# The range of disparities


@dataclass(frozen=True, slots=True, kw_only=True)
class DisparityRange:
    """The disparities ``first_px`` to ``first_px + count - 1``; OpenCV needs a ``count`` that is a multiple of 16.

    They are negative for what is farther away than the point in which the axes of the two images cross.
    """

    first_px: int
    count: int

    @property
    def reach_px(self) -> int:
        """Greatest distance to the left of a pixel's column at which its match can be."""
        return max(self.first_px + self.count, 0)

    @property
    def reach_right_px(self) -> int:
        """The same to the right."""
        return max(-self.first_px, 0)

    @property
    def of_right_view(self) -> DisparityRange:
        """The range of the right view's disparities, which have the other sign."""
        return DisparityRange(first_px=1 - self.first_px - self.count, count=self.count)

    @property
    def unknown(self) -> int:
        """OpenCV's value of a pixel without a match, sixteenths of a pixel."""
        return SIXTEENTHS * (self.first_px - 1)

    def shrunk(self, factor: int) -> DisparityRange:
        """Return the range in an image with ``factor`` times fewer columns."""
        first, end = self.first_px // factor, -(-(self.first_px + self.count) // factor)
        return DisparityRange(first_px=first, count=16 * math.ceil((end - first) / 16))


def disparity_range(rig: StereoRig, min_depth_m: float) -> DisparityRange:
    """Return the disparities of all depths between ``min_depth_m`` and infinity on a rig.

    The range goes from the disparity of infinity, which is 0 unless the principal points differ, to fx B / z -
    (cx_right - cx), rounded up to the next multiple of 16, and never beyond the image's width.

    Raises
    ------
    VfoaError
        If nothing at that depth has a disparity in the image.
    """
    first = max(math.floor(rig.cx_px - rig.cx_right_px), 1 - rig.width_px)
    last = min(math.ceil(float(disparity_from_depth(min_depth_m, rig))), rig.width_px - 1)
    if last <= first:
        raise VfoaError(
            f"stereo.min_depth_m: expected a depth with a disparity above {first} px on this rig, "
            f"found {min_depth_m} m, which has {last} px"
        )
    return DisparityRange(first_px=first, count=16 * math.ceil((last - first + 1) / 16))


# Both views


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

        OpenCV does not match the columns at an edge, as many as its search reaches; the image is extended by as many.
        """
        before, after = self.searched.reach_px, self.searched.reach_right_px
        given = with_edge(matched, self.block_size_px, before=before, after=after)
        of_left = self.left_matcher.compute(cut(left, given), cut(right, given))
        return np.ascontiguousarray(cropped(of_left, given, reached))

    def right(self, left: Gray, right: Gray, reached: Region) -> Sixteenths:
        """Return disparities of the right view, which have the other sign, so that the edges are exchanged."""
        before, after = self.searched.reach_right_px, self.searched.reach_px
        given = with_edge(reached, self.block_size_px, before=before, after=after)
        of_right = self.right_matcher.compute(cut(right, given), cut(left, given))
        return np.ascontiguousarray(cropped(of_right, given, reached))

    def both(self, left: Gray, right: Gray, matched: Region, reached: Region) -> tuple[Sixteenths, Sixteenths]:
        """Return disparities of both views, computed in parallel if this process may use several threads."""
        if cv2.getNumThreads() == 1:
            return self.left(left, right, matched, reached), self.right(left, right, reached)
        with ThreadPoolExecutor(1) as pool:
            of_right = pool.submit(self.right, left, right, reached)
            return self.left(left, right, matched, reached), of_right.result()

    def agreeing(self, of_left: Sixteenths, of_right: Sixteenths, most_px: int) -> Sixteenths:
        """Return the left view's disparities; unknown where the right view's differ by more whole pixels than that."""
        left_px, right_px = (_whole_px(disparities) for disparities in (of_left, of_right))
        columns = np.arange(of_left.shape[1]) - left_px
        inside = (columns >= 0) & (columns < of_left.shape[1])
        back_px = np.take_along_axis(right_px, np.where(inside, columns, 0), axis=1)
        agrees = inside & (back_px >= self.searched.of_right_view.first_px) & (np.abs(left_px + back_px) <= most_px)
        return np.where(agrees, of_left, self.searched.unknown).astype(np.int16)

    def reached(self, matched: Region, limits: Region) -> Region:
        """Return a region extended by the columns in which its matches may lie, clipped to the limits."""
        return replace(
            matched,
            u0=max(matched.u0 - self.searched.reach_px, limits.u0),
            u1=min(matched.u1 + self.searched.reach_right_px, limits.u1),
        )


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


def _whole_px(disparities: Sixteenths) -> NDArray[np.intp]:
    """The nearest whole numbers of pixels."""
    return (disparities.astype(np.intp) + SIXTEENTHS // 2) // SIXTEENTHS


# Smoothing within the edges of the image (weighted least squares, Min et al. 2014)


_in_parts = Lock()


@contextmanager
def _parts() -> Iterator[None]:
    """Let OpenCV divide an image into :data:`PARTS` in this block, whatever the number of its threads is."""
    with _in_parts:
        threads = cv2.getNumThreads()
        cv2.setNumThreads(PARTS)
        try:
            yield
        finally:
            cv2.setNumThreads(threads)


class WlsFilter:
    """OpenCV's WLS filter with its confidence: agreement of the two views' maps, and their local variance.

    The guide is the colour image: a gray one smears dark scenes. Pixels up to ``discontinuity_radius_px`` from a depth
    edge have a lower confidence.
    """

    def __init__(self, *, smoothness: float, sigma_color: float, discontinuity_radius_px: int) -> None:
        self._filter: Any = cv2.ximgproc.createDisparityWLSFilterGeneric(True)
        self._filter.setLambda(smoothness)
        self._filter.setSigmaColor(sigma_color)
        self._filter.setDepthDiscontinuityRadius(discontinuity_radius_px)

    def filter(self, left: NDArray[np.int16], right: NDArray[np.int16], guide: Image) -> tuple[NDArray[np.int16], Map]:
        """Filter the left view's map by the right view's.

        Parameters
        ----------
        left, right
            (H, W) raw disparities of both views in sixteenths of a pixel; the right view's are negative.
        guide
            (H, W, 3) the left image.

        Returns
        -------
        The filtered map in sixteenths, every pixel filled, and its confidence (H, W) in [0, 1].
        """
        height, width = left.shape
        with _parts():
            filtered = self._filter.filter(left, guide, disparity_map_right=right, ROI=(0, 0, width, height))
        return filtered, self._filter.getConfidenceMap() / np.float32(CONFIDENCE_SCALE)
