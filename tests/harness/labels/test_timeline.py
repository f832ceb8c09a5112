from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.labels.labels import Timeline, format_seconds, parse_seconds, timeline_of
from harness.sources.sintel import SintelClip, SintelSettings
from tests.disk import sintel_scene

DISTINCT_TIMES = st.lists(st.integers(-(10**18), 10**18), min_size=1, max_size=30, unique=True).map(sorted)


@given(times_ns=DISTINCT_TIMES, data=st.data())
def test_a_range_of_frames_comes_back_from_its_times(times_ns: list[int], data: st.DataObject) -> None:
    timeline = Timeline(frames=[3 * place for place in range(len(times_ns))], times_ns=times_ns)
    first, last = sorted(data.draw(st.tuples(*[st.sampled_from(timeline.frames)] * 2)))
    start_ns, end_ns = timeline.span_ns(first, last)
    assert timeline.between(start_ns, end_ns) == (first, last)
    if last < timeline.frames[-1]:
        assert timeline.span_ns(last + 3, last + 3)[0] == end_ns


@given(time_ns=st.integers(-(10**19) + 1, 10**19 - 1))
def test_seconds_are_exact(time_ns: int) -> None:
    text = format_seconds(time_ns)
    assert parse_seconds(text) == time_ns
    assert float(text) == pytest.approx(time_ns / 1e9)


@pytest.mark.parametrize("text", ["", "1.", ".5", "1e3", "1,5", "nan", " 1", "1.0000000001", "٣"])
def test_what_is_not_decimal_seconds(text: str) -> None:
    assert parse_seconds(text) is None


def test_a_clip_tells_the_times_that_its_frames_have(tmp_path: Path) -> None:
    clip = SintelClip(SintelSettings(scene="alley"), sintel_scene(tmp_path, frames=(1, 4)))
    timeline = timeline_of(clip)
    assert timeline == Timeline(frames=(1, 4), times_ns=[clip.frame(1).time_ns, clip.frame(4).time_ns])


@pytest.mark.parametrize(
    ("times_ns", "step_ns"),
    [
        ([5], 1_000_000_000),
        ([5, 45], 40),
        ([0, 40, 80, 1080], 40),  # a pause does not change the usual step
        ([7, 7, 7], 1),  # a clock that stood: a frame lasts all the same
    ],
)
def test_the_last_frame_lasts_for_the_median_step(times_ns: list[int], step_ns: int) -> None:
    timeline = Timeline(frames=range(1, len(times_ns) + 1), times_ns=times_ns)
    assert timeline.step_ns == step_ns
    assert timeline.span_ns(len(times_ns), len(times_ns))[1] == times_ns[-1] + step_ns


def test_the_last_frame_of_a_part_lasts_until_the_next_one_may_come() -> None:
    part = Timeline(frames=[4, 5, 6], times_ns=[0, 40_000_000, 120_000_000], is_whole=False)
    assert part.span_ns(5, 6) == (40_000_000, 140_000_000)
    assert part.between(40_000_000, 140_000_000) == (5, 6)


@pytest.mark.parametrize(
    ("times_ns", "rounding_ns"), [([0, 40_000_000], 500_000), ([0, 800_000, 1_200_000], 200_000), ([5], 500_000)]
)
def test_a_rounded_time_is_nearer_to_its_own_frame_than_to_the_next(times_ns: list[int], rounding_ns: int) -> None:
    assert Timeline(frames=range(len(times_ns)), times_ns=times_ns).rounding_ns == rounding_ns


@pytest.mark.parametrize(
    ("time_ns", "text"), [(0, "0"), (1, "0.000000001"), (-1, "-0.000000001"), (10 * 10**9, "10"), (-5 * 10**8, "-0.5")]
)
def test_seconds_are_written_in_as_few_digits_as_they_take(time_ns: int, text: str) -> None:
    assert format_seconds(time_ns) == text
