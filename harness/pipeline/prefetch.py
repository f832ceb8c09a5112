"""Work in threads: items that are computed before they are needed, and a clip that several threads read.

The order and all results stay the same: NumPy, OpenCV and ONNX Runtime let other threads run while they compute.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from threading import Lock
from typing import Any, TypeVar, cast

from harness.sources import Clip

T = TypeVar("T")
_END = object()


def prefetch(items: Generator[T], depth: int) -> Generator[T]:
    """Yield the items; a thread has up to ``depth`` of them ready and computes the next one. 0: no thread.

    An error is raised in place of its item. When the caller stops, the thread ends after its current item.
    """
    return _computed_ahead(items, depth) if depth else items


def _computed_ahead(items: Generator[T], depth: int) -> Generator[T]:
    thread = ThreadPoolExecutor(1)
    try:
        ahead = deque(thread.submit(next, items, _END) for _ in range(depth + 1))
        while (item := ahead.popleft().result()) is not _END:
            ahead.append(thread.submit(next, items, _END))
            yield cast("T", item)
    finally:
        thread.shutdown(cancel_futures=True)
        items.close()  # it may have a thread of its own


def one_at_a_time(clip: Clip) -> tuple[Clip, Clip]:
    """Return the clip once for each of two threads: only one reads at a time, since a clip need not be thread-safe.

    Each is an object of its own, with its own last ground truth (:func:`harness.pipeline.ground_truth.truth_of`).
    """
    lock = Lock()
    return cast("Clip", _OneAtATime(clip, lock)), cast("Clip", _OneAtATime(clip, lock))


class _OneAtATime:
    """A clip whose methods wait for each other."""

    def __init__(self, clip: Clip, lock: Lock) -> None:
        self._clip, self._lock = clip, lock

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._clip, name)
        return self._locked(value) if callable(value) else value

    def _locked(self, method: Any) -> Any:
        def call(*arguments: Any) -> Any:
            with self._lock:
                return method(*arguments)

        return call
