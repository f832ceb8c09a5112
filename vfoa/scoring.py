"""Scores of answers against labels, from arrays: no clip, no run and no file is needed.

    >>> print(vfoa.score(["cup", "cup", "none", "book"], ["cup", "book", "none", None]))
    2 of 4 right: FRR 50.0 %, balanced 66.7 % (targets 33.3 %, nowhere 100.0 %), answers in 3 of 4

The harness scores a run by the same functions (``frr.csv``), and adds what arrays do not tell: error types, baselines,
and intervals by clips and looks. Frames of one look are right or wrong together, so that
their number alone gives no interval.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfoa.errors import VfoaError
from vfoa.types import Codes, Flags, Float, NoAttention

NOWHERE = "none"
"""The label, and the answer, "looks at none of the targets"."""
IGNORED = "ignore"
"""The label of a frame that does not count."""
NO_HIT = "(nothing hit)"
"""The answer of a frame in which nothing got any attention. It is not the answer "looks at nothing"."""
NO_PREDICTION = "no prediction"
"""The text that people see for a frame without a prediction."""
NO_TRUTH = "not annotated"
"""The text that people see for a frame without a label."""
ANOTHER = "(another of this name)"
"""Appended to a predicted name that equals the true one but belongs to another instance: it must not count as
agreement."""
ALL = "(all)"
"""The clip, or the subject, in a row over all of them."""
OTHER = "(other)"
"""The rarer names of a picture, together."""
_NO_HITS = (NO_HIT, NoAttention.NO_HIT.value)
_NO_NAMES = frozenset({*_NO_HITS, NO_PREDICTION, NO_TRUTH, ANOTHER, ALL, OTHER})
LEAST_PROBABILITY = 0.001
"""Probabilities of the truth below this count as this: without it, one sure and wrong frame would decide a log loss."""
BRIER_WITHOUT_ANSWER = 1.0
"""Brier's score of a frame without an answer: it has no probability anywhere."""
BINS = 10
"""Bins of the expected calibration error."""
_EMPTY_AS_TEXT = frozenset({"None", "nan", "NaN", "NaT", "<NA>"})
"""What empty cells are after ``astype(str)``: as names, those of truth and answers would be equal."""
SUM_TOLERANCE = 1e-3
"""By how much the sum of a frame's probabilities may differ from 1, for tables with few digits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Shares of ``n`` labelled frames; NaN where there is nothing to divide by, or no probabilities were given.

    ``frr`` is the focus recognition rate: the share of right frames; one without an answer is wrong. ``balanced_frr``
    is the mean of the next two, so that always answering one thing gets at most a half. ``recall_targets`` is the
    share of right frames among those with a true target, ``recall_nowhere`` that among those labelled ``none``.
    ``coverage`` is the share of frames with an answer, ``kappa`` Cohen's (1960), ``macro_f1`` the mean F1 over the
    labels that occur. ``log_loss`` (Good 1952; nats), ``brier`` (Brier 1950; 0 to 2) and ``calibration_error`` (Guo et
    al. 2017, ten bins) are those of probabilities: lower is better.
    """

    n: int
    correct: int
    frr: float
    balanced_frr: float
    recall_targets: float
    recall_nowhere: float
    coverage: float
    kappa: float
    macro_f1: float
    log_loss: float = math.nan
    brier: float = math.nan
    calibration_error: float = math.nan

    def __str__(self) -> str:
        percents = (self.frr, self.balanced_frr, self.recall_targets, self.recall_nowhere)
        frr, balanced, targets, nowhere = ("–" if math.isnan(each) else f"{100 * each:.1f} %" for each in percents)
        line = (
            f"{self.correct} of {self.n} right: FRR {frr}, balanced {balanced} (targets {targets}, nowhere {nowhere}), "
            f"answers in {round(self.coverage * self.n)} of {self.n}"
        )
        if math.isnan(self.log_loss):
            return line
        return f"{line}; log loss {self.log_loss:.3f}, calibration error {self.calibration_error:.3f}"


