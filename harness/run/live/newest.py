"""The newest frame of a live source."""

from __future__ import annotations

from collections.abc import Iterator
from threading import Condition, Event, Thread

from harness.sources.live import Arrival, LiveSource


class Newest:
    """Reads a source in a thread and gives the caller the newest frame; earlier ones are dropped and counted."""

    def __init__(self, source: LiveSource, stopped: Event) -> None:
        self._source = source
        self._dropped = 0
        self._changed = Condition()
        self._waiting: Arrival | None = None
        self._ended = False
        self._error: BaseException | None = None
        self._thread = Thread(target=self._read, args=(stopped,), daemon=True)

    def __iter__(self) -> Iterator[tuple[Arrival, int]]:
        """Yield the newest frame each time one is requested, and the number of frames dropped since the one before.

        Ends when the source ends, and raises its error.
        """
        self._thread.start()
        while (taken := self._take()) is not None:
            yield taken
        self._thread.join()
        if self._error is not None:
            raise self._error

    def begin(self) -> None:
        """Begin to count dropped frames."""
        with self._changed:
            self._dropped = 0
        self._source.begin()

    def _take(self) -> tuple[Arrival, int] | None:
        with self._changed:
            self._changed.wait_for(lambda: self._waiting is not None or self._ended)
            arrival, dropped = self._waiting, self._dropped
            self._waiting, self._dropped = None, 0
            return None if arrival is None else (arrival, dropped)

    def _read(self, stopped: Event) -> None:
        try:
            for arrival in self._source.arrivals(stopped):
                with self._changed:
                    self._dropped += self._waiting is not None
                    self._waiting = arrival
                    self._changed.notify()
        except BaseException as error:  # the thread that waits for a frame must know
            self._error = error
        with self._changed:
            self._ended = True
            self._changed.notify()
