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
from typing import Any, ClassVar

import cv2
import numpy as np

from vfoa.errors import VfoaError
from vfoa.stereo.block_matching_settings import BlockMatcherSettings, SemiGlobalMatcherSettings
from vfoa.stereo.cut import cropped, cut, enlarged, gray, in_frame
from vfoa.stereo.opencv_pair import SIXTEENTHS, PairMatcher
from vfoa.stereo.region import Region, whole
from vfoa.stereo.search import DisparityRange, disparity_range
from vfoa.stereo.views import both_views
from vfoa.stereo.wls import WlsFilter
from vfoa.types import Disparity, Map, StereoFrame, StereoRig

SGBM_MODES = {
    "sgbm": cv2.STEREO_SGBM_MODE_SGBM,
    "3way": cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    "hh": cv2.STEREO_SGBM_MODE_HH,
}
NO_LIMIT = 1_000_000


class _Matcher(ABC):
    """The steps of both matchers. Subclasses build OpenCV's object, which is kept until the rig changes."""

    discontinuity_blocks: ClassVar[float]

    def __init__(self, settings: BlockMatcherSettings | SemiGlobalMatcherSettings) -> None:
        self._common = settings
        self._factor = 2 if settings.resolution == "half" else 1
        self._rig: StereoRig | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle only the settings: OpenCV's objects cannot be pickled and are built again for the first frame."""
        return type(self), (self._common,)

    @abstractmethod
    def _create(self, disparities: DisparityRange) -> Any:
        """Return OpenCV's matcher of the left view."""

    def match(self, frame: StereoFrame) -> Disparity:
        """Match one pair (see :class:`vfoa.stereo.StereoMatcher`).

        Pixels are unknown without a match, with a match outside the right image, and with a low confidence.
        """
        return self._match_if_there_is_room(frame, whole(frame.rig))

    def match_region(self, frame: StereoFrame, region: Region) -> Disparity:
        """Match a region, and a margin, of one pair (see :class:`vfoa.stereo.RegionMatcher`)."""
        return self._match_if_there_is_room(frame, region.grown(self._common.region_margin_px, whole(frame.rig)))

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
        reached = self._pair.reached(matched)  # the WLS filter compares both views in this region
        if self._common.wls:
            guide = cut(frame.left, reached.times(self._factor))
            sixteenths, confidence = self._wls.filter(*self._pair.both(left, right, matched, reached), guide)
        else:
            sixteenths, confidence = enlarged(self._pair.left(left, right, matched, reached), self._factor), None
        origin = reached.times(self._factor)
        disparity: Map = np.divide(cropped(sixteenths, origin, region), SIXTEENTHS, dtype=np.float32)
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
        searched = self._range.shrunk(self._factor)
        left = self._create(searched)
        self._pair = PairMatcher(
            left_matcher=left,
            right_matcher=cv2.ximgproc.createRightMatcher(left),
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
