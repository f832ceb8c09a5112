from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from harness.run.warm_up import LONGEST_STRETCH, stretches


@given(frames=st.lists(st.integers(), unique=True, max_size=600), workers=st.integers(2, 9))
def test_stretches_hold_every_frame_once_and_in_order_and_grow_no_longer(frames: list[int], workers: int) -> None:
    cut = list(stretches(frames, workers))
    assert [frame for stretch in cut for frame in stretch] == frames
    lengths = [len(stretch) for stretch in cut]
    assert lengths == sorted(lengths, reverse=True)
    assert max(lengths, default=0) <= LONGEST_STRETCH
    assert set(lengths[-workers:]) <= {1}
