"""Scoring that reads only what has changed writes the same bytes as scoring that reads everything."""

from __future__ import annotations

import random
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from harness.report.write import rescore
from harness.run import tables
from harness.run.directory import RunDirectory
from harness.run.records import FrameRecord
from harness.run.table_records import Block, TableReader, read_records
from tests import large_run
from tests.records import write_run
from vfoa.types import DirectionFit

FRAMES, BLOCK, CONFIGURATIONS = 90, 30, 2

Read = list[tuple[str, int]]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunDirectory:
    """A run of two configurations, one of them with probabilities, in three blocks each; scored once."""
    monkeypatch.setattr(tables, "GROUP_FRAMES", BLOCK)
    directory = large_run.write_run(tmp_path, FRAMES, CONFIGURATIONS, 2)
    manifest = directory.read_manifest()
    manifest["methods"] = {"configuration-1": {"probabilistic": True, "says_nowhere": True}}
    directory.write_manifest(manifest)
    write_run(directory.path, map(_with_probabilities, list(read_records(directory))))
    large_run.write_labels(tmp_path, FRAMES, 2, 0)
    rescore(directory)
    return directory


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> Read:
    """The configuration and the first frame of each block whose records are read."""
    seen: Read = []
    real = TableReader.read

    def watched(reader: TableReader, block: Block) -> Iterator[FrameRecord]:
        seen.append((block.configuration, block.frames[0]))
        return real(reader, block)

    monkeypatch.setattr(TableReader, "read", watched)
    return seen


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


def _edit_results(directory: RunDirectory, place: int) -> None:
    """Say of one frame that somebody's eyes were not found."""
    records = list(read_records(directory))
    first, *others = records[place].subjects
    records[place] = replace(records[place], subjects=(replace(first, missing="no_eyes_3d"), *others))
    write_run(directory.path, records)


def _written(directory: RunDirectory) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in directory.path.iterdir() if path.is_file()}


def _score_both_ways(directory: RunDirectory, read: Read) -> tuple[dict[str, bytes], Read]:
    """Score with what is kept, and from scratch: what was written, the same both times, and what was read at first."""
    manifest = directory.manifest.read_bytes()  # a scoring notes the labels there
    read.clear()
    rescore(directory)
    kept, seen = _written(directory), list(read)
    directory.manifest.write_bytes(manifest)
    shutil.rmtree(directory.score_cache)
    rescore(directory)
    assert _written(directory) == kept
    return kept, seen


def _edit(directory: RunDirectory, old: str, new: str) -> None:
    path = directory.path.parent / "annotations" / "large.csv"
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))


@pytest.fixture
def settled(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock of the next minute: every file has been left alone for long enough."""
    now = time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: now() + 60 * 10**9)


def test_one_edited_label_reads_its_own_blocks_alone(run: RunDirectory, read: Read) -> None:
    before = _written(run)
    _edit(run, "41,60,anna,bottle,", "41,60,anna,ball,")
    written, seen = _score_both_ways(run, read)
    assert seen == [("configuration-0", 31), ("configuration-1", 31)]
    assert written["frr.csv"] != before["frr.csv"]
    assert {"measures.csv", "objects.csv", "report.html"} <= written.keys()


def test_several_blocks_give_the_tables_of_one(run: RunDirectory, monkeypatch: pytest.MonkeyPatch) -> None:
    rescore(run)  # the page shows the labels that the first scoring noted in the manifest
    in_blocks = _written(run)
    records = list(read_records(run))
    monkeypatch.setattr(tables, "GROUP_FRAMES", FRAMES)
    write_run(run.path, records)
    shutil.rmtree(run.score_cache)
    rescore(run)
    assert len(list(run.score_cache.glob("*.part"))) == CONFIGURATIONS
    assert _written(run) == in_blocks


def test_nothing_is_read_where_nothing_has_changed(run: RunDirectory, read: Read) -> None:
    _, seen = _score_both_ways(run, read)
    assert seen == []


def test_another_record_is_read_again(run: RunDirectory, read: Read) -> None:
    _edit_results(run, 65)
    _, seen = _score_both_ways(run, read)
    assert seen == [("configuration-0", first) for first in (1, 31, 61)]


def test_any_edits_are_scored_as_from_nothing(run: RunDirectory, read: Read, settled: None) -> None:
    rng = random.Random(0)
    run.timings.write_text("clip,configuration,frame,stage,ms\nlarge,configuration-0,1,stereo,1\n")
    whole = list(read_records(run))
    pages = set()
    for edit in ("label", "result", "time", "part", "label back", "result back"):
        parts = sorted(run.score_cache.glob("*.part"))
        match edit:
            case "label" | "label back":
                large_run.write_labels(run.path.parent, FRAMES, 2, rng.randrange(1, 5) if edit == "label" else 0)
            case "result":
                _edit_results(run, rng.randrange(len(whole)))
            case "result back":
                write_run(run.path, whole)
            case "time":
                run.timings.write_text(run.timings.read_text().replace("stereo,1\n", "stereo,25\n"))
            case "part":
                part = rng.choice(parts)
                part.write_bytes(bytes(each ^ 1 for each in part.read_bytes()))
        written, _ = _score_both_ways(run, read)
        pages.add(written["report.html"])
    assert len(pages) == 5  # a damaged part changes none


def test_a_damaged_part_is_made_anew(run: RunDirectory, read: Read) -> None:
    for path in run.score_cache.iterdir():
        path.write_bytes(path.read_bytes()[:-1])
    _, seen = _score_both_ways(run, read)
    assert len(seen) == CONFIGURATIONS * FRAMES // BLOCK


def test_parts_of_older_labels_are_removed(run: RunDirectory) -> None:
    for target in ("ball", "mug", "book"):
        large_run.write_labels(run.path.parent, FRAMES, 2, len(target))
        rescore(run)
    assert len(list(run.score_cache.glob("*.part"))) == CONFIGURATIONS * FRAMES // BLOCK


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
    assert "harness.report.record_parts" in found
    assert heavy.isdisjoint(found)
