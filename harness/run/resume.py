"""What a killed run leaves, and how it continues: results so far, one line per frame, and checkpoints.

The lines of a frame go to the operating system when the frame is finished, its timings before its result. A run that
continues keeps the whole lines of the killed run. It continues from the last checkpoint, or from the first frame
without one: trackers and filters carry more than the lines hold. The frames after the checkpoint are computed again and
compared with their lines.

A checkpoint is a file beside the partial results, rewritten from time to time. It holds the memory of ``attend``, the
names so far, and how far each sink has written its files: values and no code. A run that continues reads it, skips the
frames before it, and gives the same results to the last bit. A checkpoint that does not fit the files is ignored, with
a reason; then every frame is attended to again.
"""

from __future__ import annotations

import time
import zlib
from collections.abc import Collection, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

from harness.clips.naming import SubjectNames
from harness.files.io import atomic_write, take_lock
from harness.pipeline.cache_store import Codec
from harness.run.directory import Pair, RunDirectory
from harness.run.frame_sink import FinishedFrame, SinkContext, SinkState
from harness.run.results import to_line
from vfoa.bayes import BeliefState
from vfoa.errors import VfoaError
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
"""After this time, the pause grows as the run does. A checkpoint makes recordings send all that waits, in small chunks,
whose number would else grow with the time."""

EVEN_FRAMES = 600
"""A checkpoint waits for a frame at a multiple of this number, for at most as long again as the pause, so that a kill
loses at most a fifth of the time so far. Recordings send their rows at these frames anyway: chunks of all sizes would
fragment the memory. It is a multiple of the key frames' distance at common rates."""

_TAIL = 1 << 16
"""Number of bytes at the end of a file's written part that are checked."""


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


_PARTS = (Checkpoint, SinkState, Memory, TrackerState, Track, GazeFilterState, CueFilter, Traces, Means)
_BELIEF = (BeliefState, Belief, GazeHypotheses, HeadHypotheses, Looks, GazeError, HeadMotion)


_codec = Codec((*_PARTS, *_BELIEF, SubjectNames, WindowStart))


def is_due(run_s: float, since_s: float, frames: int) -> bool:
    """Whether a checkpoint is due, so many seconds and frames after the begin of a run, and seconds after the last."""
    pause_s = SECONDS * max(1.0, (run_s - since_s) / _STEADY_S)
    return since_s >= (pause_s if frames % EVEN_FRAMES == 0 else 2 * pause_s)


def write_checkpoint(directory: RunDirectory, pair: Pair, checkpoint: Checkpoint) -> None:
    """Replace the last checkpoint by a new one, atomically."""
    files = {name: size for state in checkpoint.sinks.values() for name, size in state.files.items()}
    tails = {name: _tail(directory.path / name, size) for name, size in files.items()}
    body = _codec.encode((checkpoint, tails))
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
        checkpoint, tails = _codec.decode(body)
    except Exception as error:  # a right checksum, but not written by this program
        return None, f"{type(error).__name__}: {error}"
    return (checkpoint, None) if (why := _misfit(checkpoint, tails, directory, frames, sinks)) is None else (None, why)


def _misfit(
    checkpoint: object,
    tails: Mapping[str, int],
    directory: RunDirectory,
    frames: Collection[int],
    names: Collection[str],
) -> str | None:
    if not isinstance(checkpoint, Checkpoint) or checkpoint.frame not in frames:
        return "expected a frame of this run"
    if not checkpoint.sinks.keys() <= set(names):
        return f"expected the sinks {', '.join(sorted(names))}, found {', '.join(sorted(checkpoint.sinks))}"
    for state in checkpoint.sinks.values():
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


LOCK_SECONDS = 10.0
"""Seconds that the last writer of a file may take to end before it counts as another run."""


def _cut_results(file: BinaryIO, start: int) -> int:
    """Drop an unfinished last line, go to ``start``, and return the number of lines from there on."""
    file.seek(start)
    lines, end = 0, start
    for line in file:
        if not line.endswith(b"\n"):
            break
        lines, end = lines + 1, end + len(line)
    file.truncate(end)
    file.seek(start)
    return lines


