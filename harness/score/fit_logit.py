"""``vfoa fit``: fits the weights of the logit to labels, and scores them on people and times that were left out.

With several clips, each is left out in turn. With one clip, blocks of at least :data:`BLOCK_S` are.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from harness.labels.labels import IGNORED, Labels
from harness.run.directory import RunDirectory
from harness.run.fitted_weights import FitRecord, FittedWeights, MethodScore
from harness.run.grid import base_of
from harness.run.records import FrameRecord
from harness.score.baselines import Baselines, best_limit_rad
from harness.score.finished_run import FinishedRun
from harness.score.metrics import LEAST_PROBABILITY
from harness.score.reliability import reliability
from harness.score.replay import to_subject, to_target
from harness.score.verdicts import find_subject, right_answers
from vfoa import __version__
from vfoa.attention import AttentionSettings, pay_attention
from vfoa.errors import VfoaError, did_you_mean
from vfoa.logit import LogitSettings, LogitWeights, Traces, probabilities, shipped_weights
from vfoa.logit import weigh_attentions as weigh
from vfoa.logit_cues import ROWS, Seen, features, later_means
from vfoa.logit_fit import SMOOTHINGS, UNKNOWN, LabelledSequence, Smoothing, fit
from vfoa.types import PROBABILISTIC, Float

BLOCK_S = 10.0
"""Shortest block that is left out of a single clip, seconds: a look must not be on both sides of a border."""
_MOST_BLOCKS = 8
CURVE_S = (20, 60, 120, 240, 480, 960)
"""Labelled seconds at which the learning curve is computed."""
_CONES = AttentionSettings(cones_cm=(10, 25))
FITTED, DEFAULT = "fitted", "default weights"
COMMONEST, NEAREST, TWO_CONES = "commonest", "nearest within a limit", "two cones"

Outcome = tuple[bool, float, float]
"""Whether an answer is right; its probability, and that of the truth. NaN without probabilities."""


class Nearest(NamedTuple):
    """The target nearest in angle to the measured direction: its angle, radians, and whether it is the true one."""

    angle_rad: float
    is_true: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class Person:
    """One labelled person of a clip under one seed, by frame: the sequence, and the answers of other methods."""

    sequence: LabelledSequence
    nearest: Sequence[Nearest]
    others: Mapping[str, Sequence[Outcome]]

    @property
    def labelled(self) -> Sequence[int]:
        """The positions of the frames that are scored."""
        return [k for k, target in enumerate(self.sequence.targets) if target != UNKNOWN]

    def only(self, chosen: Iterable[int]) -> Person:
        """Return the person with the labels of these frames alone."""
        wanted = set(chosen)
        targets = [each if k in wanted else UNKNOWN for k, each in enumerate(self.sequence.targets)]
        return replace(self, sequence=replace(self.sequence, targets=targets))

    def first(self, seconds: float) -> Person:
        """Return the person with the first labelled seconds alone."""
        end = np.cumsum([min(self.sequence.gaps_s[k], 1.0) for k in self.labelled])
        return self.only([k for k, until in zip(self.labelled, end, strict=True) if until <= seconds + 1e-9])

    @property
    def labelled_s(self) -> float:
        """Labelled time, seconds."""
        return float(sum(min(self.sequence.gaps_s[k], 1.0) for k in self.labelled))


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledRun:
    """One configuration of a run with labels, under all its seeds."""

    experiment: str
    configuration: str
    seeds: int
    people: Sequence[Person]


def read_labelled(directory: RunDirectory, configuration: str | None = None) -> LabelledRun:
    """Read a finished run. Without a name, take its first logit, or else its first configuration.

    Raises
    ------
    VfoaError
        If the run is not finished, has no such configuration, or no labelled frame with a measured direction.
    """
    run = FinishedRun.read(directory)
    known = run.manifest["configurations"]
    bases = list(dict.fromkeys(base_of(name) for name in known))
    logits = [base_of(name) for name, each in known.items() if each.get("attention", {}).get("method") == "logit"]
    chosen = configuration or next(iter((*logits, *bases)))
    if chosen not in bases:
        raise VfoaError(f"{directory.path}: no configuration {chosen!r}; {did_you_mean(chosen, bases)}")
    labels = run.reference().labels
    by_run: dict[tuple[str, str], list[FrameRecord]] = {}
    others: dict[tuple[str, str, int], dict[str, Outcome]] = {}
    for record in run.records():
        base = base_of(record.configuration)
        if record.clip in labels:
            if base == chosen:
                by_run.setdefault((record.clip, record.configuration), []).append(record)
            if base == record.configuration or record.configuration.endswith(".seed1"):
                has_probabilities = known[record.configuration]["attention"]["method"] in PROBABILISTIC
                for name, outcome in _outcomes(record, labels[record.clip], has_probabilities=has_probabilities):
                    others.setdefault((record.clip, name, record.frame), {})[base] = outcome
    seeds = len({name for _, name in by_run})
    people = [
        person
        for (clip, _), records in by_run.items()
        for person in labelled_people(clip, records, labels[clip], others, 1 / seeds)
    ]
    experiment = str(run.manifest.get("experiment", ""))
    if not any(person.labelled for person in people):
        raise VfoaError(f"fit: {experiment}: no labelled frame has measured directions; expected labelled clips")
    return LabelledRun(experiment=experiment, configuration=chosen, seeds=seeds, people=people)


def labelled_people(
    clip: str,
    records: Sequence[FrameRecord],
    labels: Labels,
    others: Mapping[tuple[str, str, int], Mapping[str, Outcome]],
    weight: float,
) -> list[Person]:
    """Return everyone's features and labels in a clip. A frame whose true target has no box counts as unlabelled."""
    settings = LogitSettings(method="logit", weights=shipped_weights())
    traces = Traces()
    rows: dict[str, list[tuple[float, Seen, int | None, Nearest, Mapping[str, Outcome]]]] = {}
    for record in records:
        targets = tuple(to_target(each) for each in record.targets)
        subjects = tuple(to_subject(each) for each in record.subjects)
        attentions, traces = weigh(subjects, targets, traces, settings, record.time_ns)
        seen = {each.subject.track_id: each.belief for each in attentions}
        for name in labels.subjects:
            found = find_subject(record, name)
            if found is None or seen[found.track_id] is None:
                continue
            label = labels.at(record.frame, name)
            right = () if label is None or label.target == IGNORED else right_answers(record, label)
            target = next((each for each in right if each is None or each in seen[found.track_id].ids), UNKNOWN)
            pick = Baselines(record).choose(found)
            answers = dict(others.get((clip, name, record.frame), {}))
            if target != UNKNOWN:
                subject = next(each for each in subjects if each.track_id == found.track_id)
                answers[TWO_CONES] = pay_attention(subject, targets, _CONES).focus in right, math.nan, math.nan
            nearest = Nearest(pick.angle_rad, pick.in_angle in right and pick.in_angle is not None)
            rows.setdefault(name, []).append((record.time_ns / 1e9, seen[found.track_id], target, nearest, answers))
    people = []
    for of_person in rows.values():
        times_s, seen_, targets_, nearest_, answers_ = zip(*of_person, strict=True)
        names = list(dict.fromkeys(name for each in answers_ for name in each))
        missing: Outcome = (False, math.nan, math.nan)
        people.append(
            Person(
                sequence=LabelledSequence(group=clip, times_s=times_s, seen=seen_, targets=targets_, weight=weight),
                nearest=nearest_,
                others={name: [each.get(name, missing) for each in answers_] for name in names},
            )
        )
    return people


