"""The benchmarks of hours and of a run's overhead measure what they say."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from harness.files import digests
from harness.report.write import rescore
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from scripts.measure import generated_clip, hours
from scripts.measure.generated_clip import write_clip, write_labels
from scripts.measure.overhead import measure_overhead, overhead_table


def test_the_generated_clip_is_seen_attended_to_and_scored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: now() + 60 * 10**9)
    monkeypatch.setattr(generated_clip, "FIXATION", 10)
    frames = 20
    experiment = write_clip(tmp_path, frames)
    hours.run_experiment(experiment, tmp_path / "run")
    first = rescore(RunDirectory(tmp_path / "run"))
    assert [row.configuration for row in first.rows.by_clip] == ["one-cone", "two-cones", "filtered", "nearest"]
    assert all(row.n == frames and row.predicted > frames / 4 for row in first.rows.by_clip)
    write_labels(tmp_path, frames, edited=frames)
    edited = rescore(RunDirectory(tmp_path / "run"))
    changed = [a.truth != b.truth for a, b in zip(first.verdicts, edited.verdicts, strict=True)]
    assert sum(changed) == 4 * 10
    assert not any("images" in note.text for note in edited.notes)
    read: list[Path] = []
    real = digests.file_digest
    monkeypatch.setattr(digests, "file_digest", lambda path: (read.append(path), real(path))[1])
    rescore(RunDirectory(tmp_path / "run"))
    assert not [path for path in read if path.suffix == ".png"]


def test_overhead_is_of_every_sink_and_of_the_scores() -> None:
    found = measure_overhead(load_experiment("demo", clips=("studio_table",)), limit=1, rounds=1)
    assert list(found.ms)[1:] == ["thumbnails", "recordings", "scores, first time"]
    assert (found.clip, found.frames, found.configurations) == ("studio_table", 1, 4)
    assert overhead_table(found).rows[-1][0] == "overhead in all"
