"""An image in a recording, as its camera's driver or SDK wrote it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageMessage:
    """An image as a driver sent it, or a packet of a video.

    ``form`` is the encoding of its pixels or its compression, as ROS and Foxglove name it, ``frame_id`` its coordinate
    frame. ``size_px`` is the (width, height) of raw pixels, in rows of ``step`` bytes; None: compressed. ``is_key`` is
    a packet's own flag for a key frame; None if it has none.
    """

    form: str
    data: bytes
    frame_id: str = ""
    size_px: tuple[int, int] | None = None
    step: int = 0
    is_bigendian: bool = False
    is_key: bool | None = None