def _outcomes(record: FrameRecord, labels: Labels, *, has_probabilities: bool) -> Iterator[tuple[str, Outcome]]:
    """Yield the outcome of the record's own answers, by subject."""
    for _, name, label in labels.labelled([record.frame]):
        found = find_subject(record, name)
        if found is not None and label.target != IGNORED:
            right = right_answers(record, label)
            if not has_probabilities or found.missing is not None:
                yield name, (found.missing is None and found.focus in right, math.nan, math.nan)
                continue
            chance: dict[int | None, float] = {each.instance_id: each.total for each in found.attention}
            chance[None] = max(0.0, 1 - sum(chance.values()))
            yield name, (found.focus in right, chance[found.focus], sum(chance.get(key, 0.0) for key in right))


class Fold(NamedTuple):
    """People, or parts of them, to fit on, and those to score."""

    train: Sequence[Person]
    test: Sequence[Person]


def folds_of(run: LabelledRun, first_s: float | None) -> list[Fold]:
    """Divide a run's people; ``first_s``: fit on the first labelled seconds of one clip only, score on all the rest.

    Raises
    ------
    VfoaError
        If there is one clip, and it is too short for two blocks.
    """
    people = run.people
    clips = list(dict.fromkeys(person.sequence.group for person in people))
    if first_s is not None:
        folds = []
        for clip in clips:
            train = [person.first(first_s) for person in people if person.sequence.group == clip]
            rest = [person for person in people if person.sequence.group != clip]
            if len(clips) == 1:
                rest = [
                    person.only(set(person.labelled) - set(part.labelled))
                    for person, part in zip(people, train, strict=True)
                ]
            folds.append(Fold(train, rest))
        return folds
    if len(clips) > 1:
        return [
            Fold(
                [person for person in people if person.sequence.group != clip],
                [person for person in people if person.sequence.group == clip],
            )
            for clip in clips
        ]
    times = [person.sequence.times_s[k] for person in people for k in person.labelled]
    begin, end = min(times), max(times)
    count = min(int((end - begin) / BLOCK_S), _MOST_BLOCKS)
    if count < 2:
        raise VfoaError(
            f"fit: {run.experiment}: {end - begin:.1f} s are labelled; expected at least {2 * BLOCK_S:g} s, to fit on "
            "one part and score on the other (--even-if-worse writes a file without a score)"
        )
    edges = np.linspace(begin, end + 1e-6, count + 1)
    folds = []
    for low, high in itertools.pairwise(edges):
        inside = [[k for k in each.labelled if low <= each.sequence.times_s[k] < high] for each in people]
        folds.append(
            Fold(
                [each.only(set(each.labelled) - set(ks)) for each, ks in zip(people, inside, strict=True)],
                [each.only(ks) for each, ks in zip(people, inside, strict=True)],
            )
        )
    return folds


