from __future__ import annotations

import pytest

from harness.bench.depth_memory import Form, measure_depth_memory


@pytest.mark.parametrize("form", ["db3", "mcap, H.264"])
def test_ten_times_the_frames_take_no_more_memory(form: Form) -> None:
    # 900 more frames are 27 MiB of pixels and depth: if they were kept, it would show.
    found = measure_depth_memory(form, 100, 1000)
    assert found.long_mib <= 1.1 * found.short_mib
