"""Meaning of each column of a run's tables, for programs, notebooks and the documentation."""

from __future__ import annotations

from collections.abc import Mapping

from harness.score.baselines import BASELINES
from harness.score.metrics import load_metrics
from harness.score.verdicts import ERROR_TYPES
from vfoa.errors import VfoaError


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
        "correct": "frames with the right answer",
        "wrong": "frames with a wrong answer or none",
        "predicted": "frames with an answer",
        "no_hit": "frames in which nothing got any attention",
        "frr": "focus recognition rate: correct / n, in [0, 1]",
        "interval_low": "95 % interval of frr, lower end; missing where it is not known",
        "interval_high": "upper end",
        "interval_unit": "what the interval takes as independent: clip (clips like these) or look (these clips only)",
        "wilson_low": "Wilson's 95 % interval of frr, lower end, if frames were independent; they are not",
        "wilson_high": "upper end",
        "coverage": "predicted / n, in [0, 1]",
        "frr_predicted": "correct / predicted, in [0, 1]; NaN without a prediction",
        "n_visible": "frames whose line of sight no label calls blocked",
        "frr_visible": "frr of those frames",
        "none_true": "frames whose label is none",
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
        "unknown_names": "names in the results that the clip's manifest does not know: such an answer counts as wrong",
    }
    metrics = {name: metric.meaning for name, metric in load_metrics().items()}
    if taken := sorted(columns.keys() & metrics.keys()):
        raise VfoaError(f"metric {taken[0]!r}: frr.csv already has a column of that name; expected another name")
    return columns | metrics


FRAMES_COLUMNS: Mapping[str, str] = {
    "clip": "clip",
    "configuration": "configuration",
    "frame": "the source's own frame number",
    "time_s": "time of the frame on the source's clock, s; NaN for a frame without a record",
    "subject": "subject's name; missing for a person the manifest does not know",
    "track": "number of the person's track; missing where nobody was tracked",
    "target": "name of one target; missing where the subject has no attention values",
    "instance": "the target's instance number in the frame's masks",
    "gaze": "the gaze's part of the attention, in [0, 1]; NaN where gaze was not measured",
    "head": "the head's part of the attention, in [0, 1]; NaN where head pose was not measured",
    "total": "attention of the subject to the target, in [0, 1]",
    "focus": "1 for the target with the most attention, else 0",
    "set_90": "1 for the targets of the smallest set with 90 % of the probability, else 0; NaN without probabilities",
    "truth": "label of the frame; missing where there is none",
    "predicted": "answer of the configuration; missing without one",
    "outcome": "correct, wrong or unscored; missing for a person without a name",
    "error_type": "why a wrong frame is wrong, one of the names in frr.csv",
}
"""Column of ``frames.csv`` to its meaning. A row is one target of one subject in one frame of one configuration."""

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
