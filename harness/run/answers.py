"""The answers of a configuration on a clip as a table (:mod:`harness.run.tables`)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from typing import Any

from harness.run.directory import Pair, RunDirectory
from harness.run.records import FrameRecord
from harness.run.tables import Row, TableWriter, answers_table
from vfoa.types import CUES, Cue


def filtered_cues(settings: Mapping[str, Any]) -> tuple[Cue, ...]:
    """The cues that a configuration filters, by its settings in the run's manifest."""
    cues = settings.get("gaze_filter", {}).get("cues", "off")
    return tuple(cue for cue in CUES if cues in ("both", cue))


def write_answers(
    directory: RunDirectory,
    pair: Pair,
    keys: Mapping[str, str],
    records: Iterable[FrameRecord],
    filtered: tuple[Cue, ...],
) -> None:
    """Write the answers in the records of a (clip, configuration); an earlier file is replaced.

    Parameters
    ----------
    keys
        The final keys ``scene`` and ``directions``.
    filtered
        The cues that are filtered.

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    path = answers_table(directory.path, pair)
    draft = path.with_suffix(".partial")
    table = TableWriter({"answers": draft}, {"clip": pair[0], **keys, "configuration": pair[1]})
    for record in records:
        table.add({"answers": answer_rows(record, filtered)})
    table.close()
    draft.replace(path)


def answer_rows(record: FrameRecord, filtered: tuple[Cue, ...]) -> Iterator[Row]:
    """The rows of a frame's answers."""
    for subject in record.subjects:
        attention = subject.attention
        yield (
            *(record.frame, subject.track_id, subject.missing, subject.focus, subject.tied),
            [value.instance_id for value in attention],
            [value.gaze for value in attention],
            [value.head for value in attention],
            [value.total for value in attention],
            asdict(subject.fit) if subject.fit else None,
            *((getattr(subject, cue) if cue in filtered else None) for cue in CUES),
        )
