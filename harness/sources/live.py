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
    """A frame that has come, not decoded yet: its number, its time, and when it came (:func:`time.monotonic`).

    ``read`` decodes it, in whichever thread; it raises :class:`vfoa.errors.VfoaError` for one that is damaged.
    """

    number: int
    time_ns: int
    arrived_s: float
    read: Callable[[], StereoFrame]


class LiveSource(Protocol):
    """Something that frames come from, whether anybody is ready for them or not."""

    @property
    def rate_hz(self) -> float | None:
        """Frames per second, None where it is not known."""
        ...

    def arrivals(self, stopped: Event) -> Iterator[Arrival]:
        """Every frame as it comes, with ascending numbers; ends with the source, or soon after ``stopped`` is set.

        The first one is for rehearsal: a source that can wait gives it at once, and again when it is told to begin.

        Raises
        ------
        VfoaError
            If there is nothing to read, or no more.
        """
        ...

    def begin(self) -> None:
        """Hear that all is ready: what comes from now on counts."""
        ...