def fit_logit(run: LabelledRun, *, first_s: float | None = None, scored: bool = True) -> FittedWeights:
    """Fit the weights on all labels, or on the first seconds of each clip; score fits on what they did not see."""
    people = [person.first(first_s) for person in run.people] if first_s is not None else run.people
    folds = folds_of(run, first_s) if scored else []
    weights = fitted_to(people)
    return FittedWeights(
        fit=FitRecord(
            experiment=run.experiment,
            configuration=run.configuration,
            clips=tuple(dict.fromkeys(str(person.sequence.group) for person in people)),
            people=len(people) // run.seeds,
            labelled_s=round(sum(person.labelled_s for person in people) / run.seeds, 1),
            seeds=run.seeds,
            version=__version__,
            held_out=tuple(_compared(folds)) if scored else (),
            curve=tuple(_curve(folds, run.seeds)) if scored and first_s is None else (),
        ),
        attention=LogitSettings(method="logit", weights=weights),
    )


def fitted_to(
    people: Sequence[Person],
    smoothings: Collection[Smoothing] = SMOOTHINGS,
    answering: Sequence[Person] | None = None,
) -> LogitWeights:
    """Return weights fitted to people; rounded as in the file, so that a file gives the same answers.

    ``answering``: fit only the weights that the frames of these people use.
    """
    cases = ROWS if answering is None else {seen.case for person in answering for seen in person.sequence.seen}
    found = fit([person.sequence for person in people], shipped_weights(), smoothings, sorted(cases))
    return LogitWeights.model_validate(_rounded(found.model_dump()))


def _rounded(value: object) -> object:
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    if isinstance(value, tuple):
        return tuple(_rounded(each) for each in value)
    return round(value, 4) if isinstance(value, float) else value


def _compared(folds: Sequence[Fold]) -> Iterator[MethodScore]:
    """Yield the score of every method on the left-out parts of all folds."""
    found: dict[str, list[Outcome]] = {}
    truths: list[bool] = []
    for train, test in folds:
        limit_rad = _limit(train)
        share = _share_nowhere(train)
        weights = fitted_to(train, answering=test)
        for person in test:
            labelled = person.labelled
            truths += [person.sequence.targets[k] is not None for k in labelled]
            constant = [_constant(person, k, share) for k in labelled]
            nearest = [_within(person, k, limit_rad) for k in labelled]
            by_method: dict[str, Sequence[Outcome]] = {COMMONEST: constant, NEAREST: nearest}
            by_method |= {name: [each[k] for k in labelled] for name, each in person.others.items()}
            for smoothing in SMOOTHINGS:
                for name, each in ((DEFAULT, shipped_weights()), (FITTED, weights)):
                    by_method[f"{name}, {smoothing}"] = answers(person, each, smoothing)
            for name, outcomes in by_method.items():
                found.setdefault(name, []).extend(outcomes)
    for name, outcomes in found.items():
        if len(outcomes) == len(truths):
            yield score(name, outcomes, truths)


