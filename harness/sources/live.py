"""Sources that deliver frames at their own pace: a recording being written, cameras, a clip played in real time.

``live_sources.py`` and ``mcap/tail.py`` hold the sources. :mod:`harness.run.live` processes the newest frame of one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from threading import Event
from typing import Protocol

from vfoa.types import StereoFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrival:
    """A frame that has arrived and is not decoded: its number, its time, and its arrival (:func:`time.monotonic`).

    ``read`` decodes it, in any thread; it raises :class:`vfoa.errors.VfoaError` for a damaged one.
    """

    number: int
    time_ns: int
    arrived_s: float
    read: Callable[[], StereoFrame]


class LiveSource(Protocol):
    """A source that delivers frames whether or not anybody is ready for them."""

    @property
    def rate_hz(self) -> float | None:
        """Frames per second; None if not known."""
        ...

    def arrivals(self, stopped: Event) -> Iterator[Arrival]:
        """Yield frames as they arrive, with ascending numbers; ends with the source, or soon after ``stopped`` is set.

        The first one is for rehearsal: a source that can wait gives it at once, and again after :meth:`begin`.

        Raises
        ------
        VfoaError
            If there is nothing to read, or no more.
        """
        ...

    def begin(self) -> None:
        """Tell the source that everything is ready: frames from now on count."""
        ...
