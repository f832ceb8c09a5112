"""Scores from arrays: against scikit-learn, and against values worked out by hand."""

from __future__ import annotations

import math
from dataclasses import astuple
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

import vfoa
from vfoa.errors import VfoaError
from vfoa.scoring import BRIER_WITHOUT_ANSWER, LEAST_PROBABILITY, cohen_kappa, confusion_matrix, macro_f1

NAMES = ("book", "cup", "none")
CHANCES = {"book": [0.25, 0.5, 0.0], "cup": [0.5, 0.5, 0.0], "none": [0.25, 0.0, 1.0]}


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=2, max_size=200))
def test_kappa_and_macro_f1_are_those_of_scikit_learn(pairs: list[tuple[int, int]]) -> None:
    from sklearn.metrics import cohen_kappa_score, f1_score

    truth, predicted = np.array(pairs, dtype=np.intp).T
    confusion = confusion_matrix(truth, predicted, 5)
    labels = np.unique(truth)
    f1 = f1_score(truth, predicted, labels=labels, average="macro", zero_division=0)
    assert macro_f1(confusion) == pytest.approx(f1, abs=1e-12)
    if len({*truth.tolist(), *predicted.tolist()}) > 1:
        assert cohen_kappa(confusion) == pytest.approx(cohen_kappa_score(truth, predicted), abs=1e-12)
    else:
        assert math.isnan(cohen_kappa(confusion))  # 0 / 0: chance alone always agrees


def test_measures_of_nothing_are_unknown() -> None:
    nothing = np.zeros((2, 2), dtype=np.intp)
    assert math.isnan(cohen_kappa(nothing))
    assert math.isnan(macro_f1(nothing))


@given(
    st.lists(
        st.tuples(st.sampled_from(NAMES), st.lists(st.integers(1, 9), min_size=3, max_size=3)), min_size=2, max_size=60
    )
)
def test_scores_of_probabilities_are_those_of_scikit_learn(frames: list[tuple[str, list[int]]]) -> None:
    from sklearn.metrics import brier_score_loss, log_loss

    truth = [name for name, _ in frames]
    weights = np.array([weights for _, weights in frames], dtype=np.float64)
    chances = weights / weights.sum(axis=1, keepdims=True)
    answers = [NAMES[place] for place in chances.argmax(axis=1)]
    scored = vfoa.score(truth, answers, dict(zip(NAMES, chances.T, strict=True)))
    assert scored.log_loss == pytest.approx(log_loss(truth, chances, labels=NAMES), abs=1e-9)
    of_each = [brier_score_loss([name == one for name in truth], chances[:, place]) for place, one in enumerate(NAMES)]
    assert scored.brier == pytest.approx(sum(of_each), abs=1e-9)
    assert scored.frr == pytest.approx(np.mean([one == other for one, other in zip(truth, answers, strict=True)]))


def test_rates_count_targets_and_nowhere_apart() -> None:
    truth = ["cup", "cup", "book", "none", "none", "ignore", None, ""]
    answers = ["cup", "book", None, "none", "cup", "cup", "cup", "cup"]
    scored = vfoa.score(truth, answers)
    assert (scored.n, scored.correct) == (5, 2)
    assert (scored.frr, scored.coverage) == (2 / 5, 4 / 5)
    assert (scored.recall_targets, scored.recall_nowhere) == (1 / 3, 1 / 2)
    assert scored.balanced_frr == pytest.approx((1 / 3 + 1 / 2) / 2)
    assert math.isnan(scored.log_loss)
    assert math.isnan(scored.calibration_error)


@pytest.mark.parametrize("word", ["(nothing hit)", "no_hit"])
def test_nothing_hit_is_right_where_nothing_is_looked_at_and_never_an_answer(word: str) -> None:
    truth, answers = ["none", "none", "cup", "cup"], [word, "none", word, "cup"]
    scored = vfoa.score(truth, answers, {"cup": [0.0, 0.0, 0.0, 1.0]})
    assert (scored.correct, scored.recall_nowhere, scored.coverage) == (3, 1, 2 / 4)
    assert scored.kappa == vfoa.score(truth, ["none", "none", None, "cup"]).kappa
    assert scored.log_loss == pytest.approx(-math.log(LEAST_PROBABILITY) / 2)  # two frames without probabilities
    assert (scored.brier, scored.calibration_error) == (2 * BRIER_WITHOUT_ANSWER / 4, 0)


def test_one_kind_of_label_alone_is_its_balanced_rate() -> None:
    scored = vfoa.score(["cup", "book"], ["cup", "cup"])
    assert scored.balanced_frr == scored.frr == 1 / 2
    assert math.isnan(scored.recall_nowhere)
    assert "nan" not in str(scored)


def test_an_answer_in_whose_frame_all_probabilities_are_empty_is_refused() -> None:
    """They would be those of a sure nowhere."""
    with pytest.raises(VfoaError, match="expected values from 0 to 1, found nan"):
        vfoa.score(["cup", "cup"], ["cup", "cup"], {"cup": [0.9, math.nan], "book": [0.1, math.nan]})


@pytest.mark.parametrize("missing", [None, "", math.nan, np.float64("nan"), pd.NA, pd.NaT])
def test_an_empty_cell_of_a_table_is_no_answer(missing: object) -> None:
    answers = pd.Series(["cup", missing, "book"], dtype=object)
    found, expected = (vfoa.score(["cup", "cup", "book"], given) for given in (answers, ["cup", None, "book"]))
    assert astuple(found) == astuple(expected)


