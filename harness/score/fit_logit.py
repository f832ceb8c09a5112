"""``vfoa fit``: fits the weights of the logit to labels, and scores them on people and times that were left out.

With several clips, each is left out in turn. With one clip, blocks of at least :data:`BLOCK_S` are. An experiment with
``attention.weights = "left-out"`` gets such weights for each clip: see :func:`with_left_out_weights`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from harness.pipeline.configuration import Configuration
from harness.run.directory import RunDirectory
from harness.run.experiment import Experiment, FitRecord, FittedWeights, MethodScore
from harness.run.grid import base_of
from harness.score.baselines import best_limit_rad
from harness.score.calibration import reliability
from harness.score.labelled_run import LabelledRun, Outcome, Person, read_features
from harness.score.metrics import LEAST_PROBABILITY
from vfoa import __version__
from vfoa.errors import VfoaError
from vfoa.logit import LogitSettings, LogitWeights, probabilities, shipped_weights
from vfoa.logit_cues import ROWS, features, later_means
from vfoa.logit_fit import SMOOTHINGS, Smoothing, fit
from vfoa.nearest import NearestSettings
from vfoa.types import Float

BLOCK_S = 10.0
"""Shortest block that is left out of a single clip, seconds: a look must not be on both sides of a border."""
_MOST_BLOCKS = 8
CURVE_S = (20, 60, 120, 240, 480, 960)
"""Labelled seconds at which the learning curve is computed."""
FITTED, DEFAULT = "fitted", "default weights"
COMMONEST, NEAREST = "commonest", "nearest within a limit"


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
    inside = {clip: [person for person in people if person.sequence.group == clip] for clip in clips}
    outside = {clip: [person for person in people if person.sequence.group != clip] for clip in clips}
    if first_s is not None:
        firsts = {clip: [person.first(first_s) for person in inside[clip]] for clip in clips}
        if len(clips) > 1:
            return [Fold(firsts[clip], outside[clip]) for clip in clips]
        (first,) = firsts.values()
        rest = [each.only(set(each.labelled) - set(part.labelled)) for each, part in zip(people, first, strict=True)]
        return [Fold(first, rest)]
    if len(clips) > 1:
        return [Fold(outside[clip], inside[clip]) for clip in clips]
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
        block = [[k for k in each.labelled if low <= each.sequence.times_s[k] < high] for each in people]
        folds.append(
            Fold(
                [each.only(set(each.labelled) - set(ks)) for each, ks in zip(people, block, strict=True)],
                [each.only(ks) for each, ks in zip(people, block, strict=True)],
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
    people: Sequence[Person], smoothings: Collection[Smoothing] = SMOOTHINGS, answering: Sequence[Person] | None = None
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


def with_left_out_weights(experiment: Experiment, run: Callable[[Experiment], RunDirectory]) -> Experiment:
    """Return the experiment with weights wherever a configuration has ``"left-out"``.

    ``run`` runs an experiment: the clips under the stages of these configurations, which give the features. The seeds
    of a configuration are fitted together. A clip without labels gets weights fitted to all clips with labels.

    Raises
    ------
    VfoaError
        If fewer than two clips have labels.
    """
    wanted = {
        each.name: attention
        for each in experiment.configurations
        if isinstance(attention := each.attend.attention, LogitSettings) and attention.weights == "left-out"
    }
    if not wanted:
        return experiment
    used = [each for each in experiment.configurations if each.name in wanted]
    shared: dict[str, str] = {}  # by base name, that of the first configuration with the same stages
    first: dict[str, str] = {}
    for each in used:
        stages = repr({key: value for key, value in each.plain().items() if key != "attention"})
        shared.setdefault(base_of(each.name), first.setdefault(stages, base_of(each.name)))
    plain = tuple(
        _attending(each, NearestSettings(method="nearest")) for each in used if base_of(each.name) in shared.values()
    )
    directory = run(replace(experiment, configurations=plain, notes=(), published=None))
    fitted: dict[str, dict[str, Any]] = {}
    for labelled in read_features(directory, dict.fromkeys(shared.values())):
        people = labelled.people
        clips = list(dict.fromkeys(str(person.sequence.group) for person in people))
        if len(clips) < 2:
            raise VfoaError(
                f'{experiment.name}: attention.weights = "left-out": labels of {", ".join(clips)} alone; expected two '
                "labelled clips or more"
            )
        smoothings = sorted(
            {wanted[each.name].smoothing for each in used if shared[base_of(each.name)] == labelled.configuration}
        )
        fitted[labelled.configuration] = {
            "weights": fitted_to(people, smoothings),
            "by_clip": {
                clip: fitted_to([each for each in people if each.sequence.group != clip], smoothings) for clip in clips
            },
        }
    return replace(
        experiment,
        configurations=tuple(
            _attending(each, wanted[each.name].model_copy(update=fitted[shared[base_of(each.name)]]))
            if each.name in wanted
            else each
            for each in experiment.configurations
        ),
    )


def _attending(configuration: Configuration, attention: NearestSettings | LogitSettings) -> Configuration:
    return replace(configuration, attend=configuration.attend.model_copy(update={"attention": attention}))
