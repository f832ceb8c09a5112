"""Every attention value of a run as a table for programs, ``frames.csv``, and the meaning of its columns.

It is made from the tables of the run and the present labels when it is asked for: it is larger than all other tables.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from operator import attrgetter
from pathlib import Path

from harness.files.io import check_new, replacing
from harness.report.formats import csv_cell
from harness.run.directory import RunDirectory
from harness.run.manifest import AnswerTraits
from harness.run.records import FrameRecord, SubjectRecord
from harness.score.finished_run import FinishedRun
from harness.score.score import score
from harness.score.verdicts import PLAIN, Verdict, prediction_set

FRAMES_COLUMNS: Mapping[str, str] = {
    "clip": "clip",
    "configuration": "configuration",
    "frame": "the source's own frame number",
    "time_s": "time of the frame on the source's clock, s; NaN for a frame without a record",
    "subject": "subject's name; missing for a person the manifest does not know",
    "track": "number of the person's track; missing where nobody was tracked",
    "target": "name of one target; missing where the subject has no attention values",
    "instance": "the target's instance number in the frame's masks",
    "gaze": "the gaze's part of the attention, in [0, 1]; NaN where gaze was not measured",
    "head": "the head's part of the attention, in [0, 1]; NaN where head pose was not measured",
    "total": "attention of the subject to the target, in [0, 1]",
    "focus": "1 for the target with the most attention, else 0",
    "set_90": "1 for the targets of the smallest set with 90 % of the probability, else 0; NaN without probabilities",
    "truth": "label of the frame; missing where there is none",
    "predicted": "answer of the configuration, (nothing hit) if nothing got any attention; missing without one",
    "confidence": "probability of the answer, of all targets of its name, in [0, 1]; NaN without one",
    "outcome": "correct, wrong or unscored; missing for a person without a name",
    "error_type": "why a wrong frame is wrong, one of the names in frr.csv",
}
"""Column of ``frames.csv`` to its meaning. A row is one target of one subject in one frame of one configuration."""

_cell = lru_cache(maxsize=None)(csv_cell)
_JUDGED = attrgetter("clip", "configuration", "frame", "subject")


def export_frames(run: Path, folder: Path | None = None, *, replace: bool = False) -> Path:
    """Write ``frames.csv`` of a finished run.

    Parameters
    ----------
    folder
        Default: ``exported`` in the run's directory.

    Raises
    ------
    VfoaError
        If the run is not finished or cannot be scored, or the file is there and is not to be replaced.
    """
    directory = RunDirectory(run)
    path = (folder or run / "exported") / "frames.csv"
    check_new(path, replace=replace, inputs=directory.inputs)
    texts = run_frames(directory)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as draft, draft.open("w", encoding="utf-8", newline="") as file:
        file.writelines(texts)
    return path


def run_frames(directory: RunDirectory) -> Iterator[str]:
    """The text of ``frames.csv`` of a finished run, judged by the present labels.

    Raises
    ------
    VfoaError
        If the run is not finished or cannot be scored.
    """
    run = FinishedRun.read(directory)
    reference = run.reference()
    return frames_csv(run.records(), score(run.columns(), reference).verdicts, reference.traits)


def frames_csv(
    records: Iterable[FrameRecord], verdicts: Iterable[Verdict], traits: Mapping[str, AnswerTraits]
) -> Iterator[str]:
    """Yield the text of ``frames.csv`` in the order of the records: one row per target, ``focus`` 1 for the focus.

    A subject without attention values has one row without a target. Labelled frames that have no such subject, or
    no record, come last. ``set_90`` is 1 for the targets of the smallest set with 90 % of the probability, and
    blank if attention is no probability. Attention has four decimals, time three. A person that the manifest does
    not know has a track and no name.

    Parameters
    ----------
    traits
        What the answers of each configuration are; :data:`harness.score.verdicts.PLAIN` of one that is not there.
    """
    judged = {_JUDGED(verdict): verdict for verdict in verdicts}
    yield ",".join(FRAMES_COLUMNS) + "\n"
    for record in records:
        start = _start(record.clip, record.configuration, record.frame, time=f"{record.time_ns / 1e9:.3f}")
        names = {target.instance_id: _cell(target.name) for target in record.targets}
        has_probabilities = traits.get(record.configuration, PLAIN).probabilistic
        for subject in record.subjects:
            key = record.clip, record.configuration, record.frame, subject.name
            # removed when used: if tracks share a name, the first is the one that was judged
            end = _judgement(judged.pop(key, None) if subject.name is not None else None)
            of_subject = f"{start}{_cell(subject.name or '')},{subject.track_id},"
            lines = _subject_lines(of_subject, subject, names, has_probabilities)
            yield f"{end.join(lines)}{end}"
    for verdict in judged.values():
        start = _start(verdict.clip, verdict.configuration, verdict.frame, time="")
        yield f"{start}{_cell(verdict.subject)},,,,,,,,,{_judgement(verdict)}"


def _start(clip: str, configuration: str, frame: int, time: str) -> str:
    return f"{_cell(clip)},{_cell(configuration)},{frame},{time},"


def _subject_lines(start: str, subject: SubjectRecord, names: dict[int, str], has_probabilities: bool) -> list[str]:
    if not subject.attention:
        return [f"{start},,,,,,,"]
    held = prediction_set(subject) if has_probabilities else None
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
        return ",,,,\n"
    return (
        f"{_cell(verdict.truth or '')},{_cell(verdict.predicted or '')},{_number(verdict.confidence)},"
        f"{verdict.outcome},{verdict.error_type or ''}\n"
    )
