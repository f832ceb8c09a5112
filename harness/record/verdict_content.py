"""The layer of the verdicts: each subject's truth, prediction and verdict, the answers in space, and a page per frame.

It is made from a run's results and the labels only, so that each scoring can rewrite it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import rerun as rr

from harness.labels.labels import IGNORED, NOWHERE, Label, Labels
from harness.record import entities
from harness.record.appearance import (
    GREY,
    OUTCOME_COLOURS,
    TRUTH_COLOUR,
    Colour,
    Colours,
    subject_names,
    target_names,
)
from harness.record.frame_log import FrameLog
from harness.run.records import AttentionRecord, FrameRecord
from harness.score.verdicts import ERROR_TYPES, Verdict, answered, prediction_set, probabilities, true_targets
from vfoa.geometry import quaternion
from vfoa.scoring import NO_HIT, NO_PREDICTION, NO_TRUTH


def predicted_in_words(verdict: Verdict) -> str:
    """The prediction, with its probability in percent if there is one; another object of the true name is marked."""
    confidence = "" if verdict.confidence is None else f" ({100 * verdict.confidence:.0f} %)"
    predicted = answered(verdict) if verdict.outcome == "wrong" else verdict.predicted or NO_PREDICTION
    return f"{predicted}{confidence}"


def log_verdicts(log: FrameLog, record: FrameRecord, verdicts: Sequence[Verdict], labels: Labels) -> None:
    """Log all verdicts of a frame; ``labels`` say which of several targets of a name is meant."""
    configuration = record.configuration
    for verdict in verdicts:
        _log_states(log, verdict)
        _log_answers(log, record, verdict, labels.at(record.frame, verdict.subject))
        if verdict.outcome == "wrong":
            log.event(entities.log(configuration), rr.TextLog, text=[_sentence(verdict)], level=[rr.TextLogLevel.WARN])
    page = summary(record, verdicts)
    log.row(entities.summary(configuration), rr.TextDocument, text=[page], media_type=[rr.MediaType.MARKDOWN])


def _log_states(log: FrameLog, verdict: Verdict) -> None:
    """Log three rows of states per subject: the truth, the prediction, and whether they agree; and the error type."""
    states = (verdict.truth or NO_TRUTH, verdict.predicted or NO_PREDICTION, verdict.outcome)
    for lane, state in zip(_LANES, states, strict=True):
        log.row(entities.verdict(verdict.configuration, verdict.subject, lane), rr.StateChange, state=[state])
    if verdict.error_type is not None:  # a text, which is no lane of the timeline: for queries
        path = entities.verdict(verdict.configuration, verdict.subject, "error_type")
        log.row(path, rr.TextDocument, text=[verdict.error_type])


_LANES = ("truth", "predicted", "verdict")


def log_palettes(stream: rr.RecordingStream, configuration: str, subjects: Iterable[str], colours: Colours) -> None:
    """Log the colours of the subjects' timelines, once for all frames."""
    targets = {**colours.known, **dict.fromkeys((NOWHERE, IGNORED, NO_TRUTH, NO_HIT, NO_PREDICTION), GREY)}
    for subject in subjects:
        for lane in _LANES:
            palette = OUTCOME_COLOURS if lane == "verdict" else targets
            stream.log(entities.verdict(configuration, subject, lane), _states(palette), static=True)


def _states(palette: dict[str, Colour]) -> rr.StateConfiguration:
    names = list(palette)
    return rr.StateConfiguration(values=names, labels=names, colors=[(*palette[name], 255) for name in names])


def _log_answers(log: FrameLog, record: FrameRecord, verdict: Verdict, label: Label | None) -> None:
    """Log the box of the true target in green, that of a wrong answer in red, and the line from the eyes to each.

    Of several true targets the one that is the answer is marked; if none is, all are, since any may be meant.
    """
    names = subject_names(record)
    subject = next((s for s in record.subjects if names[s.track_id] == verdict.subject), None)
    focus = None if subject is None else subject.focus
    true = [] if label is None else [target for target in true_targets(record, label) if target.box]
    answers = [("truth", [target for target in true if target.instance_id == focus] or true, verdict.truth)]
    if verdict.outcome == "wrong":
        answers.append(("predicted", [] if focus is None else [record.target(focus)], predicted_in_words(verdict)))
    for what, targets, words in answers:
        boxes = [target.box for target in targets if target.box is not None]
        if not boxes:
            continue
        path = entities.answer_3d(verdict.configuration, verdict.subject, what)
        centers = np.array([box.center_m for box in boxes], dtype=np.float32)
        log.row(
            f"{path}/box",
            rr.Boxes3D,
            centers=centers,
            half_sizes=[np.array(box.half_size_m) * _MARGIN for box in boxes],
            quaternions=[quaternion(np.transpose(box.axes)) for box in boxes],
        )
        # above the box: the target's own name is in its middle
        heights_m = [float(np.abs(np.transpose(box.axes)[1]) @ box.half_size_m) * _LABEL_HEIGHT for box in boxes]
        above = centers - np.array([(0, height_m, 0) for height_m in heights_m], dtype=np.float32)
        log.row(f"{path}/label", rr.Points3D, positions=above, labels=[f"{what}: {words}"] * len(boxes))
        if subject is not None and subject.eye_origin_m is not None:
            eyes = np.broadcast_to(np.array(subject.eye_origin_m, dtype=np.float32), centers.shape)
            strips = np.stack([eyes, centers], axis=1)
            log.row(f"{path}/line", rr.LineStrips3D, strips=strips)


