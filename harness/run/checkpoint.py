"""Checkpoints: the state of a configuration on a clip, from which a killed run continues.

A checkpoint is a file beside the partial results, rewritten from time to time. It holds the memory of ``attend``, the
names so far, and how far each sink has written its files: values and no code. A run that continues reads it, skips the
frames before it, and gives the same results to the last bit. A checkpoint that does not fit the files is ignored, with
a reason; then every frame is attended to again.
"""

from __future__ import annotations

import zlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from harness.clips.naming import SubjectNames
from harness.files.io import atomic_write
from harness.run.directory import Pair, RunDirectory
from harness.stages.cache_store import Codec
from vfoa.bayes import BeliefState
from vfoa.gaze.temporal import WindowStart
from vfoa.gaze_filter import CueFilter, GazeFilterState
from vfoa.logit import Traces
from vfoa.logit_cues import Means
from vfoa.pipeline import Memory
from vfoa.posterior.belief import Belief
from vfoa.posterior.gaze_error import GazeError
from vfoa.posterior.grid import GazeHypotheses, HeadHypotheses
from vfoa.posterior.head_motion import HeadMotion
from vfoa.posterior.looks import Looks
from vfoa.tracking import Track, TrackerState

VERSION = 1
"""Version of the format. A checkpoint of another version is ignored."""

SECONDS = 10.0
"""Least time between two checkpoints of a run."""

_STEADY_S = 100.0
"""After this time, the pause grows as the run does: a kill loses at most a tenth of the time so far. A checkpoint makes
recordings send all that waits, in small chunks, whose number would else grow with the time."""

_TAIL = 1 << 16
"""Number of bytes at the end of a file's written part that are checked."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SinkState:
    """How far a sink has come. ``files`` gives the bytes written, by path below the run's directory.

    ``values`` holds whatever else the sink needs to continue.
    """

    files: Mapping[str, int]
    values: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Checkpoint:
    """The state of one configuration after ``frame``, the last of ``written`` frames that every sink has taken.

    ``window`` is where a temporal gaze model must begin again. ``sinks`` are by their name in the job.
    """

    frame: int
    written: int
    memory: Memory
    names: SubjectNames
    window: WindowStart | None
    sinks: Mapping[str, SinkState]

    @property
    def first_read(self) -> int:
        """The first frame that must be read to continue; it may be attended to already."""
        return self.frame + 1 if self.window is None else self.window.frame


@dataclass(frozen=True, slots=True)
class _Layout:
    """An array and the memory order of its axes: the order of a sum, and so its last bit, depends on it."""

    order: tuple[int, ...]
    array: Any


_PARTS = (Checkpoint, SinkState, Memory, TrackerState, Track, GazeFilterState, CueFilter, Traces, Means)
_BELIEF = (BeliefState, Belief, GazeHypotheses, HeadHypotheses, Looks, GazeError, HeadMotion)


_ITEMS = "$items"


class _CheckpointCodec(Codec):
    """A codec that also takes mappings, and keeps the memory order of arrays."""

    def __init__(self) -> None:
        super().__init__((*_PARTS, *_BELIEF, SubjectNames, WindowStart, _Layout))

    def _plain(self, value: object) -> object:
        if isinstance(value, np.ndarray) and not value.flags.c_contiguous:
            order = tuple(int(axis) for axis in np.argsort([-abs(stride) for stride in value.strides], kind="stable"))
            return super()._plain(_Layout(order, np.ascontiguousarray(value.transpose(order))))
        if isinstance(value, Mapping):
            return {_ITEMS: [[self._plain(key), self._plain(each)] for key, each in value.items()]}
        return super()._plain(value)

    def _value(self, plain: Any) -> Any:
        if isinstance(plain, dict) and _ITEMS in plain:
            return {self._value(key): self._value(each) for key, each in plain[_ITEMS]}
        value = super()._value(plain)
        return value.array.transpose(np.argsort(value.order)) if isinstance(value, _Layout) else value


_codec = _CheckpointCodec()


def pause_s(run_s: float) -> float:
    """Seconds between the checkpoint after ``run_s`` seconds of a run and the next one."""
    return SECONDS * max(1.0, run_s / _STEADY_S)


def write_checkpoint(directory: RunDirectory, pair: Pair, found: Checkpoint) -> None:
    """Replace the last checkpoint by a new one, atomically."""
    files = {name: size for state in found.sinks.values() for name, size in state.files.items()}
    tails = {name: _tail(directory.path / name, size) for name, size in files.items()}
    body = _codec.encode((found, tails))
    head = f"vfoa checkpoint {VERSION} {zlib.crc32(body):08x}\n".encode()
    atomic_write(directory.checkpoint(pair), head + body)


def read_checkpoint(
    directory: RunDirectory, pair: Pair, frames: Collection[int], sinks: Collection[str]
) -> tuple[Checkpoint | None, str | None]:
    """Read the checkpoint of a (clip, configuration), None without a usable one; and the reason why it is not usable.

    ``frames`` are those of the run, ``sinks`` the names of its sinks.
    """
    try:
        head, _, body = directory.checkpoint(pair).read_bytes().partition(b"\n")
    except OSError:
        return None, None
    if head != f"vfoa checkpoint {VERSION} {zlib.crc32(body):08x}".encode():
        return None, f"expected format {VERSION} with a right checksum"
    try:
        found, tails = _codec.decode(body)
    except Exception as error:  # a right checksum, but not written by this program
        return None, f"{type(error).__name__}: {error}"
    return (found, None) if (why := _misfit(found, tails, directory, frames, sinks)) is None else (None, why)


def _misfit(
    found: object, tails: Mapping[str, int], directory: RunDirectory, frames: Collection[int], sinks: Collection[str]
) -> str | None:
    if not isinstance(found, Checkpoint) or found.frame not in frames:
        return "expected a frame of this run"
    if not found.sinks.keys() <= set(sinks):
        return f"expected the sinks {', '.join(sorted(sinks))}, found {', '.join(sorted(found.sinks))}"
    for state in found.sinks.values():
        for name, size in state.files.items():
            path = directory.path / name
            if not path.is_file() or path.stat().st_size < size or _tail(path, size) != tails.get(name):
                return f"{name} has changed since it was written"
    return None


def _tail(path: Path, size: int) -> int:
    """Checksum of the last bytes of the first ``size`` bytes of a file."""
    with path.open("rb") as file:
        file.seek(max(0, size - _TAIL))
        return zlib.crc32(file.read(min(size, _TAIL)))
