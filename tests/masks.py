"""Known masks, and pictures whose colours are masks."""

from __future__ import annotations

import numpy as np

from vfoa.coco import THING_IDS
from vfoa.types import Image, Instances, Mask

PERSON, CUP, BOOK = (THING_IDS.index(id_) for id_ in (1, 47, 84))
"""Places among the 80 things of a person, a cup and a book, whose own numbers in COCO are 1, 47 and 84."""


def picture(width: int, height: int, **colored: Mask) -> Image:
    """A black image, red, green or blue where the masks say."""
    image = np.zeros((height, width, 3), np.uint8)
    for channel, name in enumerate(("red", "green", "blue")):
        if name in colored:
            image[colored[name], channel] = 255
    return image


def rectangle(width: int, height: int, u0: int, v0: int, u1: int, v1: int) -> Mask:
    """A mask (H, W), set from (u0, v0) to before (u1, v1)."""
    mask = np.zeros((height, width), bool)
    mask[v0:v1, u0:u1] = True
    return mask


def patchwork(width: int, height: int, count: int, seed: int = 0) -> list[Mask]:
    """Masks (H, W) that do not overlap: every pixel belongs to one of them, or to none, by chance."""
    owner = np.random.default_rng(seed).integers(0, count + 1, (height, width))
    return [owner == n for n in range(1, count + 1)]


def logits(masks: list[Mask], size: float = 8.0) -> np.ndarray:
    """Masks as logits (N, H, W): ``size`` where they are set, ``-size`` elsewhere."""
    return np.where(np.stack(masks), size, -size).astype(np.float32)


def seen(found: Instances) -> list[tuple[str, int, bool, float]]:
    """Found instances in order: label, COCO's number, whether it is a thing, score to 4 digits."""
    return [
        (instance.label, instance.category_id, instance.is_thing, round(instance.score, 4))
        for instance in found.instances
    ]


def assert_masks(found: Instances, *masks: Mask) -> None:
    """The i-th instance has exactly the i-th mask."""
    assert [instance.id for instance in found.instances] == list(range(1, len(masks) + 1))
    for number, mask in enumerate(masks, start=1):
        np.testing.assert_array_equal(found.mask(number), mask)