def log_styles(stream: rr.RecordingStream, configuration: str, subjects: Iterable[str], paths: Collection[str]) -> None:
    """Log the style of the answers once for all frames, at the entity paths that the recording has."""
    for subject in subjects:
        for what, colour in (("truth", TRUTH_COLOUR), ("predicted", OUTCOME_COLOURS["wrong"])):
            for name, (archetype, style) in _STYLES.items():
                path = f"{entities.answer_3d(configuration, subject, what)}/{name}"
                if path in paths:
                    stream.log(path, archetype.from_fields(colors=[colour], **style), static=True)


_STYLES: dict[str, tuple[Any, dict[str, Any]]] = {
    "box": (rr.Boxes3D, {"fill_mode": rr.components.FillMode.MajorWireframe, "radii": rr.Radius.ui_points(3)}),
    "label": (rr.Points3D, {"radii": rr.Radius.ui_points(0), "show_labels": True}),
    "line": (rr.LineStrips3D, {"radii": rr.Radius.ui_points(2.5)}),
}

_MARGIN = 1.06
"""The marking box is a little larger than the target's own."""

_LABEL_HEIGHT = 1.6
"""Height of a label over the middle of its box, in half heights of the box."""


def _sentence(verdict: Verdict) -> str:
    return f"{verdict.subject}: truth {verdict.truth}, predicted {predicted_in_words(verdict)}: {verdict.error_type}"


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
            predicted_in_words(verdict),
            verdict.outcome,
            (verdict.error_type or "").replace("_", " "),
        )
        row = [_cell(cell) for cell in cells]
        row[3] = f"**{row[3].upper()}**" if verdict.outcome == "wrong" else row[3]
        lines.append(f"| {' | '.join(row)} |")
    types = dict.fromkeys(verdict.error_type for verdict in verdicts if verdict.error_type)
    meanings = [f"{error_type.replace('_', ' ')}: {ERROR_TYPES[error_type]}\n" for error_type in types]
    probable = {verdict.subject for verdict in verdicts if verdict.confidence is not None}
    parts = (
        *meanings,
        *_masks_note(record),
        *_depth_note(record),
        *_prediction_sets(record, probable),
        *_attention_table(record, probable),
    )
    return "\n".join([*lines, "", *parts]) + "\n"


def _masks_note(record: FrameRecord) -> list[str]:
    """A line if the masks were not found in this frame."""
    if record.masks_from is None:
        return []
    age = f", {record.masks_age_s:.2f} s old" if record.masks_age_s else ""
    return [f"Masks: carried from frame {record.masks_from}{age}\n"]


def _depth_note(record: FrameRecord) -> list[str]:
    """A line if boxes or eyes are at the depth of an earlier frame."""
    targets, people = target_names(record), subject_names(record)
    held = [(targets[each.instance_id], each.depth_from) for each in record.targets]
    held += [(f"the eyes of {people[each.track_id]}", each.depth_from) for each in record.subjects]
    words = [f"{_cell(name)} from {frame}" for name, frame in held if frame is not None]
    return [f"Depth of earlier frames: {', '.join(words)}\n"] if words else []


def _prediction_sets(record: FrameRecord, probable: Collection[str]) -> list[str]:
    """A line for each subject whose attention is a probability: the smallest set with 90 % of it."""
    names, targets = subject_names(record), target_names(record)
    lines = []
    for subject in record.subjects:
        if names[subject.track_id] in probable and (held := prediction_set(subject)):
            words = ", ".join(_cell(NOWHERE if key is None else targets[key]) for key in held)
            lines.append(f"{_cell(names[subject.track_id])}, 90 % set: {words}\n")
    return lines


def _attention_table(record: FrameRecord, probable: Collection[str]) -> list[str]:
    """One row per object, one column per subject, the most attended one first.

    Subjects whose attention is a probability, ``probable``, have a row for looking at nothing.
    """
    names, targets = subject_names(record), target_names(record)
    columns: dict[str, dict[str, str]] = {}
    strongest: dict[str, float] = {}
    for subject in record.subjects:
        name = names[subject.track_id]
        totals = {targets[value.instance_id]: value.total for value in subject.attention}
        columns[name] = {targets[value.instance_id]: _numbers(value) for value in subject.attention}
        if totals and name in probable:
            totals[NOWHERE] = probabilities(subject)[None]
            columns[name][NOWHERE] = f"{totals[NOWHERE]:.2f}"
        for target, total in totals.items():
            strongest[target] = max(total, strongest.get(target, 0.0))
    lines = [f"{_cell(names[s.track_id])}: no attention, {_cell(s.missing)}\n" for s in record.subjects if s.missing]
    lines += [f"{_cell(names[s.track_id])}: {ERROR_TYPES[s.no_gaze]}\n" for s in record.subjects if s.no_gaze]
    if not strongest:
        return lines
    lines.append(f"| total (gaze, head) | {' | '.join(_cell(name) for name in columns)} |")
    lines.append("|---" * (1 + len(columns)) + "|")
    for target in sorted(strongest, key=lambda target: (-strongest[target], target)):
        cells = [column.get(target, "") for column in columns.values()]
        lines.append(f"| {_cell(target)} | {' | '.join(cells)} |")
    return lines


def _numbers(value: AttentionRecord) -> str:
    gaze, head = ("not measured" if cue is None else f"{cue:.2f}" for cue in (value.gaze, value.head))
    return f"{value.total:.2f} ({gaze}, {head})"


@lru_cache(maxsize=1024)
def _cell(text: str) -> str:
    """A name in a Markdown table: characters that would end the cell or start a format are escaped."""
    return "".join(f"\\{sign}" if sign in "\\|*_`<[#" else sign for sign in text.replace("\n", " "))
