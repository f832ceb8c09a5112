"""How each subject was judged: lanes over time, lines in the scene, the frame's table, and a warning per failure."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import rerun as rr

from harness.annotations.files import IGNORED, NOWHERE
from harness.recording import entities
from harness.recording.frame_log import FrameLog
from harness.recording.labels import (
    GREY,
    OUTCOME_COLOURS,
    TRUTH_COLOUR,
    Colour,
    Colours,
    attention_by_name,
    subject_names,
)
from harness.runs.results import AttentionRecord, FrameRecord, SubjectRecord
from harness.scores.verdicts import CAUSES, Verdict

NO_PREDICTION = "no prediction"
NO_TRUTH = "not annotated"


def log_verdicts(log: FrameLog, record: FrameRecord, verdicts: Sequence[Verdict], colours: Colours) -> None:
    """All of a frame's verdicts."""
    for verdict in verdicts:
        _log_lanes(log, verdict, colours)
        _log_lines(log, record, verdict)
        if verdict.outcome == "wrong":
            log.log(entities.LOG, rr.TextLog(_sentence(verdict), level=rr.TextLogLevel.WARN))
    log.log(entities.SUMMARY, rr.TextDocument(summary(record, verdicts), media_type=rr.MediaType.MARKDOWN))


def _log_lanes(log: FrameLog, verdict: Verdict, colours: Colours) -> None:
    """Three lanes a subject: the truth, the prediction, and whether they agree."""
    truth, predicted = verdict.truth or NO_TRUTH, verdict.predicted or NO_PREDICTION
    targets = {**colours.known, **dict.fromkeys((NOWHERE, IGNORED, NO_TRUTH, NO_PREDICTION), GREY)}
    lanes = (
        (("truth",), truth, targets),
        (("predicted",), predicted, targets),
        ((), verdict.outcome, OUTCOME_COLOURS),
    )
    for parts, state, palette in lanes:
        path = entities.verdict(verdict.subject, *parts)
        log.keep(path, partial(_states, palette), key=tuple(palette))
        log.log(path, rr.StateChange(state=state))


def _states(palette: dict[str, Colour]) -> rr.StateConfiguration:
    names = list(palette)
    return rr.StateConfiguration(values=names, labels=names, colors=[(*palette[name], 255) for name in names])


def _log_lines(log: FrameLog, record: FrameRecord, verdict: Verdict) -> None:
    """From the eyes to the true target, and to the predicted one where that is another."""
    names = subject_names(record)
    subject = next((s for s in record.subjects if names[s.track_id] == verdict.subject), None)
    if subject is None or subject.eye_origin_m is None:
        return
    lines = [("truth", verdict.truth, TRUTH_COLOUR)]
    if verdict.outcome == "wrong":
        lines.append(("predicted", verdict.predicted, OUTCOME_COLOURS["wrong"]))
    for what, target, colour in lines:
        centre = _centre(record, target, subject)
        if centre is None:
            continue
        path = entities.subject_3d(verdict.subject, what)
        log.keep(path, partial(_line_style, colour), key="style")
        line = rr.LineStrips3D.from_fields(
            strips=np.array([[subject.eye_origin_m, centre]], dtype=np.float32),
            labels=[f"{what}: {target}"],
            show_labels=len(record.subjects) == 1,
        )
        log.log(path, line)


def _line_style(colour: Colour) -> rr.LineStrips3D:
    return rr.LineStrips3D.from_fields(colors=[colour], radii=rr.Radius.ui_points(2.5))


def _centre(record: FrameRecord, name: str | None, subject: SubjectRecord) -> tuple[float, float, float] | None:
    """The centre of a target's box; of several with that name, the one in focus, else the first."""
    boxes = {t.instance_id: t.box.center_m for t in record.targets if t.name == name and t.box is not None}
    if subject.focus in boxes:
        return boxes[subject.focus]
    return next(iter(boxes.values()), None)


def _sentence(verdict: Verdict) -> str:
    predicted = verdict.predicted or NO_PREDICTION
    return f"{verdict.subject}: truth {verdict.truth}, predicted {predicted} ({verdict.cause})"


def summary(record: FrameRecord, verdicts: Sequence[Verdict]) -> str:
    """The frame as a Markdown page: one row per subject, then the attention of each subject to each target."""
    lines = [
        f"**Frame {record.frame}** of {_cell(record.clip)}, {_cell(record.configuration)}",
        "",
        "| subject | looks at | predicted | verdict | cause |",
        "|---|---|---|---|---|",
    ]
    for verdict in verdicts:
        cells = (
            verdict.subject,
            verdict.truth or NO_TRUTH,
            verdict.predicted or NO_PREDICTION,
            verdict.outcome,
            f"{verdict.cause}: {CAUSES[verdict.cause]}" if verdict.cause else "",
        )
        row = [_cell(cell) for cell in cells]
        row[3] = f"**{row[3].upper()}**" if verdict.outcome == "wrong" else row[3]
        lines.append(f"| {' | '.join(row)} |")
    return "\n".join([*lines, "", *_attention_table(record)]) + "\n"


def _attention_table(record: FrameRecord) -> list[str]:
    """One row a target, one column a subject, the most attended target first."""
    names = subject_names(record)
    columns = {names[subject.track_id]: attention_by_name(record, subject) for subject in record.subjects}
    strongest: dict[str, float] = {}
    for column in columns.values():
        for target, value in column.items():
            strongest[target] = max(value.total, strongest.get(target, 0.0))
    lines = [f"{_cell(names[s.track_id])}: no attention, {_cell(s.missing)}\n" for s in record.subjects if s.missing]
    if not strongest:
        return lines
    lines.append(f"| total (gaze, head) | {' | '.join(_cell(name) for name in columns)} |")
    lines.append("|---" * (1 + len(columns)) + "|")
    for target in sorted(strongest, key=lambda target: (-strongest[target], target)):
        cells = [_numbers(column[target]) if target in column else "" for column in columns.values()]
        lines.append(f"| {_cell(target)} | {' | '.join(cells)} |")
    return lines


def _numbers(value: AttentionRecord) -> str:
    gaze, head = ("not measured" if cue is None else f"{cue:.2f}" for cue in (value.gaze, value.head))
    return f"{value.total:.2f} ({gaze}, {head})"


def _cell(text: str) -> str:
    """A name in a Markdown table: what would end the cell or start a format is escaped."""
    return "".join(f"\\{sign}" if sign in "\\|*_`<[#" else sign for sign in text.replace("\n", " "))
