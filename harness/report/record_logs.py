"""The logs of a run's records for the tables and the page, and the parts of them that are stored between two scorings.

The parts are in ``score_cache/`` in a run's directory, so that only changed results are read again::

    blocks.noted    the blocks of results.jsonl, each with the digest of its lines
    times.noted     the times of the stages from timings.csv
    inputs.noted    digests of the inputs, which the run notes
    <key>.part      the logs of a block; the key depends on its lines, its labels and the code

All of it can be removed at any time. A file is read again unless it has the stamp noted
(:mod:`harness.files.digests`); a damaged part is rebuilt.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import harness
import vfoa
from harness.files.digests import file_digest
from harness.files.folders import kept_while_unchanged, read_value, settled_stamp, write_value
from harness.report.csv_tables import FrameLines, FrameRows
from harness.report.formats import Table
from harness.report.page.packing import AttentionLog, AttentionPart
from harness.report.stages import StageTimes, stage_times
from harness.report.tables import direction_check_table, prediction_set_table, subject_reliability_table
from harness.run.records import FrameRecord, PartLog, renamed
from harness.run.results import Block, MeasuredPart, MeasureLog, block_bytes, find_blocks, lines_digest, read_block
from harness.score.calibration import CalibrationData, CalibrationLog, misfit_notes
from harness.score.finished_run import FinishedRun
from harness.score.outcomes import JudgedPart, OutcomeLog, Reference
from harness.score.score import Scores, score_outcomes


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """The logs' parts of some records of one configuration on one clip."""

    outcomes: JudgedPart
    measures: MeasuredPart
    frames: list[FrameLines]
    calibration: CalibrationData
    attention: AttentionPart


class RecordLogs:
    """The logs of a run, which is scored against the reference."""

    def __init__(self, reference: Reference) -> None:
        self._reference, self.names_now = reference, reference.names_now
        self.measures, self.outcomes = MeasureLog(), OutcomeLog(reference)
        self.frames, self.attention = FrameRows(), AttentionLog()
        self.calibration = CalibrationLog(reference.probabilistic, reference.labels)

    def watch(self, records: Iterable[FrameRecord]) -> None:
        """Look at each record once."""
        for record in records:
            for log in self._logs.values():
                log.take(record)

    @property
    def _logs(self) -> dict[str, PartLog[Any]]:
        return {name: getattr(self, name) for name in ("outcomes", "measures", "frames", "attention", "calibration")}

    def scores(self) -> Scores:
        """The scores of all records watched or added; notes say where directions do not fit the posterior."""
        scores = score_outcomes(self.outcomes.outcomes(), self.measures, self._reference)
        return replace(scores, notes=(*scores.notes, *misfit_notes(self.calibration.direction_checks())))

    def tables(self) -> tuple[Table, ...]:
        """Tables of the calibration by subject, of prediction sets, and of measured directions."""
        log = self.calibration
        return (
            subject_reliability_table(log.by_subject()),
            prediction_set_table(log.coverages()),
            direction_check_table(log.direction_checks()),
        )

    def part(self, clip: str, configuration: str) -> Part:
        """Return the parts of one configuration on one clip, for other logs."""
        return Part(**{name: log.part(clip, configuration) for name, log in self._logs.items()})

    def add(self, clip: str, configuration: str, part: Part) -> None:
        """Add the parts that other logs have of one configuration on one clip."""
        for name, log in self._logs.items():
            log.add(clip, configuration, getattr(part, name))


class KeptParts:
    """The blocks of a run's results, and the stored part of the logs for each; ``reference`` holds the labels."""

    def __init__(self, run: FinishedRun, reference: Reference) -> None:
        self._results, self._timings = run.directory.results, run.directory.timings
        self._folder = run.directory.score_cache
        self._reference = reference
        self._labels: dict[tuple[str, tuple[int, ...]], str] = {}
        self.blocks = _indexed(self._results, self._folder / "blocks.noted")
        self._scored = [(block, self._key(block)) for block in run.scored_blocks(self.blocks)]

    def logs(self) -> RecordLogs:
        """Return the logs of all blocks. New parts are stored, and parts that are no longer used are removed."""
        logs = RecordLogs(self._reference)
        for block, key in self._scored:
            path = self._folder / f"{key}.part"
            part = read_value(path, Part)
            if part is None:
                part = self._watched(block)
                write_value(path, part)
            logs.add(block.clip, block.configuration, part)
        needed = {key for _, key in self._scored}
        for path in self._folder.glob("*.part"):
            if path.stem not in needed:
                path.unlink(missing_ok=True)
        return logs

    def times(self) -> StageTimes:
        """Return the times of the stages. Raises as :func:`harness.report.stages.stage_times` does."""
        path = self._folder / "times.noted"
        return kept_while_unchanged(path, self._timings, StageTimes, _code_digest(), lambda: stage_times(self._timings))

    def _watched(self, block: Block) -> Part:
        logs = RecordLogs(self._reference)
        names = self._reference.names_now.get(block.clip, {})
        logs.watch(renamed(record, names) for record in read_block(self._results, block))
        return logs.part(block.clip, block.configuration)

    def _key(self, block: Block) -> str:
        name = block.configuration
        of = (
            *(block.digest, self._labelled(block), sorted(self._reference.names_now.get(block.clip, {}).items())),
            *(name in self._reference.says_nowhere, name in self._reference.probabilistic, _code_digest()),
        )
        return hashlib.blake2b(repr(of).encode(), digest_size=16).hexdigest()

    def _labelled(self, block: Block) -> str:
        """The digest of the labels in a block's frames; configurations usually have the same frames."""
        key = block.clip, block.frames
        if key not in self._labels:
            labels = self._reference.labels.get(block.clip)
            labelled = list(labels.labelled(block.frames)) if labels else None
            self._labels[key] = hashlib.blake2b(repr(labelled).encode(), digest_size=16).hexdigest()
        return self._labels[key]


def _indexed(results: Path, index: Path) -> list[Block]:
    """Return the blocks of the results: those of the index if every line is the same, otherwise divided again."""
    stamp = settled_stamp(results)
    noted: tuple[str | None, list[Block]] | None = read_value(index, tuple[str | None, list[Block]])
    before, blocks = noted or (None, [])
    if stamp is not None and stamp == before:
        return blocks
    size = results.stat().st_size if results.is_file() else None
    if not (blocks and blocks[-1].end == size and all(_is_unchanged(results, block) for block in blocks)):
        blocks = find_blocks(results)
    write_value(index, (stamp, blocks))
    return blocks


def _is_unchanged(results: Path, block: Block) -> bool:
    return lines_digest(block_bytes(results, block)) == block.digest


@cache
def _code_digest() -> str:
    """The digest of all code of both packages: a part of another version is not used."""
    total = hashlib.blake2b(digest_size=16)
    for package in (harness, vfoa):
        root = Path(package.__file__ or "").parent
        for path in sorted(root.rglob("*.py")):
            total.update(f"{path.relative_to(root).as_posix()} {file_digest(path)}\n".encode())
    return total.hexdigest()
