"""What rules that know nothing of gaze score on the same frames.

A clip on which a trivial rule does as well as the pipeline does not show that the pipeline works. Each rule picks one
target of the frame's record, never the subject's own body; where it cannot pick (no such subject, no eye origin,
nothing with a box) it made no prediction, and that is wrong as it is for the pipeline.

``commonest``  the target the subject looks at most often in the clip's own labels: the best any constant answer can do
``nearest``    the box whose centre is nearest to the eye origin
``largest``    the largest extent in the image
``central``    the box whose centre is nearest to the camera's axis, by angle
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

from harness.runs.results import FrameRecord, SubjectRecord, TargetRecord, Vector

RULES = ("commonest", "nearest", "largest", "central")


class Choices(NamedTuple):
    """The instance that each rule picks in a frame; None where it cannot pick."""

    nearest: int | None
    largest: int | None
    central: int | None


class Rules:
    """The rules on one frame. What does not depend on the subject is ranked once."""

    def __init__(self, record: FrameRecord) -> None:
        centers = [(target.box.center_m, target.instance_id) for target in record.targets if target.box is not None]
        self._centers = centers
        self._largest = sorted((-_area_px(target), target.instance_id) for target in record.targets)
        self._central = sorted((_off_axis(center), each) for center, each in centers)

    def choose(self, subject: SubjectRecord | None) -> Choices:
        """Apply the rules to a subject of the frame. Ties go to the lower instance id."""
        if subject is None:
            return Choices(None, None, None)
        own, eyes, dist = subject.instance_id, subject.eye_origin_m, math.dist
        nearest = None
        if eyes is not None:
            nearest = min([(dist(center, eyes), each) for center, each in self._centers if each != own], default=None)
        return Choices(
            nearest=None if nearest is None else nearest[1],
            largest=_first_but(self._largest, own),
            central=_first_but(self._central, own),
        )


def commonest(truths: Iterable[str]) -> str | None:
    """The commonest label, of equally common ones the first by name; None of none."""
    counts = Counter(truths)
    return min(counts, key=lambda name: (-counts[name], name), default=None)


def _first_but(ranked: list[tuple[float, int]], own: int | None) -> int | None:
    return next((each for _, each in ranked if each != own), None)


def _area_px(target: TargetRecord) -> float:
    u0, v0, u1, v1 = target.box_px
    return (u1 - u0) * (v1 - v0)


def _off_axis(center_m: Vector) -> float:
    """Minus the cosine of the angle between a point and the camera's axis: grows with the angle."""
    return -center_m[2] / (math.hypot(*center_m) or math.inf)
