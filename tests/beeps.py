"""A video that flashes and beeps at the same times."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

SOUND_HZ = 48_000
BEEP_S = 0.1


def write_beeping_video(
    path: Path, flashes: Sequence[bool], *, rate_hz: int = 25, sound_from_s: float = 0.0, audio: bool = True
) -> Path:
    """Frames of 64 x 48 pixels, white where they flash and black elsewhere, and a beep from the start of each flash.

    ``sound_from_s``: the file holds no sound before.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        video = container.add_stream("ffv1", rate=rate_hz)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        sound = container.add_stream("pcm_s16le", rate=SOUND_HZ, layout="mono") if audio else None
        for number, flash in enumerate(flashes):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 255 * flash, np.uint8), format="rgb24")
            frame.pts, frame.time_base = number, Fraction(1, rate_hz)
            container.mux(video.encode(frame))
        container.mux(video.encode())
        for at in range(round(sound_from_s * rate_hz), len(flashes)) if sound is not None else ():
            times_s = at / rate_hz + np.arange(SOUND_HZ // rate_hz) / SOUND_HZ
            starts_s = [each / rate_hz for each, flash in enumerate(flashes) if flash]
            beeps = np.any([(times_s >= start) & (times_s < start + BEEP_S) for start in starts_s], axis=0)
            wave = (20_000 * np.sin(2 * np.pi * 1000 * times_s) * beeps).astype(np.int16)
            chunk = av.AudioFrame.from_ndarray(wave[None], format="s16", layout="mono")
            chunk.sample_rate, chunk.time_base = SOUND_HZ, Fraction(1, SOUND_HZ)
            chunk.pts = round(at / rate_hz * SOUND_HZ)
            container.mux(sound.encode(chunk))
        if sound is not None:
            container.mux(sound.encode())
    return path
