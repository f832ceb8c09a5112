"""Outcomes: records and labels as columns of the scored frames of one subject in one clip under one configuration."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from harness.clips.axes import other_axes
from harness.labels.labels import NOWHERE, Labels
from harness.run.directory import Pair, Published
from harness.run.records import FrameRecord, SubjectRecord
from harness.run.results import AnswerTraits
from harness.score.baselines import BASELINES, Choices, best_limit_rad, choose, commonest
from harness.score.looks import LEAST_S, correlation_time_s, number_looks
from harness.score.statistics import Codes, Flags
from harness.score.verdicts import (
    NO_HIT,
    NO_PROBABILITIES,
    PLAIN,
    UNKNOWN_WORTH,
    Verdict,
    Worth,
    answer,
    find_subject,
    judge,
    judge_absent,
    right_answers,
    worth_of,
)
from vfoa.types import DirectionFit, Float

NO_PREDICTION = -1
COMPARED_EVERY = 4
"""Of every so many frames, one is looked at for what tells of other axes and units."""
USUAL_HEAD_M = (0.1, 0.45)
"""Widths of a head's box, or a face's: a median outside of it is probably due to the unit of the depth."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Labels and frames by clip, and the notes that every table must show with the scores.

    A clip without labels is not scored. ``frames`` are those that were to be run, if they are fewer than the labels
    cover (a clip whose numbers have gaps, a run with a limit): a labelled frame without a record counts as wrong.
    ``notes`` describe the clips and the experiment, such as how a view was made; ``published`` are published figures.
    ``traits`` say what the answers of each configuration are, :data:`PLAIN` of one that is not there.
    ``unknown_names`` are names in the results of a clip that its manifest does not know: they can only be wrong.
    ``names_now`` are the present names of renamed targets by clip and name in the results.
    ``factors`` are the labels of each configuration's place in a grid, by dotted key; empty without a grid.
    ``settings`` are those of each configuration as JSON values, for advice; empty if not known. ``phases`` are those of
    each clip that has some, by the number of things beside people in a frame.
    """

    labels: Mapping[str, Labels]
    frames: Mapping[str, Iterable[int]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    published: Published | None = None
    traits: Mapping[str, AnswerTraits] = field(default_factory=dict)
    unknown_names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    names_now: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    factors: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    phases: Mapping[str, Mapping[int, str]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcomes:
    """A subject's frames in order: all verdicts, and columns (n,) of the scored ones.

    ``truth`` and ``predicted`` are codes of names, the same in a whole run; :data:`NO_PREDICTION` if there is none.
    ``positions`` count the clip's frames, so that a difference above 1 is a gap; ``frames`` are their numbers.
    ``looks`` number the looks (see :mod:`harness.score.looks`). ``no_hit`` are the frames in which nothing got any
    attention, ``nowhere`` those in which the subject looks at nothing, ``says_nowhere`` those in which the method says
    so, ``blocked`` those whose line of sight the label calls blocked. ``confidence``, ``on_truth``, ``brier``,
    ``set_size`` and ``is_covered`` are as in :class:`harness.score.verdicts.Worth`. ``baselines`` (n, baselines)
    says which baselines were right, in the order of :data:`harness.score.baselines.BASELINES`; ``angles_rad`` is
    the smallest angle from the gaze to a box's centre, NaN if not known. ``error_types`` are those of the wrong frames.
    ``rate_hz`` is the rate of the clip's frames, None if unknown.
    """

    clip: str
    configuration: str
    subject: str
    verdicts: tuple[Verdict, ...]
    frames: tuple[int, ...]
    positions: Codes
    looks: Codes
    correct: Flags
    truth: Codes
    predicted: Codes
    no_hit: Flags
    nowhere: Flags
    says_nowhere: Flags
    blocked: Flags
    confidence: Float
    on_truth: Float
    brier: Float
    set_size: Float
    is_covered: Flags
    baselines: Flags
    angles_rad: Float
    error_types: tuple[str, ...]
    rate_hz: float | None


NO_HITS = Choices().hits(())


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
                hits = choices.hits(right)
                if is_compared:
                    self.aims += _aim(record, person, right)
                worth = worth_of(record, person, label, traits)
                judgement = Judgement(verdict, judgement.is_blocked, hits, choices.angle_rad, worth)
            self.by_subject.setdefault(subject, {})[record.frame] = judgement


def _aim(record: FrameRecord, person: SubjectRecord | None, right: Iterable[int | None]) -> tuple[float, ...]:
    """A person's direction (the gaze's, else the head's) and the vector to the box looked at; nothing if not known."""
    box = next((box for number in right if number is not None and (box := record.target(number).box)), None)
    if person is None or person.eye_origin_m is None or box is None:
        return ()
    to_target = (end - start for end, start in zip(box.center_m, person.eye_origin_m, strict=True))
    return (*direction, *to_target) if (direction := person.gaze or person.head) else ()


