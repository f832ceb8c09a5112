"""A film file: its packets, and its pictures in order, from the start or from a key frame. FFmpeg decodes (PyAV).

OpenCV's reader is not used: of interlaced pictures it silently returns what was in memory before (OpenCV 5.0), the last
pictures of MPEG have no time there, and it has no decoder of AV1.
"""

from __future__ import annotations

import re
from collections.abc import Generator, Iterator
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from harness.files.io import check_fetched
from harness.files.safe_names import shell_command
from harness.sources.media.images import MOST_PIXELS, too_many_pixels
from vfoa.errors import VfoaError
from vfoa.types import Image

DECODING = {"max_pixels": str(MOST_PIXELS), "flags": "+unaligned"}
"""Options of every decoder of video: the size of pictures is limited (a packet of 100 kB can claim gigabytes), and they
are cropped at the left as they say; FFmpeg keeps columns there by default, so that its rows in memory are aligned."""

_END = re.compile(r"(\d{1,6}):(\d\d):(\d\d(?:\.\d{1,12})?)")
"""The end of a stream, from 0 on, as FFmpeg notes it in Matroska, whose duration is that of the longest stream."""


def open_film(path: Path) -> Any:
    """The container of a film for reading, as PyAV has it; tags may be of any coding, as always from PyAV 19 on."""
    import av

    of_tags: dict[str, Any] = {"metadata_errors": "replace"} if int(av.__version__.partition(".")[0]) < 19 else {}
    return av.open(f"file:{path}", **of_tags)


class RgbConverter:
    """Makes RGB of decoded pictures; FFmpeg's tables are kept from one to the next."""

    def __init__(self) -> None:
        from av.video.reformatter import VideoReformatter

        self._reformatter = VideoReformatter()

    def __call__(self, picture: Any) -> Image:
        """The pixels of a picture of PyAV, (H, W, 3) uint8 RGB."""
        return np.asarray(self._reformatter.reformat(picture, format="rgb24").to_ndarray(), dtype=np.uint8)


class Film:
    """The pictures of an open film. A damaged packet gives none. ``rgb`` makes pixels of them.

    Raises
    ------
    VfoaError
        If the file is missing, is not a video, or its pictures are too large.
    """

    def __init__(self, path: Path) -> None:
        self._container = _opened(path)
        self._stream = self._container.streams.video[0]
        context = self._stream.codec_context
        if context.width * context.height > MOST_PIXELS:
            raise VfoaError(f"{path}: {too_many_pixels(context.width, context.height)}")
        context.options = DECODING
        self._stream.thread_type = "AUTO"
        self._pictures = self._decoded(is_begun=True)
        self.rgb = RgbConverter()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._pictures.close()
        self._container.close()

    @property
    def tick_ns(self) -> Fraction:
        """The unit of time stamps."""
        return Fraction(self._stream.time_base) * 10**9

    @property
    def stated_hz(self) -> float | None:
        """The rate that the container states; None if it does not."""
        return float(self._stream.guessed_rate) if self._stream.guessed_rate else None

    @property
    def stated_frames(self) -> int:
        """The number of frames that the container states, or that fill their duration; 0 if neither is known."""
        return int(self._stream.frames or self._stated_s * Fraction(self._stream.guessed_rate or 0) + Fraction(1, 2))

    @property
    def _stated_s(self) -> Fraction:
        """How long the pictures last as the container says: they may begin after the sound, and end before it."""
        tick_s = Fraction(self._stream.time_base)
        if self._stream.duration:
            return self._stream.duration * tick_s
        begin_s, end_s = (self._stream.start_time or 0) * tick_s, Fraction(self._container.duration or 0, 10**6)
        if tag := _END.fullmatch(self._stream.metadata.get("DURATION", "")):
            hours, minutes, seconds = map(Fraction, tag.groups())
            end_s = 3600 * hours + 60 * minutes + seconds
        if not re.search("matroska|flv", self._container.format.name):
            begin_s -= Fraction(self._container.start_time or 0, 10**6)
        return max(end_s - begin_s, Fraction(0))

    @property
    def reorders(self) -> bool:
        """Whether pictures may be shown in another order than that of their packets."""
        return bool(self._stream.codec_context.has_b_frames)

    @property
    def pixel_aspect(self) -> Fraction:
        """The width of a pixel over its height."""
        return Fraction(self._stream.sample_aspect_ratio or 1)

    def packet_stamps(self) -> list[int | None]:
        """The time stamps of all packets of pictures in the order of the file; None where there is none."""
        return [packet.pts for packet in self._packets()]

    def pictures(self) -> Iterator[Any]:
        """The pictures that follow, as PyAV has them."""
        return self._pictures

    def next_picture(self) -> Any | None:
        """The picture that follows; None at the end."""
        return next(self._pictures, None)

    def last_picture(self, stamp: int) -> Any | None:
        """The last picture of the film, decoded from a time stamp on; None if no key frame is there."""
        last = self.seek(stamp)
        for picture in self._pictures:
            last = picture
        return last

    def seek(self, stamp: int | None) -> Any | None:
        """Go to a key frame at or before a time stamp, if the file has an order to search in; its picture follows."""
        if not self._goes_to(stamp):
            return None
        self._pictures = self._decoded(is_begun=False)
        return self.next_picture()

    def decodes_alone(self, stamp: int | None) -> bool:
        """Whether the key frame at or before a time stamp, or the one after, gives a picture without its successors."""
        self._stream.codec_context.thread_type = "NONE"
        if not self._goes_to(stamp):
            return False
        key = next((packet for packet in self._packets() if packet.is_keyframe), None)
        return key is None or bool([*self._given(key), *self._given(None)])

    def _goes_to(self, stamp: int | None) -> bool:
        """Whether the container could go to a time stamp."""
        import av

        if stamp is None:
            return False
        try:
            self._container.seek(stamp, stream=self._stream)
        except av.FFmpegError:
            return False
        return True

    def _decoded(self, *, is_begun: bool) -> Generator[Any]:
        """The pictures from the present packet on; if decoding has not begun, from the first key frame on."""
        for packet in self._packets():
            is_begun = is_begun or packet.is_keyframe
            if not is_begun:
                continue
            yield from self._given(packet)
        yield from self._given(None)  # those that wait for the end

    def _given(self, packet: Any) -> list[Any]:
        """The pictures that the decoder gives for a packet; none of a damaged one."""
        import av

        try:
            return list(self._stream.codec_context.decode(packet))
        except av.FFmpegError:
            return []

    def _packets(self) -> Iterator[Any]:
        """The packets from the present one on, up to the end or to where the file is cut off."""
        import av

        try:
            for packet in self._container.demux(self._stream):
                if packet.size:
                    yield packet
        except av.FFmpegError:
            return


