"""Colour by 3D position: paint that stays on a moving body and looks the same from both cameras."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Colour = tuple[float, float, float]
Values = NDArray[np.float32]
Pattern = Literal["plain", "stripes", "checks", "wood", "dots", "blotches", "panels", "face", "eye", "dial"]

_GRAIN_CELLS = 96
_GRAIN_CELL_M = 0.0035
_GRAIN_DEPTH = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """Paint: a pattern of sRGB colours in [0, 1] that repeats every ``scale_m``, roughened by ``grain``.

    ``grain`` is the depth of a fine random texture: 0.1 is as smooth as glazed pottery; 0 is a painted wall without any
    texture that a matcher could use.
    """

    colours: tuple[Colour, ...]
    pattern: Pattern = "plain"
    scale_m: float = 0.05
    grain: float = 0.1

    def paint(self, points: Values) -> Values:
        """Linear albedo (N, 3) of points (N, 3) in the body's frame, metres."""
        palette = np.asarray(self.colours, dtype=np.float32) ** np.float32(2.2)
        albedo = palette[np.minimum(_PATTERNS[self.pattern](points, self.scale_m), len(palette) - 1)]
        if self.grain:
            albedo = albedo * (1 + np.float32(_GRAIN_DEPTH * self.grain) * grain(points))[:, None]
        return albedo


def shaded(colour: Colour, share: float) -> Colour:
    """A darker tone of a colour."""
    return (share * colour[0], share * colour[1], share * colour[2])


def grain(points: Values) -> Values:
    """Fine smooth noise (N,) in about [-1, 1] at points (N, 3), from a table that repeats every 0.34 m."""
    place = points * np.float32(1 / _GRAIN_CELL_M)
    whole = np.floor(place)
    x, y, z = np.ascontiguousarray((place - whole).T)
    i, j, k = np.ascontiguousarray(whole.T).astype(np.int32) % np.int32(_GRAIN_CELLS)
    # The table is padded by one cell on each side, so the upper neighbour is one step on.
    dy = _GRAIN_CELLS + 1
    dx = dy * dy
    at = (i * dy + j) * dy + k
    table = _grain_table()

    def between(first: int) -> Values:
        low = table.take(at + first)
        return low + (table.take(at + (first + dx)) - low) * x

    near, far = between(0), between(1)
    near += (between(dy) - near) * y
    far += (between(dy + 1) - far) * y
    return near + (far - near) * z


@cache
def _grain_table() -> Values:
    """Noise of three octaves on a periodic grid, flattened, padded by one cell."""
    rng = np.random.default_rng(20)
    n = _GRAIN_CELLS
    total = np.zeros((n, n, n), dtype=np.float32)
    for step in (1, 3, 12):
        coarse = rng.uniform(-1, 1, (n // step,) * 3).astype(np.float32)
        total += coarse.repeat(step, 0).repeat(step, 1).repeat(step, 2)
    total /= np.float32(np.abs(total).max() * 0.7)
    return np.pad(total, (0, 1), mode="wrap").ravel()


def _plain(points: Values, scale: float) -> NDArray[np.int64]:
    return np.zeros(len(points), dtype=np.int64)


def _stripes(points: Values, scale: float) -> NDArray[np.int64]:
    return np.floor(points[:, 0] / scale).astype(np.int64) % 2


def _bands(points: Values, scale: float) -> NDArray[np.int64]:
    """Horizontal bands, of growing colour index from below."""
    return np.maximum(np.floor(points[:, 2] / scale).astype(np.int64), 0)


def _checks(points: Values, scale: float) -> NDArray[np.int64]:
    cells = np.floor(points[:, :2] / scale).astype(np.int64) % 2
    return cells[:, 0] + cells[:, 1]


def _wood(points: Values, scale: float) -> NDArray[np.int64]:
    x, y, z = points.T
    wave = y + np.float32(0.012) * np.sin(x * 9) + np.float32(0.004) * np.sin(x * 31 + y * 40) + np.float32(0.3) * z
    return (np.floor(wave / scale * 5).astype(np.int64) * 7 % 11) % 3


def _dots(points: Values, scale: float) -> NDArray[np.int64]:
    offset = (points / scale) % 1 - 0.5
    return ((offset**2).sum(axis=1) < 0.12).astype(np.int64)


def _blotches(points: Values, scale: float) -> NDArray[np.int64]:
    value = grain(points * np.float32(0.042 / scale))
    return np.digitize(value, [-0.25, 0.0, 0.25]).astype(np.int64)


def _face(points: Values, scale: float) -> NDArray[np.int64]:
    """Skin 0, mouth 1, brows 2, cheeks 3; in the head's frame (y forward, z up), see :mod:`harness.studio.people`."""
    x, y, z = points.T
    side, front = np.abs(x), y > 0.06
    index = np.zeros(len(points), dtype=np.int64)
    cheeks = front & (((side - 0.045) / 0.022) ** 2 + ((z - 0.048) / 0.02) ** 2 < 1)
    mouth = front & ((x / 0.027) ** 2 + ((z - 0.006 - 4 * x**2) / 0.0065) ** 2 < 1)
    brows = (
        front
        & (side > 0.014)
        & (side < 0.05)
        & (np.abs(z - 0.122 + 0.2 * (side - 0.03) + 9 * (side - 0.03) ** 2) < 0.004)
    )
    index[cheeks], index[mouth], index[brows] = 3, 1, 2
    return index


def _eye(points: Values, scale: float) -> NDArray[np.int64]:
    """White 0, iris 1, pupil 2, about the y axis of a ball of radius ``scale``."""
    off_axis = np.hypot(points[:, 0], points[:, 2]) / scale
    return np.where(points[:, 1] < 0, 0, np.digitize(-off_axis, [-0.56, -0.26])).astype(np.int64)


def _dial(points: Values, scale: float) -> NDArray[np.int64]:
    """A clock's face 0 in the xz plane with hours and hands 1 and a rim 2; ``scale`` is its radius."""
    x, z = points[:, 0] / scale, (points[:, 2] - scale) / scale
    radius, angle = np.hypot(x, z), np.arctan2(x, z)
    hours = (radius > 0.68) & (radius < 0.84) & (np.abs((angle / (np.pi / 6) + 0.5) % 1 - 0.5) < 0.11)
    long_hand = (np.abs(x) < 0.035) & (z > -0.1) & (z < 0.62)
    short_hand = (np.abs(z - 0.6 * x) < 0.06) & (x > -0.1) & (x < 0.38)
    index = (hours | long_hand | short_hand).astype(np.int64)
    index[radius > 0.88] = 2
    return index


_PATTERNS: dict[Pattern, Callable[[Values, float], NDArray[np.int64]]] = {
    "plain": _plain,
    "stripes": _stripes,
    "panels": _bands,
    "checks": _checks,
    "wood": _wood,
    "dots": _dots,
    "blotches": _blotches,
    "face": _face,
    "eye": _eye,
    "dial": _dial,
}
