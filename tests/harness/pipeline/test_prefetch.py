"""Working ahead in threads changes when things are computed, and nothing else."""

from __future__ import annotations

import threading
import time
from collections.abc import Generator
from contextlib import closing

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.pipeline.prefetch import one_at_a_time, prefetch
from harness.sources import Truth
from harness.studio import StudioClip, StudioSettings
from vfoa.errors import VfoaError
from vfoa.types import StereoFrame


def _counting(until: int, begun: list[int] | None = None, fail_at: int | None = None) -> Generator[int]:
    for number in range(until):
        if number == fail_at:
            raise VfoaError(f"frame {number}")
        if begun is not None:
            begun.append(number)
        yield number


@given(count=st.integers(0, 30), depth=st.integers(0, 5))
def test_all_items_come_in_their_order(count: int, depth: int) -> None:
    assert list(prefetch(_counting(count), depth)) == list(range(count))


@given(fail_at=st.integers(0, 9), depth=st.integers(0, 3))
def test_an_error_comes_where_its_item_would_have_come(fail_at: int, depth: int) -> None:
    items = prefetch(_counting(10, fail_at=fail_at), depth)
    assert [next(items) for _ in range(fail_at)] == list(range(fail_at))
    with pytest.raises(VfoaError, match=f"frame {fail_at}"):
        next(items)


def test_a_thread_is_so_far_ahead_and_no_further() -> None:
    begun: list[int] = []
    with closing(prefetch(_counting(100, begun), 2)) as items:
        next(items)
        deadline = time.monotonic() + 10
        while len(begun) < 4 and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(0.05)
        # the one that was taken, two that are ready, and one that waits for a place
        assert begun == [0, 1, 2, 3]


@pytest.mark.parametrize("depth", [0, 1, 3])
def test_whoever_stops_asking_leaves_no_thread_and_no_open_generator(depth: int) -> None:
    ended: list[str] = []

    def source() -> Generator[int]:
        try:
            yield from _counting(1000)
        finally:
            ended.append("source")

    before = threading.active_count()
    with closing(prefetch(prefetch(source(), depth), depth)) as items:
        assert [next(items), next(items)] == [0, 1]
    assert ended == ["source"]
    assert threading.active_count() == before


def test_the_threads_of_a_clip_read_one_at_a_time_and_each_has_its_own_truth() -> None:
    reading: list[str] = []

    class Watched(StudioClip):
        def frame(self, number: int) -> StereoFrame:
            return self._watched(lambda: super(Watched, self).frame(number))

        def truth(self, number: int) -> Truth:
            return self._watched(lambda: super(Watched, self).truth(number))

        def _watched(self, read):  # type: ignore[no-untyped-def]
            assert reading == []
            reading.append("one")
            time.sleep(0.01)
            found = read()
            reading.clear()
            return found

    clip = Watched(StudioSettings(scenario="table", frames=4), None)
    one, other = one_at_a_time(clip)
    truths: list[Truth] = []
    thread = threading.Thread(target=lambda: truths.extend(one.truth(number) for number in one.frames))
    thread.start()
    frames = [other.frame(number) for number in other.frames]
    thread.join()
    assert [frame.index for frame in frames] == [1, 2, 3, 4]
    assert len(truths) == 4
    assert (one.rate_hz, one.notes, one.digest(), one.time_ns(2)) == (
        clip.rate_hz,
        clip.notes,
        clip.digest(),
        clip.time_ns(2),
    )
    assert one is not other
