"""Convert counts of a depth sensor to metres."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vfoa.types import Map

MILLIMETRES = 1000.0


def depth_map(counts: NDArray[Any], counts_per_m: float) -> Map:
    """Depth (H, W) float32 in metres; NaN where the sensor has 0, NaN, infinity or a negative number."""
    with np.errstate(all="ignore"):  # values that are no numbers, as in a damaged file
        values = counts.astype(np.float32) / np.float32(counts_per_m)
    return np.where((values > 0) & np.isfinite(values), values, np.float32(np.nan))


def default_counts_per_m(counts: NDArray[Any]) -> float:
    """The default unit: integers are millimetres and floating point numbers metres."""
    return MILLIMETRES if np.issubdtype(counts.dtype, np.integer) else 1.0
