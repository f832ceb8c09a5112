"""Images as a video stream: AV1, which the viewer and every browser decode by themselves.

The native viewer needs an FFmpeg program for H.264. AV1 by SVT-AV1 is also smaller: 5 kB a frame of 1024 x 436 pixels
where H.264 takes 7 and a JPEG of quality 85 takes 66 (25 frames of ``studio_talk``).
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from vfoa.types import Image

if TYPE_CHECKING:
    import av

LEAST_SIDE_PX = 64
"""The encoder takes no smaller images."""

_QUALITY = 32
"""Constant rate factor, 0 (best) to 63: no artefact is visible at the size of the viewer's panes."""
_PRESET = 10
"""Speed, 0 (slowest) to 13."""


class VideoEncoder:
    """Encodes images of one size, with a key frame at the first and at every ``key_every``-th image.

    The same images give the same bytes: one thread, no frames of the future.
    """

    def __init__(self, width_px: int, height_px: int, key_every: int) -> None:
        import av

        os.environ.setdefault("SVT_LOG", "1")  # the encoder would write its settings to the terminal
        codec: av.VideoCodecContext = av.CodecContext.create("libsvtav1", "w")
        codec.width, codec.height = _even(width_px), _even(height_px)
        codec.pix_fmt = "yuv420p"
        codec.time_base = Fraction(1, 25)  # only the order counts
        codec.gop_size = key_every
        codec.options = {
            "preset": str(_PRESET),
            "crf": str(_QUALITY),
            "svtav1-params": f"pred-struct=1:lp=1:keyint={key_every}:scd=0",
        }
        open_without_real_time(codec)
        self._codec = codec
        self._count = 0

    def encode(self, image: Image) -> Iterator[tuple[int, bytes]]:
        """Take an image; yield what is encoded by now: the position of an image in the stream and its packet."""
        import av

        padded = np.pad(
            image, ((0, image.shape[0] % 2), (0, image.shape[1] % 2), (0, 0)), mode="edge"
        )  # the codec takes even sizes
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(padded), format="rgb24")
        frame.pts = self._count
        self._count += 1
        yield from self._packets(frame)

    def finish(self) -> Iterator[tuple[int, bytes]]:
        """Yield the packets of the images that are not yet encoded."""
        if self._count:
            yield from self._packets(None)

    def _packets(self, frame: av.VideoFrame | None) -> Iterator[tuple[int, bytes]]:
        for packet in self._codec.encode(frame):
            assert packet.pts is not None
            yield packet.pts, bytes(packet)


def open_without_real_time(codec: av.VideoCodecContext) -> None:
    """Open the encoder, and give its threads and this one the scheduling that this one had.

    For root, SVT-AV1 makes them all real-time threads: they, and every process that is started later, would take the
    processor from everything else on the machine.
    """
    if not hasattr(os, "sched_setscheduler"):
        codec.open()
        return
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    codec.open()
    for thread in map(int, os.listdir("/proc/self/task")):
        with contextlib.suppress(ProcessLookupError):
            if os.sched_getscheduler(thread) != policy:
                os.sched_setscheduler(thread, policy, parameters)


def _even(size_px: int) -> int:
    return size_px + size_px % 2
