"""The benchmarks of hours and of a run's overhead measure what they say."""

from __future__ import annotations

from pathlib import Path

from harness.bench import hours
from harness.bench.overhead import measure_overhead, overhead_table
from harness.report.write import rescore
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment


def test_the_generated_clip_is_seen_attended_to_and_scored(tmp_path: Path) -> None:
    frames = 2 * hours.FIXATION
    experiment = hours.write_clip(tmp_path, frames)
    hours.run_experiment(experiment, tmp_path / "run")
    first = rescore(RunDirectory(tmp_path / "run"))
    assert [row.configuration for row in first.by_clip()] == ["one-cone", "two-cones", "filtered", "nearest"]
    assert all(row.n == frames and row.predicted > frames / 4 for row in first.by_clip())
    hours.write_labels(tmp_path, frames, edited=frames)
    edited = rescore(RunDirectory(tmp_path / "run"))
    changed = [a.truth != b.truth for a, b in zip(first.verdicts, edited.verdicts, strict=True)]
    assert sum(changed) == 4 * hours.FIXATION


def test_overhead_is_of_every_sink_and_of_the_scores() -> None:
    found = measure_overhead(load_experiment("demo", clips=("studio_table",)), limit=2, rounds=1)
    assert list(found.ms)[1:] == ["records", "thumbnails", "recordings", "scores, first time"]
    assert (found.clip, found.frames, found.configurations) == ("studio_table", 2, 4)
    assert overhead_table(found).rows[-1][0] == "overhead in all"