def _opened(path: Path) -> Any:
    """The container of a film whose pictures can be decoded; raises as :class:`Film`."""
    import av

    if not path.is_file():
        raise VfoaError(f"{path}: no such file")
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise VfoaError(f"{path}: its name is not UTF-8, which FFmpeg cannot open; rename it") from None
    try:
        container = open_film(path)
        stream = container.streams.video[0]
    except (av.FFmpegError, OSError, ValueError, IndexError):
        check_fetched(path)
        raise VfoaError(f"{path}: not a readable video; expected a file that FFmpeg opens") from None
    if stream.codec_context is None:
        film = shell_command("ffmpeg", "-i", path, "-c:v", "libx264", "-crf", "15", Path(f"{path.stem}_h264.mp4"))
        raise VfoaError(f"{path}: found a video codec that vfoa cannot decode; expected H.264, for example: `{film}`")
    return container


_BT_601, _LIMITED = 6, 1
"""FFmpeg's numbers of a matrix and a range (AVCOL_SPC_SMPTE170M, AVCOL_RANGE_MPEG)."""


def state_colours(coder: Any) -> None:
    """Let a film state how FFmpeg has made YUV of its RGB: by BT.601.

    Of a film that does not, players and Rerun's viewer take BT.709, and show a green of 254 as 215.
    """
    coder.colorspace, coder.color_range = _BT_601, _LIMITED


def container_tags(path: Path) -> dict[str, str]:
    """The tags of a film as a whole; none of a file that is no film."""
    import av

    try:
        with open_film(path) as container:
            return dict(container.metadata)
    except (av.FFmpegError, OSError):
        return {}


def first_picture_s(path: Path) -> float:
    """The time at which a player shows a video's first picture, seconds.

    Its zero is that of the container: in MPEG-4 and Matroska files the zero of the time stamps, in others, whose stamps
    begin anywhere, the first picture or sound.

    Raises
    ------
    VfoaError
        If the file is not a video.
    """
    import av

    with _opened(path) as container:
        stream = container.streams.video[0]
        begins_s = float((stream.start_time or 0) * (stream.time_base or 0))
        is_at_zero = any(name in container.format.name for name in ("mp4", "matroska"))
        zero_s = 0.0 if is_at_zero else (container.start_time or 0) / av.time_base
    return max(begins_s - zero_s, 0.0)
