"""The sound of a video file, synchronous with its frames."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray

from vfoa.errors import VfoaError

SOUND_HZ = 24_000
_LARGEST_SLIP = SOUND_HZ // 25
"""Rounding of time stamps moves samples by less; a larger step is a gap in the sound."""


def sound_of(path: Path) -> NDArray[np.int16] | None:
    """Return one channel of samples at :data:`SOUND_HZ`, beginning at the video's first frame; None without sound.

    Raises
    ------
    VfoaError
        If the sound cannot be decoded.
    """
    try:
        with av.open(str(path)) as container:
            if not (container.streams.audio and container.streams.video):
                return None
            video, audio = container.streams.video[0], container.streams.audio[0]
            start_s = float((video.start_time or 0) * (video.time_base or 0))
            resampler = av.AudioResampler(format="s16", layout="mono", rate=SOUND_HZ)
            parts: list[tuple[int, NDArray[np.int16]]] = []
            end: int | None = None
            for frame in container.decode(audio):
                at = round((float(frame.time or 0.0) - start_s) * SOUND_HZ)
                if end is None or abs(at - end) > _LARGEST_SLIP:
                    end = at
                for each in resampler.resample(frame):
                    parts.append((end, each.to_ndarray().reshape(-1).astype(np.int16)))
                    end += len(parts[-1][1])
    except (av.FFmpegError, OSError) as error:
        raise VfoaError(f"{path}: its sound cannot be decoded: {error}") from None
    return _joined(parts)


def _joined(parts: list[tuple[int, NDArray[np.int16]]]) -> NDArray[np.int16]:
    """Join parts at their positions, with silence in gaps; anything before the first frame is cut."""
    samples = np.zeros(max((at + len(part) for at, part in parts), default=0), np.int16)
    for at, part in parts:
        kept = part[max(-at, 0) :]
        samples[max(at, 0) : max(at, 0) + len(kept)] = kept
    return samples
