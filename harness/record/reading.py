"""Reading recordings back. A damaged one, for example after a killed run, gives an error of one line."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

import numpy as np
from rerun.chunk import Chunk, RrdReader
from rerun.error_utils import RerunWarning

from harness.record import entities
from harness.record.layers import RecordingIds
from vfoa.errors import VfoaError, first_line
from vfoa.geometry import box_corners, rotation_of
from vfoa.types import Box3D, Float


@contextmanager
def reading(recording: Path) -> Iterator[None]:
    """Turn errors of Rerun's reader in the block into a :class:`VfoaError` that names the recording."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RerunWarning)  # a missing footer: what is read is complete, or an error
            yield
    except (RuntimeError, ValueError) as error:
        raise VfoaError(f"{recording}: incomplete or damaged recording: {first_line(error)}") from None


class RecordingFile:
    """A file of a recording, opened once: the ids that all layers of a clip share, its properties and its chunks.

    Raises
    ------
    VfoaError
        Here, or from its methods, if the file is damaged.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        with reading(path):
            self._reader = RrdReader(path)
            entry = self._reader.recordings()[0]
        self.ids = RecordingIds(application=entry.application_id, recording=entry.recording_id)

    def chunks(self) -> Iterator[Chunk]:
        """Yield all chunks."""
        with reading(self._path):
            yield from self._reader.stream()

    def frames(self) -> set[int]:
        """Return the numbers of all frames."""
        batches = (chunk.to_record_batch() for chunk in self.chunks() if "frame" in chunk.timeline_names)
        return {number for batch in batches for number in batch.column("frame").cast("int64").to_pylist()}

    def times_ns(self) -> tuple[int, int] | None:
        """Return the first and the last time, nanoseconds; None without any."""
        batches = (chunk.to_record_batch() for chunk in self.chunks() if "time" in chunk.timeline_names)
        times = [batch.column("time").cast("int64").to_numpy() for batch in batches if batch.num_rows]
        return (int(min(map(np.min, times))), int(max(map(np.max, times)))) if times else None

    def properties(self) -> dict[str, object]:
        """Return the properties of the recording that are single values, by name."""
        by_name: dict[str, object] = {}
        with reading(self._path):
            for chunk in self._reader.stream().filter(content="/__properties/**"):
                for name, values in chunk.to_record_batch().to_pydict().items():
                    if values and isinstance(values[-1], list) and len(values[-1]) == 1:
                        by_name[name] = values[-1][0]
        return by_name


def has_video(recording: Path) -> bool:
    """Whether images of a file are AV1 video; a file is read once, and again after it was written."""
    status = recording.stat()
    return _has_video(recording, (status.st_size, status.st_mtime_ns, status.st_ino))


@lru_cache(maxsize=1024)
def _has_video(recording: Path, stamp: tuple[int, ...]) -> bool:
    """As :func:`has_video`, for the file with this stamp; errors are not kept."""
    with reading(recording):
        return any(True for _ in RrdReader(recording).stream().filter(components="VideoStream:codec"))


def first_shapes(recording: Path) -> list[Float]:
    """Return the points (N, 3) of each instance at its first frame, camera frame, metres, for the first instances.

    They are those of its cloud, if there is one, and the corners of its box.
    """
    clouds = [points for (points,) in _first_rows(recording, ("Points3D:positions",))]
    boxes = [
        Box3D(center_m=center, half_size_m=half_size, left_from_box=rotation_of(quaternion))
        for (center,), (half_size,), (quaternion,) in _first_rows(recording, _BOX)
    ]
    return [*clouds, *(box_corners(boxes) if boxes else ())]


_BOX = ("Boxes3D:centers", "Boxes3D:half_sizes", "Boxes3D:quaternions")


def _first_rows(recording: Path, components: tuple[str, ...]) -> list[list[Float]]:
    """The first row of each instance with these components, each as an array (N, ...)."""
    first: dict[str, list[Float]] = {}
    with reading(recording):
        stream = RrdReader(recording).stream().filter(content=f"{entities.RECONSTRUCTION}/**", components=[*components])
        for chunk in stream:
            if chunk.entity_path in first:  # the time of an instance repeats: all first rows have been read
                break
            batch = chunk.to_record_batch()
            rows = zip(*(batch.column(component).to_pylist() for component in components), strict=True)
            if row := next((row for row in rows if all(row)), None):
                first[chunk.entity_path] = [np.array(values, dtype=np.float64) for values in row]
    return list(first.values())
