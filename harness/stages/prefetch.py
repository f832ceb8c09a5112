"""Prefetching in threads: the next frames are read and perceived while the last ones are attended to and written.

The order and all results stay the same: they do not depend on timing. NumPy, OpenCV and ONNX Runtime let other threads
run while they compute.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from queue import Empty, Queue
from threading import Event, Lock, Thread
from typing import Generic, TypeVar

from harness.sources import Clip, Truth
from vfoa.types import StereoFrame

T = TypeVar("T")
_POLL_S = 0.05


@dataclass(frozen=True, slots=True)
class _Item(Generic[T]):
    value: T


@dataclass(frozen=True, slots=True)
class _End:
    error: BaseException | None


def prefetch(items: Generator[T], depth: int) -> Generator[T]:
    """Yield the items; a thread computes up to ``depth`` of them in advance. 0: none, and no thread.

    An error is raised where its item would have come. When the caller stops, the thread ends after its current item.
    """
    if depth == 0:
        yield from items
        return
    ready: Queue[_Item[T] | _End] = Queue(depth)
    unwanted = Event()
    thread = Thread(target=_compute, args=(items, ready, unwanted), daemon=True)
    thread.start()
    try:
        while isinstance(found := ready.get(), _Item):
            yield found.value
        if found.error is not None:
            raise found.error
    finally:
        unwanted.set()
        while thread.is_alive():  # the thread may wait for a place in the queue
            _drain(ready)
            thread.join(_POLL_S)


def _compute(items: Generator[T], ready: Queue[_Item[T] | _End], unwanted: Event) -> None:
    try:
        for value in items:
            ready.put(_Item(value))
            if unwanted.is_set():
                break
        items.close()  # the generator may have a thread of its own
    except BaseException as error:  # raised again in the thread that waits for the item
        ready.put(_End(error))
    else:
        ready.put(_End(None))


def _drain(ready: Queue[_Item[T] | _End]) -> None:
    try:
        while True:
            ready.get_nowait()
    except Empty:
        return


def one_at_a_time(clip: Clip, count: int) -> tuple[Clip, ...]:
    """Return the clip once for each of several threads: only one reads at a time, since a clip need not be thread-safe.

    Each is an object of its own, with its own last ground truth (:func:`harness.stages.ground_truth.oracle.truth_of`).
    """
    lock = Lock()
    return tuple(_OneAtATime(clip, lock) for _ in range(count))


class _OneAtATime:
    def __init__(self, clip: Clip, lock: Lock) -> None:
        self._clip, self._lock = clip, lock

    @property
    def frames(self) -> Sequence[int]:
        """As in :class:`harness.sources.Clip`; so are the following methods."""
        return self._clip.frames

    @property
    def rate_hz(self) -> float | None:
        """Frames per second."""
        return self._clip.rate_hz

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the reader of a table."""
        return self._clip.notes

    def time_ns(self, number: int) -> int:
        """Time of a frame, nanoseconds."""
        with self._lock:
            return self._clip.time_ns(number)

    def frame(self, number: int) -> StereoFrame:
        """Read one stereo pair."""
        with self._lock:
            return self._clip.frame(number)

    def truth(self, number: int) -> Truth:
        """The ground truth of a frame."""
        with self._lock:
            return self._clip.truth(number)

    def digest(self) -> str:
        """Digest of everything that a frame depends on."""
        with self._lock:
            return self._clip.digest()
