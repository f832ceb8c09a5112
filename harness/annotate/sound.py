"""The sound of a clip for the page: a WAV file that the browser plays, and its envelope."""

from __future__ import annotations

import tempfile
import threading
import wave
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.sources import AnyClip, SoundClip
from harness.sources.media.sound import SOUND_HZ, sound_of

_BIN_S = 0.02
_MOST_BINS = 20_000


class Sound:
    """The sound of a clip's first video that has any; decoded when it is first requested."""

    def __init__(self, clip: AnyClip) -> None:
        self._files = clip.sound_files if isinstance(clip, SoundClip) else ()
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._lock, self._is_decoded = threading.Lock(), False
        self._about: dict[str, Any] | None = None

    def about(self) -> dict[str, Any] | None:
        """Its duration, and its loudness (0 to 100) per ``bin_s``, as JSON; None for a clip without sound."""
        with self._lock:
            if not self._is_decoded:
                self._decode()
            return self._about

    def wav(self) -> Path | None:
        """The WAV file; None for a clip without sound."""
        if self.about() is None or self._folder is None:
            return None
        return Path(self._folder.name) / "sound.wav"

    def close(self) -> None:
        """Delete the file."""
        if self._folder is not None:
            self._folder.cleanup()

    def _decode(self) -> None:
        found = (samples for path in self._files if (samples := sound_of(path)) is not None)
        samples = next(found, None)
        self._is_decoded = True
        if samples is None or not len(samples):
            return
        self._folder = tempfile.TemporaryDirectory(prefix="vfoa-")
        with wave.open(str(Path(self._folder.name) / "sound.wav"), "wb") as writer:
            writer.setnchannels(1)
            writer.setsampwidth(2)
            writer.setframerate(SOUND_HZ)
            writer.writeframes(samples.astype("<i2").tobytes())
        self._about = _envelope(samples)


def _envelope(samples: NDArray[np.int16]) -> dict[str, Any]:
    seconds = len(samples) / SOUND_HZ
    size = max(round(_BIN_S * SOUND_HZ), -(-len(samples) // _MOST_BINS))
    padded = np.pad(np.abs(samples.astype(np.int32)), (0, -len(samples) % size)).reshape(-1, size)
    return {
        "seconds": seconds,
        "bin_s": size / SOUND_HZ,
        "loudness": (padded.max(axis=1) * 100 // 32768).tolist(),
    }
