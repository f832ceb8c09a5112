"""Logging frame by frame into a Rerun stream: times, static values, and the clearing of entities that disappear.

A call to Rerun costs as much as twenty rows, and each chunk takes 2 kB of the file: so the rows of many frames are sent
together, as columns.
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

Time = tuple[int, int]
"""A frame's number and its time, ns."""


Columns = tuple[str, tuple[str, ...]]
"""The name of an entity's archetype, and the fields that its rows have."""

Shown = dict[str, Columns]
"""The entities of a frame by path."""

_ROW_BYTES = 500
"""About what the objects of one row take, beside its values."""


class FrameLog:
    """A part of a recording in which an entity, or a field of one, is cleared in frames that do not log it.

    Rerun shows the latest value of an entity: without clearing, a box would stay where its object was last seen. A row
    without instances clears, in the same chunk as the other rows of the entity.

    Rows wait for :meth:`send`; ``waiting_bytes`` is about the memory that they take. ``before`` are the entities that
    the frame before the first one shows.
    """

    def __init__(self, stream: rr.RecordingStream, before: Shown | None = None) -> None:
        self.waiting_bytes = 0
        self._stream = stream
        self._time: Time = (0, 0)
        self._waiting: dict[tuple[str, Columns], list[tuple[Time, Mapping[str, Batch]]]] = {}
        self._before: Shown = before or {}
        self._now: Shown = {}
        self._kept: dict[str, object] = {}
        self._logged_to: int | None = None

    @property
    def shown(self) -> Shown:
        """The entities of the last frame, sorted by path."""
        return dict(sorted(self._before.items()))

    @property
    def paths(self) -> set[str]:
        """The paths of all rows that are not sent yet."""
        return {path for path, _ in self._waiting}

    @property
    def kept(self) -> set[str]:
        """The paths of all entities with something that outlives its frame, such as a style."""
        return set(self._kept)

    def begin(self, frame: int, time_ns: int) -> bool:
        """Set the frame number and time of the following entities; False if the frame is already logged."""
        if self._logged_to is not None and frame <= self._logged_to:
            return False
        self._logged_to = frame
        self._time = (frame, time_ns)
        return True

    def row(self, path: str, archetype: Any, *, style: Mapping[str, Any] | None = None, **fields: Batch) -> None:
        """Log an entity of this frame: a batch for each field of the archetype's ``columns``.

        ``style`` has the fields that never change. They are static: logged once, and not cleared with the entity.
        """
        if style is not None:
            self.keep(path, lambda: archetype.from_fields(**style), key="style")
        self._now[path] = archetype.__name__, tuple(fields)
        self._add(self._time, path, self._now[path], fields)

    def number(self, path: str, value: float) -> None:
        """Log one number of a curve."""
        self.row(path, rr.Scalars, scalars=[value])

    def event(self, path: str, archetype: Any, *, at: Time | None = None, **fields: Batch) -> None:
        """Log an entity of this frame, or of another one, that is never cleared, such as a line of a text log."""
        self._add(at or self._time, path, (archetype.__name__, tuple(fields)), fields)

    def keep(self, path: str, build: Callable[[], rr.AsComponents], *, key: object, static: bool = True) -> None:
        """Build and log an entity that outlives the frame, but only if its ``key`` has changed since the last time."""
        if path in self._kept and self._kept[path] == key:
            return
        self._kept[path] = key
        if not static:
            frame, time_ns = self._time
            self._stream.set_time("frame", sequence=frame)
            self._stream.set_time("time", duration=np.timedelta64(time_ns, "ns"))
        self._stream.log(path, build(), static=static)

    def end(self) -> None:
        """Clear what the frame before had and this one has not: entities, and fields of them."""
        for path, (archetype, fields) in self.shown.items():
            now, same = self._now.get(path, ("", ()))
            if gone := tuple(field for field in fields if now != archetype or field not in same):
                self._add(self._time, path, (archetype, gone), dict.fromkeys(gone, ()))
        self._before, self._now = self._now, {}

    def send(self) -> None:
        """Send the waiting rows, those of an entity together."""
        for (path, (kind, names)), rows in self._waiting.items():
            archetype = getattr(rr, kind)
            times, fields = zip(*rows, strict=True)
            columns = [
                column for name in names for column in _columns(archetype, name, [field[name] for field in fields])
            ]
            self._stream.send_columns(path, indexes=_time_columns(times), columns=columns)
        self._waiting, self.waiting_bytes = {}, 0

    def _add(self, time: Time, path: str, columns: Columns, fields: Mapping[str, Batch]) -> None:
        self._waiting.setdefault((path, columns), []).append((time, fields))
        self.waiting_bytes += _ROW_BYTES + sum(map(_bytes, fields.values()))


def _bytes(batch: Batch) -> int:
    if isinstance(batch, np.ndarray):
        return batch.nbytes
    return sum(len(item) for item in batch if isinstance(item, bytes | str))


def _columns(archetype: Any, name: str, batches: Sequence[Batch]) -> Iterable[rr.ComponentColumn]:
    """A field of many rows."""
    filled = [batch for batch in batches if len(batch)]
    is_array = bool(filled) and isinstance(filled[0], np.ndarray)
    joined = np.concatenate(filled) if is_array else [*chain.from_iterable(filled)]
    columns: rr.ComponentColumnList = archetype.columns(**{name: joined})
    return columns.partition([len(batch) for batch in batches])


def _time_columns(times: Sequence[Time]) -> list[rr.TimeColumn]:
    frames, times_ns = zip(*times, strict=True)
    return [
        rr.TimeColumn("frame", sequence=frames),
        rr.TimeColumn("time", duration=np.array(times_ns, dtype="timedelta64[ns]")),
    ]
