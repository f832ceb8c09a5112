"""OpenCV's block matching (Konolige 1998) and semi-global matching (Hirschmüller 2008), with or without WLS.

At half resolution the pair is averaged over 2 x 2 pixels and matched. Columns u of the half-size images are columns
2 u + 0.5 of the pair, on both sides, so that a disparity is exactly half as large. The WLS filter is given the
full-size image as its guide and brings the map back to full size, doubled, along the edges of that image; without WLS,
a match stands for its 2 x 2 pixels. Either way the result is in pixels of the full-size pair.

In a region, only its rows and columns (and a margin) are matched, against all that the right view has to offer them. A
block match is the same there as in the whole frame. What looks further than a block (semi-global matching, the WLS
filter, the checks for speckles and for the way back from the right view) forgets with distance, so that a margin makes
it nearly the same.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from vfoa.errors import VfoaError
from vfoa.stereo.block_matching_settings import BlockMatcherSettings, SemiGlobalMatcherSettings
from vfoa.stereo.cut import cropped, cut, enlarged, gray, in_frame
from vfoa.stereo.region import Region, whole
from vfoa.stereo.search import DisparityRange, disparity_range
from vfoa.stereo.wls import WlsFilter
from vfoa.types import Disparity, Map, StereoFrame, StereoRig

Gray = NDArray[np.uint8]
Sixteenths = NDArray[np.int16]

SGBM_MODES = {
    "sgbm": cv2.STEREO_SGBM_MODE_SGBM,
    "3way": cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    "hh": cv2.STEREO_SGBM_MODE_HH,
}
SIXTEENTHS = 16
"""OpenCV's matchers answer int16 disparities in sixteenths of a pixel."""

NO_LIMIT = 1_000_000


class _Matcher(ABC):
    """The course of both matchers; subclasses build OpenCV's object. It is built once and kept while the rig stays."""

    discontinuity_blocks: ClassVar[float]

    def __init__(self, settings: BlockMatcherSettings | SemiGlobalMatcherSettings) -> None:
        self._common = settings
        self._factor = 2 if settings.resolution == "half" else 1
        self._rig: StereoRig | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the settings alone: OpenCV's objects cannot be, and are built anew for the first frame."""
        return type(self), (self._common,)

    @abstractmethod
    def _create(self, disparities: DisparityRange) -> Any:
        """OpenCV's matcher of the left view."""

    def match(self, frame: StereoFrame) -> Disparity:
        """Match one pair (see :class:`vfoa.stereo.StereoMatcher`).

        Unknown are pixels without a match, with a match outside the right image, and of low confidence.
        """
        return self._match_if_there_is_room(frame, whole(frame.rig))

    def match_region(self, frame: StereoFrame, region: Region) -> Disparity:
        """Match a region, and a margin, of one pair (see :class:`vfoa.stereo.RegionMatcher`)."""
        return self._match_if_there_is_room(frame, region.grown(self._common.region_margin_px, frame.rig))

    def _match_if_there_is_room(self, frame: StereoFrame, region: Region) -> Disparity:
        try:
            return self._match(frame, region)
        except cv2.error as error:
            if error.code != cv2.Error.StsNoMem:
                raise
            size = f"{region.u1 - region.u0} x {region.v1 - region.v0} pixels"
            raise VfoaError(
                f"frame {frame.index}: no memory for matching {size} with {self._searched.count} disparities; "
                'expected a greater stereo.min_depth_m, stereo.resolution = "half", stereo.region = "needed" or, of '
                'sgbm, stereo.mode = "3way"'
            ) from None

    def _match(self, frame: StereoFrame, region: Region) -> Disparity:
        if region.is_empty:
            return in_frame(np.empty((0, 0), np.float32), None, region, frame.rig)
        if frame.rig != self._rig:
            self._prepare(frame.rig)
        left, right = (gray(image, self._factor) for image in (frame.left, frame.right))
        matched = region.shrunk(self._factor)
        # and the columns in which its matches may lie: the filter compares both views there
        reached = matched.from_column(max(matched.u0 - self._searched.reach_px, 0))
        if self._common.wls:
            guide = cut(frame.left, reached.times(self._factor))
            found, confidence = self._wls.filter(*self._match_both(left, right, matched, reached), guide)
        else:
            found, confidence = enlarged(self._match_left(left, right, matched, reached), self._factor), None
        origin = reached.times(self._factor)
        disparity: Map = np.divide(cropped(found, origin, region), SIXTEENTHS, dtype=np.float32)
        known = disparity > self._range.first_px
        known &= disparity <= np.arange(region.u0, region.u1, dtype=np.float32)
        if confidence is not None:
            confidence = cropped(confidence, origin, region)
            known &= confidence >= self._common.min_confidence
        np.copyto(disparity, np.nan, where=~known)
        return in_frame(disparity, confidence, region, frame.rig)

    def _prepare(self, rig: StereoRig) -> None:
        settings = self._common
        self._range = disparity_range(rig, settings.min_depth_m)
        self._searched = self._range.shrunk(self._factor)
        self._left_matcher = self._create(self._searched)
        if settings.wls:
            self._right_matcher = cv2.ximgproc.createRightMatcher(self._left_matcher)
            self._wls = WlsFilter(
                smoothness=settings.wls_lambda,
                sigma_color=settings.wls_sigma,
                discontinuity_radius_px=math.ceil(self.discontinuity_blocks * settings.block_size_px),
            )
        self._rig = rig

    def _match_both(self, left: Gray, right: Gray, matched: Region, reached: Region) -> tuple[Sixteenths, Sixteenths]:
        """Both views' disparities, side by side where this process may compute with several threads."""
        if cv2.getNumThreads() == 1:
            return self._match_left(left, right, matched, reached), self._match_right(left, right, reached)
        with ThreadPoolExecutor(1) as beside:
            of_right = beside.submit(self._match_right, left, right, reached)
            return self._match_left(left, right, matched, reached), of_right.result()

    def _match_left(self, left: Gray, right: Gray, matched: Region, reached: Region) -> Sixteenths:
        """The left view's disparities in ``reached``; what is not to be matched is below the range.

        OpenCV is blind in its first columns, as many as it searches: it is given so many more.
        """
        given = _with_edge(matched, self._common.block_size_px, before=self._searched.reach_px)
        found = self._left_matcher.compute(cut(left, given), cut(right, given))
        return np.ascontiguousarray(cropped(found, given, reached))

    def _match_right(self, left: Gray, right: Gray, reached: Region) -> Sixteenths:
        """The right view's disparities, which are negative. Here, OpenCV is blind in the last columns."""
        given = _with_edge(reached, self._common.block_size_px, after=self._searched.reach_px)
        found = self._right_matcher.compute(cut(right, given), cut(left, given))
        return np.ascontiguousarray(cropped(found, given, reached))


