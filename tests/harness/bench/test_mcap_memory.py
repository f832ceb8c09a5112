from __future__ import annotations

import pytest

from harness.bench.mcap_memory import measure


def test_four_times_the_frames_take_no_more_memory() -> None:
    # 120 more pairs are 13 MiB of pixels: if they were kept, it would show.
    assert measure(160) == pytest.approx(measure(40), rel=0.1)
