"""What tables and page take from a run's records: parts in plain values, which are stored between two scorings.

They are in ``score_cache/`` in a run's directory, so that only changed results are read again::

    times.noted     the times of the stages from timings.csv
    inputs.noted    digests of the inputs, which the run notes
    <key>.part      the part of a block (:class:`TableReader`); the key depends on its files, its labels and the code

All of it can be removed at any time. ``timings.csv`` is read again unless it has the stamp noted
(:mod:`harness.files.digests`); a damaged part is rebuilt.
"""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import harness
import vfoa
from harness.files.digests import file_digest
from harness.files.folders import kept_while_unchanged, read_value, write_value
from harness.report.page.packing import AttentionPart
from harness.report.stages import StageTimes, stage_times
from harness.run.directory import Pair
from harness.run.records import FrameRecord, merge, renamed
from harness.run.results import MeasuredPart
from harness.run.table_records import Block, TableReader
from harness.score.finished_run import FinishedRun
from harness.score.outcomes import JudgedPart, Reference
from harness.score.score import Scores, score_parts
from harness.score.verdicts import PLAIN


@dataclass(slots=True)
class Part:
    """Everything that scores, tables and the page take from the records of one configuration on one clip."""

    judged: JudgedPart = field(default_factory=JudgedPart)
    measured: MeasuredPart = field(default_factory=MeasuredPart)
    attention: AttentionPart = field(default_factory=AttentionPart)

    def take(self, record: FrameRecord, reference: Reference) -> None:
        """Add a record."""
        self.judged.take(record, reference)
        self.measured.take(record)
        self.attention.take(record)


class RecordParts:
    """The parts of a run that is scored against the reference, by clip and configuration."""

    def __init__(self, reference: Reference, records: Iterable[FrameRecord] = ()) -> None:
        self.reference = reference
        self.parts = defaultdict[Pair, Part](Part)
        for record in records:
            self.parts[record.clip, record.configuration].take(record, reference)

    def of(self, name: str) -> dict[Pair, Any]:
        """One field of all parts."""
        return {pair: getattr(part, name) for pair, part in self.parts.items()}

    def scores(self) -> Scores:
        """The scores of all records."""
        return score_parts(self.of("judged"), self.of("measured"), self.reference)


class KeptParts:
    """The blocks of a run's tables, and the stored part of each; ``reference`` holds the labels."""

    def __init__(self, run: FinishedRun, reference: Reference) -> None:
        self._timings, self._folder = run.directory.timings, run.directory.score_cache
        self._reference = reference
        self._labels: dict[tuple[str, tuple[int, ...]], str] = {}
        self.reader = TableReader(run.directory)
        self._scored = [(block, self._key(block)) for block in run.scored_blocks(self.reader.blocks)]

    def read(self) -> RecordParts:
        """Return the parts of all blocks. New ones are stored, and those that are no longer used are removed."""
        run = RecordParts(self._reference)
        for block, key in self._scored:
            path = self._folder / f"{key}.part"
            part = read_value(path, Part)
            if part is None:
                part = self._watched(block)
                write_value(path, part)
            merge(run.parts[block.clip, block.configuration], part)
        needed = {key for _, key in self._scored}
        for path in self._folder.glob("*.part"):
            if path.stem not in needed:
                path.unlink(missing_ok=True)
        return run

    def times(self) -> StageTimes:
        """Return the times of the stages. Raises as :func:`harness.report.stages.stage_times` does."""
        path = self._folder / "times.noted"
        return kept_while_unchanged(path, self._timings, StageTimes, _code_digest(), lambda: stage_times(self._timings))

    def _watched(self, block: Block) -> Part:
        names, part = self._reference.names_now.get(block.clip, {}), Part()
        for record in self.reader.read(block):
            part.take(renamed(record, names), self._reference)
        return part

    def _key(self, block: Block) -> str:
        name = block.configuration
        of = (
            *(block.digest, self._labelled(block), sorted(self._reference.names_now.get(block.clip, {}).items())),
            sorted(self._reference.phases.get(block.clip, {}).items()),
            *(self._reference.traits.get(name, PLAIN), _code_digest()),
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


@cache
def _code_digest() -> str:
    """The digest of all code of both packages: a part of another version is not used."""
    total = hashlib.blake2b(digest_size=16)
    for package in (harness, vfoa):
        root = Path(package.__file__ or "").parent
        for path in sorted(root.rglob("*.py")):
            total.update(f"{path.relative_to(root).as_posix()} {file_digest(path)}\n".encode())
    return total.hexdigest()
