"""The last answers of a function: configurations that ask it the same, one after the other, share an answer."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Answer = TypeVar("Answer")


class Recent(Generic[Answer]):
    """Keeps the last ``count`` answers with what was asked: objects, compared by identity, and values, by ``==``.

    Objects are kept as long as their answer, and must not be changed in place.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._kept: OrderedDict[Hashable, tuple[tuple[object, ...], Answer]] = OrderedDict()

    def get(self, objects: tuple[object, ...], values: tuple[Hashable, ...], compute: Callable[[], Answer]) -> Answer:
        """Return the answer to this question, computed if it is not among the last ones."""
        asked = tuple(map(id, objects)), values
        known = self._kept.get(asked)
        if known is None:
            known = self._kept[asked] = objects, compute()  # with the objects, so that their ids stay theirs
            while len(self._kept) > self._count:
                self._kept.popitem(last=False)
        return known[1]
