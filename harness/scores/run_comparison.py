"""Whole runs compared: every two configurations, or each with the same one of a baseline run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from harness.runs.directory import RunDirectory
from harness.scores.comparison import Comparison, compare
from harness.scores.finished_run import read_scores
from harness.scores.ladder import without_rungs
from harness.scores.score import Scores
from harness.scores.statistics import holm
from vfoa.errors import VfoaError


def compare_runs(runs: Sequence[Path]) -> tuple[Comparison, ...]:
    """Compare every two configurations of several runs on their common frames, named ``run/configuration``.

    Oracle rungs are left out, here and below.

    Raises
    ------
    VfoaError
        If a run cannot be scored, or two runs are the same directory.
    """
    verdicts = {}
    for run in _distinct(runs):
        scores = read_scores(RunDirectory(run))
        verdicts.update({f"{run}/{name}": scores.verdicts_of(name) for name in without_rungs(scores.configurations)})
    return compare(verdicts)


def compare_with_baseline(runs: Sequence[Path], baseline: Path) -> tuple[Comparison, ...]:
    """Compare each configuration of the runs with the baseline's of the same name; Holm over all of these.

    Raises
    ------
    VfoaError
        If a run cannot be scored, has a configuration the baseline has not or none in common with it to score.
    """
    reference = read_scores(RunDirectory(baseline))
    scored = [(run, read_scores(RunDirectory(run))) for run in _distinct([baseline, *runs])[1:]]
    found = [
        _with_same(scores, name, run, reference, baseline)
        for run, scores in scored
        for name in without_rungs(scores.configurations)
    ]
    corrected = holm([each.p for each in found])
    return tuple(replace(each, p_holm=p, family=len(found)) for each, p in zip(found, corrected, strict=True))


def _with_same(scores: Scores, name: str, run: Path, reference: Scores, baseline: Path) -> Comparison:
    if name not in reference.configurations:
        raise VfoaError(
            f"{baseline}: has no configuration {name!r} of {run}; found {', '.join(reference.configurations)}"
        )
    (one,) = compare({f"{baseline}/{name}": reference.verdicts_of(name), f"{run}/{name}": scores.verdicts_of(name)})
    if one.n == 0:
        raise VfoaError(f"{run}: configuration {name!r} has no scored frame in common with {baseline}")
    return one


def _distinct(runs: Sequence[Path]) -> list[Path]:
    places = [run.resolve() for run in runs]
    for run, place in zip(runs, places, strict=True):
        if places.count(place) > 1:
            raise VfoaError(f"{run}: given twice; expected different runs")
    return list(runs)
