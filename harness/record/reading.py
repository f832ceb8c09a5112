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
from vfoa.errors import VfoaError
from vfoa.types import Float


@contextmanager
def reading(recording: Path) -> Iterator[None]:
    """Turn errors of Rerun's reader in the block into a :class:`VfoaError` that names the recording."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RerunWarning)  # a missing footer: what is read is complete, or an error
            yield
    except (RuntimeError, ValueError) as error:
        raise VfoaError(f"{recording}: incomplete or damaged recording: {str(error).splitlines()[0]}") from None


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


def first_points(recording: Path) -> list[Float]:
    """Return the points (N, 3) of each instance at its first frame, camera frame, metres, for the first instances."""
    first_clouds: dict[str, Float] = {}
    with reading(recording):
        clouds = RrdReader(recording).stream().filter(content=f"{entities.RECONSTRUCTION}/**", components=_POSITIONS)
        for chunk in clouds:
            if chunk.entity_path in first_clouds:  # the time of a cloud repeats: all first clouds have been read
                break
            clouds_of = [cloud for cloud in chunk.to_record_batch().column(_POSITIONS).drop_null().to_pylist() if cloud]
            if clouds_of:
                first_clouds[chunk.entity_path] = np.array(clouds_of[0], dtype=np.float64).reshape(-1, 3)
    return list(first_clouds.values())


_POSITIONS = "Points3D:positions"
