"""Reading recordings back. A damaged one, for example after a killed run, gives an error of one line."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

import numpy as np
from rerun.chunk import RrdReader
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


def entity_paths(recording: Path) -> set[str]:
    """Return every entity path of a file."""
    with reading(recording):
        return {chunk.entity_path for chunk in RrdReader(recording).stream()}


def ids_of(recording: Path) -> RecordingIds:
    """Return the ids that all layers of a clip share."""
    with reading(recording):
        entry = RrdReader(recording).recordings()[0]
        return RecordingIds(application=entry.application_id, recording=entry.recording_id)


def has_video(recording: Path) -> bool:
    """Whether images of a file are AV1 video; a file is read once, and again after it was written."""
    status = recording.stat()
    return _has_video(recording, (status.st_size, status.st_mtime_ns, status.st_ino))


@lru_cache(maxsize=1024)
def _has_video(recording: Path, stamp: tuple[int, ...]) -> bool:
    """As :func:`has_video`, for the file with this stamp; errors are not kept."""
    with reading(recording):
        return any(True for _ in RrdReader(recording).stream().filter(components="VideoStream:codec"))


def properties(recording: Path) -> dict[str, object]:
    """Return the properties of a recording that are single values, by name."""
    by_name: dict[str, object] = {}
    with reading(recording):
        for chunk in RrdReader(recording).stream().filter(content="/__properties/**"):
            for name, values in chunk.to_record_batch().to_pydict().items():
                if values and isinstance(values[-1], list) and len(values[-1]) == 1:
                    by_name[name] = values[-1][0]
    return by_name


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
