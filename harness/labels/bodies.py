"""Positions in a frame that formats of other programs need: heads, and the object at a point of the image."""

from __future__ import annotations

from typing import Protocol

Box = tuple[float, float, float, float]
"""u0, v0, u1, v1 in pixels."""
Point = tuple[float, float]


class Bodies(Protocol):
    """Positions in one clip's frames; None: not known."""

    def head_box(self, frame: int, subject: str) -> Box | None:
        """The box of a subject's head."""
        ...

    def target_at(self, frame: int, point_px: Point, but: str) -> str | None:
        """The name of the object at a point, other than the subject ``but``; None: nothing with a name."""
        ...

    def point_of(self, frame: int, target: str) -> Point | None:
        """A point on a target."""
        ...
