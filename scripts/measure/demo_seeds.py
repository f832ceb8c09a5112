"""How often the demo shows the effects of its factors, over seeds of the errors: ``reports/demo_seeds.md``."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from harness.files.io import atomic_write
from harness.pipeline.cache_store import open_store
from harness.report.factors import compare_factors
from harness.report.formats import Table, to_markdown
from harness.run.executors import cores
from harness.run.experiment import load_experiment
from harness.run.grid import repeated
from harness.run.runner import prepare, run_plan
from harness.score.comparison import Comparison
from harness.score.finished_run import read_scores
from harness.score.score import Scores

PAPER: Mapping[str, float] = {"sgbm against bm": 0.14, "two against one": 0.06}
"""The paper's differences on its 50 frames, of the factors' mean rates, as shares."""


def seeds_table(scores: Scores, seeds: int) -> Table:
    """A row for each factor of the grid: its effect under each seed alone."""
    comparisons: dict[str, list[Comparison]] = {}
    for seed in range(1, seeds + 1):
        of_seed = tuple(
            of_subject for of_subject in scores.judged_subjects if of_subject.configuration.endswith(f".seed{seed}")
        )
        alone = replace(scores, judged_subjects=of_seed)
        frames = {name: alone.frames_of(name) for name in scores.scored_configurations}
        for comparison in chain.from_iterable(compare_factors(frames, scores.factors).values()):
            comparisons.setdefault(f"{comparison.configuration} against {comparison.reference}", []).append(comparison)
    return Table(
        title="The demo's verdict under other seeds of the error",
        columns=(
            *("Effect", "Mean points", "Lowest", "Highest", "Shown", "Shown the other way"),
            *("The paper's points", "Ruled out"),
        ),
        words=1,
        rows=tuple(_row(name, by_seed) for name, by_seed in comparisons.items()),
        notes=(
            f"vfoa demo under {seeds} seeds of the errors of gaze and head, each judged alone: sign flips by clip "
            f"over {next(iter(comparisons.values()))[0].clips} clips, corrected for {len(comparisons)} comparisons. "
            "Shown: seeds under which the effect is significant.",
            "Ruled out: seeds whose interval does not hold the paper's difference or more.",
            "Written by python -m scripts.measure demo_seeds.",
        ),
    )


def _row(name: str, comparisons: list[Comparison]) -> tuple[str, ...]:
    points = np.array([100 * comparison.difference for comparison in comparisons])
    verdicts = [comparison.verdict for comparison in comparisons]
    paper, seeds = PAPER.get(name), len(comparisons)
    ruled_out = [paper is not None and comparison.interval.high < paper for comparison in comparisons]
    return (
        *(name, f"{points.mean():+.1f}", f"{points.min():+.1f}", f"{points.max():+.1f}"),
        *(f"{verdicts.count('better')} of {seeds}", f"{verdicts.count('worse')} of {seeds}"),
        *(("–", "–") if paper is None else (f"{100 * paper:+.0f}", f"{sum(ruled_out)} of {seeds}")),
    )


def main() -> None:
    """Run the demo under all seeds and write the table."""
    parser = argparse.ArgumentParser(description="Measure how often the demo shows the effects of its factors.")
    parser.add_argument("--out", type=Path, default=Path("reports/demo_seeds.md"), help="The Markdown file to write.")
    parser.add_argument("--seeds", type=int, default=20, help="Number of seeds.")
    given = parser.parse_args()
    demo = load_experiment("demo")
    configurations = (
        configuration for base in demo.configurations for configuration in repeated(base, given.seeds, demo.name)
    )
    plan = prepare(replace(demo, configurations=tuple(configurations)))
    with TemporaryDirectory() as folder:
        workers, cache = cores(), open_store(None)
        directory = run_plan(plan, Path(folder) / "run", workers=workers, progress=lambda clip: None, cache=cache)
        atomic_write(given.out, to_markdown(seeds_table(read_scores(directory), given.seeds)))
