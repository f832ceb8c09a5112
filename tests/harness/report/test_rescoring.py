"""Scoring reads the tables of a run as they are now, in however many row groups they are."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from harness.cli.terminal import say_relabelled
from harness.report import write
from harness.report.write import rescore
from harness.run import table_columns, table_files
from harness.run.directory import RunDirectory
from harness.run.manifest import RunManifest
from harness.run.records import FrameRecord
from harness.score.finished_run import FinishedRun, read_scores
from tests import large_run
from tests.records import write_manifest, write_run
from vfoa.types import DirectionFit

FRAMES, GROUP, CONFIGURATIONS = 90, 30, 2


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunDirectory:
    """A run of two configurations, one of them with probabilities, in three row groups each; scored once."""
    monkeypatch.setattr(table_files, "GROUP_FRAMES", GROUP)
    directory = large_run.write_run(tmp_path, FRAMES, CONFIGURATIONS, 2)
    manifest = directory.read_manifest().plain()
    manifest["methods"] = {"configuration-1": {"probabilistic": True, "says_nowhere": True}}
    write_manifest(directory, manifest)
    write_run(directory.path, _records())
    large_run.write_labels(tmp_path, FRAMES, 2, 0)
    rescore(directory)
    return directory


def _records() -> list[FrameRecord]:
    return [*map(_with_probabilities, large_run.measured_records(FRAMES, CONFIGURATIONS, 2))]


def _with_probabilities(record: FrameRecord) -> FrameRecord:
    """The record, of the second configuration with totals that are probabilities, and how well they fit."""
    if record.configuration != "configuration-1":
        return record
    fit = DirectionFit(tail=0.01 * (record.frame % 90), claimed_error_rad=0.1, implied_error_rad=0.3)
    sums = [1.1 * sum(each.total for each in subject.attention) for subject in record.subjects]
    attentions = (
        tuple(replace(each, total=each.total / total) for each in subject.attention)
        for subject, total in zip(record.subjects, sums, strict=True)
    )
    subjects = zip(record.subjects, attentions, strict=True)
    return replace(record, subjects=tuple(replace(each, fit=fit, attention=values) for each, values in subjects))


def _written(directory: RunDirectory) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in directory.path.iterdir() if path.is_file()}


def test_several_row_groups_give_the_tables_of_one(run: RunDirectory, monkeypatch: pytest.MonkeyPatch) -> None:
    rescore(run)  # the page shows the labels that the first scoring noted in the manifest
    in_groups = _written(run)
    monkeypatch.setattr(table_files, "GROUP_FRAMES", FRAMES)
    write_run(run.path, _records())
    rescore(run)
    assert _written(run) == in_groups
    assert {"frr.csv", "measures.csv", "objects.csv", "report.html"} <= in_groups.keys()


def test_another_record_and_another_label_change_the_tables_and_back_again(run: RunDirectory) -> None:
    rescore(run)
    before, records = _written(run), _records()
    first, *others = records[65].subjects
    edited = [*records]
    edited[65] = replace(records[65], subjects=(replace(first, missing="no_eyes_3d"), *others))
    tables_of = [before["frr.csv"]]
    for of_run, edit in ((edited, 0), (edited, 1), (records, 1), (records, 0)):
        write_run(run.path, of_run)
        large_run.write_labels(run.path.parent, FRAMES, 2, edit)
        rescore(run)
        tables_of.append(_written(run)["frr.csv"])
    assert len({*tables_of}) == 4
    assert all(_written(run)[name] == before[name] for name in ("frr.csv", "comparisons.csv", "measures.csv"))


def test_labels_that_changed_after_the_recordings_got_their_verdicts_are_said(
    run: RunDirectory, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def said(clip: str | None = None) -> str:
        say_relabelled(run.path, clip)
        return capsys.readouterr().err

    assert said() == ""
    large_run.write_labels(tmp_path, FRAMES, 2, 1)
    assert f"vfoa score {run.path}" in said()
    assert said("large").startswith("vfoa: large: ")
    assert said("other") == ""
    rescore(run)
    assert said() == ""
    large_run.write_labels(tmp_path, FRAMES, 2, 0)
    (tmp_path / "datasets" / "large.toml").unlink()
    assert said() == ""  # the run was copied to a machine without its clip


def test_a_label_that_changes_while_a_run_is_scored_is_not_taken_for_scored(
    run: RunDirectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def label_meanwhile(*args: Any) -> Any:
        large_run.write_labels(tmp_path, FRAMES, 2, 1)
        return write_before(*args)

    write_before = write.write_scores
    monkeypatch.setattr(write, "write_scores", label_meanwhile)
    rescore(run)
    assert FinishedRun.read(run).relabelled() == ["large"]
    monkeypatch.undo()
    rescore(run)
    assert FinishedRun.read(run).relabelled() == []


def test_scoring_reads_the_manifest_and_every_table_once(run: RunDirectory, monkeypatch: pytest.MonkeyPatch) -> None:
    manifests, read = list[RunDirectory](), Counter[tuple[str, ...]]()

    def read_manifest(directory: RunDirectory) -> RunManifest:
        manifests.append(directory)
        return read_before(directory)

    def read_arrow(path: Path, table: str, names: Sequence[str]) -> Any:
        read[path.as_posix(), *names] += 1
        return table_files.read_arrow(path, table, names)

    read_before = RunDirectory.read_manifest
    monkeypatch.setattr(RunDirectory, "read_manifest", read_manifest)
    monkeypatch.setattr(table_columns, "read_arrow", read_arrow)
    assert len(read_scores(run).judged_subjects) == CONFIGURATIONS * 2
    assert manifests == [run]
    assert {*read.values()} == {1}


def test_scoring_imports_what_it_needs_alone() -> None:
    heavy = {
        "rerun",
        "pandas",
        "pyarrow",
        "cv2",
        "scipy",
        "onnxruntime",
        "vfoa.pipeline",
        "harness.pipeline.configuration",
    }
    code = "import sys, harness.report.write; print(*sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "harness.score.verdict_columns" in found
    assert heavy.isdisjoint(found)


def test_scores_are_read_without_pandas(run: RunDirectory) -> None:
    """Arrow imports it to convert an array, in more time than a small run is scored in."""
    code = (
        "import sys; from pathlib import Path; from harness.run.directory import RunDirectory\n"
        "from harness.score.finished_run import FinishedRun, read_scores\n"
        f"print(len(read_scores(RunDirectory(Path({str(run.path)!r}))).judged_subjects)); print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    judged, *modules = done.stdout.split()
    assert (int(judged), "pyarrow" in modules, "pandas" in modules) == (CONFIGURATIONS * 2, True, False)
