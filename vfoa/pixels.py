"""Maps of ids, parts of the image, and the points of their pixels in space."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vfoa.geometry import back_project, depth_from_disparity
from vfoa.types import Disparity, Float, Instances, Mask, StereoRig

GOLDEN_RATIO = (math.sqrt(5) - 1) / 2

Window = tuple[slice, slice]
"""Rows and columns of a part of the image."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewMaps:
    """The disparities and the masks of one view: the input of clouds and eye origins."""

    disparity: Disparity
    instances: Instances
    rig: StereoRig


def relabel(ids: NDArray[np.unsignedinteger], numbers: Mapping[int, int]) -> NDArray[np.uint16]:
    """Convert an id map (H, W) to the number of each id, in 16 bits; an id without one becomes 0, no instance."""
    table = np.zeros(int(ids.max(initial=0)) + 1, np.uint16)
    for id_, number in numbers.items():
        if id_ < len(table):
            table[id_] = number
    return table.take(ids)  # in two thirds of the time of table[ids]


def window_of(u0: float, v0: float, u1: float, v1: float, rig: StereoRig) -> Window:
    """Rows and columns of the pixels whose centres lie in a region, clipped to the image."""
    rows, columns = (
        slice(min(max(math.ceil(low), 0), size), min(max(math.floor(high) + 1, 0), size))
        for low, high, size in ((v0, v1, rig.height_px), (u0, u1, rig.width_px))
    )
    return rows, columns


def known_pixels(mask: Mask, window: Window, seen: ViewMaps, *, most: int | None = None) -> NDArray[np.intp]:
    """Pixels (N, 2), as (v, u), where the mask of a window is set and the disparity is known.

    With ``most``, at most that many of them, spread evenly.
    """
    rows, columns = window
    places = np.flatnonzero(mask & np.isfinite(seen.disparity.disparity_px[window]))
    if most is not None:
        places = _thinned(places, most)
    v, u = np.unravel_index(places, mask.shape)
    return np.column_stack([v + rows.start, u + columns.start])


def _thinned(places: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """Choose at most ``count`` of the places, spread evenly by the golden ratio.

    A constant step could coincide with the row length of a mask and always miss the same columns.
    """
    if len(places) <= count:
        return places
    fractions = np.arange(count) * GOLDEN_RATIO % 1
    chosen = np.zeros(len(places), np.bool_)
    chosen[(fractions * len(places)).astype(np.intp)] = True
    return places[chosen]


def points_of(pixels: NDArray[np.intp], seen: ViewMaps) -> Float:
    """Points (N, 3), metres, camera frame, of pixels (v, u); pixels whose disparity gives no depth are left out."""
    v, u = pixels.T
    depth = depth_from_disparity(seen.disparity.disparity_px[v, u], seen.rig)
    points = back_project(u, v, depth, seen.rig)
    return points[np.isfinite(depth)]
