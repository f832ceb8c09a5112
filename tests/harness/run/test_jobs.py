"""How a plan becomes jobs, and which of them run at the same time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.pipeline.cache_store import Store
from harness.run.directory import Pair, RunDirectory, new_run_id
from harness.run.experiment import load_experiment
from harness.run.frame_sink import SinkContext, SinkFactory
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


class Counts:
    """A sink factory without files."""

    def described(self) -> dict[str, Any]:
        return {}

    def open(self, context: SinkContext) -> None:
        return None


class Recordings(Counts):
    """A sink factory whose configurations write one file together."""

    def files(self, directory: RunDirectory, pair: Pair) -> tuple[Path, ...]:
        return (directory.path / f"{pair[0]}.rrd",)


DEMO = ["bm-one", "bm-two", "bm-nearest", "sgbm-one", "sgbm-two", "sgbm-nearest"]


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
    ("sinks", "together"),
    [
        (Counts(), [DEMO]),
        # apart, since one of them may have killed the workers; then all together, for the recording that they share
        (Recordings(), [*([name] for name in DEMO), DEMO]),
    ],
)
def test_no_two_jobs_write_one_recording_at_the_same_time(
    sinks: SinkFactory, together: list[list[str]], tmp_path: Path
) -> None:
    experiment = load_experiment("demo", clips=("studio_table",))
    plan = prepare(experiment, limit=2, sinks=[sinks])
    directory, executor = RunDirectory(tmp_path / "run"), DyingWorkers()
    directory.write_manifest({"run_id": new_run_id()})
    store = Store(tmp_path / "cache", 10**9)
    run_jobs(plan, directory, cache=store, executor=executor, progress=lambda clip: None)  # type: ignore[arg-type]
    assert executor.together == together


def test_a_recording_is_written_again_without_the_configuration_that_killed_its_worker(tmp_path: Path) -> None:
    class OneDies(DyingWorkers):
        def run(
            self, work: object, jobs: Sequence[ClipJob], progress: object, lost: Callable[[ClipJob, str], ClipOutcome]
        ) -> Iterator[ClipOutcome]:
            for job, outcome in zip(jobs, super().run(work, jobs, progress, lost), strict=True):
                names = [configuration.name for configuration in job.configurations]
                yield lost(job, "died") if names == ["bm-two"] else outcome

    plan = prepare(load_experiment("demo", clips=("studio_table",)), limit=2, sinks=[Recordings()])
    directory, executor = RunDirectory(tmp_path / "run"), OneDies()
    directory.write_manifest({"run_id": new_run_id()})
    store = Store(tmp_path / "cache", 10**9)
    failures, _ = run_jobs(plan, directory, cache=store, executor=executor, progress=print)  # type: ignore[arg-type]
    assert list(failures) == [("studio_table", "bm-two")]
    assert executor.together[-1] == [name for name in DEMO if name != "bm-two"]
