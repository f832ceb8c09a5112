"""Logging frame by frame into a Rerun stream: times, static values, and the clearing of entities that disappear."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
import rerun as rr

COLUMN_FRAMES = 25
"""Number of frames whose numbers are sent together. A kill loses the curves of at most this many frames."""


class FrameLog:
    """A part of a recording in which an entity is cleared in frames that do not log it.

    Rerun shows the latest value of an entity: without clearing, a box would stay where its object was last seen.

    Numbers wait for :data:`COLUMN_FRAMES` frames and are then sent as one column per curve: a call to Rerun costs more
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
        """Send the waiting numbers, and return the state from which another log can continue with the next frame."""
        self.close()
        return {"logged_to": max(self._logged, default=self._logged_to), "before": sorted(self._before)}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Continue from the state of another log."""
        self._logged_to, self._before = state["logged_to"], set(state["before"])

    def begin(self, frame: int, time_ns: int) -> bool:
        """Set the frame number and time of the following entities; False if the frame is already logged."""
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
        """Build and log an entity that outlives the frame, but only if its ``key`` has changed since the last time."""
        if path not in self._kept or self._kept[path] != key:
            self._kept[path] = key
            self._stream.log(path, build(), static=static)

    def end(self) -> None:
        """Clear the entities that the frame before had and this one has not."""
        for path in sorted(self._before - self._now):
            self._stream.log(path, rr.Clear(recursive=True))
        self._before, self._now = self._now, set()
        self._frames_waiting += 1
        if self._frames_waiting >= COLUMN_FRAMES:
            self.close()

    def close(self) -> None:
        """Send the waiting numbers."""
        for path, rows in self._waiting.items():
            frames, times_ns, values = zip(*rows, strict=True)
            columns = rr.Scalars.columns(scalars=values)
            self._stream.send_columns(path, indexes=_time_columns(frames, times_ns), columns=columns)
        self._waiting, self._frames_waiting = {}, 0

    def _set_time(self, frame: int, time_ns: int) -> None:
        self._stream.set_time("frame", sequence=frame)
        self._stream.set_time("time", duration=np.timedelta64(time_ns, "ns"))


class ColumnLog:
    """As :class:`FrameLog`, for data of many frames at once: each entity is sent as one column of rows.

    A call to Rerun costs as much as twenty rows. ``before`` are the paths of the frame before the first one.
    """

    def __init__(self, stream: rr.RecordingStream, before: Iterable[str] = ()) -> None:
        self._stream = stream
        self._time = (0, 0)
        self._rows: dict[tuple[str, Any], list[tuple[int, int, Mapping[str, Any]]]] = {}
        self._before, self._now = set(before), set[str]()

    @property
    def shown(self) -> list[str]:
        """The paths of the last frame, sorted."""
        return sorted(self._before)

    @property
    def paths(self) -> set[str]:
        """All paths with rows that are not sent yet."""
        return {path for path, _ in self._rows}

    def begin(self, frame: int, time_ns: int) -> None:
        """Set the time of all that follows: the source's frame number and time."""
        self._time = (frame, time_ns)

    def log(self, path: str, archetype: Any, **row: Any) -> None:
        """Log an entity of this frame: one row of the archetype's ``columns``."""
        self._now.add(path)
        self._rows.setdefault((path, archetype), []).append((*self._time, row))

    def end(self) -> None:
        """Clear the entities that the frame before had and this one has not."""
        for path in sorted(self._before - self._now):
            self._rows.setdefault((path, rr.Clear), []).append((*self._time, {"is_recursive": True}))
        self._before, self._now = self._now, set()

    def send(self) -> None:
        """Send the rows that are not sent yet."""
        for (path, archetype), rows in self._rows.items():
            frames, times_ns, values = zip(*rows, strict=True)
            columns = archetype.columns(**{name: [row[name] for row in values] for name in values[0]})
            self._stream.send_columns(path, indexes=_time_columns(frames, times_ns), columns=columns)
        self._rows = {}


def _time_columns(frames: Iterable[int], times_ns: Iterable[int]) -> list[rr.TimeColumn]:
    return [
        rr.TimeColumn("frame", sequence=list(frames)),
        rr.TimeColumn("time", duration=np.array(list(times_ns), dtype="timedelta64[ns]")),
    ]