def score(
    truth: Sequence[str | None],
    answers: Sequence[str | None],
    probabilities: Mapping[str, ArrayLike] | None = None,
) -> Score:
    """Score one answer per frame, or per frame and person: as ``vfoa score`` does, from arrays.

    Parameters
    ----------
    truth
        What is looked at in each of the frames: the name of a target, ``"none"`` for none of them. ``"ignore"``, None
        and ``""`` do not count.
    answers
        The answers, in the same order: a name, ``"none"``, or None or ``""`` where there is no answer, which is wrong.
        ``"(nothing hit)"`` and ``"no_hit"``, as tables of a run have them, are right where the label is ``"none"``, and
        no answer. :attr:`vfoa.estimate.Look.answer` is of this form; ``target`` is not: it is None for nothing, too.
    probabilities
        By target, and perhaps for ``"none"``: the probability (n,) in each frame. Without ``"none"``, it has what is
        left up to 1. NaN, an empty cell, is 0 beside others of the frame. Those of frames without an answer are not
        read.

    Raises
    ------
    VfoaError
        If lengths differ, no frame counts, a name is an empty cell made text (``"nan"``) or a word of tables
        (``"no prediction"``), an answer is ``"ignore"``, a probability is not in [0, 1], those of a frame add up to
        more than 1 (or to less, with ``"none"``), or an answer has none.
    """
    labels, predicted = _names(truth, "truth", (IGNORED,)), _names(answers, "answers", _NO_HITS)
    if len(labels) != len(predicted):
        raise VfoaError(f"score: answers: found {len(predicted)}; expected {len(labels)}, one for each label")
    counts = (labels != "") & (labels != IGNORED)
    if not counts.any():
        raise VfoaError(
            f"score: truth: all {len(labels)} labels are empty or {IGNORED!r}; expected targets' names, or {NOWHERE!r}"
        )
    labels, predicted = labels[counts], predicted[counts]
    is_nowhere, is_no_hit = labels == NOWHERE, np.isin(predicted, _NO_HITS)
    predicted = np.where(is_no_hit, np.where(is_nowhere, NOWHERE, ""), predicted)
    correct, is_given = labels == predicted, (predicted != "") & ~is_no_hit
    targets, nowhere = share(correct[~is_nowhere]), share(correct[is_nowhere])
    table = confusion(labels, predicted)
    worth = {} if probabilities is None else _worth(_chances(probabilities, counts), labels, predicted, is_given)
    return Score(
        n=len(labels),
        correct=int(correct.sum()),
        frr=share(correct),
        balanced_frr=balanced(targets, nowhere),
        recall_targets=targets,
        recall_nowhere=nowhere,
        coverage=share(is_given),
        kappa=cohen_kappa(table),
        macro_f1=macro_f1(table),
        **worth,
    )


def _names(values: Iterable[Any], what: str, words: Collection[str]) -> NDArray[np.str_]:
    """The names (n,), ``""`` where there is none: None, or the NaN or NA of a table's empty cell.

    Of the words that cannot be a target's name, only ``words`` and :data:`NOWHERE` are taken.
    """
    if isinstance(values, str | bytes | Mapping | Set) or getattr(values, "ndim", 1) != 1:
        shape = getattr(values, "shape", "")
        raise VfoaError(f"score: {what}: found {type(values).__name__} {shape}; expected a list or one column")
    names = np.array([_name(value) for value in values], dtype=np.str_)
    if found := sorted(_EMPTY_AS_TEXT.intersection(names.tolist())):
        raise VfoaError(
            f"score: {what}: found the text {found[0]!r}, an empty cell made text; expected None or '', or {NOWHERE!r}"
        )
    for name in np.unique(names).tolist():
        if name not in words and (name == IGNORED or is_word_of_tables(name)):
            expected = ", ".join(map(repr, (NOWHERE, *words)))
            raise VfoaError(f"score: {what}: found {name!r}; expected a target's name, {expected}, or None")
    return names


def is_word_of_tables(name: str) -> bool:
    """Whether tables, pages or recordings have this text in the place of a name: no target is called so."""
    return name in _NO_NAMES or name.endswith(f" {ANOTHER}")


def _name(value: Any) -> str:
    if value is None or isinstance(value, str):
        return value or ""
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    is_itself = value == value  # False for NaN, and neither True nor False for the NA of pandas
    if not (isinstance(is_itself, bool | np.bool_) and is_itself):
        return ""
    # an empty cell makes a column of whole numbers one of floats
    return f"{value:.0f}" if isinstance(value, float | np.floating) and value == np.rint(value) else str(value)


def _chances(probabilities: Mapping[str, ArrayLike], counts: Flags) -> dict[str, Float]:
    """The probabilities of the frames that count, by name."""
    chances = {}
    for name, column in probabilities.items():
        values = np.asarray(column, dtype=np.float64)
        if values.shape != counts.shape:
            raise VfoaError(
                f"score: probabilities of {name!r}: found the shape {values.shape}; expected {counts.shape}"
            )
        chances[_name(name)] = values[counts]
    return chances


