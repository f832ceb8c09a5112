"""The cost of continuing a killed run: from the command to the first new frame, and to the end."""

from __future__ import annotations

import os
import resource
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from harness.bench.generated_clip import write_clip
from harness.files.digests import SETTLED_NS
from harness.processes import spawning
from harness.report.formats import Table
from harness.report.sinks import composed_sinks
from harness.run.experiment import load_experiment
from harness.run.frame_sink import FinishedFrame, SinkContext, SinkState
from harness.run.plan import prepare
from harness.run.runner import run_plan


@dataclass(frozen=True, slots=True, kw_only=True)
class Reached:
    """How long after the start of a process something was reached: seconds, and CPU seconds of the process."""

    seconds: float
    cpu_seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Resumed:
    """A run of this many frames that was killed at one of them, and the process that continued it.

    Reached, one after the other: the program's modules are imported, the clip is opened, the run is described and its
    checkpoints are read, the first new frame is written, the run is finished.
    """

    frames: int
    killed_at: int
    imported: Reached
    opened: Reached
    described: Reached
    first_frame: Reached
    finished: Reached
    peak_mib: float


def measure_resume(frames: int, killed_at: int, root: Path) -> Resumed:
    """Run a generated clip of this many frames in an empty folder, kill the run at a frame, and continue it."""
    experiment = write_clip(root, frames)
    time.sleep(SETTLED_NS / 1e9)  # files that were written just now would be read again
    killed = spawning().Process(target=_run_until, args=(experiment, root / "run", killed_at))
    killed.start()
    killed.join()
    with spawning().Pool(1) as pool:
        return pool.apply(_resume, (experiment, root / "run", frames, killed_at, time.time()))


@dataclass(frozen=True, slots=True)
class Watch:
    """A sink that writes nothing: it calls ``seen`` with the number of each frame."""

    seen: Callable[[int], object]

    def described(self) -> Mapping[str, Any]:
        """It is no setting of a run."""
        return {}

    def open(self, context: SinkContext) -> Self:
        """Watch a configuration."""
        return self

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None: ...

    def write(self, frame: FinishedFrame) -> None:
        """Take one frame."""
        self.seen(frame.record.frame)

    def state(self) -> SinkState:
        """There is nothing to continue."""
        return SinkState(files={})


def _run_until(experiment: Path, out: Path, frame: int) -> None:
    def kill_at_frame(number: int) -> None:
        if number == frame:
            os.kill(os.getpid(), signal.SIGKILL)

    loaded = load_experiment(str(experiment))
    sinks = (*composed_sinks(loaded.configurations), Watch(kill_at_frame))
    run_plan(prepare(loaded, sinks=sinks), out, workers=1, progress=lambda clip: None)


def _resume(experiment: Path, out: Path, frames: int, killed_at: int, started: float) -> Resumed:
    def reached() -> Reached:
        return Reached(seconds=time.time() - started, cpu_seconds=time.process_time())

    imported = reached()
    described: list[Reached] = []
    first: list[Reached] = []
    loaded = load_experiment(str(experiment))

    def note_first(number: int) -> None:
        if not first:
            first.append(reached())

    sinks = (*composed_sinks(loaded.configurations), Watch(note_first))
    plan = prepare(loaded, sinks=sinks)
    opened = reached()
    run_plan(plan, out, workers=1, progress=lambda clip: None, tell=lambda line: described.append(reached()))
    return Resumed(
        frames=frames,
        killed_at=killed_at,
        imported=imported,
        opened=opened,
        described=described[-1],
        first_frame=first[0],
        finished=reached(),
        peak_mib=peak_mib(),
    )


def resume_table(rows: Sequence[Resumed]) -> Table:
    """One row per run; CPU seconds since the start of the process that continues it."""
    return Table(
        title="Runs that were killed and continued",
        columns=(
            *("frames", "killed at", "imported", "opened", "described", "first new frame", "its wall s"),
            *("finished", "its wall s", "peak MiB"),
        ),
        rows=tuple(
            (
                *(str(row.frames), str(row.killed_at)),
                *(f"{cost.cpu_seconds:.1f}" for cost in (row.imported, row.opened, row.described, row.first_frame)),
                f"{row.first_frame.seconds:.1f}",
                f"{row.finished.cpu_seconds:.1f}",
                f"{row.finished.seconds:.1f}",
                f"{row.peak_mib:.0f}",
            )
            for row in rows
        ),
        words=0,
        notes=("CPU seconds since the start of the process that continues, the imports included.",),
    )


def peak_mib() -> float:
    """Peak resident memory of this process, in MiB."""
    status = Path("/proc/self/status")
    if status.is_file():  # ru_maxrss would also include the peak of the parent process
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
