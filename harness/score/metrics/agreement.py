"""Agreement of answers with the ground truth, beyond the share of correct frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.score.outcomes import Outcomes
from harness.score.statistics import Counts, cohen_kappa, confusion_matrix, macro_f1


class MacroF1:
    """Mean F1 over the labels that occur in the ground truth."""

    title = "Macro F1"
    meaning = "Macro F1: mean over the labels that occur in the truth."

    def __call__(self, group: Sequence[Outcomes]) -> float:
        """Macro F1 of a row, in [0, 1]."""
        return macro_f1(confusion(group))


class Kappa:
    """Cohen's kappa. "No prediction", and any target that is never the truth, are answers of their own."""

    title = "Kappa"
    meaning = "Kappa: Cohen's, with no prediction as an answer of its own."

    def __call__(self, group: Sequence[Outcomes]) -> float:
        """Kappa of a row, at most 1; NaN where chance alone would always agree."""
        return cohen_kappa(confusion(group))


def confusion(group: Sequence[Outcomes]) -> Counts:
    """Counts (L + 1, L + 1) of truth (rows) by answer, over the L labels of the truth, then any other answer or none.

    Answers that are never the truth share a column: telling them apart would change neither kappa nor macro F1.
    """
    truth, predicted = (np.concatenate([getattr(each, name) for each in group]) for name in ("truth", "predicted"))
    labels, true_codes = np.unique(truth, return_inverse=True)
    another = len(labels)
    nearest = np.minimum(np.searchsorted(labels, predicted), another - 1)
    answers = np.where(labels[nearest] == predicted, nearest, another)
    return confusion_matrix(true_codes, answers, another + 1)
