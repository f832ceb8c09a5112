"""The last answers of a function: configurations that ask it the same, one after the other, share an answer."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

Answer = TypeVar("Answer")


class Recent(Generic[Answer]):
    """Keeps the last ``count`` answers with what was asked: objects, compared by identity, and values, by ``==``.

    Objects are kept as long as their answer, and must not be changed in place.
    """

    def __init__(self, count: int) -> None:
        self._kept: deque[tuple[object, tuple[object, ...], Answer]] = deque(maxlen=count)

    def get(self, objects: tuple[object, ...], values: tuple[object, ...], compute: Callable[[], Answer]) -> Answer:
        """Return the answer to this question, computed if it is not among the last ones."""
        asked = tuple(map(id, objects)), values
        for known, _, answer in reversed(tuple(self._kept)):
            if known == asked:
                return answer
        answer = compute()
        self._kept.append((asked, objects, answer))  # with the objects, so that their ids stay theirs
        return answer
