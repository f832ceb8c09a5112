"""The cost of hours of video: ``python -m scripts.measure hours 1500 6000 18000``.

Each length is a generated clip of 160 x 120 pixels at 25 Hz, with one person, three objects and labels, under four
configurations: block matching, masks and gazes from files, attention by cones, a filtered gaze and the nearest angle;
with recordings, thumbnails, tables and page. A run, its first scoring, and a scoring after one label was edited are
three fresh processes. CPU seconds are those of the process; wall-clock seconds also depend on the load of the machine.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.processes import spawning
from harness.report.formats import Table
from harness.report.sinks import composed_sinks
from harness.report.write import rescore
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.plan import prepare
from harness.run.runner import run_plan
from scripts.measure.generated_clip import write_clip, write_labels
from scripts.measure.printing import print_tables


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Seconds, CPU seconds, and the peak memory of a fresh process."""

    seconds: float
    cpu_seconds: float
    peak_mib: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Hours:
    """A run of this many frames, its first scoring and the one after an edited label, and the bytes of its files."""

    frames: int
    run: Cost
    scored: Cost
    again: Cost
    results_bytes: int
    recordings_bytes: int
    thumbnails_bytes: int
    page_bytes: int


def measure_hours(frames: int, root: Path) -> Hours:
    """Run and score a generated clip of this many frames in an empty folder."""
    experiment = write_clip(root, frames)
    out = root / "run"
    run = _fresh(run_experiment, experiment, out)
    scored = _fresh(score_run, out)
    write_labels(root, frames, edited=frames // 2)
    again = _fresh(score_run, out)
    return Hours(
        frames=frames,
        run=run,
        scored=scored,
        again=again,
        results_bytes=_bytes(out, "*/**/*.parquet"),
        recordings_bytes=_bytes(out, "*.rrd"),
        thumbnails_bytes=_bytes(out, "thumbnails/**/*"),
        page_bytes=(out / "report.html").stat().st_size,
    )


def run_experiment(experiment: Path, out: Path) -> None:
    """Run an experiment without a cache, with light recordings and thumbnails, in this process."""
    loaded = load_experiment(str(experiment))
    plan = prepare(loaded, sinks=composed_sinks(loaded.configurations))
    run_plan(plan, out, workers=1, progress=lambda clip: None)


def score_run(out: Path) -> None:
    """Score a run as ``vfoa score`` does."""
    rescore(RunDirectory(out))


def _fresh(work: Callable[..., None], *arguments: Path) -> Cost:
    with spawning().Pool(1) as pool:
        return pool.apply(_cost, (work, arguments))


def _cost(work: Callable[..., None], arguments: tuple[Path, ...]) -> Cost:
    started, cpu = time.perf_counter(), time.process_time()
    work(*arguments)
    return Cost(seconds=time.perf_counter() - started, cpu_seconds=time.process_time() - cpu, peak_mib=peak_mib())


def peak_mib() -> float:
    """Peak resident memory of this process, in MiB."""
    status = Path("/proc/self/status")
    if status.is_file():  # ru_maxrss would also include the peak of the parent process
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def _bytes(out: Path, pattern: str) -> int:
    return sum(path.stat().st_size for path in out.glob(pattern) if path.is_file())


def hours_table(rows: Sequence[Hours]) -> Table:
    """One row per length; rates are per thousand frames, so that linear growth gives the same number in each row."""
    return Table(
        title="Runs of generated clips of 160 x 120 pixels under four configurations",
        columns=(
            *("frames", "run s", "CPU s", "CPU ms a frame", "peak MiB", "results MB", "recordings MB"),
            *("thumbnails MB", "page MB", "score CPU s", "peak MiB", "again s", "CPU s"),
        ),
        rows=tuple(
            (
                str(row.frames),
                f"{row.run.seconds:.0f}",
                f"{row.run.cpu_seconds:.0f}",
                f"{1e3 * row.run.cpu_seconds / row.frames:.1f}",
                f"{row.run.peak_mib:.0f}",
                f"{row.results_bytes / 1e6:.1f}",
                f"{row.recordings_bytes / 1e6:.0f}",
                f"{row.thumbnails_bytes / 1e6:.0f}",
                f"{row.page_bytes / 1e6:.1f}",
                f"{row.scored.cpu_seconds:.1f}",
                f"{row.scored.peak_mib:.0f}",
                f"{row.again.seconds:.1f}",
                f"{row.again.cpu_seconds:.1f}",
            )
            for row in rows
        ),
        words=0,
        notes=("Again: scoring after one label was edited, imports of the fresh process included.",),
    )


def main() -> None:
    """Measure the given lengths."""
    parser = argparse.ArgumentParser(description="Measure runs of generated clips.")
    parser.add_argument("frames", type=int, nargs="+", help="numbers of frames")
    given = parser.parse_args()
    runs: list[Hours] = []
    for frames in given.frames:
        with tempfile.TemporaryDirectory() as folder:
            runs.append(measure_hours(frames, Path(folder)))
        print_tables(hours_table(runs))
