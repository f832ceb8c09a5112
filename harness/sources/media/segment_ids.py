"""Map segment ids of other formats to the 16 bits of :attr:`vfoa.types.Instances.ids`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from vfoa.errors import VfoaError

_LARGEST = np.iinfo(np.uint16).max


def small_ids(ids: Iterable[int], where: str) -> dict[int, int]:
    """Return a 16-bit id above 0 for each id: its own if it fits, else the smallest free one, in ascending order.

    Raises
    ------
    VfoaError
        If there are more than 65,535 ids.
    """
    wanted = sorted(set(ids) - {0})
    if len(wanted) > _LARGEST:
        raise VfoaError(f"{where}: {len(wanted)} different segment ids; expected at most {_LARGEST}")
    kept = {number for number in wanted if number <= _LARGEST}
    free = (number for number in range(1, _LARGEST + 1) if number not in kept)
    return {number: number if number in kept else next(free) for number in wanted}


def present_ids(ids: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Every id that an id map (H, W) has, ascending."""
    if ids.size and ids.max() <= _LARGEST:  # for few different numbers, counting is ten times as fast as sorting
        return np.flatnonzero(np.bincount(ids.ravel())).astype(np.uint32)
    return np.unique(ids)


def relabel(ids: NDArray[np.uint32], small: Mapping[int, int]) -> NDArray[np.uint16]:
    """Convert an id map (H, W) to 16 bits; ids that are not in ``small`` become 0, no instance."""
    if ids.size and ids.max() <= _LARGEST:
        table = np.zeros(_LARGEST + 1, np.uint16)
        for number, other in small.items():
            if number <= _LARGEST:
                table[number] = other
        return table[ids]
    present, where = np.unique(ids, return_inverse=True)
    table = np.array([small.get(int(number), 0) for number in present], dtype=np.uint16)
    return table[where].reshape(ids.shape)
