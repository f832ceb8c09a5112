"""The layer of the verdicts: the truth, prediction and verdict of each subject, the answers in space, the frame's page.

It is made from a run's results and the labels alone, so that each scoring can write it anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from harness.labels.labels import IGNORED, NOWHERE
from harness.record import entities
from harness.record.appearance import (
    GREY,
    OUTCOME_COLOURS,
    TRUTH_COLOUR,
    Colour,
    Colours,
    attention_by_name,
    subject_names,
    target_names,
)
from harness.record.frame_log import FrameLog
from harness.run.records import AttentionRecord, FrameRecord, SubjectRecord, TargetRecord
from harness.score.posterior_checks import prediction_set
from harness.score.verdicts import ERROR_TYPES, Verdict

NO_PREDICTION = "no prediction"
NO_TRUTH = "not annotated"


def log_verdicts(log: FrameLog, record: FrameRecord, verdicts: Sequence[Verdict], colours: Colours) -> None:
    """All of a frame's verdicts."""
    configuration = record.configuration
    for verdict in verdicts:
        _log_states(log, verdict, colours)
        _log_answers(log, record, verdict)
        if verdict.outcome == "wrong":
            log.log(entities.log(configuration), rr.TextLog(_sentence(verdict), level=rr.TextLogLevel.WARN))
    page = rr.TextDocument(summary(record, verdicts), media_type=rr.MediaType.MARKDOWN)
    log.log(entities.summary(configuration), page)


def _log_states(log: FrameLog, verdict: Verdict, colours: Colours) -> None:
    """Three lanes a subject: the truth, the prediction, and whether they agree."""
    truth, predicted = verdict.truth or NO_TRUTH, verdict.predicted or NO_PREDICTION
    targets = {**colours.known, **dict.fromkeys((NOWHERE, IGNORED, NO_TRUTH, NO_PREDICTION), GREY)}
    lanes = (
        ("truth", truth, targets),
        ("predicted", predicted, targets),
        ("verdict", verdict.outcome, OUTCOME_COLOURS),
    )
    for lane, state, palette in lanes:
        path = entities.verdict(verdict.configuration, verdict.subject, lane)
        log.keep(path, partial(_states, palette), key=tuple(palette))
        log.log(path, rr.StateChange(state=state))


def _states(palette: dict[str, Colour]) -> rr.StateConfiguration:
    names = list(palette)
    return rr.StateConfiguration(values=names, labels=names, colors=[(*palette[name], 255) for name in names])


def _log_answers(log: FrameLog, record: FrameRecord, verdict: Verdict) -> None:
    """The box of the true target in green, that of a wrong answer in red, and the line from the eyes to each."""
    names = subject_names(record)
    subject = next((s for s in record.subjects if names[s.track_id] == verdict.subject), None)
    answers = [("truth", verdict.truth, TRUTH_COLOUR)]
    if verdict.outcome == "wrong":
        answers.append(("predicted", verdict.predicted, OUTCOME_COLOURS["wrong"]))
    for what, name, colour in answers:
        target = _target(record, name, subject)
        if target is None or target.box is None:
            continue
        path = entities.answer_3d(verdict.configuration, verdict.subject, what)
        log.keep(f"{path}/box", partial(_box_style, colour), key="style")
        rotation = Rotation.from_matrix(np.array(target.box.axes).T)
        log.log(
            f"{path}/box",
            rr.Boxes3D.from_fields(
                centers=np.array([target.box.center_m]),
                half_sizes=np.array([target.box.half_size_m]) * _MARGIN,
                quaternions=rotation.as_quat()[None],
                labels=[f"{what}: {name}"],
            ),
        )
        if subject is not None and subject.eye_origin_m is not None:
            log.keep(f"{path}/line", partial(_line_style, colour), key="style")
            ends = np.array([[subject.eye_origin_m, target.box.center_m]], dtype=np.float32)
            log.log(f"{path}/line", rr.LineStrips3D.from_fields(strips=ends))


_MARGIN = 1.06
"""The marking box is a little larger than the target's own."""


def _box_style(colour: Colour) -> rr.Boxes3D:
    return rr.Boxes3D.from_fields(
        colors=[colour],
        fill_mode=rr.components.FillMode.MajorWireframe,
        radii=rr.Radius.ui_points(3),
        show_labels=True,
    )


def _line_style(colour: Colour) -> rr.LineStrips3D:
    return rr.LineStrips3D.from_fields(colors=[colour], radii=rr.Radius.ui_points(2.5))


def _target(record: FrameRecord, name: str | None, subject: SubjectRecord | None) -> TargetRecord | None:
    """The target of that name with a box; of several, the one in focus, else the first."""
    found = [target for target in record.targets if target.name == name and target.box is not None]
    focus = subject.focus if subject is not None else None
    return next((each for each in found if each.instance_id == focus), found[0] if found else None)


def _sentence(verdict: Verdict) -> str:
    predicted = verdict.predicted or NO_PREDICTION
    return f"{verdict.subject}: truth {verdict.truth}, predicted {predicted} ({verdict.error_type})"


def summary(record: FrameRecord, verdicts: Sequence[Verdict]) -> str:
    """The frame as a Markdown page: one row per subject, then the attention of each subject to each target."""
    lines = [
        f"**Frame {record.frame}** of {_cell(record.clip)}, {_cell(record.configuration)}",
        "",
        "| subject | looks at | predicted | verdict | error type |",
        "|---|---|---|---|---|",
    ]
    for verdict in verdicts:
        cells = (
            verdict.subject,
            verdict.truth or NO_TRUTH,
            verdict.predicted or NO_PREDICTION,
            verdict.outcome,
            f"{verdict.error_type}: {ERROR_TYPES[verdict.error_type]}" if verdict.error_type else "",
        )
        row = [_cell(cell) for cell in cells]
        row[3] = f"**{row[3].upper()}**" if verdict.outcome == "wrong" else row[3]
        lines.append(f"| {' | '.join(row)} |")
    return "\n".join([*lines, "", *_prediction_sets(record), *_attention_table(record)]) + "\n"


def _prediction_sets(record: FrameRecord) -> list[str]:
    """A line for each subject whose attention is a probability: the smallest set with 90 % of it."""
    names, targets = subject_names(record), target_names(record)
    lines = []
    for subject in record.subjects:
        held = prediction_set(subject)
        if held is not None:
            words = ", ".join(_cell(NOWHERE if key is None else targets[key]) for key in held)
            lines.append(f"{_cell(names[subject.track_id])}, 90 % set: {words}\n")
    return lines


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
