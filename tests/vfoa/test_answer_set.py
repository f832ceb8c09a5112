from __future__ import annotations

import pytest

from tests.scenes import make_subject
from vfoa.answer_set import smallest_set
from vfoa.types import Attention, NoAttention, TargetAttention


def attention(*totals: float) -> Attention:
    values = tuple(
        TargetAttention(instance_id=number, gaze=total, head=0.0, total=total) for number, total in enumerate(totals, 1)
    )
    return Attention(subject=make_subject(), values=values)


@pytest.mark.parametrize(
    ("totals", "probability", "expected"),
    [
        ((0.95, 0.03), 0.9, (1,)),
        ((0.5, 0.4), 0.9, (1, 2)),
        ((0.1, 0.2), 0.9, (None, 2)),
        ((0.3, 0.3), 0.5, (None, 1)),
        ((), 0.9, (None,)),
        ((0.25, 0.25, 0.25, 0.25), 1.0, (1, 2, 3, 4)),
    ],
)
def test_the_fewest_that_reach_the_probability(totals: tuple[float, ...], probability: float, expected: object) -> None:
    assert smallest_set(attention(*totals), probability) == expected


def test_who_has_no_attention_has_no_answer() -> None:
    assert smallest_set(Attention(subject=make_subject(), missing=NoAttention.NO_DIRECTION)) == ()
