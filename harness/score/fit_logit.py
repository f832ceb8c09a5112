"""``vfoa fit``: fits the weights of the logit to labels, and scores them on people and times that were left out.

With several clips, each is left out in turn. With one clip, blocks of at least :data:`BLOCK_S` are. An experiment with
``attention.weights = "left-out"`` gets such weights for each clip: see :func:`left_out_weights`.
"""

from __future__ import annotations

import itertools
import json
import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from harness.labels.labels import Labels
from harness.pipeline.configuration import Configuration
from harness.run.columns import Words
from harness.run.directory import Pair
from harness.run.executors import Executor
from harness.run.experiment import Experiment
from harness.run.fitted import FitRecord, FittedWeights, MethodScore
from harness.run.grid import base_of
from harness.run.table_columns import TableFiles, look_columns, scene_columns
from harness.score.baselines import best_limit_rad
from harness.score.labelled_run import (
    LabelledPair,
    LabelledPerson,
    LabelledRun,
    Names,
    ScoredAnswer,
    cases_of,
    labelled_runs,
    truths_of,
)
from vfoa import __version__
from vfoa.errors import VfoaError
from vfoa.logit import LogitSettings, LogitWeights, default_weights, target_probabilities
from vfoa.logit_cues import ROWS, later_means
from vfoa.logit_fit import SMOOTHINGS, Smoothing, fit
from vfoa.methods import likeliest
from vfoa.scoring import calibration_error, log_loss
from vfoa.types import Flags, Float

BLOCK_S = 10.0
"""Shortest block that is left out of a single clip, seconds: a look must not be on both sides of a border."""
_MOST_BLOCKS = 8
CURVE_S = (20, 60, 120, 240, 480, 960)
"""Labelled seconds at which the learning curve is computed."""
FITTED, DEFAULT = "fitted", "default weights"
COMMONEST, NEAREST = "commonest", "nearest within a limit"


class Fold(NamedTuple):
    """People, or parts of them, to fit on, and those to score."""

    train: Sequence[LabelledPerson]
    test: Sequence[LabelledPerson]


class UnscoredError(VfoaError):
    """Nothing is left to score a fit on; it can be made without a score."""


def folds_of(run: LabelledRun, first_s: float | None) -> list[Fold]:
    """Divide a run's people; ``first_s``: fit on the first labelled seconds of one clip only, score on all the rest.

    Raises
    ------
    UnscoredError
        If there is one clip, and it is too short for two blocks, or has no label beyond the first seconds.
    """
    clips = list(dict.fromkeys(person.sequence.group for person in run.people if person.labelled))
    if len(clips) == 1:
        return _blocks(run) if first_s is None else [_first_and_rest(run, first_s)]
    inside = {clip: [person for person in run.people if person.sequence.group == clip] for clip in clips}
    outside = {clip: [person for person in run.people if person.sequence.group != clip] for clip in clips}
    if first_s is None:
        return [Fold(outside[clip], inside[clip]) for clip in clips]
    return [Fold([person.first(first_s) for person in inside[clip]], outside[clip]) for clip in clips]


def _first_and_rest(run: LabelledRun, first_s: float) -> Fold:
    first = [person.first(first_s) for person in run.people]
    rest = [person.without(part.labelled) for person, part in zip(run.people, first, strict=True)]
    if not any(person.labelled for person in rest):
        longest_s = max(person.labelled_s for person in run.people)
        raise UnscoredError(
            f"fit: {run.experiment}: --first {first_s:g}s: each person has at most {longest_s:.1f} labelled seconds; "
            "expected more, to score the fit on the rest: label more, or fit on fewer seconds"
        )
    return Fold(first, rest)


def _blocks(run: LabelledRun) -> list[Fold]:
    """Leave out one block of time after another."""
    times = [person.sequence.times_s[k] for person in run.people for k in person.labelled]
    begin, end = min(times), max(times)
    labelled_s = end - begin + max(max(person.sequence.gaps_s[:1], default=0.0) for person in run.people)
    count = min(int(labelled_s / BLOCK_S + 1e-6), _MOST_BLOCKS)
    if count < 2:
        raise UnscoredError(
            f"fit: {run.experiment}: {labelled_s:.1f} s are labelled; expected at least {2 * BLOCK_S:g} s, to fit on "
            "one part and score on the other"
        )
    folds = []
    for low, high in itertools.pairwise(np.linspace(begin, end + 1e-6, count + 1)):
        inside = [[k for k in person.labelled if low <= person.sequence.times_s[k] < high] for person in run.people]
        parts = list(zip(run.people, inside, strict=True))
        folds.append(Fold([person.without(ks) for person, ks in parts], [person.only(ks) for person, ks in parts]))
    return folds


