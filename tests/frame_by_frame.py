"""Judging records one after the other: what verdicts as columns must say, too."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from harness.labels.labels import IGNORED, NOWHERE, Label
from harness.run.manifest import AnswerTraits
from harness.run.records import BoxPx, FrameRecord, SubjectRecord
from harness.score.baselines import COSINE, SHARE, angle_rad
from harness.score.reference import Reference
from harness.score.verdict_columns import COMPARED_EVERY
from harness.score.verdicts import (
    NO_OBJECT,
    NO_PROBABILITIES,
    OF_SCENE,
    PLAIN,
    UNKNOWN_WORTH,
    Outcome,
    Verdict,
    Worth,
    find_subject,
    prediction_set,
    probabilities,
    true_targets,
)
from vfoa.scoring import NO_HIT
from vfoa.types import DirectionFit

NO_HITS = (False,) * 4


class Choices(NamedTuple):
    """The instance that each baseline picks in a frame; None if it cannot pick.

    ``angle_rad`` is between the direction and the pick of ``in_angle``; NaN without a pick.
    """

    nearest: int | None = None
    largest: int | None = None
    central: int | None = None
    in_angle: int | None = None
    angle_rad: float = math.nan


class Judgement(NamedTuple):
    """Truth and prediction of a subject in a frame, and what its probabilities are worth.

    ``hits`` says which baselines that use the frame are right, ``angle_rad`` is as in :class:`Choices`.
    """

    verdict: Verdict
    is_blocked: bool
    hits: tuple[bool, ...] = NO_HITS
    angle_rad: float = math.nan
    worth: Worth = UNKNOWN_WORTH


Judged = dict[int, Judgement]
"""Judgements by frame."""


@dataclass(slots=True)
class JudgedPart:
    """The judgements of a configuration on a clip by subject, time and phase of each frame, fits of the directions.

    ``fits`` are those of all frames of named subjects, labelled or not. ``aims`` are some directions, one after the
    other, each with the vector from the eyes to what the label says: six numbers. ``head_widths_m`` are some widths.
    ``targets`` are the names of all targets that were found.
    """

    by_subject: dict[str, Judged] = field(default_factory=dict)
    times_ns: dict[int, int] = field(default_factory=dict)
    phases: dict[int, str] = field(default_factory=dict)
    fits: list[DirectionFit] = field(default_factory=list)
    aims: list[float] = field(default_factory=list)
    head_widths_m: list[float] = field(default_factory=list)
    targets: dict[str, bool] = field(default_factory=dict)

    def take(self, record: FrameRecord, reference: Reference) -> None:
        """Judge every labelled or named subject of a record."""
        self.times_ns[record.frame] = record.time_ns
        self.targets.update((target.name, True) for target in record.targets)
        if phases := reference.phases.get(record.clip):
            bodies = {subject.instance_id for subject in record.subjects}
            things = sum(target.instance_id not in bodies for target in record.targets)
            if (phase := phases.get(things)) is not None:
                self.phases[record.frame] = phase
        named = [subject for subject in record.subjects if subject.name is not None]
        self.fits += [subject.fit for subject in named if subject.fit is not None]
        is_compared = len(self.times_ns) % COMPARED_EVERY == 1
        if is_compared:
            self.head_widths_m += [subject.head_width_m for subject in record.subjects if subject.head_width_m]
        of_clip = reference.labels.get(record.clip)
        traits = reference.traits.get(record.configuration, PLAIN)
        labels = {subject: label for _, subject, label in of_clip.labelled([record.frame])} if of_clip else {}
        for subject in dict.fromkeys((*labels, *(str(person.name) for person in named))):
            label = labels.get(subject)
            verdict = judge(record, subject, label, traits)
            judgement = Judgement(verdict, label is not None and label.is_blocked)
            if label and verdict.outcome != "unscored":
                person = find_subject(record, subject)
                choices, right = choose(record, person), right_answers(record, label)
                hits = tuple(pick is not None and pick in right for pick in choices[:4])
                if is_compared:
                    self.aims += _aim(record, person, right)
                worth = worth_of(record, person, label, traits)
                judgement = Judgement(verdict, judgement.is_blocked, hits, choices.angle_rad, worth)
            self.by_subject.setdefault(subject, {})[record.frame] = judgement


def _aim(record: FrameRecord, person: SubjectRecord | None, right: Sequence[int | None]) -> tuple[float, ...]:
    """A person's direction (the gaze's, else the head's) and the vector to the box looked at; nothing if not known."""
    if person is None or person.eye_origin_m is None or len(right) != 1 or right[0] is None:
        return ()
    if (box := record.target(right[0]).box) is None:
        return ()
    to_target = (end - start for end, start in zip(box.center_m, person.eye_origin_m, strict=True))
    return (*direction, *to_target) if (direction := person.gaze or person.head) else ()


def worth_of(record: FrameRecord, subject: SubjectRecord | None, label: Label, traits: AnswerTraits) -> Worth:
    """What a subject's probabilities are worth. A true target that the frame does not have has probability 0."""
    worth = NO_PROBABILITIES if traits.probabilistic else UNKNOWN_WORTH
    if subject is None:
        return worth
    right = right_answers(record, label)
    if traits.probabilistic and subject.missing is None:
        chances = probabilities(subject)
        on_truth = sum(chances.get(key, 0.0) for key in right)
        wrong: dict[str | None, float] = {}
        for key, chance in chances.items():
            if key not in right:
                name = None if key is None else record.target(key).name
                wrong[name] = wrong.get(name, 0.0) + chance
        brier = (1 - on_truth) ** 2 + sum(chance**2 for chance in wrong.values())
        held = prediction_set(subject)
        is_covered = not set(held).isdisjoint(right)
        worth = Worth(_confidence(record, subject, label), on_truth, brier, len(held) or math.nan, is_covered)
    return worth


