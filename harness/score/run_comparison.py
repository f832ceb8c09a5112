"""Comparisons of whole runs: every two configurations, or each with the same one of a baseline run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from harness.run.directory import RunDirectory
from harness.score.comparison import Comparison, compare, with_holm
from harness.score.finished_run import read_scores
from harness.score.oracle_ablation import without_oracles
from harness.score.score import Scores
from vfoa.errors import VfoaError


def compare_runs(runs: Sequence[Path]) -> tuple[Comparison, ...]:
    """Compare every two configurations of several runs on their common frames, named ``run/configuration``.

    The oracle ablation is left out, here and below.

    Raises
    ------
    VfoaError
        If a run cannot be scored, two runs are the same directory, or their labels differ.
    """
    found = {}
    for run in _distinct(runs):
        scored = read_scores(RunDirectory(run))
        found.update({f"{run}/{name}": scored.frames_of(name) for name in _compared(scored)})
    return compare(found)


def compare_with_baseline(runs: Sequence[Path], baseline: Path) -> tuple[Comparison, ...]:
    """Compare each configuration of the runs with the baseline's of the same name; Holm over all of these.

    Raises
    ------
    VfoaError
        If a run cannot be scored, has a configuration that the baseline lacks, or has none in common with it to score.
    """
    reference = read_scores(RunDirectory(baseline))
    scored = [(run, read_scores(RunDirectory(run))) for run in _distinct([baseline, *runs])[1:]]
    return with_holm(
        [_with_same(one, name, run, reference, baseline) for run, one in scored for name in _compared(one)]
    )


def _compared(scored: Scores) -> list[str]:
    return without_oracles(scored.scored_configurations)


def _with_same(scored: Scores, name: str, run: Path, reference: Scores, baseline: Path) -> Comparison:
    known = reference.scored_configurations
    if name not in known:
        raise VfoaError(f"{baseline}: has no configuration {name!r} of {run}; found {', '.join(known)}")
    (one,) = compare({f"{baseline}/{name}": reference.frames_of(name), f"{run}/{name}": scored.frames_of(name)})
    if one.n == 0:
        raise VfoaError(f"{run}: configuration {name!r} has no scored frame in common with {baseline}")
    return one


def _distinct(runs: Sequence[Path]) -> list[Path]:
    places = [run.resolve() for run in runs]
    for run, place in zip(runs, places, strict=True):
        if places.count(place) > 1:
            raise VfoaError(f"{run}: given twice; expected different runs")
    return list(runs)
