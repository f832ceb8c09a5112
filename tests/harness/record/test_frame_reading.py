"""One frame of a recording as arrays, from video and from pictures."""

from __future__ import annotations

import numpy as np
import pytest

from harness.record.composed import find_clips
from harness.record.frame_reading import read_frame
from tests.harness.record.conftest import ANN, CONFIGURATION
from vfoa.errors import VfoaError


@pytest.mark.parametrize("jpeg", [False, True])
def test_a_frame_is_read_back(record_run, frames, jpeg):
    recorded = record_run(frames, jpeg=jpeg)
    (clip,) = find_clips(recorded.run, None, None)
    for frame in frames:
        content = read_frame(clip, CONFIGURATION, ANN, frame.record.frame)
        assert content.image is not None
        assert content.image.shape == frame.frame.left.shape
        others = [np.abs(content.image.astype(float) - other.frame.left).mean() for other in frames]
        assert int(np.argmin(others)) == frames.index(frame)  # lossy, and still the right one
        assert sorted(content.clouds) == [target.instance.id for target in frame.result.scene.targets]
        assert content.masks is not None
        assert content.masks.shape == (64, 96, 4)
        assert content.masks[30, 70, 3] > 0  # the book, in every frame
        assert content.masks[0, 0, 3] == 0
    at_start = read_frame(clip, CONFIGURATION, ANN, 10)
    assert {cue: len(lines) for cue, lines in at_start.cones.items()} == {"gaze": 2, "head": 2}
    assert read_frame(clip, CONFIGURATION, ANN, 13).cones == {}  # nobody is there


def test_a_damaged_layer_is_one_line(record_run, frames):
    recorded = record_run(frames)
    (clip,) = find_clips(recorded.run, None, None)
    recorded.files.images.write_bytes(b"RRF2" + b"x" * 50)
    with pytest.raises(VfoaError, match=r"clip\.rrd: .*damaged"):
        read_frame(clip, CONFIGURATION, ANN, 10)