def axis_notes(judged: Mapping[Pair, JudgedPart]) -> tuple[str, ...]:
    """A note for each clip whose directions seem to be in another program's axes, under the first configuration."""
    notes: dict[str, str] = {}
    for (clip, configuration), part in judged.items():
        directions, to_targets = np.array(part.aims).reshape(-1, 2, 3).swapaxes(0, 1)
        if clip not in notes and (found := other_axes(directions, to_targets)) is not None:
            notes[clip] = f"{clip} under {configuration}: {found}."
    return tuple(notes.values())


def unit_notes(judged: Mapping[Pair, JudgedPart]) -> tuple[str, ...]:
    """A note for each clip whose heads have no usual size in metres, under the first configuration."""
    notes: dict[str, str] = {}
    for (clip, configuration), part in judged.items():
        width_m = float(np.median(part.head_widths_m)) if part.head_widths_m else USUAL_HEAD_M[0]
        if clip not in notes and not USUAL_HEAD_M[0] <= width_m <= USUAL_HEAD_M[1]:
            notes[clip] = (
                f"{clip} under {configuration}: heads are {width_m:.2g} m wide (median): is the unit of depth right? "
                "In [source], depth_scale is the number of counts per metre of measured depth, baseline_m (or "
                "calibration_unit) that of a pair."
            )
    return tuple(notes.values())


def to_outcomes(judged: Mapping[Pair, JudgedPart], reference: Reference, phase: str | None = None) -> list[Outcomes]:
    """The outcomes of all judged records, and of every labelled frame without a record; or of one phase's records.

    In order of clip, configuration (both as they first appear in the records) and subject (by name). The baselines of a
    phase are fitted to that phase of the other clips.
    """
    codes: dict[str, int] = {}
    outcomes = []
    for name in dict.fromkeys(clip for clip, _ in judged):
        parts = {configuration: part for (clip, configuration), part in judged.items() if clip == name}
        wanted = _wanted(name, reference)
        times_ns = {frame: time for part in parts.values() for frame, time in part.times_ns.items()}
        places = {frame: place for place, frame in enumerate(sorted({*wanted, *times_ns}))}
        labels = reference.labels.get(name)
        wanted_labels = list(labels.labelled(wanted)) if labels else []
        for configuration, part in parts.items():
            traits = reference.traits.get(configuration, PLAIN)
            worth = NO_PROBABILITIES if traits.probabilistic else UNKNOWN_WORTH
            for frame, subject, label in wanted_labels:
                of_subject = part.by_subject.setdefault(subject, {})
                if frame not in of_subject:
                    verdict = judge_absent(name, configuration, frame, subject, label, traits)
                    of_subject[frame] = Judgement(verdict, label.is_blocked, worth=worth)
            for subject, judgements in sorted(part.by_subject.items()):
                in_phase = {k: each for k, each in judgements.items() if phase in (None, part.phases.get(k))}
                key = name, configuration, subject
                outcomes.append(_outcomes(key, in_phase, places, _rate_hz(times_ns), codes))
    return _with_limits(_with_commonest(_with_longer_looks(outcomes), judged, codes))


def _wanted(clip: str, reference: Reference) -> list[int]:
    """The frames of a clip that are scored if they have a label."""
    if (frames := reference.frames.get(clip)) is not None:
        return sorted(set(frames))
    ranges = labels.ranges if (labels := reference.labels.get(clip)) else ()
    return sorted({frame for row in ranges for frame in range(row.first_frame, row.last_frame + 1)})


def _rate_hz(times_ns: Mapping[int, int]) -> float | None:
    """The frame rate by the median step between frames that have a time; None if all times are equal."""
    times = np.array([time for _, time in sorted(times_ns.items())])
    step_ns = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    return 1e9 / step_ns if step_ns > 0 else None


def _with_longer_looks(outcomes: list[Outcomes]) -> list[Outcomes]:
    """The outcomes with looks joined until they last twice as long as verdicts of this run stay alike."""
    least_s = 2 * correlation_time_s((outcome.correct, outcome.positions, outcome.rate_hz) for outcome in outcomes)
    if least_s <= LEAST_S:
        return outcomes
    return [
        replace(outcome, looks=number_looks(outcome.truth, outcome.positions, outcome.rate_hz, least_s))
        for outcome in outcomes
    ]


