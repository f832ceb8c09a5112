"""Every method on four kinds of material, and in settings that none was fitted in: written to reports/methods.md.

python -m scripts.every_method, after one of the committed reports, or vfoa/logit.toml, was made anew.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from scripts.quoted_figures import ROOT, tables
from vfoa.logit import shipped_fit

REPORTS = {
    "people.md": "people among ten things (eight, each left out)",
    "conversation.md": "a conversation (one clip)",
    "bandage_2.md": "a drawn film (one clip)",
    "drawn.md": "drawn scenes (24 clips)",
}
COLUMNS = ("n", "FRR %", "95 %", "Balanced %", "Targets %", "Nowhere %", "Log loss", "ECE")
INTRODUCTION = """# Methods in settings that nobody labelled

Written by `python -m scripts.every_method` from the reports of the table below and from vfoa/logit.toml: log loss /
balanced FRR in %. The logit has weights that were fitted on the other settings alone (in bandage_2, which is in no
fit, those that ship). Nothing of the other methods is fitted, but the posterior's settings were chosen on the people
and the conversation. Settings weigh the same: people (half heads alone, half gazes of 5, 11 and 20 degrees), a
conversation (heads alone), drawn scenes (gazes), and bandage_2 (learned models; means over the disparities). All with
earlier frames alone. Log loss is of methods that give probabilities, and the least mean decides: the first row is the
default of a clip of one's own.
"""
EVERY = """
# Every method on four kinds of material

From reports/people.md, conversation.md, bandage_2.md and drawn.md, which
say what each row is, on which labels it was fitted, and whether the best simple rule is beaten. Of people who look at
nothing most of the time, always answering none gets the FRR of the share of nothing: read the balanced FRR, the mean
of the shares of right answers where there is a target and where there is none. ECE: expected calibration error.
"""


@dataclass(frozen=True, slots=True)
class Rates:
    """Log loss, calibration error (NaN without probabilities) and balanced FRR, 0 to 1."""

    log_loss: float
    calibration_error: float
    balanced: float


SETTINGS = ("people", "conversation", "drawn scenes", "bandage_2")
LEFT_OUT = {
    "posterior": {
        "people.md": ("heads-posterior", "gaze_5-posterior", "gaze_11-posterior", "gaze_20-posterior"),
        "conversation.md": ("forward",),
        "drawn.md": ("posterior",),
        "bandage_2.md": ("sgbm-bayes", "truth-bayes"),
    },
    "nearest within 15 deg (conversation: 30)": {
        "people.md": ("heads-nearest_15", "gaze_5-nearest_15", "gaze_11-nearest_15", "gaze_20-nearest_15"),
        "conversation.md": ("nearest_30_deg",),
        "drawn.md": ("nearest_15",),
    },
    "two cones": {
        "people.md": ("heads-two_cones", "gaze_5-two_cones", "gaze_11-two_cones", "gaze_20-two_cones"),
        "conversation.md": ("two_cones",),
        "drawn.md": ("two_cones",),
        "bandage_2.md": ("sgbm-two",),
    },
}
"""The rows of each method that was not fitted, by report; of people heads alone come first and weigh half."""


def main() -> None:
    """Write the tables."""
    lines = [INTRODUCTION, *_elsewhere(), EVERY, f"| Material | Configuration | {' | '.join(COLUMNS)} |"]
    lines.append("| --- | --- |" + " ---: |" * len(COLUMNS))
    for report, material in REPORTS.items():
        rows = _rows(report)
        several = any(row["Clip"] == "(all)" for row in rows)
        lines += [
            f"| {material} | {row['Configuration']} | {' | '.join(row[name] for name in COLUMNS)} |"
            for row in rows
            if row["Clip"] == "(all)" or not several
        ]
    (ROOT / "reports" / "methods.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _rows(report: str) -> list[dict[str, str]]:
    """The rows of a report's rates by heading, with the calibration error."""
    found = tables(ROOT / "reports" / report)
    rates = next(each for each in found if each.header[0] == "Clip" and "FRR %" in each.header)
    calibration = next((each for each in found if "ECE" in each.header and each.header[0] == "Configuration"), None)
    errors = {row[0]: row[calibration.header.index("ECE")] for row in calibration.rows} if calibration else {}
    return [dict(zip(rates.header, row, strict=True)) | {"ECE": errors.get(row[1], "–")} for row in rates.rows]


def _elsewhere() -> list[str]:
    """The table over settings in which no weight was fitted: a row for each method, the least mean log loss first."""
    methods = {name: _by_setting(chosen) for name, chosen in LEFT_OUT.items()}
    methods["logit"] = _logit_by_setting()
    ranked = sorted(methods, key=lambda name: (math.isnan(_log_loss(methods[name])), _log_loss(methods[name])))
    lines = [f"| Method | {' | '.join(SETTINGS)} | Mean log loss | Mean ECE | Mean balanced % |"]
    lines.append("| --- |" + " ---: |" * (len(SETTINGS) + 3))
    for name in ranked:
        known = methods[name]
        cells = [
            f"{_number(rates.log_loss)} / {100 * rates.balanced:.1f}" if (rates := known.get(setting)) else "–"
            for setting in SETTINGS
        ]
        error = _mean([rates.calibration_error for rates in known.values()])
        balanced = _mean([rates.balanced for rates in known.values()])
        lines.append(
            f"| {name} | {' | '.join(cells)} | {_number(_log_loss(known))} | {_number(error)} | {100 * balanced:.1f} |"
        )
    return lines


def _by_setting(chosen: dict[str, Sequence[str]]) -> dict[str, Rates]:
    """The rates of these configurations by setting, means over them."""
    found = {}
    for setting, report in zip(SETTINGS, ("people.md", "conversation.md", "drawn.md", "bandage_2.md"), strict=True):
        if report in chosen:
            rows = {
                row["Configuration"]: row for row in _rows(report) if row["Clip"] == "(all)" or report != "people.md"
            }
            rates = [_rates(rows[name]) for name in chosen[report]]
            found[setting] = _halves(rates) if report == "people.md" else _means(rates)
    return found


def _logit_by_setting() -> dict[str, Rates]:
    """The rates of the logit with weights of the other settings, from its file; of bandage_2 with all of them."""
    scores = {row["method"]: row for row in shipped_fit()["held_out"]}

    def of(name: str) -> Rates:
        row = scores[f"{name}, forward"]
        return Rates(row["log_loss"], row["calibration_error"], row["balanced_frr"])

    return {
        "people": _halves([of("people left out, head"), of("people left out, both")]),
        "conversation": of("conversation left out, head"),
        "drawn scenes": of("drawn left out, both"),
        **_by_setting({"bandage_2.md": ("sgbm-logit", "truth-logit")}),
    }


def _rates(row: dict[str, str]) -> Rates:
    return Rates(_value(row["Log loss"]), _value(row["ECE"]), _value(row["Balanced %"]) / 100)


def _value(cell: str) -> float:
    return math.nan if cell == "–" else float(cell)


def _halves(rates: Sequence[Rates]) -> Rates:
    """The mean of the first one and of the mean of the others."""
    return _means([rates[0], _means(rates[1:])])


def _means(rates: Sequence[Rates]) -> Rates:
    return Rates(
        _mean([each.log_loss for each in rates]),
        _mean([each.calibration_error for each in rates]),
        _mean([each.balanced for each in rates]),
    )


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


def _log_loss(known: dict[str, Rates]) -> float:
    return _mean([rates.log_loss for rates in known.values()])


def _number(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.3f}"


if __name__ == "__main__":
    main()
