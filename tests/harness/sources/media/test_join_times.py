from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from harness.sources.media.frame_times import join_times

STAMPS = st.lists(st.integers(0, 1000), max_size=30).map(sorted)


@given(left=STAMPS, right=STAMPS, tolerance=st.integers(0, 100))
def test_pairs_are_close_in_order_and_use_nothing_twice(left: list[int], right: list[int], tolerance: int) -> None:
    pairs = join_times(left, right, tolerance)
    assert all(abs(left[one] - right[other]) <= tolerance for one, other in pairs)
    for places in zip(*pairs, strict=True):
        assert list(places) == sorted(set(places))


@given(
    numbers=st.sets(st.integers(1, 40), min_size=1),
    dropped=st.sets(st.integers(1, 40)),
    jitter=st.lists(st.integers(-4, 4), min_size=41, max_size=41),
)
def test_every_frame_that_both_sides_have_is_found(numbers: set[int], dropped: set[int], jitter: list[int]) -> None:
    left = [10 * n for n in sorted(numbers)]
    kept = sorted(numbers - dropped)
    pairs = join_times(left, [10 * n + jitter[n] for n in kept], 4)
    assert [left[one] for one, _ in pairs] == [10 * n for n in kept]
