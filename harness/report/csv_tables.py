"""The tables for programs, and the meaning of their columns: ``frr.csv`` and ``comparisons.csv``."""

from __future__ import annotations

import math
from collections.abc import Mapping

from harness.report.formats import Table, csv_share
from harness.score.baselines import BASELINES
from harness.score.metrics import load_metrics
from harness.score.rows import ScoreRow
from harness.score.score import Scores
from harness.score.verdicts import ERROR_TYPES
from vfoa.errors import VfoaError
from vfoa.scoring import ALL

COMPARISON_COLUMNS: Mapping[str, str] = {
    "reference": "the configuration that is compared with",
    "configuration": "the configuration",
    "n": "frames that both were scored on",
    "looks": "looks of these frames, joined as the test joins them",
    "clips": "clips of these frames",
    "better": "frames right under the configuration and wrong under the reference",
    "worse": "frames wrong under the configuration and right under the reference",
    "difference": "difference of the rates, in [-1, 1]",
    "difference_low": "95 % interval of the difference, corrected as p_holm is, lower end; missing if not known",
    "difference_high": "upper end",
    "unit": "what interval and test take as independent: clip (clips like these) or look (these clips only)",
    "p": "exact sign-flip test over these units, two-sided",
    "p_holm": "p corrected for all comparisons of the table (Holm)",
    "detectable": "true difference that would be significant, corrected, with 80 % power; inf: none can be",
    "sentence": "the comparison in words",
}
"""Column of ``comparisons.csv`` to its meaning. A row is a pair of configurations."""


_OF_FILES = {
    f"error_type_{name}": f"wrong frames because {ERROR_TYPES[name]}; only in runs with attention.method = answers"
    for name in ("no_answer", "no_object")
}
"""The columns of ``frr.csv`` that only runs with another system's answers have."""


def frr_columns() -> Mapping[str, str]:
    """Column of ``frr.csv`` to its meaning, in their order.

    A row is one subject, one clip, or all of them, under one configuration. "Frame" means a labelled (frame, subject)
    pair that is not ``ignore``.

    Raises
    ------
    VfoaError
        If a metric has the name of another column.
    """
    columns = {
        "clip": "clip; (all): all clips together, longer ones weigh more",
        "subject": "subject; (all): all subjects together",
        "configuration": "configuration",
        "n": "frames scored",
        "looks": "looks scored: longest runs of one true target of a subject; short ones are joined with the next",
        "clips": "clips of these frames",
        "correct": "frames that are right: with the right answer, or with no hit where the label is none",
        "wrong": "the other frames: n - correct",
        "predicted": "frames with an answer",
        "no_hit": "frames without an answer because nothing got any attention",
        "frr": "focus recognition rate: correct / n, in [0, 1]",
        "interval_low": "95 % interval of frr, lower end; missing where it is not known",
        "interval_high": "upper end",
        "interval_unit": "what the intervals take as independent: clip (clips like these) or look (these clips only)",
        "balanced_low": "95 % interval of balanced_frr, lower end; missing if few units have a target, or few none",
        "balanced_high": "upper end",
        "wilson_low": "Wilson's 95 % interval of frr, lower end, if frames were independent; they are not",
        "wilson_high": "upper end",
        "coverage": "predicted / n, in [0, 1]",
        "frr_predicted": "share of right ones of the predicted frames, without no hit, in [0, 1]; missing without any",
        "n_visible": "frames whose line of sight no label calls blocked",
        "frr_visible": "frr of those frames",
        "none_true": "frames whose label is none; missing, as the next four, of methods that cannot answer none",
        "none_said": "frames in which the answer is that nothing is looked at",
        "none_right": "frames that are in both",
        "none_precision": "none_right / none_said",
        "none_recall": "none_right / none_true",
        "true_events": "looks in the ground truth: longest runs of one label",
        "found_events": "looks in the answers",
        "matched_events": "pairs of a true and a found look with one label that overlap",
        "event_recall": "matched_events / true_events",
        "event_precision": "matched_events / found_events",
        "event_f": "harmonic mean of the two",
        **{f"baseline_{name}": f"frr of the baseline rule {name!r} on the same frames" for name in BASELINES},
        "beats_baselines": "whether frr is above that of the best baseline: yes (significantly), not shown, or no",
        **{f"error_type_{name}": f"wrong frames because {why}" for name, why in ERROR_TYPES.items()},
        **_OF_FILES,
        "unknown_names": "names in the results that the clip's manifest does not know: such an answer counts as wrong",
    }
    metrics = {name: metric.meaning for name, metric in load_metrics().items()}
    if taken := sorted(columns.keys() & metrics.keys()):
        raise VfoaError(f"metric {taken[0]!r}: frr.csv already has a column of that name; expected another name")
    return columns | metrics


def scores_table(scores: Scores) -> Table:
    """Every measure of every row, for programs: shares with six decimals, unknown values empty.

    Raises
    ------
    VfoaError
        If a metric has the name of an existing column.
    """
    rows = ((*_score_cells(row, scores), *map(csv_share, row.metrics.values())) for row in scores.rows)
    table = Table(title="Scores", columns=tuple(frr_columns()), words=3, rows=tuple(rows))
    left_out = () if scores.has_answers_of_file else tuple(_OF_FILES)
    return table.only([column for column in table.columns if column not in left_out])


def _score_cells(row: ScoreRow, scores: Scores) -> tuple[str, ...]:
    events, matches, nowhere = row.events, row.nowhere, [""] * 5
    if matches:
        nowhere = [*map(str, matches), csv_share(matches.precision), csv_share(matches.recall)]
    return (
        *(row.clip or ALL, row.subject or ALL, row.configuration),
        *map(str, (row.n, row.looks, row.clips, row.correct, row.n - row.correct, row.predicted, row.no_hit)),
        *map(csv_share, (row.frr, row.interval.low, row.interval.high)),
        "" if math.isnan(row.interval.low) else row.interval.unit,
        *map(csv_share, (row.balanced_interval.low, row.balanced_interval.high)),
        *map(csv_share, (row.wilson.low, row.wilson.high, row.coverage, row.frr_predicted)),
        *(str(row.visible), csv_share(row.frr_visible)),
        *nowhere,
        *map(str, events),
        *map(csv_share, events.rates),
        *(csv_share(row.baselines[name]) for name in BASELINES),
        row.beats,
        *(str(row.error_types[error_type]) for error_type in ERROR_TYPES),
        _unknown_names(row, scores),
    )


def _unknown_names(row: ScoreRow, scores: Scores) -> str:
    clips = scores.unknown_names if row.clip is None else (row.clip,)
    return " ".join(dict.fromkeys(name for clip in clips for name in scores.unknown_names.get(clip, ())))