def judge(record: FrameRecord, subject: str, label: Label | None, traits: AnswerTraits = PLAIN) -> Verdict:
    """Judge a frame's record for a subject. No label, or ``ignore``: unscored."""
    person = find_subject(record, subject)
    predicted = _predicted(record, person)
    outcome: Outcome = "unscored"
    error_type = None
    has_chances = traits.probabilistic and person is not None and person.missing is None
    if label is not None and label.target != IGNORED:
        error_type = _error_type(record, subject, person, label, predicted)
        outcome = "wrong" if error_type else "correct"
    if traits.says_nowhere and predicted == NO_HIT and not (person and person.missing == "no_hit"):
        predicted, error_type = NOWHERE, "missed" if error_type == "no_hit" else error_type
    if traits.from_file and error_type is not None:
        error_type = OF_SCENE.get(error_type, error_type)
    return Verdict(
        clip=record.clip,
        configuration=record.configuration,
        frame=record.frame,
        subject=subject,
        truth=label.target if label else None,
        predicted=predicted,
        outcome=outcome,
        error_type=error_type,
        confidence=_confidence(record, person, label) if has_chances and person else None,
    )


def _predicted(record: FrameRecord, person: SubjectRecord | None) -> str | None:
    if person is None or person.missing not in (None, NO_OBJECT, "no_hit"):
        return None
    if person.focus is not None:
        return record.target(person.focus).name
    return NOWHERE if any(value.total > 0.0 for value in person.attention) else NO_HIT


def _error_type(
    record: FrameRecord, subject: str, person: SubjectRecord | None, label: Label, predicted: str | None
) -> str | None:
    """Why the frame is wrong: the first error type that applies; None if it is correct."""
    if person is None:
        return "no_subject"
    if person.missing == "no_direction" and person.no_gaze is not None:
        return person.no_gaze
    if person.missing in (NO_OBJECT, "no_hit"):
        return None if label.target == NOWHERE else person.missing
    if person.missing is not None:
        return person.missing
    if person.focus in right_answers(record, label):
        return None
    if label.target == NOWHERE:
        return "false_attention"
    targets = true_targets(record, label)
    if not targets:
        return "target_not_segmented"
    if all(target.box is None for target in targets):
        return "target_without_box"
    if _is_somebody_else(record, subject, person) or predicted == subject:
        return "wrong_subject"
    attended = {value.instance_id for value in person.attention if value.total > 0.0}
    if not attended:
        return "no_hit"
    return "outscored" if any(target.instance_id in attended for target in targets) else "missed"


def _is_somebody_else(record: FrameRecord, subject: str, person: SubjectRecord) -> bool:
    bodies = {target.instance_id for target in record.targets if target.name == subject}
    return person.instance_id is not None and bool(bodies) and person.instance_id not in bodies


def _confidence(record: FrameRecord, subject: SubjectRecord, label: Label | None) -> float:
    """The probability of the answer: of all objects of its name, but for those that a label's point tells apart."""
    chances, focus = probabilities(subject), subject.focus
    if focus is None:
        return min(chances[None], 1.0)
    right = () if label is None else right_answers(record, label)
    alike = {
        target.instance_id
        for target in record.targets
        if target.name == record.target(focus).name and (target.instance_id in right) == (focus in right)
    }
    return min(sum(chances.get(number, 0.0) for number in alike), 1.0)


def right_answers(record: FrameRecord, label: Label) -> tuple[int | None, ...]:
    """Return the instances that the label names in this frame, each of them a right focus; None means nowhere."""
    if label.target == NOWHERE:
        return (None,)
    return tuple(target.instance_id for target in true_targets(record, label))


def choose(record: FrameRecord, subject: SubjectRecord | None) -> Choices:
    """Apply the baselines to a subject of a frame. Ties go to the lower instance id."""
    if subject is None:
        return Choices()
    others = [target for target in record.targets if target.instance_id != subject.instance_id]
    centers = {target.instance_id: target.box.center_m for target in others if target.box is not None}
    eyes, direction = subject.eye_origin_m, subject.gaze or subject.head
    angles = {
        number: angle_rad(direction, eyes, center)
        for number, center in centers.items()
        if eyes is not None and direction is not None
    }
    in_angle = _least({number: -math.cos(angle) for number, angle in angles.items()}, margin=COSINE)
    return Choices(
        nearest=_least({n: math.dist(center, eyes) for n, center in centers.items() if eyes is not None}, share=SHARE),
        largest=_least({each.instance_id: -_area_px(each.box_px) for each in others if each.box_px is not None}),
        central=_least({n: -at[2] / (math.hypot(*at) or math.inf) for n, at in centers.items()}, margin=COSINE),
        in_angle=in_angle,
        angle_rad=math.nan if in_angle is None else angles[in_angle],
    )


def _least(values: Mapping[int, float], *, share: float = 0.0, margin: float = 0.0) -> int | None:
    """The lowest key of the least value and of those that are equal to it but for rounding."""
    least = min(values.values(), default=math.nan)
    return min((key for key, value in values.items() if value <= least + abs(least) * share + margin), default=None)


def _area_px(box_px: BoxPx) -> float:
    u0, v0, u1, v1 = box_px
    return (u1 - u0) * (v1 - v0)
