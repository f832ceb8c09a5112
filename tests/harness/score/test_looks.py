from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.score.looks import LEAST_S, number_looks


def _looks(letters: str, rate: float | None, positions: list[int] | None = None) -> str:
    """The looks of frames that show one letter for each target, as digits."""
    codes = np.array([ord(each) for each in letters], dtype=np.intp)
    places = np.array(positions or range(len(letters)), dtype=np.intp)
    return "".join(map(str, number_looks(codes, places, rate).tolist()))


@pytest.mark.parametrize(
    ("letters", "rate", "looks"),
    [
        ("aabbba", None, "001112"),  # no rate: nothing is joined
        ("aabbba", 1.0, "001111"),  # looks of 2, 3 and 1 s: the last joins the one before
        ("abcdef", 1.0, "001122"),
        ("aaa", 1.0, "000"),
        ("aabb", 100.0, "0000"),  # never lasts long enough: one look
        ("", 1.0, ""),
    ],
)
def test_looks_shorter_than_two_seconds_are_joined(letters: str, rate: float | None, looks: str) -> None:
    assert _looks(letters, rate) == looks


def test_a_gap_ends_a_look_and_sparse_labels_do_not() -> None:
    assert _looks("aaaa", None, [0, 1, 5, 6]) == "0011"
    assert _looks("aaaa", None, [0, 10, 20, 30]) == "0000"
    assert _looks("aabb", 10.0, [0, 10, 20, 30]) == "0011"  # a label stands for a second each


@given(letters=st.text("abc", min_size=1, max_size=80), rate=st.sampled_from([0.5, 1.0, 7.0, 25.0]))
def test_units_are_whole_looks_in_order_and_long_enough(letters: str, rate: float) -> None:
    codes = np.array([ord(each) for each in letters], dtype=np.intp)
    places = np.arange(len(letters), dtype=np.intp)
    units, looks = number_looks(codes, places, rate), number_looks(codes, places, None)
    assert units[0] == 0
    assert set(np.diff(units)) <= {0, 1}
    assert len({*zip(looks.tolist(), units.tolist(), strict=True)}) == looks[-1] + 1
    seconds = np.bincount(units) / rate
    assert len(seconds) == 1 or seconds.min() >= LEAST_S
