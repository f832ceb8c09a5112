"""Results of ``vfoa fit``, as tables and as the file that a run reads."""

from __future__ import annotations

from harness.report.formats import UNKNOWN, Table
from harness.run.fitted_settings import FittedSettings
from harness.toml_text import toml_key, toml_value


def fit_tables(fitted: FittedSettings) -> list[Table]:
    """The fitted values with their intervals, and every clip under settings fitted on the others."""
    return [
        Table(
            title=f"Fitted on {', '.join(fitted.fit.clips)}",
            columns=("Value", "Estimate", "95 % interval", "n"),
            words=1,
            rows=tuple(
                (
                    each.name,
                    f"{each.value:.3g}",
                    UNKNOWN if each.low is None or each.high is None else f"{each.low:.3g} to {each.high:.3g}",
                    str(each.n),
                )
                for each in fitted.fit.value
            ),
            notes=("Intervals: delete-one jackknife over clips; unknown with one clip.",),
        ),
        Table(
            title="Each clip with settings fitted on the others",
            columns=("Clip", "n", "Right % before", "after", "ECE before", "after"),
            words=1,
            rows=tuple(
                (
                    each.clip,
                    str(each.n),
                    f"{100 * each.right_before:.1f}",
                    f"{100 * each.right_after:.1f}",
                    f"{each.calibration_error_before:.3f}",
                    f"{each.calibration_error_after:.3f}",
                )
                for each in fitted.fit.held_out
            ),
            notes=("Before: the settings of the run. Forward smoothing. ECE: expected calibration error.",),
        ),
    ]


def fitted_text(fitted: FittedSettings) -> str:
    """The file, as :func:`harness.run.fitted_settings.read_fitted` reads it."""
    plain = fitted.model_dump(mode="json", exclude_none=True)
    fit = plain["fit"]
    lines = ["# Written by vfoa fit. Use it as a preset: vfoa run EXPERIMENT --preset THIS_FILE", "[fit]"]
    lines += [f"{key} = {toml_value(fit[key])}" for key in ("experiment", "clips")]
    for table in ("value", "held_out"):
        for row in fit[table]:
            lines += ["", f"[[fit.{table}]]", *(f"{toml_key(key)} = {toml_value(value)}" for key, value in row.items())]
    lines += ["", "[attention]", *(f"{key} = {toml_value(value)}" for key, value in plain["attention"].items())]
    return "\n".join(lines) + "\n"
