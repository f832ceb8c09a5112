"""An exported table: a run's scores in one JSON file with a data sheet, to publish and to compare without the run.

It holds the data of a comparison, frame by frame: the look of each frame, and which configurations are right in it.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any, Literal

from harness.files.io import read_text
from harness.files.parsing import parse_json
from harness.run.grid import base_of
from harness.score.scored_frames import ScoredFrames
from vfoa.errors import VfoaError
from vfoa.settings import Settings
from vfoa.validation import parse

FORMAT: Literal["vfoa table 1"] = "vfoa table 1"


class ExportedClip(Settings):
    """One clip: its citation, how much of it was scored, and the digests of its content and of the scored labels."""

    name: str
    licence: str | None
    citation: str | None
    frames: int
    scored: int
    sha256: str
    labels_sha256: str


class ExportedSubject(Settings):
    """A subject's scored frames in a clip. ``correct``, by configuration, has a digit for each frame, 1 for right."""

    clip: str
    subject: str
    frames: tuple[int, ...]
    looks: tuple[int, ...]
    truth: tuple[str, ...]
    correct: dict[str, str]


class Sheet(Settings):
    """The data sheet: configurations and clips, seeds and versions; ``source_sha256`` is of the code."""

    experiment: str
    clips: tuple[ExportedClip, ...]
    subjects: int
    pairs: int
    units: str
    seeds: dict[str, dict[str, int]]
    notes: tuple[str, ...]
    versions: dict[str, str]
    source_sha256: str | None
    commit: str | None


class ExportedTable(Settings):
    """The whole file. ``rows`` are those of ``frr.csv``; ``digest`` is the sha256 of everything but itself."""

    format: Literal["vfoa table 1"] = FORMAT
    sheet: Sheet
    configurations: dict[str, Any]
    rows: tuple[dict[str, str], ...]
    frames: tuple[ExportedSubject, ...]
    digest: str = ""

    def with_digest(self) -> ExportedTable:
        """The table with its digest filled in."""
        return self.model_copy(update={"digest": self._digest()})

    def _digest(self) -> str:
        text = json.dumps(self.model_dump(mode="json", exclude={"digest"}), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def scored_configurations(self) -> tuple[str, ...]:
        """The configurations, in the order of the run; one name for all seeds of a configuration."""
        return tuple(dict.fromkeys(map(base_of, self.configurations)))

    def frames_of(self, configuration: str) -> list[ScoredFrames]:
        """One configuration's scored frames, as :func:`harness.score.comparison.compare` takes them."""
        return [
            ScoredFrames(
                clip=each.clip,
                subject=each.subject,
                frames=each.frames,
                looks=each.looks,
                truth=each.truth,
                correct=tuple(sum(digit == "1" for digit in digits) for digits in zip(*seeds, strict=True)),
                seeds=len(seeds),
            )
            for each in self.frames
            if (seeds := [digits for name, digits in each.correct.items() if base_of(name) == configuration])
        ]

    @classmethod
    def read(cls, path: Path) -> ExportedTable:
        """Read an exported table.

        Raises
        ------
        VfoaError
            If it is missing, is no such table, or was changed after it was written.
        """
        data = parse_json(read_text(path), path)
        found = data.get("format") if isinstance(data, dict) else None
        if found != FORMAT:
            raise VfoaError(f"{path}: format: found {found!r}; expected {FORMAT!r}, as `vfoa export-table` writes it")
        table = parse(cls, data, str(path))
        try:
            digest = table._digest()
        except UnicodeEncodeError:
            raise VfoaError(f"{path}: holds text that is not Unicode; expected a table that vfoa has written") from None
        if table.digest != digest:
            raise VfoaError(f"{path}: digest: not that of the content; the file was changed after it was written")
        for each in table.frames:
            lengths = {len(each.frames), len(each.looks), len(each.truth), *map(len, each.correct.values())}
            if len(lengths) != 1:
                raise VfoaError(f"{path}: frames of {each.subject} in {each.clip}: lists of different lengths")
        return table


def labels_digest(truths: list[tuple[int, str, str]]) -> str:
    """The sha256 of a clip's scored labels, as (frame, subject, target) in order: equal digests, equal ground truth."""
    return hashlib.sha256(json.dumps(sorted(truths)).encode()).hexdigest()
