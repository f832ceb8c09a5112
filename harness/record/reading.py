"""Reading recordings back: one line for one that is damaged, as one is that a run was killed in."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from harness.record import entities
from vfoa.errors import VfoaError
from vfoa.types import Float


@contextmanager
def reading(recording: Path) -> Iterator[None]:
    """Within the block, what Rerun's reader says against a recording is a :class:`VfoaError` that names it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RerunWarning)  # of a missing footer: what is read is whole, or an error
            yield
    except (RuntimeError, ValueError) as error:
        raise VfoaError(f"{recording}: not a whole recording: {str(error).splitlines()[0]}") from None


def entity_paths(recording: Path) -> set[str]:
    """Every entity of a file."""
    with reading(recording):
        return {chunk.entity_path for chunk in RrdReader(recording).stream()}


def properties(recording: Path) -> dict[str, object]:
    """The properties of a recording that are single values, by name, whatever they are of."""
    found: dict[str, object] = {}
    with reading(recording):
        for chunk in RrdReader(recording).stream().filter(content="/__properties/**"):
            for name, values in chunk.to_record_batch().to_pydict().items():
                if values and isinstance(values[-1], list) and len(values[-1]) == 1:
                    found[name] = values[-1][0]
    return found


def first_points(recording: Path) -> list[Float]:
    """The points (N, 3) of each instance at its first frame, camera frame, metres, of the first instances to come."""
    found: dict[str, Float] = {}
    with reading(recording):
        clouds = RrdReader(recording).stream().filter(content=f"{entities.RECONSTRUCTION}/**", components=_POSITIONS)
        for chunk in clouds:
            if chunk.entity_path in found:  # the second part of a cloud's time: the first parts have all come
                break
            values = chunk.to_record_batch().column(_POSITIONS).drop_null().to_pylist()
            if values:
                found[chunk.entity_path] = np.array(values[0], dtype=np.float64).reshape(-1, 3)
    return list(found.values())


_POSITIONS = "Points3D:positions"
