"""Scoring that reads only what has changed writes the same bytes as scoring that reads everything."""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from harness.report import record_parts
from harness.report.write import rescore
from harness.run import results
from harness.run.directory import RunDirectory
from harness.run.records import FrameRecord
from harness.run.results import Block
from tests import large_run

FRAMES, BLOCK, CONFIGURATIONS = 90, 30, 2

Read = list[tuple[str, int]]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunDirectory:
    """A run of two configurations, one of them with probabilities, in three blocks each; scored once."""
    monkeypatch.setattr(results, "BLOCK_FRAMES", BLOCK)
    directory = large_run.write_run(tmp_path, FRAMES, CONFIGURATIONS, 2)
    manifest = directory.read_manifest()
    manifest["methods"] = {"configuration-1": {"probabilistic": True, "says_nowhere": True}}
    directory.write_manifest(manifest)
    lines = directory.results.read_text().splitlines()
    for place, line in enumerate(lines):
        record = json.loads(line)
        if record["configuration"] == "configuration-1":
            for subject in record["subjects"]:
                total = sum(each["total"] for each in subject["attention"]) * 1.1
                for each in subject["attention"]:
                    each["total"] /= total
                subject["fit"] = {"tail": 0.01 * (place % 90), "claimed_error_rad": 0.1, "implied_error_rad": 0.3}
        lines[place] = json.dumps(record, separators=(",", ":"))
    directory.results.write_text("\n".join(lines) + "\n")
    large_run.write_labels(tmp_path, FRAMES, 2, 0)
    rescore(directory)
    return directory


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> Read:
    """The configuration and the first frame of each block whose records are read."""
    seen: Read = []
    real = results.read_block

    def watched(path: Path, block: Block) -> Iterator[FrameRecord]:
        seen.append((block.configuration, block.frames[0]))
        return real(path, block)

    monkeypatch.setattr(record_parts, "read_block", watched)
    return seen


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
    monkeypatch.setattr(results, "BLOCK_FRAMES", FRAMES)
    shutil.rmtree(run.score_cache)
    rescore(run)
    assert len(list(run.score_cache.glob("*.part"))) == CONFIGURATIONS
    assert _written(run) == in_blocks


def test_nothing_is_read_where_nothing_has_changed(run: RunDirectory, read: Read) -> None:
    _, seen = _score_both_ways(run, read)
    assert seen == []


def test_another_record_is_read_again(run: RunDirectory, read: Read) -> None:
    lines = run.results.read_bytes().splitlines(keepends=True)
    lines[65] = lines[65].replace(b'"missing":null', b'"missing":"no_eyes_3d"', 1)
    run.results.write_bytes(b"".join(lines))
    _, seen = _score_both_ways(run, read)
    assert seen == [("configuration-0", 61)]


def test_lines_are_digested_only_if_the_file_looks_different(
    run: RunDirectory, settled: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    digested: list[Block] = []
    real = record_parts._is_unchanged
    monkeypatch.setattr(
        record_parts, "_is_unchanged", lambda path, block: (digested.append(block), real(path, block))[1]
    )
    counts = []
    for touched in (False, False, True):
        if touched:
            run.results.write_bytes(run.results.read_bytes() + b"")
            os.utime(run.results, ns=(1, 1))
        rescore(run)
        counts.append(len(digested))
        digested.clear()
    blocks = CONFIGURATIONS * FRAMES // BLOCK
    assert counts == [blocks, 0, blocks]  # the first scoring was too early to note it


def test_any_edits_are_scored_as_from_nothing(run: RunDirectory, read: Read, settled: None) -> None:
    rng = random.Random(0)
    run.timings.write_text("clip,configuration,frame,stage,ms\nlarge,configuration-0,1,stereo,1\n")
    whole = run.results.read_bytes()
    pages = set()
    for edit in ("label", "result", "time", "part", "label back", "result back"):
        parts = sorted(run.score_cache.glob("*.part"))
        match edit:
            case "label" | "label back":
                large_run.write_labels(run.path.parent, FRAMES, 2, rng.randrange(1, 5) if edit == "label" else 0)
            case "result":
                lines = whole.splitlines(keepends=True)
                place = rng.randrange(len(lines))
                lines[place] = lines[place].replace(b'"missing":null', b'"missing":"no_eyes_3d"', 1)
                run.results.write_bytes(b"".join(lines))
            case "result back":
                run.results.write_bytes(whole)
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
