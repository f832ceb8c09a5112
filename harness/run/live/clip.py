"""A live source as a clip: its frames are those that were taken, one after the other."""

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
    """One frame: the milliseconds from its arrival to the end of all that was done with it, and how many it cost.

    ``dropped_before`` counts the frames that came and went since the one before.
    """

    frame: int
    latency_ms: float
    dropped_before: int


class LiveClip:
    """What the pipeline sees of a live source (:class:`harness.sources.Clip`, but for the order).

    :meth:`numbers` waits for the newest frame, which can be read until the next one is asked for. A frame that is
    damaged is passed over, and counted.
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
        """Those that were taken so far."""
        return tuple(self._times_ns)

    def numbers(self, rehearse: Callable[[int], None], limit: int | None = None) -> Generator[int]:
        """The number of each frame that is taken, when it has come; at most ``limit`` of them.

        ``rehearse`` is called with the first one, which is taken again only if no other comes: what is loaded at its
        first use takes seconds, and the frames that come meanwhile are not counted as dropped.
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
        """Decode a frame; False for one that is damaged."""
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
        """Take note that everything was done with a frame."""
        arrival, dropped = self._underway.pop(number)
        latency_ms = 1e3 * (time.monotonic() - arrival.arrived_s)
        self.latencies.append(Latency(frame=number, latency_ms=latency_ms, dropped_before=dropped))

    def time_ns(self, number: int) -> int:
        """As the source has it."""
        return self._times_ns[number]

    def frame(self, number: int) -> StereoFrame:
        """The frame that was taken last."""
        return self._frames[number]

    def truth(self, number: int) -> Truth:
        """Nothing is known."""
        return Truth()

    def digest(self) -> str:
        """Of the frames' numbers and times: the frames themselves are gone."""
        return hashlib.sha256(repr(list(self._times_ns.items())).encode()).hexdigest()
