"""The method of a clip of one's own, and what the program quotes of the reports that decide it."""

from __future__ import annotations

import re

from harness.run.experiment import load_experiment
from scripts.quoted_figures import ROOT, Table, tables
from vfoa.bayes import BayesSettings
from vfoa.logit import LogitSettings

METHODS = {"posterior": "bayes", "logit": "logit", "two_cones": "cones", "nearest_15": "nearest"}
POSTERIORS = {
    "people.md": ("heads-posterior", "gaze_5-posterior", "gaze_11-posterior", "gaze_20-posterior"),
    "conversation.md": ("forward",),
    "drawn.md": ("posterior",),
    "bandage_2.md": ("sgbm-bayes", "truth-bayes"),
}
"""Rows of the posterior with the claims of the models, by report."""


def _of_benchmark(title: str) -> Table:
    (table,) = (each for each in tables(ROOT / "reports" / "benchmark.md") if each.title == title)
    return table


def _fits() -> list[dict[str, str]]:
    """The calibration errors of methods beside those of weights that were fitted to a few seconds."""
    return [
        {row[0]: row[each.header.index("ECE")] for row in each.rows}
        for report in ("fit_people_20s.md", "fit_conversation.md")
        for each in tables(ROOT / "reports" / report)[:1]
    ]


def test_the_default_is_the_method_with_the_least_log_loss_in_settings_that_nobody_labelled() -> None:
    table = _of_benchmark("Methods in settings that nobody labelled")
    losses = {METHODS[row[0]]: row[table.header.index("Mean log loss")] for row in table.rows}
    known = {method: float(loss) for method, loss in losses.items() if loss != "–"}
    (default,) = load_experiment("default", clips=("studio_table",)).configurations
    assert default.attend.attention.method == min(known, key=known.__getitem__)


def test_the_logit_quotes_the_calibration_errors_of_its_default_weights() -> None:
    table = _of_benchmark("Every method on every material")
    rows = [dict(zip(table.header, row, strict=True)) for row in table.rows]
    errors = [float(row["ECE"]) for row in rows if row["Method"] == "logit"]
    fits = [float(of[name]) for of in _fits() for name in ("fitted, forward", "default weights, forward")]
    quoted = re.findall(r"0\.\d\d", LogitSettings(method="logit").expectation)
    assert quoted == [f"{error:.2f}" for error in (min(errors), max(errors), *fits)]


def test_the_posterior_quotes_the_calibration_errors_of_the_reports() -> None:
    rows = [
        dict(zip(table.header, row, strict=True))
        for report, names in POSTERIORS.items()
        for table in tables(ROOT / "reports" / report)
        if table.header[0] == "Configuration" and "ECE" in table.header
        for row in table.rows
        if row[0] in names
    ]
    errors = [float(row["ECE"]) for row in rows]
    people, conversation = _fits()
    expected = [
        *(min(errors), max(errors)),
        *(float(people[name]) for name in ("fitted, forward", "gaze_11-posterior")),
        *(float(conversation[name]) for name in ("fitted, forward", "forward")),
    ]
    quoted = re.findall(r"0\.\d\d", BayesSettings(method="bayes").expectation)
    assert quoted == [f"{error:.2f}" for error in expected]
