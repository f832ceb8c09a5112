"""A live source as a clip: its frames are those that were taken from the source."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass

from harness.run.live.newest import Newest
from harness.sources import Truth
from harness.sources.live import Arrival
from vfoa.errors import VfoaError
from vfoa.types import StereoFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class Latency:
    """Latency of one frame: milliseconds from its arrival to the end of all processing, and the frames that it cost.

    ``dropped_before`` counts the frames that arrived and were dropped since the one before.
    """

    frame: int
    latency_ms: float
    dropped_before: int


class LiveClip:
    """A live source as the pipeline reads it (:class:`harness.sources.Clip`, but only in the order of the source).

    :meth:`numbers` waits for the newest frame, which can be read until the next one is requested. A damaged frame is
    skipped and counted.
    """

    def __init__(self, newest: Newest, rate_hz: float | None) -> None:
        self.rate_hz = rate_hz
        self.latencies: list[Latency] = []
        self.damaged: list[str] = []
        self.notes: tuple[str, ...] = ()
        self._newest = newest
        self._frames: dict[int, StereoFrame] = {}
        self._underway: dict[int, tuple[Arrival, int]] = {}
        self._times_ns: dict[int, int] = {}

    @property
    def frames(self) -> tuple[int, ...]:
        """Numbers of the frames taken so far."""
        return tuple(self._times_ns)

    def numbers(self, rehearse: Callable[[int], None], limit: int | None = None) -> Generator[int]:
        """Yield the number of each frame that is taken, when it has arrived; at most ``limit`` of them.

        ``rehearse`` is called with the first one: things loaded at first use take seconds, and the frames that arrive
        meanwhile do not count as dropped. The first frame is taken again only if no other arrives.
        """
        first: Arrival | None = None
        for arrival, dropped in self._newest:
            is_whole = self._read(arrival)
            if first is None:
                first = arrival
                if is_whole:
                    rehearse(arrival.number)
                self._newest.begin()
            elif is_whole:
                yield self._take(arrival, dropped)
                if limit is not None and len(self._times_ns) >= limit:
                    return
        if first is not None and not self._times_ns and first.number in self._frames:
            yield self._take(first, 0)

    def _read(self, arrival: Arrival) -> bool:
        """Decode a frame; return False if it is damaged."""
        try:
            self._frames = {arrival.number: arrival.read()}
        except VfoaError as error:
            self.damaged.append(str(error))
            return False
        return True

    def _take(self, arrival: Arrival, dropped: int) -> int:
        self._times_ns[arrival.number] = arrival.time_ns
        self._underway[arrival.number] = arrival, dropped
        return arrival.number

    def done(self, number: int) -> None:
        """Note the time at which a frame was done."""
        arrival, dropped = self._underway.pop(number)
        latency_ms = 1e3 * (time.monotonic() - arrival.arrived_s)
        self.latencies.append(Latency(frame=number, latency_ms=latency_ms, dropped_before=dropped))

    def time_ns(self, number: int) -> int:
        """Time of a frame, as given by the source."""
        return self._times_ns[number]

    def frame(self, number: int) -> StereoFrame:
        """Return the frame that was taken last."""
        return self._frames[number]

    def truth(self, number: int) -> Truth:
        """A live source has no ground truth."""
        return Truth()

    def digest(self) -> str:
        """Digest of the frames' numbers and times: the frames themselves are gone."""
        return hashlib.sha256(repr(list(self._times_ns.items())).encode()).hexdigest()
