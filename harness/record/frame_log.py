"""Logging frame by frame into a Rerun stream: times, static values, and the clearing of what has gone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import rerun as rr

COLUMN_FRAMES = 25
"""Frames whose numbers are sent together. A kill loses at most this many frames of the curves."""


class FrameLog:
    """A part of a recording in which an entity that a frame does not log is cleared.

    Rerun shows the latest value of an entity: without the clearing, a box would stay where its object was last seen.

    Numbers wait for :data:`COLUMN_FRAMES` frames and are then sent as one column a curve: a call to Rerun costs more
    than a number. :meth:`close` sends the last of them.
    """

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._time = (0, 0)
        self._waiting: dict[str, list[tuple[int, int, float]]] = {}
        self._frames_waiting = 0
        self._before: set[str] = set()
        self._now: set[str] = set()
        self._kept: dict[str, object] = {}
        self._logged: set[int] = set()
        self._logged_to: int | None = None

    def state(self) -> dict[str, Any]:
        """What another log needs to go on with the next frame. The numbers that wait are sent."""
        self.close()
        return {"logged_to": max(self._logged, default=self._logged_to), "before": sorted(self._before)}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on where another log was."""
        self._logged_to, self._before = state["logged_to"], set(state["before"])

    def begin(self, frame: int, time_ns: int) -> bool:
        """Set the time of all that follows: the source's frame number and time. False: that frame is logged already."""
        if frame in self._logged or (self._logged_to is not None and frame <= self._logged_to):
            return False
        self._logged.add(frame)
        self._time = (frame, time_ns)
        self._set_time(frame, time_ns)
        return True

    def log(self, path: str, entity: rr.AsComponents) -> None:
        """Log an entity of this frame."""
        self._now.add(path)
        self._stream.log(path, entity)

    def log_at(self, frame: int, time_ns: int, path: str, entity: rr.AsComponents) -> None:
        """Log an entity of another frame, which is never cleared."""
        self._set_time(frame, time_ns)
        self._stream.log(path, entity)
        self._set_time(*self._time)

    def number(self, path: str, value: float) -> None:
        """Log one number of a curve."""
        self._now.add(path)
        self._waiting.setdefault(path, []).append((*self._time, value))

    def keep(self, path: str, build: Callable[[], rr.AsComponents], *, key: object, static: bool = True) -> None:
        """Build and log what outlives the frame, only when its ``key`` differs from that of the last time."""
        if path not in self._kept or self._kept[path] != key:
            self._kept[path] = key
            self._stream.log(path, build(), static=static)

    def end(self) -> None:
        """Clear what the frame before had and this one has not."""
        for path in sorted(self._before - self._now):
            self._stream.log(path, rr.Clear(recursive=True))
        self._before, self._now = self._now, set()
        self._frames_waiting += 1
        if self._frames_waiting >= COLUMN_FRAMES:
            self.close()

    def close(self) -> None:
        """Send the numbers that wait."""
        for path, rows in self._waiting.items():
            frames, times_ns, values = zip(*rows, strict=True)
            times = [
                rr.TimeColumn("frame", sequence=frames),
                rr.TimeColumn("time", duration=np.array(times_ns, dtype="timedelta64[ns]")),
            ]
            self._stream.send_columns(path, indexes=times, columns=rr.Scalars.columns(scalars=values))
        self._waiting, self._frames_waiting = {}, 0

    def _set_time(self, frame: int, time_ns: int) -> None:
        self._stream.set_time("frame", sequence=frame)
        self._stream.set_time("time", duration=np.timedelta64(time_ns, "ns"))
