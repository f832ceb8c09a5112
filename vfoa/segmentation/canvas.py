"""A map of instances, painted from masks with COCO categories."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from vfoa.coco import STUFF, THINGS
from vfoa.errors import VfoaError, did_you_mean
from vfoa.segmentation.placement import PixelBox, Size
from vfoa.types import Instance, Instances, Mask


class Canvas:
    """A map of instances that is painted best first: each mask takes the pixels that are still free.

    A mask is dropped if better ones cover a larger share of it than ``max_hidden``: it is probably the same object
    again (Kirillov et al. 2019, Panoptic Feature Pyramid Networks, section 3.2).
    """

    def __init__(self, size: Size, max_hidden: float) -> None:
        self._ids = np.zeros(size, np.uint16)
        self._instances: list[Instance] = []
        self._max_hidden = max_hidden

    @property
    def free(self) -> Mask:
        """Pixels (H, W) that no mask has taken yet."""
        return np.equal(self._ids, 0)

    def paint(self, mask: Mask, category_id: int, score: float, window: PixelBox | None = None) -> None:
        """Paint the mask of a COCO category: (H, W), or of the size of ``window``, a part of the image."""
        instance = Instance(
            id=len(self._instances) + 1,
            label=THINGS.get(category_id) or STUFF[category_id],
            category_id=category_id,
            is_thing=category_id in THINGS,
            score=float(score),
        )
        self.add(mask, instance, window)

    def add(self, mask: Mask, instance: Instance, window: PixelBox | None = None) -> None:
        """Paint the mask of an instance that has an id of its own, as :meth:`paint` does."""
        u0, v0, u1, v1 = window or (0, 0, self._ids.shape[1], self._ids.shape[0])
        ids = self._ids[v0:v1, u0:u1]
        taken = mask & (ids == 0)
        visible, area = int(np.count_nonzero(taken)), int(np.count_nonzero(mask))
        if visible == 0 or area - visible > self._max_hidden * area:
            return
        self._instances.append(instance)
        ids[taken] = instance.id

    def instances(self) -> Instances:
        """The painted instances, in the order of painting."""
        return Instances(ids=self._ids.copy(), instances=tuple(self._instances))


def wanted_categories(labels: Iterable[str], names: Mapping[int, str]) -> frozenset[int]:
    """Return the ids of the categories with these labels, among those in ``names``; all of them if there is no label.

    Raises
    ------
    VfoaError
        If there is no category of that name.
    """
    ids = {name: id_ for id_, name in names.items()}
    for label in labels:
        if label not in ids:
            kind = "category" if len(names) > len(THINGS) else "thing"
            raise VfoaError(f"labels: no {kind} {label!r} in COCO; {did_you_mean(label, ids)}")
    return frozenset(ids[label] for label in labels) or frozenset(names)
