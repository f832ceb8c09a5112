"""Frames held back until the frames after them are known, where attention is smoothed from both sides."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Generic, TypeVar

from harness.runs.faults import guarded
from vfoa.bayes import BayesSettings
from vfoa.dwell import revise
from vfoa.pipeline import AttendSettings
from vfoa.types import FrameResult

T = TypeVar("T")


class Hindsight(Generic[T]):
    """Takes results in order, each with something that goes with it, and gives them back in the same order.

    At once, unless the settings look ahead: then a result waits for so many later ones, and comes back revised.
    """

    def __init__(self, settings: AttendSettings) -> None:
        self._settings = settings.attention if isinstance(settings.attention, BayesSettings) else None
        self._awaited = self._settings.frames_awaited if self._settings else 0
        self._past: deque[FrameResult] = deque(maxlen=self._awaited)
        self._waiting: deque[tuple[FrameResult, T]] = deque()

    def add(self, result: FrameResult, companion: T) -> Iterator[tuple[FrameResult, T]]:
        """Take a result; what has waited long enough comes back."""
        self._waiting.append((result, companion))
        while len(self._waiting) > self._awaited:
            yield self._release()

    def finish(self) -> Iterator[tuple[FrameResult, T]]:
        """Give back all that still waits: the clip has ended."""
        while self._waiting:
            yield self._release()

    def _release(self) -> tuple[FrameResult, T]:
        result, companion = self._waiting[0]
        if self._settings is not None and self._awaited:
            window = [*self._past, *(each for each, _ in self._waiting)]
            revised = guarded("attention", revise, window, len(self._past), self._settings)
            self._past.append(result)
        else:
            revised = result
        self._waiting.popleft()
        return revised, companion
