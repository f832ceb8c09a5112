"""Logging frame by frame into a Rerun stream: times, static values, and the clearing of entities that disappear.

A call to Rerun costs as much as twenty rows, so the rows of many frames are sent together, as columns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

Batch = Sequence[Any] | NDArray[Any]
"""The values of one field in one frame: one for each instance of the entity."""


class FrameLog:
    """A part of a recording in which an entity is cleared in frames that do not log it.

    Rerun shows the latest value of an entity: without clearing, a box would stay where its object was last seen.

    Rows wait for :meth:`send`; with ``at_once``, they are sent at the end of their frame.
    """

    def __init__(self, stream: rr.RecordingStream, *, at_once: bool = False) -> None:
        self._stream, self._at_once = stream, at_once
        self._time = (0, 0)
        self._rows = _Rows(stream)
        self._before: set[str] = set()
        self._now: set[str] = set()
        self._kept: dict[str, object] = {}
        self._logged: set[int] = set()
        self._logged_to: int | None = None

    def state(self) -> dict[str, Any]:
        """Send the waiting rows, and return the state from which another log can continue with the next frame."""
        self.send()
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
        return True

    def row(self, path: str, archetype: Any, **fields: Batch) -> None:
        """Log an entity of this frame: a batch for each field of the archetype's ``columns``."""
        self._now.add(path)
        self._rows.add(self._time, path, archetype, fields)

    def number(self, path: str, value: float) -> None:
        """Log one number of a curve."""
        self.row(path, rr.Scalars, scalars=[value])

    def log(self, path: str, entity: rr.AsComponents) -> None:
        """Log any entity of this frame at once: for one that is too large to wait."""
        self._now.add(path)
        self._send(path, entity)

    def row_at(self, frame: int, time_ns: int, path: str, archetype: Any, **fields: Batch) -> None:
        """Log an entity of another frame, which is never cleared."""
        self._rows.add((frame, time_ns), path, archetype, fields)

    def keep(self, path: str, build: Callable[[], rr.AsComponents], *, key: object, static: bool = True) -> None:
        """Build and log an entity that outlives the frame, but only if its ``key`` has changed since the last time."""
        if path not in self._kept or self._kept[path] != key:
            self._kept[path] = key
            self._send(path, build(), static=static)

    def end(self) -> None:
        """Clear the entities that the frame before had and this one has not."""
        for path in sorted(self._before - self._now):
            self._rows.add(self._time, path, rr.Clear, {"is_recursive": [True]})
        self._before, self._now = self._now, set()
        if self._at_once:
            self.send()

    def send(self) -> None:
        """Send the waiting rows."""
        self._rows.send()

    def _send(self, path: str, entity: rr.AsComponents, *, static: bool = False) -> None:
        if not static:
            frame, time_ns = self._time
            self._stream.set_time("frame", sequence=frame)
            self._stream.set_time("time", duration=np.timedelta64(time_ns, "ns"))
        self._stream.log(path, entity, static=static)


class ColumnLog:
    """As :class:`FrameLog`, for entities of one instance in a known stretch of frames: nothing is sent before its end.

    ``before`` are the paths of the frame before the first one.
    """

    def __init__(self, stream: rr.RecordingStream, before: Iterable[str] = ()) -> None:
        self._time = (0, 0)
        self._rows = _Rows(stream)
        self._before, self._now = set(before), set[str]()

    @property
    def shown(self) -> list[str]:
        """The paths of the last frame, sorted."""
        return sorted(self._before)

    @property
    def paths(self) -> set[str]:
        """All paths with rows that are not sent yet."""
        return self._rows.paths

    def begin(self, frame: int, time_ns: int) -> None:
        """Set the time of all that follows: the source's frame number and time."""
        self._time = (frame, time_ns)

    def log(self, path: str, archetype: Any, **row: Any) -> None:
        """Log an entity of this frame: one row of the archetype's ``columns``."""
        self._now.add(path)
        self._rows.add(self._time, path, archetype, {name: [value] for name, value in row.items()})

    def end(self) -> None:
        """Clear the entities that the frame before had and this one has not."""
        for path in sorted(self._before - self._now):
            self._rows.add(self._time, path, rr.Clear, {"is_recursive": [True]})
        self._before, self._now = self._now, set()

    def send(self) -> None:
        """Send the rows that are not sent yet."""
        self._rows.send()


class _Rows:
    """Rows that wait until they are sent, the rows of an entity together."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._waiting: dict[tuple[str, Any, tuple[str, ...]], list[tuple[tuple[int, int], Mapping[str, Batch]]]] = {}

    @property
    def paths(self) -> set[str]:
        """The paths of all waiting rows."""
        return {path for path, _, _ in self._waiting}

    def add(self, time: tuple[int, int], path: str, archetype: Any, fields: Mapping[str, Batch]) -> None:
        """Add a row at a frame number and time, ns."""
        self._waiting.setdefault((path, archetype, tuple(fields)), []).append((time, fields))

    def send(self) -> None:
        """Send every row."""
        for (path, archetype, names), rows in self._waiting.items():
            times, fields = zip(*rows, strict=True)
            columns = [
                column for name in names for column in _columns(archetype, name, [each[name] for each in fields])
            ]
            self._stream.send_columns(path, indexes=_time_columns(times), columns=columns)
        self._waiting = {}


def _columns(archetype: Any, name: str, batches: Sequence[Batch]) -> Iterable[rr.ComponentColumn]:
    """A field of many rows."""
    joined = np.concatenate(batches) if isinstance(batches[0], np.ndarray) else [*chain.from_iterable(batches)]
    columns: rr.ComponentColumnList = archetype.columns(**{name: joined})
    return columns.partition([len(each) for each in batches])


def _time_columns(times: Sequence[tuple[int, int]]) -> list[rr.TimeColumn]:
    frames, times_ns = zip(*times, strict=True)
    return [
        rr.TimeColumn("frame", sequence=frames),
        rr.TimeColumn("time", duration=np.array(times_ns, dtype="timedelta64[ns]")),
    ]
