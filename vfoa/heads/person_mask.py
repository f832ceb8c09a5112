"""Heads from the masks of people: without a network, and also for people who turn away."""

from __future__ import annotations

from bisect import insort
from collections.abc import Sequence

import numpy as np
from pydantic import Field

from vfoa import settings
from vfoa.types import Float, Head, Instances, Mask, StereoFrame

HEAD_ASPECT = 1.25
"""Height over width of a head's box: between a face (about 1.5) and a profile (about 1.2)."""

LEAST_SHARE = 0.05
"""A part narrower than this share of a mask's width, or of a head's pixels on one side, is not part of the head."""

SCORE_FACTOR = 0.5
"""A head from a mask has half the score of its person, so that heads with a face come first."""


class PersonMask:
    """A head detector that takes the top of each person's mask as the head (:func:`head_in_mask`)."""

    finds_faces = False

    class Settings(settings.Settings):
        """Label of the instances that are people, and the least height of a head's box in pixels."""

        label: str = "person"
        """Label of the instances that are people."""
        min_height_px: float = Field(default=8.0, gt=0)
        """Least height of a head's box."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings

    def detect(self, frame: StereoFrame, instances: Instances) -> tuple[Head, ...]:
        """Return one head per person, best first; none for a person whose mask is too small."""
        heads = []
        for person in instances.instances:
            box = head_in_mask(instances.mask(person.id)) if person.label == self.settings.label else None
            if box is not None and box[3] - box[1] >= self.settings.min_height_px:
                heads.append(Head(box_px=box, score=SCORE_FACTOR * person.score, instance_id=person.id))
        return tuple(sorted(heads, key=lambda head: -head.score))


def head_in_mask(mask: Mask) -> Float | None:
    """Return the box (4,) of the head in a person's mask (H, W); None for an empty mask.

    Rows are taken from the top of the mask until their number reaches 1.25 times their median width. The top is the
    first row with a twentieth of the greatest width. The left and right edges leave out a twentieth of the pixels on
    either side, so that a strand of hair, a raised finger or a stray pixel is not part of the head. An arm raised above
    the head is taken for the head: the mask alone cannot tell them apart.
    """
    widths = mask.sum(axis=1)
    if not widths.any():
        return None
    top = int(np.argmax(widths >= max(LEAST_SHARE * widths.max(), 1)))
    bottom = int(np.flatnonzero(widths)[-1])
    height = _head_rows(widths[top : bottom + 1].tolist())
    columns = np.repeat(np.arange(mask.shape[1]), mask[top : top + height].sum(axis=0))
    left, right = np.quantile(columns, [LEAST_SHARE, 1 - LEAST_SHARE])
    return np.array([left - 0.5, top - 0.5, right + 0.5, top + height - 0.5])


def _head_rows(widths: Sequence[int]) -> int:
    """The least number of rows that reaches ``HEAD_ASPECT`` times their median width; all rows if none does."""
    ordered: list[int] = []
    for count, width in enumerate(widths, start=1):
        insort(ordered, width)
        median = (ordered[(count - 1) // 2] + ordered[count // 2]) / 2
        if count >= HEAD_ASPECT * median:
            return count
    return len(widths)
