"""Settings of block matching and of semi-global matching."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from vfoa.settings import CountsWith, Settings

_MOST_PENALTY = 2**14
"""Greatest penalty of a block: OpenCV adds costs in 16 bits, and matched nothing, or wrongly, from about 2^15 on."""


def _odd(value: int) -> int:
    if value % 2 == 0:
        raise ValueError(f"expected an odd number, found {value}")
    return value


class BlockMatchingSettings(Settings):
    """Settings of both matchers.

    With ``wls``, a pixel is known if the two views agree and their maps are smooth around it. Without, it is known if
    its match is unique, if the right view has the same match, and if it is not in a speckle.
    """

    counts_with: ClassVar[CountsWith] = {
        **dict.fromkeys(
            ("uniqueness_percent", "left_right_px", "speckle_size_px", "speckle_range_px"), ("wls", (False,))
        ),
        **dict.fromkeys(("wls_lambda", "wls_sigma", "min_confidence"), ("wls", (True,))),
        "region_margin_px": ("region", ("needed",)),
    }

    min_depth_m: float = Field(default=0.45, gt=0)
    """Least depth that is searched; it bounds the disparities. Nearer objects are not matched."""
    uniqueness_percent: int = Field(default=10, ge=0, le=99)  # at 100, StereoSGBM divides by 0
    """Without ``wls``: how much more the next best match must cost for a pixel to be known."""
    left_right_px: int = Field(default=1, ge=0, le=100_000)
    """Without ``wls``: greatest difference of the two views' matches."""
    speckle_size_px: int = Field(default=100, ge=0, le=100_000_000)
    """Without ``wls``: regions of fewer pixels count as noise and are unknown."""
    speckle_range_px: int = Field(default=2, ge=1, le=100_000)
    """Without ``wls``: greatest difference in disparity between neighbouring pixels of one region."""
    wls: bool = True
    """Match both views, and smooth the left map along the edges of the colour image (weighted least squares)."""
    wls_lambda: float = Field(default=8000, gt=0)
    """With ``wls``: strength of the smoothing."""
    wls_sigma: float = Field(default=1.5, gt=0)
    """With ``wls``: strength of a colour edge that the map may change across; low values keep weak edges."""
    min_confidence: float = Field(default=0.5, ge=0, le=1)
    """With ``wls``: pixels with a lower confidence, 0 to 1, are unknown."""
    resolution: Literal["full", "half"] = "full"
    """``half``: match images of half the size, with a quarter of the pixels and half the disparities. Sizes and limits
    of blocks, speckles and differences are in their pixels."""
    region: Literal["frame", "needed"] = "frame"
    """``needed``: match only the region of objects and heads; ``frame``: match the whole frame."""
    region_margin_px: int = Field(default=16, ge=0)
    """Width of the margin around the needed region."""


class BlockMatcherSettings(BlockMatchingSettings):
    """Settings of :class:`vfoa.stereo.block_matching.BlockMatcher`."""

    counts_with: ClassVar[CountsWith] = {**BlockMatchingSettings.counts_with, "texture_threshold": ("wls", (False,))}

    block_size_px: Annotated[int, Field(ge=5, le=255), AfterValidator(_odd)] = 15
    """Side of the compared blocks; odd."""
    pre_filter_cap: int = Field(default=31, ge=1, le=63)
    """Greatest horizontal gradient; larger ones are clipped. Gradients are compared instead of gray values."""
    texture_threshold: int = Field(default=10, ge=0, le=100_000_000)
    """Without ``wls``: least texture of a block that is matched, the sum of its gradients."""


class SemiGlobalMatcherSettings(BlockMatchingSettings):
    """Settings of :class:`vfoa.stereo.block_matching.SemiGlobalMatcher`."""

    mode: Literal["sgbm", "3way", "hh"] = "3way"
    """Number of image paths along which costs are summed: ``3way`` three, ``sgbm`` five, ``hh`` eight."""
    block_size_px: Annotated[int, Field(ge=1, le=11), AfterValidator(_odd)] = 5
    """Side of the compared blocks; odd."""
    pre_filter_cap: int = Field(default=63, ge=1, le=63)
    """Greatest horizontal gradient; larger ones are clipped. Gradients are compared beside gray values."""
    p1: int = Field(default=8, ge=0)
    """Penalty of a disparity step of one between neighbours, per pixel of the block."""
    p2: int = Field(default=32, ge=1)
    """Penalty of a larger step, per pixel of the block; above ``p1``."""

    @model_validator(mode="after")
    def _penalties(self) -> Self:
        if self.p2 <= self.p1:
            raise ValueError(f"p2: expected more than p1 = {self.p1}, found {self.p2}")
        most = _MOST_PENALTY // self.block_size_px**2
        if self.p2 > most:
            raise ValueError(f"p2: expected at most {most} with block_size_px = {self.block_size_px}, found {self.p2}")
        return self
