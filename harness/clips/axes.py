"""Directions in another program's axes: a component of the wrong sign, or two axes exchanged.

Such directions are unit vectors as good as any, and all that follows from them is wrong. Labels tell: the directions of
a labelled person point about at what he or she looks at. If hardly any does, and nearly all do with some components
negated or two exchanged, the axes are probably not ours.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from vfoa.types import Float

NEAR_DEG = 20.0
"""A direction points at a target if it is this near to the target's centre: gaze models and heads are that far off."""
LEAST_SHARE = 0.6
"""Least share of directions that point at their targets in the other axes."""
LEAST_SHARE_OF_ONE = 0.9
"""The same where all targets are in about one direction, at which biased directions may point by chance."""
SPREAD_DEG = 30.0
"""Angle between the directions of two targets from which on they are not about one direction."""
LEAST_MORE = 0.35
"""How much larger the share must be in the other axes than as the directions are."""
FEWEST = 10
"""Fewer directions tell nothing."""
FAR_DEG = 30.0
"""How far the face must be from where it is said to be on a body: eyes look this far aside from where heads point."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherAxes:
    """What is probably wrong with the axes of ``n`` directions, and the shares that point at their targets."""

    change: str
    n: int
    share: float
    share_as_they_are: float

    def __str__(self) -> str:
        return (
            f"with {self.change}, {self.share:.0%} of {self.n} measured directions point within {NEAR_DEG:g} degrees "
            f"of the labelled targets, and {self.share_as_they_are:.0%} as they are: are their axes another program's? "
            "Expected x to the right, y down, z forward"
        )


def other_axes(directions: Float, to_targets: Float) -> OtherAxes | None:
    """The axes in which directions (N, 3) point at their targets, if those are not ours.

    ``to_targets`` (N, 3) are the vectors from the eyes to the true targets, in the same frame, of any length.
    """
    if len(directions) < FEWEST:
        return None
    aims = _unit(to_targets)
    as_they_are = _share(directions, aims)
    change, share = max(
        ((name, _share(directions @ matrix.T, aims)) for name, matrix in _changes()), key=lambda pair: pair[1]
    )
    spread = np.degrees(np.arccos(np.clip((aims @ _unit(aims.mean(axis=0))).min(), -1, 1))) * 2
    least = LEAST_SHARE if spread > SPREAD_DEG else LEAST_SHARE_OF_ONE
    if share < least or share - as_they_are < LEAST_MORE:
        return None
    return OtherAxes(change=change, n=len(directions), share=share, share_as_they_are=as_they_are)


def other_forward(to_targets: Float, forward: Float) -> Float | None:
    """Where the face points in the axes of a worn body, a unit vector (3,); None if it is as the settings say.

    ``to_targets`` (N, 3) are the vectors from the eyes to the true targets in the body's own axes, and ``forward`` (3,)
    the unit vector of the settings. None unless most targets are about one direction, which is far from that.
    """
    if len(to_targets) < FEWEST:
        return None
    aims = _unit(to_targets)
    found = _unit(np.median(aims, axis=0))
    is_one = np.mean(aims @ found >= np.cos(np.radians(FAR_DEG))) >= LEAST_SHARE
    return found if is_one and forward @ found < np.cos(np.radians(FAR_DEG)) else None


def _changes() -> Iterator[tuple[str, Float]]:
    """Each change of axes by name: (3, 3), applied to a direction."""
    for count in (1, 2, 3):
        for axes in combinations("xyz", count):
            yield f"{' and '.join(axes)} negated", np.diag([-1.0 if axis in axes else 1.0 for axis in "xyz"])
    for first, second in combinations(range(3), 2):
        matrix = np.eye(3)
        matrix[[first, second]] = matrix[[second, first]]
        yield f"{'xyz'[first]} and {'xyz'[second]} exchanged", matrix


def _share(directions: Float, aims: Float) -> float:
    cosines = (_unit(directions) * aims).sum(axis=1)
    return float(np.mean(cosines >= np.cos(np.radians(NEAR_DEG))))


def _unit(vectors: Float) -> Float:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12))