def _outcomes(
    key: tuple[str, str, str], judged: Judged, places: dict[int, int], rate: float | None, codes: dict[str, int]
) -> Outcomes:
    clip, configuration, subject = key
    in_order = [judged[frame] for frame in sorted(judged)]
    scored = [judgement for judgement in in_order if judgement.verdict.outcome != "unscored"]
    verdicts = [judgement.verdict for judgement in scored]
    truths = [str(verdict.truth) for verdict in verdicts]
    truth = _coded(truths, codes)
    positions = np.array([places[verdict.frame] for verdict in verdicts], dtype=np.intp)
    worths = np.array([judgement.worth for judgement in scored], dtype=np.float64)
    confidence, on_truth, brier, set_size, is_covered = worths.reshape(-1, len(UNKNOWN_WORTH)).T
    always = commonest(truths)
    baselines = [(False, *judgement.hits, truth == always) for truth, judgement in zip(truths, scored, strict=True)]
    return Outcomes(
        clip=clip,
        configuration=configuration,
        subject=subject,
        verdicts=tuple(judgement.verdict for judgement in in_order),
        frames=tuple(verdict.frame for verdict in verdicts),
        positions=positions,
        looks=number_looks(truth, positions, rate),
        correct=np.array([verdict.outcome == "correct" for verdict in verdicts], dtype=np.bool_),
        truth=truth,
        predicted=_coded([answer(verdict) for verdict in verdicts], codes),
        no_hit=np.array([verdict.predicted == NO_HIT for verdict in verdicts], dtype=np.bool_),
        nowhere=np.array([name == NOWHERE for name in truths], dtype=np.bool_),
        says_nowhere=np.array([verdict.predicted == NOWHERE for verdict in verdicts], dtype=np.bool_),
        blocked=np.array([judgement.is_blocked for judgement in scored], dtype=np.bool_),
        confidence=confidence,
        on_truth=on_truth,
        brier=brier,
        set_size=set_size,
        is_covered=is_covered.astype(np.bool_),
        baselines=np.array(baselines, dtype=np.bool_).reshape(-1, len(BASELINES)),
        angles_rad=np.array([judgement.angle_rad for judgement in scored], dtype=np.float64),
        error_types=tuple(verdict.error_type for verdict in verdicts if verdict.error_type is not None),
        rate_hz=rate,
    )


def _with_commonest(
    outcomes: list[Outcomes], judged: Mapping[Pair, JudgedPart], codes: Mapping[str, int]
) -> list[Outcomes]:
    """The outcomes with the hits of the commonest label of the other clips, by configuration."""
    counts: dict[tuple[str, str], Codes] = {}
    for outcome in outcomes:
        key = outcome.configuration, outcome.clip
        counts[key] = counts.get(key, 0) + np.bincount(outcome.truth, minlength=len(codes))
    totals: dict[str, Codes] = {}
    for (configuration, _), of_clip in counts.items():
        totals[configuration] = totals.get(configuration, 0) + of_clip
    place, found = list(BASELINES).index("commonest"), []
    for outcome in outcomes:
        others = totals[outcome.configuration] - counts[outcome.configuration, outcome.clip]
        targets = {*judged[outcome.clip, outcome.configuration].targets, NOWHERE} - {outcome.subject}
        can_be = {name: int(others[code]) for name, code in codes.items() if name in targets and others[code]}
        baselines = outcome.baselines.copy()
        if can_be:
            baselines[:, place] = outcome.truth == codes[min(can_be, key=lambda name: (-can_be[name], name))]
        found.append(replace(outcome, baselines=baselines))
    return found


def _with_limits(outcomes: list[Outcomes]) -> list[Outcomes]:
    """The outcomes with the limit of ``nearest_in_angle`` that is best on the other clips, by configuration."""
    place = list(BASELINES).index("nearest_in_angle")
    limits: dict[tuple[str, str], float] = {}
    limited = []
    for outcome in outcomes:
        key = outcome.configuration, outcome.clip
        if key not in limits:
            others = [other for other in outcomes if other.configuration == key[0] and other.clip != key[1]]
            limits[key] = _limit_rad(others, place)
        is_target = outcome.angles_rad <= limits[key]
        says_nothing = np.isfinite(outcome.angles_rad) & ~is_target
        baselines = outcome.baselines.copy()
        baselines[:, place] = (outcome.baselines[:, place] & is_target) | (outcome.nowhere & says_nothing)
        limited.append(replace(outcome, baselines=baselines))
    return limited


def _limit_rad(others: list[Outcomes], place: int) -> float:
    if not others:
        return math.inf
    angles_rad = np.concatenate([outcome.angles_rad for outcome in others])
    hits = np.concatenate([outcome.baselines[:, place] for outcome in others])
    return best_limit_rad(angles_rad, hits, np.concatenate([outcome.nowhere for outcome in others]))


def _coded(names: Iterable[str | None], codes: dict[str, int]) -> Codes:
    coded = [NO_PREDICTION if name is None else codes.setdefault(name, len(codes)) for name in names]
    return np.array(coded, dtype=np.intp)
