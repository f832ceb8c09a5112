"""The tables and the page of ``vfoa run benchmark``, from the scores of each material."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np

from harness.files.groups import grouped
from harness.files.io import atomic_write
from harness.report.benchmark import MATERIALS
from harness.report.formats import UNKNOWN, Table, number, percent, percent_range, to_csv, to_markdown
from harness.report.page.render import page_of_tables
from harness.report.verdict import verdict_lines
from harness.score.calibration import calibration_errors
from harness.score.score import Scores

RULE = "rule: "
"""How the row of the best simple rule begins."""

_NOTES = (
    "FRR: correct / annotated (frame, subject) pairs. Balanced: mean of the shares of right pairs with a true target "
    "and of those whose label is none. 95 %: as in the report of the material's run.",
    "Log loss and ECE (expected calibration error): of methods that give probabilities; lower is better.",
    "rule: the best simple rule on the same frames that has not seen their labels; see the run's table of baselines.",
    "logit: with the default weights, which are fitted to nothing. logit_fitted: fitted to the material's other clips.",
)


def benchmark_table(scores: Mapping[str, Scores], left_out: Iterable[str]) -> Table:
    """The table of all materials, by their names; ``left_out`` are sentences on what is not in it."""
    return Table.of(
        "Every method on every material",
        "Material | Method | n | Clips | FRR % | 95 % | Balanced % | Log loss | ECE",
        (row for name, of_material in scores.items() for row in _rows(MATERIALS[name].title, of_material)),
        words=2,
        notes=(*_NOTES, *left_out),
    )


@dataclass(frozen=True, slots=True)
class Rates:
    """Log loss and calibration error, NaN without probabilities, and balanced FRR, 0 to 1."""

    log_loss: float
    calibration_error: float
    balanced: float

    @classmethod
    def mean(cls, rates: Iterable[Rates]) -> Rates:
        """The mean of each."""
        return cls(*np.mean([astuple(each) for each in rates], axis=0).tolist())


UNFITTED = ("nearest_15", "two_cones", "posterior", "logit")
"""Methods of the table on settings that nobody labelled: those that use no later frames, and the simplest rule."""


def unlabelled_settings_table(scores: Mapping[str, Scores]) -> Table:
    """The table of methods in settings that nobody labelled: log loss / balanced FRR, the least mean log loss first."""
    of_runs = {name: _of_run(of_material) for name, of_material in scores.items()}
    of_methods = {method: _by_setting(method, of_runs) for method in UNFITTED}
    settings = list(dict.fromkeys(MATERIALS[name].setting for name in scores))
    means = {name: Rates.mean(rates.values()) for name, rates in of_methods.items() if rates}
    ranked = sorted(means, key=lambda name: (math.isnan(means[name].log_loss), means[name].log_loss))
    return Table.of(
        "Methods in settings that nobody labelled",
        " | ".join(["Method", *settings, "Mean log loss", "Mean ECE", "Mean balanced %"]),
        (
            (
                name,
                *(_loss_and_rate(of_methods[name].get(setting)) for setting in settings),
                number(means[name].log_loss, 3),
                number(means[name].calibration_error, 3),
                percent(means[name].balanced),
            )
            for name in ranked
        ),
        words=1,
        notes=(
            "Log loss (of methods that give probabilities) / balanced FRR in %, with earlier frames alone. Settings "
            "weigh the same; of people, heads alone are a half.",
            "Nothing is fitted, but the settings of the posterior, whose answer the logit starts from, were chosen on "
            "the people and the conversation.",
        ),
    )


def _by_setting(method: str, of_runs: Mapping[str, Mapping[str, Rates]]) -> dict[str, Rates]:
    """The rates of a method by setting, without those in which it failed."""
    found = grouped((MATERIALS[name].setting, of_run[method]) for name, of_run in of_runs.items() if method in of_run)
    return {setting: Rates.mean(rates) for setting, rates in found.items()}


def _of_run(scores: Scores) -> dict[str, Rates]:
    """The rates of each method of a run."""
    errors = calibration_errors(scores.judged_subjects)
    return {
        row.configuration: Rates(
            row.metrics["log_loss"], errors.get(row.configuration, math.nan), row.metrics["balanced_frr"]
        )
        for row in scores.rows.overall
    }


def _loss_and_rate(rates: Rates | None) -> str:
    return UNKNOWN if rates is None else f"{number(rates.log_loss, 3)} / {percent(rates.balanced)}"


def benchmark_lines(scores: Mapping[str, Scores], unlabelled_settings: Table) -> list[str]:
    """The answer: the best method where it has seen no label; then that of each material, and if it beats a rule."""
    best = dict(zip(unlabelled_settings.columns, unlabelled_settings.rows[0], strict=True))
    return [
        f"In settings that nobody labelled {best['Method']} is best: mean log loss {best['Mean log loss']}, "
        f"balanced FRR {best['Mean balanced %']} %.",
        *(f"{MATERIALS[name].title}: {' '.join(verdict_lines(own)[:2])}" for name, own in scores.items()),
    ]


def write_benchmark(folder: Path, scores: Mapping[str, Scores], tables: tuple[Table, Table]) -> Path:
    """Write both tables as Markdown, the first one as CSV, and a page; return the page.

    It links the reports of the materials, whose runs are in ``folder``, by name.
    """
    atomic_write(folder / "benchmark.md", "\n".join(map(to_markdown, tables)))
    atomic_write(folder / "benchmark.csv", to_csv(tables[0]))
    methods = {row.configuration for of_material in scores.values() for row in of_material.rows.overall}
    facts = [f"{len(scores)} of {len(MATERIALS)} materials", f"{len(methods)} methods"]
    links = {MATERIALS[name].title: f"{name}/report.html" for name in scores}
    page = folder / "benchmark.html"
    atomic_write(
        page, page_of_tables("Every method on every material", facts, benchmark_lines(scores, tables[1]), tables, links)
    )
    return page


def _rows(title: str, scores: Scores) -> Iterator[tuple[object, ...]]:
    """The rows of a material: the best simple rule, then the methods."""
    errors = calibration_errors(scores.judged_subjects)
    rows = scores.rows.overall
    for row in rows[:1]:
        rule = row.best_baseline
        rates = percent(row.baselines[rule]), UNKNOWN, percent(row.baselines_balanced[rule])
        yield (title, RULE + rule.replace("_", " "), row.n, row.clips, *rates, UNKNOWN, UNKNOWN)
    for row in rows:
        rates = percent(row.frr), percent_range(row.interval), percent(row.metrics["balanced_frr"])
        losses = number(row.metrics["log_loss"], 3), number(errors.get(row.configuration), 3)
        yield (title, row.configuration, row.n, row.clips, *rates, *losses)
