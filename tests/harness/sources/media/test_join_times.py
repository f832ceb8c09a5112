from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.sources.media.frame_times import join_times, rate_of, stamp_unit, times_beside

STAMPS = st.lists(st.integers(0, 1000), max_size=30).map(sorted)


@pytest.mark.parametrize("rate_hz", [15.0, 24.0, 29.97, 30.0, 59.94, 90.0, 120.0])
@pytest.mark.parametrize("tick_ns", [1, 1_000_000])
def test_times_rounded_to_milliseconds_have_the_rate_of_the_camera(rate_hz: float, tick_ns: int) -> None:
    """Also where it lost frames."""
    numbers = [number for number in range(900) if number % 100]
    assert rate_of(round(n * 1e9 / rate_hz / tick_ns) * tick_ns for n in numbers) == pytest.approx(rate_hz, rel=2e-4)


def test_the_rate_of_times_that_are_not_rounded_is_of_the_median_step() -> None:
    assert rate_of([0, 40_000_001, 80_000_000, 200_000_000, 240_000_000]) == 25.0
    assert rate_of([0, 40_000_000, 200_000_000]) == 10.0  # no step is near the median of two
    assert rate_of([7]) is None


def test_the_rate_of_pictures_that_are_far_apart_is_not_rounded() -> None:
    """An hour apart, it was 0, which is not known; ten minutes apart, 0.002 Hz."""
    assert rate_of([0, 3600 * 10**9, 7200 * 10**9]) == pytest.approx(1 / 3600)


@given(left=STAMPS, right=STAMPS, tolerance=st.integers(0, 100))
def test_pairs_are_close_in_order_and_use_nothing_twice(left: list[int], right: list[int], tolerance: int) -> None:
    pairs = join_times(left, right, tolerance)
    assert all(abs(left[one] - right[other]) <= tolerance for one, other in pairs)
    for places in zip(*pairs, strict=True):
        assert list(places) == sorted(set(places))


@given(
    numbers=st.sets(st.integers(1, 40), min_size=1),
    dropped=st.tuples(st.sets(st.integers(1, 40)), st.sets(st.integers(1, 40))),
    jitter=st.lists(st.integers(-4, 4), min_size=41, max_size=41),
    tolerance=st.integers(4, 5),
)
def test_every_frame_that_both_sides_have_is_found(
    numbers: set[int], dropped: tuple[set[int], set[int]], jitter: list[int], tolerance: int
) -> None:
    left, right = (sorted(numbers - gone) for gone in dropped)
    pairs = join_times([10 * n for n in left], [10 * n + jitter[n] for n in right], tolerance)
    assert [(left[one], right[other]) for one, other in pairs] == [(n, n) for n in left if n in right]


def test_a_time_without_a_pair_leaves_the_nearer_one_to_its_neighbour() -> None:
    assert join_times([20], [16, 21], 10) == [(0, 1)]
    assert join_times([16, 21], [20], 10) == [(1, 0)]


@pytest.mark.parametrize(
    ("numbers", "unit"),
    [
        ((1718000000, 1718000001), "s"),
        ((1718000000123, 1718000000163), "ms"),
        ((1718000000123456, 1718000000163456), "us"),
        ((1718000000123456789, 1718000000163456789), "ns"),
        ((1500000000, 1500040000), None),  # a camera's microseconds since it was started
        ((3000000000, 3000000001), None),  # of 2065
        ((999999999, 1000000000), None),
        ((1, 2), None),
    ],
)
def test_the_unit_of_times_since_1970_is_told_by_their_digits(numbers: tuple[int, int], unit: str | None) -> None:
    assert stamp_unit(numbers) == unit


@pytest.mark.parametrize("name", ["{:06d}_{}.{:06d}.png", "{:d}-{}.{:06d}_left.png", "{:04d}_{}_{:06d}000.png"])
def test_seconds_beside_the_number_of_a_frame_have_their_decimals(name: str) -> None:
    """Pictures that are seconds apart had the times of whole seconds, others none."""
    for step_us in (1_600_000, 40_000):
        times_us = {number: 1_718_000_000_500_000 + number * step_us for number in (9, 10, 11)}
        files = {number: Path(name.format(number, *divmod(us, 10**6))) for number, us in times_us.items()}
        assert times_beside(files) == {number: 1000 * us for number, us in times_us.items()}