class BlockMatcher(_Matcher):
    """Block matching (``"bm"``): OpenCV's StereoBM, after Konolige 1998."""

    Settings = BlockMatcherSettings
    discontinuity_blocks = 0.33

    def __init__(self, settings: BlockMatcherSettings) -> None:
        super().__init__(settings)
        self._settings = settings

    def _create(self, disparities: DisparityRange) -> Any:
        settings = self._settings
        matcher = cv2.StereoBM.create(disparities.count, settings.block_size_px)
        matcher.setMinDisparity(disparities.first_px)
        matcher.setPreFilterCap(settings.pre_filter_cap)
        if settings.wls:
            matcher.setTextureThreshold(0)
            matcher.setUniquenessRatio(0)
        else:
            matcher.setTextureThreshold(settings.texture_threshold)
            matcher.setUniquenessRatio(settings.uniqueness_percent)
            matcher.setDisp12MaxDiff(settings.left_right_px)
            matcher.setSpeckleWindowSize(settings.speckle_size_px)
            matcher.setSpeckleRange(settings.speckle_range_px)
        return matcher


class SemiGlobalMatcher(_Matcher):
    """Semi-global matching (``"sgbm"``): OpenCV's StereoSGBM, after Hirschmüller 2008, on gray images."""

    Settings = SemiGlobalMatcherSettings
    discontinuity_blocks = 0.5

    def __init__(self, settings: SemiGlobalMatcherSettings) -> None:
        super().__init__(settings)
        self._settings = settings

    def _create(self, disparities: DisparityRange) -> Any:
        settings = self._settings
        area = settings.block_size_px**2
        matcher = cv2.StereoSGBM.create(
            minDisparity=disparities.first_px,
            numDisparities=disparities.count,
            blockSize=settings.block_size_px,
            P1=settings.p1 * area,
            P2=settings.p2 * area,
            preFilterCap=settings.pre_filter_cap,
            mode=SGBM_MODES[settings.mode],
        )
        if settings.wls:
            matcher.setDisp12MaxDiff(NO_LIMIT)
        else:
            matcher.setUniquenessRatio(settings.uniqueness_percent)
            matcher.setDisp12MaxDiff(settings.left_right_px)
            matcher.setSpeckleWindowSize(settings.speckle_size_px)
            matcher.setSpeckleRange(settings.speckle_range_px)
        return matcher


def _with_edge(region: Region, block_size_px: int, *, before: int = 0, after: int = 0) -> Region:
    """A region with all that decides on its matches, and columns before or after it.

    Around it, half a block, and a pixel more for the gradient that OpenCV takes of both views first. Of that gradient
    OpenCV leaves out the last of an odd number of rows: the number is made even.
    """
    edge_px = block_size_px // 2 + 1
    odd = (region.v1 - region.v0) % 2
    return Region(
        u0=region.u0 - edge_px - before,
        v0=region.v0 - edge_px,
        u1=region.u1 + edge_px + after,
        v1=region.v1 + edge_px + odd,
    )