def _curve(folds: Sequence[Fold], seeds: int) -> Iterator[MethodScore]:
    """Yield the score of forward fits on a part of the labels: as many seconds, spread over the people."""
    for seconds in CURVE_S:
        outcomes: list[Outcome] = []
        truths: list[bool] = []
        for train, test in folds:
            if sum(person.labelled_s for person in train) < 1.2 * seeds * seconds:
                return
            weights = fitted_to([person.first(seconds * seeds / len(train)) for person in train], SMOOTHINGS[:1], test)
            for person in test:
                outcomes += answers(person, weights, "forward")
                truths += [person.sequence.targets[k] is not None for k in person.labelled]
        yield score(f"{seconds} s", outcomes, truths)


def answers(person: Person, weights: LogitWeights, smoothing: Smoothing) -> list[Outcome]:
    """Return the outcome of the logit in each labelled frame."""
    sequence = person.sequence
    cases = getattr(weights, smoothing)
    later = smoothing == "both"
    after: Sequence[Float | None] = [None] * len(sequence.seen)
    if later:
        after = later_means(sequence.seen, sequence.gaps_s[:-1])
    found = []
    for k in person.labelled:
        seen, target = sequence.seen[k], sequence.targets[k]
        chance = probabilities(features(seen, seen.case, after[k]) @ getattr(cases, seen.case).vector)
        nowhere = float(1 - chance.sum())
        best = int(chance.argmax()) if len(chance) and chance.max() > nowhere else None
        of_best = nowhere if best is None else float(chance[best])
        of_true = nowhere if target is None else float(chance[seen.ids.index(target)])
        found.append(((None if best is None else seen.ids[best]) == target, of_best, of_true))
    return found


def score(name: str, outcomes: Sequence[Outcome], on_target: Sequence[bool]) -> MethodScore:
    """Return the rates of a method. ``on_target`` says which frames have a true target, others are nowhere."""
    right, confidence, of_true = np.array(outcomes, dtype=np.float64).reshape(-1, 3).T
    target = np.array(on_target, dtype=np.bool_)
    recalls = [float(right[part].mean()) if part.any() else None for part in (target, ~target)]
    known = [each for each in recalls if each is not None]
    log_loss = calibration = None
    if np.isfinite(of_true).all() and len(of_true):
        log_loss = round(float(-np.log(np.maximum(of_true, LEAST_PROBABILITY)).mean()), 4)
        frames = np.column_stack([confidence, right, np.zeros(len(right))])
        calibration = round(reliability(name, frames).calibration_error, 4)
    return MethodScore(
        method=name,
        n=len(right),
        log_loss=log_loss,
        calibration_error=calibration,
        balanced_frr=round(sum(known) / len(known), 4) if len(known) == 2 else None,
        frr=round(float(right.mean()), 4),
        recall_on_targets=None if recalls[0] is None else round(recalls[0], 4),
    )


def _limit(people: Sequence[Person]) -> float:
    rows = [(*person.nearest[k], person.sequence.targets[k] is None) for person in people for k in person.labelled] or [
        (math.nan, False, False)
    ]
    angles, hits, nowhere = (np.array(column) for column in zip(*rows, strict=True))
    return best_limit_rad(angles.astype(np.float64), hits.astype(np.bool_), nowhere.astype(np.bool_))


def _within(person: Person, k: int, limit_rad: float) -> Outcome:
    angle_rad, hit = person.nearest[k]
    is_inside = angle_rad <= limit_rad
    return (hit if is_inside else person.sequence.targets[k] is None), math.nan, math.nan


def _share_nowhere(people: Sequence[Person]) -> float:
    """Share of nowhere among the labels, by Laplace's rule."""
    targets = [person.sequence.targets[k] for person in people for k in person.labelled]
    return (sum(each is None for each in targets) + 1) / (len(targets) + 2)


def _constant(person: Person, k: int, share: float) -> Outcome:
    """The outcome of a constant share of nowhere, and equal probabilities of the targets."""
    target, count = person.sequence.targets[k], max(len(person.sequence.seen[k].ids), 1)
    of_each = (1 - share) / count
    says_nowhere = share >= of_each
    is_right = target is None if says_nowhere else person.sequence.seen[k].ids[0] == target
    return is_right, max(share, of_each), share if target is None else of_each
