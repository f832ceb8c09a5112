"""The part of the left image whose disparities are needed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from vfoa.pixels import Window, window_of
from vfoa.types import Head, Instances, Mask, StereoRig


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """Pixels of the left image: columns ``u0`` to before ``u1``, rows ``v0`` to before ``v1``."""

    u0: int
    v0: int
    u1: int
    v1: int

    @property
    def is_empty(self) -> bool:
        """Whether it contains no pixel."""
        return self.u0 >= self.u1 or self.v0 >= self.v1

    @property
    def window(self) -> Window:
        """Its rows and columns as slices."""
        return slice(self.v0, self.v1), slice(self.u0, self.u1)

    def grown(self, margin_px: int, limits: Region) -> Region:
        """Return the region with a margin all around, clipped to the limits. An empty region stays as it is."""
        if self.is_empty:
            return self
        return Region(
            u0=max(self.u0 - margin_px, limits.u0),
            v0=max(self.v0 - margin_px, limits.v0),
            u1=min(self.u1 + margin_px, limits.u1),
            v1=min(self.v1 + margin_px, limits.v1),
        )

    def shrunk(self, factor: int) -> Region:
        """Return the region in an image with ``factor`` times fewer rows and columns: every pixel that it touches."""
        return Region(u0=self.u0 // factor, v0=self.v0 // factor, u1=-(-self.u1 // factor), v1=-(-self.v1 // factor))

    def times(self, factor: int) -> Region:
        """Return the region in an image with ``factor`` times more rows and columns."""
        return Region(u0=self.u0 * factor, v0=self.v0 * factor, u1=self.u1 * factor, v1=self.v1 * factor)


def whole(rig: StereoRig) -> Region:
    """Return the region of the whole image."""
    return Region(u0=0, v0=0, u1=rig.width_px, v1=rig.height_px)


def needed_region(instances: Instances, heads: Iterable[Head], rig: StereoRig, drawn: Iterable[Window] = ()) -> Region:
    """Return the smallest region with all objects, heads and drawn shapes; empty if there are none."""
    needed = np.not_equal(instances.ids, 0)
    for instance in instances.instances:
        if not instance.is_thing:
            needed &= np.not_equal(instances.ids, instance.id)
    windows = [(_extent(np.any(needed, axis=1)), _extent(np.any(needed, axis=0)))]
    for head in heads:
        u0, v0, u1, v1 = head.box_px
        windows.append(window_of(u0, v0, u1, v1, rig))
    windows += drawn
    seen = [(rows, columns) for rows, columns in windows if rows.start < rows.stop and columns.start < columns.stop]
    return Region(
        u0=min((columns.start for _, columns in seen), default=0),
        v0=min((rows.start for rows, _ in seen), default=0),
        u1=max((columns.stop for _, columns in seen), default=0),
        v1=max((rows.stop for rows, _ in seen), default=0),
    )


def _extent(marked: Mask) -> slice:
    """From the first to the last place that is set; empty if none is."""
    places = np.flatnonzero(marked)
    return slice(int(places[0]), int(places[-1]) + 1) if len(places) else slice(0, 0)
