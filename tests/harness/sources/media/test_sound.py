"""The sound of a video, in step with its frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.sources.media.sound import SOUND_HZ, sound_of
from harness.sources.media.video import Video
from tests.beeps import write_beeping_video

FLASHES = [number in (20, 45, 70) for number in range(90)]


@pytest.mark.parametrize("sound_from_s", [0.0, 0.6])
def test_a_beep_is_heard_when_the_frame_of_its_flash_is_shown(tmp_path: Path, sound_from_s: float) -> None:
    path = write_beeping_video(tmp_path / "beeps.mkv", FLASHES, sound_from_s=sound_from_s)
    samples, video = sound_of(path), Video(path)
    assert samples is not None
    bright = [video.read(place).mean() > 128 for place in range(len(FLASHES))]
    assert bright == FLASHES
    loud_s = np.flatnonzero(np.abs(samples) > 2000) / SOUND_HZ
    beeps_s = loud_s[np.diff(loud_s, prepend=-1.0) > 0.3]
    flashes_s = [video.time_ns(place) / 1e9 for place in np.flatnonzero(FLASHES)]
    assert beeps_s == pytest.approx(flashes_s, abs=0.005)


def test_a_video_without_sound_has_none(tmp_path: Path) -> None:
    assert sound_of(write_beeping_video(tmp_path / "mute.mkv", FLASHES, audio=False)) is None
