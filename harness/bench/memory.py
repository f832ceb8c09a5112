"""Peak resident memory of a whole run (reading, matching, attention, recording), by the length of its clip."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

from harness.bench.generated_clip import write_clip
from harness.bench.hours import peak_mib, run_experiment
from harness.processes import spawning


@dataclass(frozen=True, slots=True, kw_only=True)
class Peak:
    """The peak of a fresh process that ran this many frames."""

    frames: int
    peak_mib: float


def measure_memory(frames: int) -> Peak:
    """Run a generated clip under four configurations with light recordings, in a fresh process."""
    with tempfile.TemporaryDirectory() as folder, spawning().Pool(1) as pool:
        root = Path(folder)
        return Peak(frames=frames, peak_mib=pool.apply(_run, (write_clip(root, frames), root / "run")))


def _run(experiment: Path, out: Path) -> float:
    run_experiment(experiment, out)
    return peak_mib()