def fit_logit(run: LabelledRun, *, first_s: float | None = None, scored: bool = True) -> FittedWeights:
    """Fit the weights on all labels, or on the first seconds of each clip; score fits on what they did not see.

    Raises
    ------
    VfoaError
        If the first seconds have no label, or nothing is left to score the fit on (:class:`UnscoredError`).
    """
    people = [person.first(first_s) for person in run.people] if first_s is not None else run.people
    if not any(person.labelled for person in people):
        raise VfoaError(
            f"fit: {run.experiment}: --first {first_s:g}s: shorter than each labelled frame; expected more seconds"
        )
    folds = folds_of(run, first_s) if scored else []
    weights = fitted_to(people)
    clips = tuple(dict.fromkeys(str(person.sequence.group) for person in people))
    return FittedWeights(
        fit=FitRecord(
            experiment=run.experiment,
            configuration=run.configuration,
            clips=clips,
            clips_sha256=tuple(run.clips_sha256.get(clip) or "" for clip in clips),
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
    people: Sequence[LabelledPerson],
    smoothings: Collection[Smoothing] = SMOOTHINGS,
    answering: Sequence[LabelledPerson] | None = None,
) -> LogitWeights:
    """Return weights fitted to people; rounded as in the file, so that a file gives the same answers.

    ``answering``: fit only the weights that the frames of these people use.
    """
    cases = ROWS if answering is None else {seen.case for person in answering for seen in person.sequence.seen}
    weights = fit([person.sequence for person in people], smoothings, sorted(cases))
    rounded = json.loads(weights.model_dump_json(), parse_float=lambda digits: round(float(digits), 4))
    return LogitWeights.model_validate(rounded)


def _compared(folds: Sequence[Fold]) -> Iterator[MethodScore]:
    """Yield the score of every method on the left-out parts of all folds."""
    by_name: dict[str, list[Float]] = {}
    on_target = np.concatenate([is_on_target(person) for fold in folds for person in fold.test])
    for train, test in folds:
        limit_rad, labels = _limit_rad(train), _labels_of(train)
        weights = fitted_to(train, answering=test)
        for person in test:
            by_method = {COMMONEST: _commonest(person, labels), NEAREST: _within(person, limit_rad)}
            by_method |= {name: outcomes_of[person.labelled] for name, outcomes_of in person.others.items()}
            # later frames have no weight in them: both would be the same row
            by_method[f"{DEFAULT}, forward"] = answers(person, default_weights(), "forward")
            for smoothing in SMOOTHINGS:
                by_method[f"{FITTED}, {smoothing}"] = answers(person, weights, smoothing)
            for name, outcomes in by_method.items():
                by_name.setdefault(name, []).append(outcomes)
    for name, parts in by_name.items():
        if len(outcomes := np.concatenate(parts)) == len(on_target):
            yield score(name, outcomes, on_target)


def _curve(folds: Sequence[Fold], seeds: int) -> Iterator[MethodScore]:
    """Yield the score of forward fits on a part of the labels: ``CURVE_S`` seconds, spread over the people."""
    on_target = np.concatenate([is_on_target(person) for fold in folds for person in fold.test])
    for seconds in CURVE_S:
        outcomes: list[Float] = []
        for train, test in folds:
            if sum(person.labelled_s for person in train) < 1.2 * seeds * seconds:
                return
            weights = fitted_to([person.first(seconds * seeds / len(train)) for person in train], SMOOTHINGS[:1], test)
            outcomes += [answers(person, weights, "forward") for person in test]
        yield score(f"{seconds} s", np.concatenate(outcomes), on_target)


def is_on_target(person: LabelledPerson) -> Flags:
    """Return which labelled frames (n,) have a true target; the others are nowhere."""
    return np.array([None not in person.sequence.targets[k] for k in person.labelled], dtype=np.bool_)


def answers(person: LabelledPerson, weights: LogitWeights, smoothing: Smoothing) -> Float:
    """Return the outcome of the logit in each labelled frame: (labelled, 3)."""
    sequence, cases = person.sequence, getattr(weights, smoothing)
    after: Sequence[Float | None] = [None] * len(sequence.seen)
    if smoothing == "both":
        after = later_means(sequence.seen, sequence.gaps_s[:-1])
    outcomes = []
    for k in person.labelled:
        seen = sequence.seen[k]
        chance = target_probabilities(seen, getattr(cases, seen.case), after[k])
        totals, nowhere = dict(zip(seen.ids, chance.tolist(), strict=True)), 1 - float(chance.sum())
        best = next(iter(likeliest(totals, nowhere, person.names[k])), None)
        outcomes.append(_outcome(person, k, best, {None: nowhere} | totals))
    return np.array(outcomes, dtype=np.float64).reshape(-1, 3)


def _outcome(person: LabelledPerson, k: int, best: int | None, chances: Mapping[int | None, float]) -> ScoredAnswer:
    """The outcome of an answer in a frame: all objects of a name are one, but for those that a point tells apart."""
    names, right = person.names[k], person.sequence.targets[k]
    kinds = {each: (_kind(each, names), each in right) for each in chances}
    of_best = sum(chance for each, chance in chances.items() if kinds[each] == kinds[best])
    return best in right, of_best, sum(chances.get(each, 0.0) for each in right)


def score(name: str, outcomes: Float, on_target: Flags) -> MethodScore:
    """Return the rates of a method from its outcomes (n, 3); ``on_target`` (n,) as :func:`is_on_target` gives it."""
    right, confidence, of_true = outcomes.T
    recalls = [float(right[part].mean()) if part.any() else None for part in (on_target, ~on_target)]
    known = [recall for recall in recalls if recall is not None]
    loss = calibration = None
    if np.isfinite(of_true).all() and len(of_true):
        loss = round(log_loss(of_true), 4)
        given = np.isfinite(confidence)  # not where another system has no answer
        calibration = round(calibration_error(confidence[given], right[given]), 4) if given.any() else None
    return MethodScore(
        method=name,
        n=len(right),
        log_loss=loss,
        calibration_error=calibration,
        balanced_frr=round(sum(known) / len(known), 4) if len(known) == 2 else None,
        frr=round(float(right.mean()), 4),
        recall_on_targets=None if recalls[0] is None else round(recalls[0], 4),
    )


def _limit_rad(people: Sequence[LabelledPerson]) -> float:
    angles, hits = np.concatenate([np.zeros((0, 2)), *(person.nearest[person.labelled] for person in people)]).T
    nowhere = np.concatenate([np.zeros(0, dtype=np.bool_), *(~is_on_target(person) for person in people)])
    return best_limit_rad(angles, hits.astype(np.bool_), nowhere)


def _within(person: LabelledPerson, limit_rad: float) -> Float:
    """The outcomes of the nearest target within a limit, or nowhere."""
    angles, hits = person.nearest[person.labelled].T
    right = np.where(angles <= limit_rad, hits, ~is_on_target(person))
    return np.column_stack([right, np.full((len(right), 2), math.nan)])


_Labels = Counter[str | int | None]
"""The number of labelled frames of each name, None for nowhere."""


def _labels_of(people: Sequence[LabelledPerson]) -> _Labels:
    first = [(person.names[k], person.sequence.targets[k][0]) for person in people for k in person.labelled]
    return Counter(_kind(target, names) for names, target in first)


def _kind(target: int | None, names: Names) -> int | str | None:
    """What a target counts as: its name, or itself without one; None: nowhere."""
    return None if target is None else names.get(target, target)


def _commonest(person: LabelledPerson, labels: _Labels) -> Float:
    """The outcomes of the commonest of the labels, of those that a frame has.

    Its probabilities are the share of nowhere and, of the rest, that of each name, by Laplace's rule.
    """
    nowhere = (labels[None] + 1) / (labels.total() + 2)
    outcomes = []
    for k in person.labelled:
        names = {number: person.names[k].get(number, number) for number in person.sequence.seen[k].ids}
        objects, of_targets = Counter(names.values()), sum(labels[name] + 1 for name in {*names.values()})
        shares = {name: (1 - nowhere) * (labels[name] + 1) / of_targets for name in objects}
        chances: dict[int | None, float] = {None: nowhere}
        chances |= {number: shares[name] / objects[name] for number, name in names.items()}
        best = max(chances, key=lambda answer: nowhere if answer is None else shares[names[answer]])
        outcomes.append(_outcome(person, k, best, chances))
    return np.array(outcomes, dtype=np.float64).reshape(-1, 3)


def check_left_out(experiment: str, clips: Sequence[str]) -> None:
    """Refuse to fit weights for each labelled clip on the others if there are none."""
    if len(clips) < 2:
        raise VfoaError(
            f'{experiment}: attention.weights = "left-out": found labels of {", ".join(clips) or "no clip"} alone; '
            "expected two labelled clips or more"
        )


def left_out_weights(
    experiment: Experiment,
    tables: Mapping[Pair, Mapping[str, Path]],
    labels: Mapping[str, Labels],
    executor: Executor,
) -> dict[str, LogitSettings]:
    """Return the settings of each configuration whose weights are ``"left-out"``, with weights.

    The seeds of a configuration are fitted together. A clip without labels gets weights fitted to all others.

    Parameters
    ----------
    tables
        The scene and directions of each (clip, configuration), which give the features
        (:func:`harness.run.table_files.find_tables`).
    labels
        Those of each clip that has some, in the order of the experiment.
    executor
        Its workers read the features.

    Raises
    ------
    VfoaError
        If fewer than two clips have labels.
    """
    unfitted = [each for each in experiment.configurations if each.attend.attention.is_unfitted]
    shared = _first_with_the_stages(unfitted)
    read = [each for each in unfitted if base_of(each.name) in shared.values()]
    fitted: dict[str, dict[str, Any]] = {}
    pairs = [
        _labelled_pair(clip, each, tables[clip, each.name], labels[clip])
        for clip in labels
        for each in read
        if (clip, each.name) in tables
    ]
    for labelled in labelled_runs(experiment.name, pairs, dict.fromkeys(shared.values()), executor):
        users = [each for each in unfitted if shared[base_of(each.name)] == labelled.configuration]
        smoothings = sorted({_logit(each).smoothing for each in users})
        fitted[labelled.configuration] = _left_out_weights(labelled.people, smoothings, experiment.name)
    return {each.name: _logit(each).model_copy(update=fitted[shared[base_of(each.name)]]) for each in unfitted}


def _logit(configuration: Configuration) -> LogitSettings:
    return cast("LogitSettings", configuration.attend.attention)


def _labelled_pair(clip: str, configuration: Configuration, paths: Mapping[str, Path], labels: Labels) -> LabelledPair:
    """The pair of a clip that is perceived: cases are fitted of which it has some frames, and to all of its frames."""
    tables, words = TableFiles(paths), Words()
    scene = scene_columns(tables, words, {})
    looks = look_columns(scene, tables, words)
    cases = cases_of(looks)
    return LabelledPair(
        clip=clip,
        configuration=configuration.name,
        tables=paths,
        settings=configuration.attending(LogitSettings(method="logit")).attend,
        truths=truths_of(scene, looks, labels, words),
        alone=sorted(cases - {"both"}) if "both" in cases else (),
    )


def _first_with_the_stages(configurations: Iterable[Configuration]) -> dict[str, str]:
    """By base name: the base name of the first configuration with the same stages."""
    shared: dict[str, str] = {}
    first: dict[str, str] = {}
    for configuration in configurations:
        stages = repr({key: value for key, value in configuration.plain().items() if key != "attention"})
        base = base_of(configuration.name)
        shared.setdefault(base, first.setdefault(stages, base))
    return shared


def _left_out_weights(
    people: Sequence[LabelledPerson], smoothings: Collection[Smoothing], experiment: str
) -> dict[str, Any]:
    """The settings with weights fitted to all people, and for each clip to the people of the others."""
    clips = list(dict.fromkeys(str(person.sequence.group) for person in people))
    check_left_out(experiment, clips)
    others = {clip: [person for person in people if person.sequence.group != clip] for clip in clips}
    by_clip = {clip: fitted_to(of_others, smoothings) for clip, of_others in others.items()}
    return {"weights": fitted_to(people, smoothings), "by_clip": by_clip}
