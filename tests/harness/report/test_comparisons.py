from __future__ import annotations

import pytest

from harness.report.comparisons import terminal_comparisons
from harness.score.comparison import Comparison
from harness.score.statistics import Interval


def _pair(configuration: str, reference: str, *, better: int = 0, worse: int = 0, p: float = 1.0) -> Comparison:
    return Comparison(
        reference=reference,
        configuration=configuration,
        n=40,
        looks=8,
        clips=2,
        better=better,
        worse=worse,
        difference=(better - worse) / 40,
        interval=Interval(low=-0.1, high=0.1, unit="look"),
        unit="look",
        p=p,
        p_holm=p,
        family=1,
        detectable=0.1,
    )


@pytest.mark.parametrize(
    ("names", "shown"),
    [
        (("runs/demo/bm", "runs/demo/sgbm"), ("bm", "sgbm")),
        (("runs/demo-2/bm", "runs/demo/bm"), ("demo-2/bm", "demo/bm")),
        (("/far/run/bm", "near/bm"), ("/far/run/bm", "near/bm")),
        (("bm", "bm-2"), ("bm", "bm-2")),
    ],
)
def test_only_folders_that_all_names_share_are_left_out(names: tuple[str, str], shown: tuple[str, str]) -> None:
    assert terminal_comparisons([_pair(*names)]).rows[0][:2] == shown


def test_what_is_significant_says_in_which_direction() -> None:
    pairs = [
        _pair("a", "b", better=9, worse=0, p=0.004),
        _pair("a", "c", better=0, worse=9, p=0.004),
        _pair("a", "d", better=2, worse=1, p=1.0),
    ]
    assert [row[2] for row in terminal_comparisons(pairs).rows] == ["better", "worse", "not told apart"]
