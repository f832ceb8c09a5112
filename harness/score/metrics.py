"""Metrics: further columns of ``frr.csv``, one file and one registry line each.

A metric gives one number for each row of the table. Rows are single subjects, whole clips, and all clips together; a
row's *group* holds the frames of every subject that it covers. Another distribution adds a metric through the
entry-point group ``vfoa.metrics``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from harness.score.judged_subjects import JudgedSubject
from harness.score.statistics import Counts
from vfoa.registry import Registry
from vfoa.scoring import LEAST_PROBABILITY, balanced, cohen_kappa, confusion, log_loss, macro_f1, share


class Metric(Protocol):
    """One column of ``frr.csv``. Built as ``Class()``; its registered name is the column's name.

    Attributes
    ----------
    title
        Heading of its column in ``frr.md`` and on the report page.
    meaning
        One sentence that a reader of the table needs.
    """

    title: str
    meaning: str

    def __call__(self, group: Sequence[JudgedSubject]) -> float:
        """The value of one row; NaN if it has none (an empty cell in the table)."""
        ...


class BalancedFRR:
    """Mean of the recall on targets and the recall on nowhere; if only one of the two has frames, that one."""

    title = "Balanced FRR"
    meaning = "Balanced FRR: mean of the next two; always answering one thing gets at most a half."

    def __call__(self, group: Sequence[JudgedSubject]) -> float:
        """The mean of the two recalls, in [0, 1]."""
        return balanced(RecallTargets()(group), RecallNowhere()(group))


class RecallTargets:
    """Share of right frames among those with a true target."""

    title = "Recall, targets"
    meaning = "Recall, targets: share of right pairs among those with a true target."

    def __call__(self, group: Sequence[JudgedSubject]) -> float:
        """The recall, in [0, 1]; NaN if there are no such frames."""
        return _mean([of_subject.correct[~of_subject.nowhere] for of_subject in group])


class RecallNowhere:
    """Share of right frames among those whose label is ``none``."""

    title = "Recall, nowhere"
    meaning = "Recall, nowhere: among those whose label is none (no hit is right there)."

    def __call__(self, group: Sequence[JudgedSubject]) -> float:
        """The recall, in [0, 1]; NaN if there are no such frames."""
        return _mean([of_subject.correct[of_subject.nowhere] for of_subject in group])


class LogLoss:
    """Mean of -ln p, the probability of the true answer, at least :data:`LEAST_PROBABILITY` (Good 1952)."""

    title = "Log loss"
    meaning = (
        f"Log loss: mean of -ln(probability of the true answer), at least {LEAST_PROBABILITY:g}; without an answer, 0. "
        "Lower is better."
    )

    def __call__(self, group: Sequence[JudgedSubject]) -> float:
        """The log loss, nats; NaN for a method without probabilities."""
        return log_loss(np.concatenate([of_subject.on_truth for of_subject in group]))


class Brier:
    """Mean of Brier's score over all answers (Brier 1950)."""

    title = "Brier"
    meaning = "Brier: squared distance of all probabilities from the truth, 0 to 2. Lower is better."

    def __call__(self, group: Sequence[JudgedSubject]) -> float:
        """The score, 0 to 2; NaN for a method without probabilities."""
        return _mean([of_subject.brier for of_subject in group])


class MacroF1:
    """Mean F1 over the labels that occur in the ground truth."""

    title = "Macro F1"
    meaning = "Macro F1: mean over the labels that occur in the truth."

    def __call__(self, group: Sequence[JudgedSubject]) -> float:
        """Macro F1 of a row, in [0, 1]."""
        return macro_f1(confusion_of(group))


class Kappa:
    """Cohen's kappa. "No prediction", and any target that never occurs in the truth, count as answers of their own."""

    title = "Kappa"
    meaning = "Kappa: Cohen's, with no prediction as an answer of its own."

    def __call__(self, group: Sequence[JudgedSubject]) -> float:
        """Kappa of a row, at most 1; NaN if chance alone would always agree."""
        return cohen_kappa(confusion_of(group))


def _mean(values: Sequence[NDArray[Any]]) -> float:
    return share(np.concatenate(values))


def confusion_of(group: Sequence[JudgedSubject]) -> Counts:
    """Counts of truth (rows) by answer, as :func:`vfoa.scoring.confusion`."""
    truth = np.concatenate([of_subject.truth for of_subject in group])
    return confusion(truth, np.concatenate([of_subject.predicted for of_subject in group]))


METRICS = Registry(
    kind="metric",
    builtin={
        "balanced_frr": "harness.score.metrics:BalancedFRR",
        "recall_targets": "harness.score.metrics:RecallTargets",
        "recall_nowhere": "harness.score.metrics:RecallNowhere",
        "log_loss": "harness.score.metrics:LogLoss",
        "brier": "harness.score.metrics:Brier",
        "macro_f1": "harness.score.metrics:MacroF1",
        "kappa": "harness.score.metrics:Kappa",
    },
    group="vfoa.metrics",
)


def load_metrics() -> Mapping[str, Metric]:
    """Load every metric by name: those of this project, then those of other distributions, sorted."""
    return {name: METRICS.load(name)() for name in METRICS.builtin_first()}
