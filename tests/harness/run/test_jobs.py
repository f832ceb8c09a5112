"""How a plan becomes jobs, and which of them run at the same time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.pipeline.cache_store import Store
from harness.run.directory import RunDirectory, new_run_id
from harness.run.experiment import load_experiment
from harness.run.frame_sink import SinkContext
from harness.run.jobs import LONGEST_STRETCH, run_jobs, stretches
from harness.run.loop import ClipJob, ClipOutcome, run_clip
from harness.run.plan import prepare


@given(frames=st.lists(st.integers(), unique=True, max_size=600), workers=st.integers(2, 9))
def test_stretches_hold_every_frame_once_and_in_order_and_grow_no_longer(frames: list[int], workers: int) -> None:
    cut = list(stretches(frames, workers))
    assert [frame for stretch in cut for frame in stretch] == frames
    lengths = [len(stretch) for stretch in cut]
    assert lengths == sorted(lengths, reverse=True)
    assert max(lengths, default=0) <= LONGEST_STRETCH
    assert set(lengths[-workers:]) <= {1}


@dataclass(frozen=True)
class Recordings:
    """A sink factory whose configurations may write one file together."""

    shares_files: bool

    def described(self) -> dict[str, Any]:
        return {}

    def open(self, context: SinkContext) -> None:
        return None


class DyingWorkers:
    """An executor whose workers die of every frame they perceive; it notes the jobs that it is given together."""

    workers, threads = 2, 1

    def __init__(self) -> None:
        self.together: list[list[str]] = []

    def run(
        self, work: object, jobs: Sequence[ClipJob], progress: object, lost: Callable[[ClipJob, str], ClipOutcome]
    ) -> Iterator[ClipOutcome]:
        if work is run_clip:
            self.together.append([configuration.name for job in jobs for configuration in job.configurations])
        for job in jobs:
            yield ClipOutcome(failures={}) if work is run_clip else lost(job, "died")


@pytest.mark.parametrize(
    ("shares_files", "together"),
    [
        (False, [["bm-one", "bm-two", "sgbm-one", "sgbm-two"]]),
        (True, [["bm-one"], ["bm-two"], ["sgbm-one"], ["sgbm-two"]]),
    ],
)
def test_no_two_jobs_write_one_recording_at_the_same_time(
    shares_files: bool, together: list[list[str]], tmp_path: Path
) -> None:
    experiment = load_experiment("demo", clips=("studio_table",))
    plan = prepare(experiment, limit=2, sinks=[Recordings(shares_files)])
    directory, executor = RunDirectory(tmp_path / "run"), DyingWorkers()
    directory.write_manifest({"run_id": new_run_id()})
    store = Store(tmp_path / "cache", 10**9)
    run_jobs(plan, directory, cache=store, executor=executor, progress=lambda clip: None)  # type: ignore[arg-type]
    assert executor.together == together
