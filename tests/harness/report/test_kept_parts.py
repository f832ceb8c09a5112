"""Scoring that reads only what has changed writes the same bytes as scoring that reads everything."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from harness.bench import scoring
from harness.report import record_logs
from harness.report.write import rescore
from harness.run import results
from harness.run.directory import RunDirectory
from harness.run.records import FrameRecord
from harness.run.results import Block

FRAMES, BLOCK, CONFIGURATIONS = 90, 30, 2

Read = list[tuple[str, int]]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunDirectory:
    """A run of two configurations, one of them with probabilities, in three blocks each; scored once."""
    monkeypatch.setattr(results, "BLOCK_FRAMES", BLOCK)
    directory = scoring._write_run(tmp_path, FRAMES, CONFIGURATIONS, 2)
    manifest = directory.read_manifest()
    manifest["configurations"]["configuration-1"] = {"attention": {"method": "bayes"}}
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
        lines[place] = json.dumps(record)
    directory.results.write_text("\n".join(lines) + "\n")
    scoring._write_labels(tmp_path, FRAMES, 2, 0)
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

    monkeypatch.setattr(record_logs, "read_block", watched)
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
    shutil.rmtree(directory.path / record_logs.FOLDER)
    rescore(directory)
    assert _written(directory) == kept
    return kept, seen


def _edit(directory: RunDirectory, old: str, new: str) -> None:
    path = directory.path.parent / "annotations" / "large.csv"
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))


def test_one_edited_label_reads_its_own_blocks_alone(run: RunDirectory, read: Read) -> None:
    before = _written(run)
    _edit(run, "41,60,anna,bottle,", "41,60,anna,ball,")
    written, seen = _score_both_ways(run, read)
    assert seen == [("configuration-0", 31), ("configuration-1", 31)]
    assert written["frr.csv"] != before["frr.csv"]
    assert {"reliability.svg", "measures.csv", "objects.csv", "behaviour.csv", "report.html"} <= written.keys()


def test_nothing_is_read_where_nothing_has_changed(run: RunDirectory, read: Read) -> None:
    _, seen = _score_both_ways(run, read)
    assert seen == []


def test_another_record_is_read_again(run: RunDirectory, read: Read) -> None:
    lines = run.results.read_bytes().splitlines(keepends=True)
    lines[65] = lines[65].replace(b'"missing": null', b'"missing": "no_eyes_3d"', 1)
    run.results.write_bytes(b"".join(lines))
    _, seen = _score_both_ways(run, read)
    assert seen == [("configuration-0", 61)]


def test_a_damaged_part_is_made_anew(run: RunDirectory, read: Read) -> None:
    for path in (run.path / record_logs.FOLDER).iterdir():
        path.write_bytes(path.read_bytes()[:-1])
    _, seen = _score_both_ways(run, read)
    assert len(seen) == CONFIGURATIONS * FRAMES // BLOCK


def test_parts_of_older_labels_are_removed(run: RunDirectory) -> None:
    for target in ("ball", "mug", "book"):
        scoring._write_labels(run.path.parent, FRAMES, 2, len(target))
        rescore(run)
    assert len(list((run.path / record_logs.FOLDER).glob("*.part"))) == CONFIGURATIONS * FRAMES // BLOCK
