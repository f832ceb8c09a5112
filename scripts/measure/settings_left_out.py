"""Weights of the logit that were fitted in other settings, beside the default ones and the posterior.

A setting is where people were recorded, or how scenes were made; each is left out of the fit in turn. Reads a finished
``vfoa run benchmark``, and runs drawn scenes with heads alone beside it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from harness.files.io import atomic_write
from harness.report.benchmark import MATERIALS, BenchmarkMaterial, material_experiment
from harness.report.formats import Table, number, percent, to_markdown
from harness.run.directory import RunDirectory
from harness.run.executors import cores
from harness.run.fitted import MethodScore
from harness.run.runner import prepare, run_plan
from harness.score.fit_logit import answers, fitted_to, is_on_target, score
from harness.score.labelled_run import LabelledPerson, read_labelled
from vfoa.logit import default_weights
from vfoa.logit_fit import SMOOTHINGS, Smoothing

HEADS_ALONE = "drawn_heads"
OF_SETTINGS: Mapping[str, BenchmarkMaterial] = {
    **MATERIALS,
    HEADS_ALONE: BenchmarkMaterial(
        title="drawn scenes, heads alone",
        setting=MATERIALS["drawn"].setting,
        experiment=MATERIALS["drawn"].experiment,
        settings=("gaze.model=none",),
    ),
}
"""Those of the benchmark, and one more: with it, both ways to measure drawn scenes count, as they do for people."""

POSTERIOR, DEFAULT, OTHERS = METHODS = ("posterior", "logit", "fitted")
_ROWS_OF_RUN: Mapping[Smoothing, str] = {"forward": "posterior", "both": "posterior_both"}
MOST_CALIBRATION_ERROR = 0.15

People = Mapping[str, Sequence[LabelledPerson]]
"""The labelled people of each material, by its name."""


class Row(NamedTuple):
    """A material under forward or both, and the score of each of :data:`METHODS` on it."""

    material: str
    smoothing: Smoothing
    scores: Mapping[str, MethodScore]

    @property
    def is_calibrated(self) -> bool:
        """Whether the default weights have at most :data:`MOST_CALIBRATION_ERROR`."""
        return _error(self.scores[DEFAULT]) <= MOST_CALIBRATION_ERROR

    def beats(self, *methods: str) -> bool:
        """Whether the default weights are calibrated and have less log loss than each of these methods."""
        return self.is_calibrated and _loss(self.scores[DEFAULT]) < min(_loss(self.scores[name]) for name in methods)


def run_heads_alone(folder: Path) -> None:
    """Run the drawn scenes with heads alone, if their run is not finished."""
    experiment, _ = material_experiment(HEADS_ALONE, OF_SETTINGS[HEADS_ALONE])
    run_plan(prepare(experiment), folder / HEADS_ALONE, workers=cores(), progress=lambda clip: None)


def read_people(folder: Path) -> dict[str, Sequence[LabelledPerson]]:
    """Return the people of the materials whose runs are in the folder. Raises the errors of :func:`read_labelled`."""
    runs = {name: RunDirectory(folder / name) for name in OF_SETTINGS if (folder / name).is_dir()}
    return {name: read_labelled(run, _ROWS_OF_RUN["forward"]).people for name, run in runs.items()}


def measure_settings(people: People) -> Iterator[Row]:
    """Yield the rows of each material, with weights fitted to the people of all settings but its own."""
    for setting in dict.fromkeys(OF_SETTINGS[name].setting for name in people):
        others = {name: of for name, of in people.items() if OF_SETTINGS[name].setting != setting}
        weights = fitted_to(weighing_the_same(others))
        for name in people.keys() - others.keys():
            for smoothing in SMOOTHINGS:
                outcomes = {
                    POSTERIOR: [each.others[_ROWS_OF_RUN[smoothing]][each.labelled] for each in people[name]],
                    DEFAULT: [answers(each, default_weights(), smoothing) for each in people[name]],
                    OTHERS: [answers(each, weights, smoothing) for each in people[name]],
                }
                on_target = np.concatenate([is_on_target(each) for each in people[name]])
                scores = {method: score(method, np.concatenate(of), on_target) for method, of in outcomes.items()}
                yield Row(name, smoothing, scores)


def weighing_the_same(people: People) -> list[LabelledPerson]:
    """Return the people with weights by which all settings count the same, and altogether as much as before."""
    labelled_s: dict[str, float] = {}
    for name, of_material in people.items():
        setting = OF_SETTINGS[name].setting
        labelled_s[setting] = labelled_s.get(setting, 0.0) + sum(each.labelled_s for each in of_material)
    mean_s = sum(labelled_s.values()) / len(labelled_s)
    return [
        replace(each, sequence=replace(each.sequence, weight=mean_s / labelled_s[OF_SETTINGS[name].setting]))
        for name, of_material in people.items()
        for each in of_material
    ]


def settings_table(rows: Sequence[Row]) -> Table:
    """The table of all rows, and their means, of which every setting has the same share."""
    in_order = sorted(rows, key=lambda row: (list(OF_SETTINGS).index(row.material), SMOOTHINGS.index(row.smoothing)))
    titles = {"log loss": _loss, "ECE": _error, "balanced %": _balanced}
    columns = [f"{method} {title}" for title in titles for method in METHODS]
    values = [[value(row.scores[method]) for value in titles.values() for method in METHODS] for row in in_order]
    settings = [OF_SETTINGS[row.material].setting for row in in_order]
    share = np.array([1 / settings.count(setting) for setting in settings])
    means = share @ np.array(values) / share.sum()
    return Table.of(
        "Weights of the logit in settings that they were not fitted in",
        " | ".join(["Material", "Later frames", "n", *columns]),
        (
            *(
                (OF_SETTINGS[row.material].title, row.smoothing, row.scores[DEFAULT].n, *_cells(of_row))
                for row, of_row in zip(in_order, values, strict=True)
            ),
            ("(mean over settings)", "", "", *_cells(means.tolist())),
        ),
        words=2,
        notes=(
            "posterior: no labels. logit: the default weights, fitted to nothing; later frames do not change them. "
            "fitted: weights fitted to the labels of all settings but the row's; in the fit, settings weigh the same.",
            "Later frames: forward: none; both: those of 2 s. People and drawn scenes are one setting each.",
            f"Of {len(rows)} rows the default weights have an ECE (calibration error) of at most "
            f"{MOST_CALIBRATION_ERROR} in {sum(row.is_calibrated for row in rows)}, with less log loss than the "
            f"posterior in {sum(row.beats(POSTERIOR) for row in rows)}, and than both others in "
            f"{sum(row.beats(POSTERIOR, OTHERS) for row in rows)}.",
            "Written by python -m scripts.measure settings_left_out.",
        ),
    )


def _cells(values: Sequence[float]) -> list[str]:
    return [*(number(value, 3) for value in values[:-3]), *(percent(value) for value in values[-3:])]


def _loss(of_method: MethodScore) -> float:
    return np.nan if of_method.log_loss is None else of_method.log_loss


def _error(of_method: MethodScore) -> float:
    return np.nan if of_method.calibration_error is None else of_method.calibration_error


def _balanced(of_method: MethodScore) -> float:
    """The balanced FRR; the FRR where all labels are targets, or none is."""
    return of_method.frr if of_method.balanced_frr is None else of_method.balanced_frr


def main() -> None:
    """Fit with each setting left out, and write the table."""
    parser = argparse.ArgumentParser(description="Measure weights of the logit in settings that were left out.")
    parser.add_argument("runs", type=Path, help="The folder of a finished `vfoa run benchmark`.")
    parser.add_argument("--out", type=Path, default=Path("reports/settings.md"), help="The Markdown file to write.")
    given = parser.parse_args()
    if (given.runs / "drawn").is_dir():
        run_heads_alone(given.runs)
    atomic_write(given.out, to_markdown(settings_table(list(measure_settings(read_people(given.runs))))))


if __name__ == "__main__":
    main()
