"""``frames.csv``: per frame, subject and target, the attention values, and how the frame was judged."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache

from harness.report.formats import csv_cell
from harness.run.records import FrameRecord, SubjectRecord
from harness.score.posterior_checks import prediction_set
from harness.score.verdicts import Verdict

COLUMNS = (
    *("clip", "configuration", "frame", "time_s", "subject", "track", "target", "instance"),
    *("gaze", "head", "total", "focus", "set_90", "truth", "predicted", "outcome", "error_type"),
)

_cell = lru_cache(maxsize=None)(csv_cell)
_Key = tuple[str, str, int]
FrameLines = tuple[int, str | None, list[str]]
"""A frame, a subject in it, and the beginnings of their rows."""


class FrameRows:
    """Collects the rows while records pass by, so that a long run is read once: see :meth:`watch`."""

    def __init__(self) -> None:
        self._rows: list[tuple[_Key, str | None, list[str]]] = []

    def watch(self, records: Iterable[FrameRecord]) -> Iterator[FrameRecord]:
        """Hand the records on, as to :func:`harness.score.score.score`, and keep what the table needs of them."""
        for record in records:
            key = record.clip, record.configuration, record.frame
            start = _start(*key, time=f"{record.time_ns / 1e9:.3f}")
            names = {target.instance_id: _cell(target.name) for target in record.targets}
            for subject in record.subjects:
                lines = _subject_lines(f"{start}{_cell(subject.name or '')},{subject.track_id},", subject, names)
                self._rows.append((key, subject.name, lines))
            yield record

    def part(self) -> list[FrameLines]:
        """The rows so far, for another log."""
        return [(frame, subject, lines) for (_, _, frame), subject, lines in self._rows]

    def add(self, clip: str, configuration: str, rows: Iterable[FrameLines]) -> None:
        """Take over the rows of another log that has watched one configuration on one clip."""
        self._rows.extend(((clip, configuration, frame), subject, lines) for frame, subject, lines in rows)

    def to_csv(self, verdicts: Iterable[Verdict]) -> str:
        """The table as text, in the order of the records: one row per target, ``focus`` 1 for the one looked at.

        A subject without attention values has one row without a target. Labelled frames that have no such subject,
        or no record, stand at the end. ``set_90`` is 1 for the targets of the smallest set with 90 % of the
        probability, and blank where attention is no probability. Attention has four decimals, time three. A person
        the manifest does not know has a track and no name.
        """
        judged = {(each.clip, each.configuration, each.frame, each.subject): each for each in verdicts}
        text = [",".join(COLUMNS) + "\n"]
        for key, subject, lines in self._rows:
            # taken out when used: of tracks that share a name the first is the one that was judged
            end = _judgement(judged.pop((*key, subject), None) if subject is not None else None)
            text.extend(f"{line}{end}" for line in lines)
        for verdict in judged.values():
            start = _start(verdict.clip, verdict.configuration, verdict.frame, time="")
            text.append(f"{start}{_cell(verdict.subject)},,,,,,,,,{_judgement(verdict)}")
        return "".join(text)


def _start(clip: str, configuration: str, frame: int, time: str) -> str:
    return f"{_cell(clip)},{_cell(configuration)},{frame},{time},"


def _subject_lines(start: str, subject: SubjectRecord, names: dict[int, str]) -> list[str]:
    if not subject.attention:
        return [f"{start},,,,,,,"]
    held = prediction_set(subject)
    return [
        f"{start}{names[value.instance_id]},{value.instance_id},{_number(value.gaze)},{_number(value.head)},"
        f"{value.total:.4f},{1 if value.instance_id == subject.focus else 0},"
        f"{'' if held is None else int(value.instance_id in held)},"
        for value in subject.attention
    ]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4f}"


def _judgement(verdict: Verdict | None) -> str:
    if verdict is None:
        return ",,,\n"
    return (
        f"{_cell(verdict.truth or '')},{_cell(verdict.predicted or '')},{verdict.outcome},{verdict.error_type or ''}\n"
    )