def _worth(
    chances: dict[str, Float], labels: NDArray[Any], predicted: NDArray[Any], is_given: Flags
) -> dict[str, float]:
    """Log loss, Brier's score and calibration error, by name."""
    names = list(chances)
    values = np.stack([*chances.values()], axis=1) if names else np.zeros((len(labels), 0))
    is_empty = np.isnan(values)
    values = np.where(is_empty & ~is_empty.all(axis=1, keepdims=True), 0, values)
    _check(values[is_given], names)
    if NOWHERE not in chances:
        names.append(NOWHERE)
        values = np.append(values, np.maximum(1 - values.sum(axis=1, keepdims=True), 0), axis=1)
    if unknown := sorted(set(predicted[is_given].tolist()) - set(names)):
        raise VfoaError(f"score: probabilities: no column of the answer {unknown[0]!r}; expected one of each answer")
    columns = np.array(names)
    is_true, is_predicted = columns == labels[:, None], columns == predicted[:, None]
    values = np.where(is_given[:, None], values, 0)
    on_truth = (values * is_true).sum(axis=1)
    brier = (1 - on_truth) ** 2 + ((values * ~is_true) ** 2).sum(axis=1)
    return {
        "log_loss": log_loss(on_truth),
        "brier": share(np.where(is_given, brier, BRIER_WITHOUT_ANSWER)),
        "calibration_error": calibration_error(
            (values * is_predicted).sum(axis=1)[is_given], (is_true & is_predicted).any(axis=1)[is_given]
        ),
    }


def _check(values: Float, names: Sequence[str]) -> None:
    """Refuse what is no probability, and sums that are not 1 (without nowhere: above 1)."""
    ok = (values >= 0) & (values <= 1)
    if not ok.all():
        row, column = np.argwhere(~ok)[0]
        found = values[row, column]
        raise VfoaError(f"score: probabilities of {names[column]!r}: expected values from 0 to 1, found {found:g}")
    sums = values.sum(axis=1)
    wrong = (sums > 1 + SUM_TOLERANCE) | ((sums < 1 - SUM_TOLERANCE) & (NOWHERE in names))
    if wrong.any():
        limit = "1" if NOWHERE in names else f"at most 1 (the rest is that of {NOWHERE!r})"
        raise VfoaError(f"score: probabilities: those of a frame add up to {sums[wrong][0]:.4g}; expected {limit}")


def share(values: NDArray[Any]) -> float:
    """The mean of a column (n,); of none or with a NaN :data:`math.nan` itself, so that tuples of scores are equal."""
    return float(values.mean()) if len(values) and not np.isnan(values).any() else math.nan


def balanced(targets: float, nowhere: float) -> float:
    """The mean of the recalls on targets and on nowhere; if only one of the two has frames, that one."""
    known = [recall for recall in (targets, nowhere) if not math.isnan(recall)]
    return sum(known) / len(known) if known else math.nan


def log_loss(on_truth: Float) -> float:
    """Mean of -ln p, nats (Good 1952): p (n,) is that of the truth, at least :data:`LEAST_PROBABILITY`."""
    return share(-np.log(np.maximum(on_truth, LEAST_PROBABILITY)))


def calibration_error(confidence: Float, right: NDArray[Any]) -> float:
    """The expected calibration error, in [0, 1] (Guo et al. 2017), of :data:`BINS` equal bins; NaN of none.

    ``confidence`` (n,) are the probabilities of the answers, ``right`` (n,) whether they were right.
    """
    return (
        float(np.abs(np.bincount(bins(confidence), right - confidence)).sum() / len(right)) if len(right) else math.nan
    )


def bins(confidence: Float) -> Codes:
    """The bin (n,) of each confidence, from 0 to :data:`BINS` - 1."""
    return np.minimum((confidence * BINS).astype(np.intp), BINS - 1)


def confusion(truth: NDArray[Any], predicted: NDArray[Any]) -> Codes:
    """Counts (L + 1, L + 1) of truth (rows) by answer, over the L labels of the truth, then any other answer or none.

    Answers that never occur in the truth share a column: separating them would change neither kappa nor macro F1.
    """
    labels, true_codes = np.unique(truth, return_inverse=True)
    another = len(labels)
    nearest = np.minimum(np.searchsorted(labels, predicted), another - 1)
    answers = np.where(labels[nearest] == predicted, nearest, another)
    return confusion_matrix(true_codes, answers, another + 1)


def confusion_matrix(truth: Codes, predicted: Codes, categories: int) -> Codes:
    """Counts (categories, categories): rows truth, columns prediction, both coded 0 to categories - 1."""
    return np.bincount(truth * categories + predicted, minlength=categories**2).reshape(categories, categories)


def cohen_kappa(counts: Codes) -> float:
    """Cohen's kappa (Cohen 1960), agreement beyond chance; NaN if chance alone would always agree."""
    n = counts.sum()
    if n == 0:
        return math.nan
    observed = np.trace(counts) / n
    expected = float(counts.sum(axis=0) @ counts.sum(axis=1)) / float(n) ** 2
    return math.nan if expected == 1.0 else float((observed - expected) / (1 - expected))


def macro_f1(counts: Codes) -> float:
    """Mean F1 over the categories that occur in the truth (rows); NaN without ground truth."""
    true, predicted = counts.sum(axis=1), counts.sum(axis=0)
    occurs = true > 0
    if not occurs.any():
        return math.nan
    return float((2 * np.diagonal(counts)[occurs] / (true + predicted)[occurs]).mean())