def test_columns_of_every_text_type_of_pandas_are_scored() -> None:
    truth, answers = ["cup", "book", "none"], ["cup", None, "none"]
    for kind in ("object", "string", "category"):
        scored = vfoa.score(pd.Series(truth, dtype=kind), pd.Series(answers, dtype=kind))
        assert astuple(scored) == astuple(vfoa.score(truth, answers))


def test_numbers_of_targets_are_names_of_whatever_type() -> None:
    """An empty cell makes a column of whole numbers one of floats, and HDF5 has bytes."""
    truth = pd.Series([1, 2, 1, 3])
    answers = pd.Series([1, None, 1, 2])
    assert answers.dtype == float
    expected = vfoa.score(["1", "2", "1", "3"], ["1", None, "1", "2"])
    for names in (truth, np.array([b"1", b"2", b"1", b"3"])):
        assert astuple(vfoa.score(names, answers)) == astuple(expected)
    assert expected.correct == 2
    chances = {1: [0.9, 0.5, 0.8, 0.2], 2: [0.1, 0.5, 0.2, 0.8], 3: [0.0] * 4}
    by_name = {str(number): column for number, column in chances.items()}
    named = vfoa.score(["1", "2", "1", "3"], ["1", None, "1", "2"], by_name)
    assert astuple(vfoa.score(truth, answers, chances)) == astuple(named)


def test_a_frame_without_an_answer_has_no_probability_of_the_truth() -> None:
    scored = vfoa.score(["cup", "cup"], ["cup", None], {"cup": [1.0, math.nan]})
    assert scored.log_loss == pytest.approx(-math.log(LEAST_PROBABILITY) / 2)
    assert scored.brier == BRIER_WITHOUT_ANSWER / 2
    assert scored.calibration_error == 0  # of the answers that there are


def test_nowhere_has_what_is_left_of_the_probabilities() -> None:
    truth, answers = ["cup", "book", "none"], ["cup", "cup", "none"]
    left_out = {name: column for name, column in CHANCES.items() if name != "none"}
    assert astuple(vfoa.score(truth, answers, left_out)) == astuple(vfoa.score(truth, answers, CHANCES))


def test_probabilities_are_those_of_tables_with_empty_cells_and_few_digits() -> None:
    truth, answers = ["cup", "book", "none"], ["cup", "cup", "none"]
    table = {"book": [math.nan, 0.333, 0.0], "cup": [0.75, 0.333, math.nan], "none": [0.25, 0.333, 1.0]}
    plain = {name: np.nan_to_num(column) for name, column in table.items()}
    assert vfoa.score(truth, answers, table) == vfoa.score(truth, answers, plain)
    assert vfoa.score(truth, answers, table).log_loss == pytest.approx(-math.log(0.75 * 0.333) / 3)


def test_calibration_is_the_distance_of_confidence_from_the_share_of_right_answers() -> None:
    chances = [0.95, 0.95, 0.95, 0.95, 0.55]  # three of four right at .95, none at .55
    scored = vfoa.score(["cup", "cup", "cup", "none", "none"], ["cup"] * 5, {"cup": chances})
    assert scored.calibration_error == pytest.approx((4 * abs(0.75 - 0.95) + 0.55) / 5)


@pytest.mark.parametrize(
    ("truth", "answers", "probabilities", "message"),
    [
        (["cup"], ["cup", "cup"], None, "answers.*found 2.*expected 1"),
        (["cup", "cup"], [str(None), "cup"], None, "answers.*'None'"),
        (["cup", str(math.nan)], ["cup", str(math.nan)], None, "truth.*'nan'"),
        (["(nothing hit)", "cup"], ["none", "cup"], None, "truth.*'\\(nothing hit\\)'"),
        (["cup", "cup"], ["ignore", "cup"], None, "answers.*'ignore'"),
        (["cup", "cup"], ["no prediction", "cup (another of this name)"], None, "answers.*'cup \\(another"),
        (["ignore", None], ["cup", "cup"], None, "truth.*all 2"),
        (["cup"], np.array([["cup"]]), None, "answers: found ndarray \\(1, 1\\)"),
        (pd.DataFrame({"truth": ["cup"]}), ["cup"], None, "truth: found DataFrame"),
        ({"a": "cup"}, ["cup"], None, "truth: found dict"),
        ({"cup"}, ["cup"], None, "truth: found set"),
        (["cup"] * 3, "cup", None, "answers: found str"),
        (["cup"], ["cup"], {"cup": [0.5, 0.5]}, "'cup'.*\\(2,\\).*\\(1,\\)"),
        (["cup"], ["cup"], {"cup": [1.5]}, "'cup'.*0 to 1.*1.5"),
        (["cup"], ["cup"], {"cup": [math.nan]}, "'cup'.*nan"),
        (["cup"], ["cup"], {"cup": [0.7], "book": [0.7]}, "1.4.*at most 1"),
        (["cup"], ["cup"], {"cup": [0.7], "none": [0.1]}, "0.8.*expected 1"),
        (["cup"], ["book"], {"cup": [0.7]}, "'book'"),
    ],
)
def test_what_cannot_be_scored_is_one_line(
    truth: Any, answers: Any, probabilities: dict[str, list[float]] | None, message: str
) -> None:
    with pytest.raises(VfoaError, match=message):
        vfoa.score(truth, answers, probabilities)
