"""Settings of block matching and of semi-global matching."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from vfoa.settings import Settings


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

    With ``resolution = "half"``, images of half the size are matched: a quarter of the pixels, half the disparities.
    With ``region = "needed"``, only the region of things and heads with ``region_margin_px`` around it is.
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
    resolution: Literal["full", "half"] = "full"
    region: Literal["frame", "needed"] = "frame"
    region_margin_px: int = Field(default=16, ge=0)


class BlockMatcherSettings(BlockMatchingSettings):
    """Settings of :class:`vfoa.stereo.block_matching.BlockMatcher`."""

    block_size_px: Annotated[int, Field(ge=5, le=255), AfterValidator(_odd)] = 15
    pre_filter_cap: int = Field(default=31, ge=1, le=63)
    texture_threshold: int = Field(default=10, ge=0)


class SemiGlobalMatcherSettings(BlockMatchingSettings):
    """Settings of :class:`vfoa.stereo.block_matching.SemiGlobalMatcher`.

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
