"""OpenCV's block matching (Konolige 1998) and semi-global matching (Hirschmüller 2008), with or without WLS."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, Self

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, model_validator

from vfoa.errors import VfoaError
from vfoa.geometry import disparity_from_depth
from vfoa.settings import Settings
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


def _odd(value: int) -> int:
    if value % 2 == 0:
        raise ValueError(f"expected an odd number, found {value}")
    return value


class BlockMatchingSettings(Settings):
    """What both matchers share.

    Things nearer than ``min_depth_m`` are out of range. With ``wls``, both views are matched, the left map is
    smoothed under the guidance of the colour image, and pixels with a confidence (0 to 1) below ``min_confidence``
    are unknown. Without it, a pixel is known if its match is unique (the next best costs ``uniqueness_percent``
    more), is found again from the right view (to ``left_right_px``) and is no speckle.
    """

    min_depth_m: float = Field(default=0.45, gt=0)
    uniqueness_percent: int = Field(default=10, ge=0, le=100)
    left_right_px: int = Field(default=1, ge=0)
    speckle_size_px: int = Field(default=100, ge=0)
    speckle_range_px: int = Field(default=2, ge=1)
    wls: bool = True
    wls_lambda: float = Field(default=8000, gt=0)
    wls_sigma: float = Field(default=1.5, gt=0)
    min_confidence: float = Field(default=0.5, ge=0, le=1)


class BlockMatcherSettings(BlockMatchingSettings):
    """Settings of :class:`BlockMatcher`."""

    block_size_px: Annotated[int, Field(ge=5, le=255), AfterValidator(_odd)] = 15
    pre_filter_cap: int = Field(default=31, ge=1, le=63)
    texture_threshold: int = Field(default=10, ge=0)


class SemiGlobalMatcherSettings(BlockMatchingSettings):
    """Settings of :class:`SemiGlobalMatcher`.

    ``p1`` and ``p2`` are the penalties, per pixel of the block, of a disparity step of one and of more than one.
    ``3way`` follows three paths through the image, ``sgbm`` five and ``hh`` eight.
    """

    mode: Literal["sgbm", "3way", "hh"] = "3way"
    block_size_px: Annotated[int, Field(ge=1, le=11), AfterValidator(_odd)] = 5
    pre_filter_cap: int = Field(default=63, ge=1, le=63)
    p1: int = Field(default=8, ge=0)
    p2: int = Field(default=32, ge=1)

    @model_validator(mode="after")
    def _penalties(self) -> Self:
        if self.p2 <= self.p1:
            raise ValueError(f"p2: expected more than p1 = {self.p1}, found {self.p2}")
        return self


@dataclass(frozen=True, slots=True, kw_only=True)
class DisparityRange:
    """The disparities ``first_px`` to ``first_px + count - 1``; ``count`` is a multiple of 16, as OpenCV wants it."""

    first_px: int
    count: int


def disparity_range(rig: StereoRig, min_depth_m: float) -> DisparityRange:
    """The disparities of all that a rig sees between ``min_depth_m`` and infinity.

    From 0, or from the disparity of infinity where the principal points differ, to fx B / z - (cx_right - cx), up
    to the next 16, and never beyond the image's width.

    Raises
    ------
    VfoaError
        If nothing at that depth has a positive disparity.
    """
    first = max(0, math.floor(rig.cx_px - rig.cx_right_px))
    last = min(math.ceil(float(disparity_from_depth(min_depth_m, rig))), rig.width_px - 1)
    if last <= first:
        raise VfoaError(
            f"stereo.min_depth_m: expected a depth with a disparity above {first} px on this rig, "
            f"found {min_depth_m} m, which has {last} px"
        )
    return DisparityRange(first_px=first, count=16 * math.ceil((last - first + 1) / 16))


class _Matcher(ABC):
    """The course of both matchers; subclasses build OpenCV's object. It is built once and kept while the rig stays."""

    discontinuity_blocks: ClassVar[float]

    def __init__(self, settings: BlockMatcherSettings | SemiGlobalMatcherSettings) -> None:
        self._common = settings
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
        if frame.rig != self._rig:
            self._prepare(frame.rig)
        left, right = (cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (frame.left, frame.right))
        found, confidence = self._match_left(left, right), None
        if self._common.wls:
            found, confidence = self._wls.filter(found, self._match_right(left, right), frame.left)
        disparity: Map = found.astype(np.float32) / np.float32(SIXTEENTHS)
        known = (disparity > self._range.first_px) & (disparity <= np.arange(frame.rig.width_px))
        if confidence is not None:
            known &= confidence >= self._common.min_confidence
        disparity[~known] = np.nan
        return Disparity(disparity_px=disparity, confidence=confidence)

    def _prepare(self, rig: StereoRig) -> None:
        settings = self._common
        self._range = disparity_range(rig, settings.min_depth_m)
        self._left_matcher = self._create(self._range)
        if settings.wls:
            self._right_matcher = cv2.ximgproc.createRightMatcher(self._left_matcher)
            self._wls = WlsFilter(
                smoothness=settings.wls_lambda,
                sigma_color=settings.wls_sigma,
                discontinuity_radius_px=math.ceil(self.discontinuity_blocks * settings.block_size_px),
            )
        self._rig = rig

    def _match_left(self, left: Gray, right: Gray) -> Sixteenths:
        """Match the left view. OpenCV is blind in its first columns, as many as it searches, so they are padded."""
        search, edge = self._range.first_px + self._range.count, self._common.block_size_px // 2
        found = self._left_matcher.compute(_padded(left, edge, before=search), _padded(right, edge, before=search))
        return _cropped(found, edge + search, edge, left.shape)

    def _match_right(self, left: Gray, right: Gray) -> Sixteenths:
        """Match the right view, whose blind columns are the last ones. Its disparities are negative."""
        search, edge = self._range.first_px + self._range.count, self._common.block_size_px // 2
        found = self._right_matcher.compute(_padded(right, edge, after=search), _padded(left, edge, after=search))
        return _cropped(found, edge, edge, left.shape)


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


def _padded(image: Gray, edge: int, *, before: int = 0, after: int = 0) -> Gray:
    return cv2.copyMakeBorder(image, edge, edge, edge + before, edge + after, cv2.BORDER_REPLICATE)


def _cropped(disparity: Sixteenths, first_column: int, first_row: int, shape: tuple[int, ...]) -> Sixteenths:
    height, width = shape
    crop = disparity[first_row : first_row + height, first_column : first_column + width]
    return np.ascontiguousarray(crop)