def _cut_timings(file: BinaryIO, frames: int, start: int) -> None:
    """Drop all timings after ``start`` except those of the first ``frames`` frames.

    The lines of a frame are consecutive, with its number in the third column.
    """
    file.seek(start)
    end, seen, last = start, 0, b""
    for line in file:
        number = line.split(b",")[2] if line.count(b",") > 2 else b""
        seen, last = seen + (number != last), number
        if seen > frames:
            break
        end += len(line)
    file.truncate(end)
    file.seek(end)


class ResultsSink:
    """Results and timings of one (clip, configuration): two partial files, open in a ``with`` block.

    :meth:`mark_finished` gives them their names, when all sinks of the clip are closed. Frames that an interrupted
    run has written beyond ``resumed`` are compared with its lines, not written again.
    """

    def __init__(self, directory: RunDirectory, pair: Pair, resumed: SinkState | None = None) -> None:
        self._paths = directory.partial(pair, "jsonl.partial"), directory.partial(pair, "csv.partial")
        self._names = [path.relative_to(directory.path).as_posix() for path in self._paths]
        self._starts = [resumed.files[name] if resumed else 0 for name in self._names]
        self._frames = self._kept = resumed.values["frames"] if resumed else 0
        self._files = ExitStack()

    def __enter__(self) -> Self:
        """Open the files; a :class:`VfoaError` says that another process is writing them."""
        self._paths[0].parent.mkdir(parents=True, exist_ok=True)
        with ExitStack() as files:
            self._results, self._timings = (files.enter_context(open(path, "a+b")) for path in self._paths)
            deadline = time.monotonic() + LOCK_SECONDS
            while not take_lock(self._results):
                if time.monotonic() > deadline:
                    raise VfoaError(f"{self._paths[0]}: another process is writing it; expected one run in a directory")
                time.sleep(0.1)
            more = _cut_results(self._results, self._starts[0])
            _cut_timings(self._timings, more, self._starts[1])
            self._kept += more
            self._files = files.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._files.close()

    def mark_finished(self) -> None:
        """Mark the (clip, configuration) as finished."""
        for draft in reversed(self._paths):  # the results' file is the mark: it is last
            draft.replace(draft.with_suffix(""))

    @property
    def goes_on(self) -> bool:
        """Whether the next frame is a new one."""
        return self._frames >= self._kept

    def state(self) -> SinkState | None:
        """The extent of the files; None while kept frames are being compared."""
        if not self.goes_on:
            return None
        sizes = self._results.tell(), self._timings.tell()
        return SinkState(files=dict(zip(self._names, sizes, strict=True)), values={"frames": self._frames})

    def write(self, frame: FinishedFrame) -> None:
        """Write one frame: its line of results, and its ms per stage.

        Raises
        ------
        VfoaError
            If an earlier run has written another result for the frame.
        """
        record, line = frame.record, to_line(frame.record).encode()
        if self.goes_on:
            prefix = f"{record.clip},{record.configuration},{record.frame}"
            rows = "".join(f"{prefix},{stage},{1e3 * seconds:.3f}\n" for stage, seconds in frame.timings.items())
            for file, content in ((self._timings, rows.encode()), (self._results, line)):
                file.write(content)
                file.flush()
        elif self._results.readline() != line:
            raise VfoaError(
                f"{self._results.name}, line {self._frames + 1}: expected what this program computes for the frame, "
                "found another result; remove the file to begin anew"
            )
        self._frames += 1


class ResultsSinks:
    """Opens the results of each configuration: the last sink of every run, so that it knows the times of all others."""

    def described(self) -> Mapping[str, Any]:
        """The manifest needs no entry: every run has results."""
        return {}

    def open(self, context: SinkContext) -> ResultsSink:
        """Open the results of one configuration on one clip."""
        return ResultsSink(context.directory, (context.manifest.name, context.configuration), context.resumed)
