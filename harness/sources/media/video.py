"""Frames of a video file, exact in any order: frames are identified by their time stamps; seeking is verified."""

from __future__ import annotations

import os
import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from harness.files.digests import settled_stamp
from harness.files.io import check_fetched
from harness.sources import check_number
from harness.sources.media.images import MOST_PIXELS, too_many_pixels
from vfoa.errors import VfoaError
from vfoa.types import Image

# FFmpeg writes to the terminal; our own errors describe what is wrong with a file. Read when the first video is opened.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
import cv2

_RAW_SUFFIXES = frozenset({".h264", ".264", ".h265", ".265", ".hevc", ".mjpeg", ".mjpg"})
"""Of streams as an encoder gives them (Raspberry Pi), which hold no times."""
_JPEG = b"\xff\xd8\xff"
VIDEO_SUFFIXES = _RAW_SUFFIXES | {
    *(".mp4", ".avi", ".mkv", ".mov", ".m4v", ".webm", ".mpg", ".mpeg", ".wmv", ".asf", ".flv", ".3gp", ".mxf"),
    *(".ts", ".mts", ".m2ts"),  # .mts: AVCHD, of camcorders
    *(".vob", ".mod", ".m2v", ".3g2", ".qt", ".ogv", ".y4m", ".divx"),
}

STEP = 32
"""Most frames ahead that are decoded one by one; beyond that, seek."""

RATE_TOLERANCE = 0.01
"""A stated rate is used if it is this near to the mean of the times, which some containers round to ms."""


_SQUARE_TOLERANCE = 0.01
"""Pixels are square if their sides differ by less."""


@dataclass(frozen=True, slots=True)
class Turn:
    """How a player shows pictures: mirrored left to right, then turned to the right by ``quarters`` of a turn."""

    quarters: int = 0
    is_mirrored: bool = False

    @property
    def matrix(self) -> tuple[int, int, int, int]:
        """Signs of (a, b, c, d): a pixel (p, q) is shown at (a p + c q, b p + d q), x to the right and y down."""
        cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[self.quarters]
        x = -1 if self.is_mirrored else 1
        return x * cos, x * sin, -sin, cos

    def apply(self, image: Image) -> Image:
        """Turn and mirror an image (H, W, 3)."""
        if self == UPRIGHT:
            return image
        mirrored = image[:, ::-1] if self.is_mirrored else image
        return np.ascontiguousarray(np.rot90(mirrored, -self.quarters))

    def __str__(self) -> str:
        turned = [f"rotated by {90 * self.quarters} degrees"] if self.quarters else []
        return " and ".join((["mirrored"] if self.is_mirrored else []) + turned)


UPRIGHT = Turn()


class Video:
    """A video's frames by their position, from 0. Reading in order decodes each once. It can be pickled.

    Frames are counted by the packets, or by decoding if these are not conclusive. ``times_ns`` is each frame's time
    since the first one; a frame whose time is not after that of the frame before, such as the last one of an MPEG film,
    is one step after it. ``rate_hz`` is the stated rate if the times agree, else their mean rate: phones film with
    varying steps. Pictures are turned and mirrored as the file says, as players do. ``notes``: whether they are, which
    frames have no time, and whether the container states another number of frames (FFmpeg's estimate from a duration
    that the frames fill does not count).

    Raises
    ------
    VfoaError
        If the file is missing, is not a video, or has no frame.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        stamp = settled_stamp([("", str(path))])
        index = _indexed(path) if stamp is None else _kept(path, stamp)
        self.frames, self.rate_hz, self.notes = range(len(index.stamps_ns)), index.rate_hz, index.notes
        self.times_ns = tuple(at - index.times_ns[0] for at in index.times_ns)
        self._stamps_ns, self._turn = index.stamps_ns, index.turn
        self._capture: Any = None
        self._position = -1

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_capture": None}

    def file(self, number: int) -> Path:
        """The file."""
        return self.path

    def parts(self, role: str, frames: Iterable[int]) -> Iterator[tuple[str, Path]]:
        """The file with its role in a digest."""
        yield role, self.path

    def read(self, place: int) -> Image:
        """Return the frame (H, W, 3) uint8 RGB at this position.

        Raises
        ------
        VfoaError
            If there is no such frame, or it cannot be decoded.
        """
        check_number(place, self.frames, self.path)
        self._go(place)
        is_decoded, image = self._capture.retrieve()
        if not is_decoded:
            raise self._undecodable(place)
        return self._turn.apply(np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8))

    def _go(self, place: int) -> None:
        """Make ``place`` the frame that was grabbed last."""
        if self._capture is None or not 0 <= place - self._position <= STEP:
            self._jump(place)
        while self._position < place:
            if not self._capture.grab():
                self._capture = None
                raise self._undecodable(place)
            self._position += 1
        if _stamp(self._capture) != self._stamps_ns[place]:
            self._capture = None
            raise self._undecodable(place)

    def _jump(self, place: int) -> None:
        """Go to a frame at or before ``place``: by a seek if the time stamp proves where it led, else to the start."""
        if place > STEP and self._can_seek:
            self._capture = self._capture or _open(self.path)
            self._capture.set(cv2.CAP_PROP_POS_FRAMES, place)
            if self._capture.grab():
                self._position = self._places.get(_stamp(self._capture), place + 1)
                if self._position <= place:
                    return
        self._capture, self._position = _open(self.path), -1

    @cached_property
    def _places(self) -> dict[int, int]:
        """The positions of frames by their time stamp, if no other frame has it."""
        count = Counter(self._stamps_ns)
        return {stamp: place for place, stamp in enumerate(self._stamps_ns) if count[stamp] == 1}

    @cached_property
    def _can_seek(self) -> bool:
        """Whether a key frame in the middle can be decoded alone.

        A coder may refresh pictures part by part (x264's intra-refresh): a decoder can begin at each refresh, but
        pictures are whole only after it. FFmpeg gives none before; OpenCV shows them with the parts that are missing.
        """
        import av

        try:
            with _opened(self.path) as container:
                stream = container.streams.video[0]
                stream.thread_type = "NONE"
                container.seek((container.start_time or 0) + (container.duration or 0) // 2)
                for packet in container.demux(stream):
                    if packet.is_keyframe:
                        return bool([*packet.decode(), *stream.codec_context.decode(None)])
        except av.FFmpegError:
            return False
        return True

    def _undecodable(self, place: int) -> VfoaError:
        return VfoaError(f"{self.path}: frame {place} cannot be decoded; the file is damaged there")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Index:
    """What a file holds: the stamp and the time of each frame, its rate, how it is shown, and notes.

    ``stamps_ns`` are as OpenCV gives them, ``times_ns`` ascend; see :class:`Video`.
    """

    stamps_ns: tuple[int, ...]
    times_ns: tuple[int, ...]
    rate_hz: float | None
    turn: Turn
    notes: tuple[str, ...]


def _without_times(path: Path, found: str) -> VfoaError:
    """The error of a stream that no container gives times, with the command that does."""
    film = shlex.join(["ffmpeg", "-r", "RATE", "-i", str(path), "-c", "copy", f"{path.stem}.mp4"])
    return VfoaError(f"{path}: {found}; expected a film: `{film}`")


def _indexed(path: Path) -> _Index:
    """Find out what a file holds: its packets are read, and some of its frames decoded."""
    capture = _open(path)
    with path.open("rb") as file:
        if file.read(len(_JPEG)) == _JPEG:  # FFmpeg gives these the times of 25 frames per second
            raise _without_times(path, "a raw stream of JPEG pictures, which have no times")
    size_px = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
    if size_px[0] * size_px[1] > MOST_PIXELS:
        raise VfoaError(f"{path}: {too_many_pixels(*size_px)}")
    packets = sorted(_grabbed(_open(path, packets=True)))
    stamps = packets if _are_frames(path, packets) else list(_grabbed(_open(path)))
    if not stamps:
        raise VfoaError(f"{path}: no frame can be read; expected {_readable(path) if packets else 'a video'}")
    if len(stamps) > 1 and len(set(stamps)) == 1:
        raise _without_times(path, f"its {len(stamps)} frames have no times (a raw stream?)")
    stated, claimed = float(capture.get(cv2.CAP_PROP_FPS)), int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    times_ns, untimed = _ascending(stamps, stated)
    span_s = (times_ns[-1] - times_ns[0]) / 1e9
    mean = round((len(stamps) - 1) / span_s, 3) if span_s > 0 else None
    agrees = mean is None or abs(stated / mean - 1) < RATE_TOLERANCE
    is_estimate = not agrees and mean and abs(claimed / stated * mean / len(stamps) - 1) < RATE_TOLERANCE
    turn, notes = _shown(path)
    if claimed > 0 and claimed != len(stamps) and not is_estimate:
        notes.append(f"{path.name}: the container says {claimed} frames, {len(stamps)} can be read")
    if untimed:
        frames = f"{len(untimed)} frames (from {untimed[0]} on)" if len(untimed) > 1 else f"frame {untimed[0]}"
        notes.append(f"{path.name}: {frames} without a time of its own: one step after the frame before")
    if turn != UPRIGHT:
        notes.append(f"{path.name}: pictures are {turn}, as the file says")
    rate_hz = stated if agrees and np.isfinite(stated) and stated > 0 else mean
    return _Index(stamps_ns=tuple(stamps), times_ns=tuple(times_ns), rate_hz=rate_hz, turn=turn, notes=tuple(notes))


def _ascending(stamps_ns: Sequence[int], stated_hz: float) -> tuple[list[int], list[int]]:
    """The times of frames in order, and the positions of those whose stamp is not after the time before.

    MPEG's last picture comes out of the decoder when the file has ended, without a time (OpenCV: 0).
    """
    step_ns = round(1e9 / stated_hz) if np.isfinite(stated_hz) and stated_hz > 0 else max(1, _usual_step(stamps_ns))
    times_ns, untimed = [stamps_ns[0]], list[int]()
    for place, stamp in enumerate(stamps_ns[1:], start=1):
        if stamp <= times_ns[-1]:
            untimed.append(place)
            stamp = times_ns[-1] + step_ns
        times_ns.append(stamp)
    return times_ns, untimed


def _usual_step(stamps_ns: Sequence[int]) -> int:
    return int(np.median(np.diff(stamps_ns))) if len(stamps_ns) > 1 else 1


def _opened(path: Path) -> Any:
    """The container of a film for reading, as PyAV has it; tags may be of any coding."""
    import av

    return av.open(str(path), metadata_errors="replace")


def _readable(path: Path) -> str:
    """What to make of a film whose frames OpenCV does not decode: it has no decoder of AV1, among others."""
    import av

    with suppress(av.FFmpegError, IndexError, OSError), _opened(path) as container:
        coded = container.streams.video[0].codec_context.codec.canonical_name
        film = shlex.join(["ffmpeg", "-i", str(path), "-c:v", "libx264", "-crf", "15", f"{path.stem}.mp4"])
        return f"a codec other than {coded}, which OpenCV does not decode: `{film}`"
    return "a video"


@lru_cache(maxsize=16)
def _kept(path: Path, stamp: str) -> _Index:
    """:func:`_indexed`, once for each state of a file: a command opens a clip several times."""
    return _indexed(path)


def _shown(path: Path) -> tuple[Turn, list[str]]:
    """How a video's first picture is turned, by its display matrix; notes on rows of two times and on oblong pixels.

    The matrix is ``[a, b, u, c, d, v, x, y, w]`` with 16 fractional bits: a pixel (p, q) is shown at
    (a p + c q, b p + d q), x to the right and y down (libavutil/display.h).

    Raises
    ------
    VfoaError
        If pictures are turned by a part of 90 degrees, or there is no picture.
    """
    import av

    try:
        with _opened(path) as container:
            picture = next(container.decode(video=0))
            aspect = container.streams.video[0].sample_aspect_ratio or Fraction(1)
    except (av.FFmpegError, StopIteration, IndexError, OSError) as error:
        raise VfoaError(f"{path}: no frame can be read; expected a video: {error}") from None
    notes = []
    if picture.interlaced_frame:
        film = shlex.join(["ffmpeg", "-i", str(path), "-vf", "bwdif=0", "-crf", "15", f"{path.stem}.mp4"])
        notes.append(f"{path.name}: pictures are interlaced, their odd and even rows are of two times: `{film}`")
    if abs(aspect - 1) > _SQUARE_TOLERANCE:
        notes.append(
            f"{path.name}: pixels are {aspect.numerator}:{aspect.denominator}, not square: fy is that many times fx; a "
            "calibration made from these pictures has both"
        )
    data: Any = picture.side_data.get("DISPLAYMATRIX")
    if data is None:
        return UPRIGHT, notes
    values = np.frombuffer(bytes(data), np.int32, 5)
    a, b, _, c, d = np.rint(values / np.abs(values).max()).astype(int).tolist()
    for turn in (Turn(quarters, is_mirrored) for quarters in range(4) for is_mirrored in (False, True)):
        if turn.matrix == (a, b, c, d):
            return turn, notes
    raise VfoaError(f"{path}: pictures are rotated by a part of 90 degrees; expected multiples of 90")


def container_tags(path: Path) -> dict[str, str]:
    """The tags of a film as a whole; none of a file that is no film."""
    import av

    try:
        with _opened(path) as container:
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

    try:
        with _opened(path) as container:
            stream = container.streams.video[0]
            begins_s = float((stream.start_time or 0) * (stream.time_base or 0))
            is_at_zero = any(name in container.format.name for name in ("mp4", "matroska"))
            zero_s = 0.0 if is_at_zero else (container.start_time or 0) / av.time_base
    except (av.FFmpegError, IndexError, OSError) as error:
        raise VfoaError(f"{path}: not a readable video: {error}") from None
    return max(begins_s - zero_s, 0.0)


def _are_frames(path: Path, stamps: Sequence[int]) -> bool:
    """Whether decoding starts and ends with the first and the last packet: edit lists and cuts hide some packets."""
    if not stamps or len(set(stamps)) != len(stamps):
        return False
    first, last = _open(path), _open(path)
    if not first.grab() or _stamp(first) != stamps[0]:
        return False
    last.set(cv2.CAP_PROP_POS_FRAMES, len(stamps) - 1)
    return bool(last.grab() and _stamp(last) == stamps[-1] and not last.grab())


def _grabbed(capture: Any) -> Iterator[int]:
    while capture.grab():
        yield _stamp(capture)


def _stamp(capture: Any) -> int:
    """Time stamp of the frame that was grabbed last, nanoseconds."""
    return round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)


def _open(path: Path, packets: bool = False) -> Any:
    """Open a capture; ``packets``: it returns packets undecoded. A rotation noted in the file is not applied here."""
    if not path.is_file():
        raise VfoaError(f"{path}: no such file")
    name = str(path)
    try:
        name.encode()
    except UnicodeEncodeError:  # OpenCV ends the process then
        raise VfoaError(f"{name}: its name is not UTF-8, which FFmpeg cannot open; rename it") from None
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        capture = cv2.VideoCapture(name, cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1] if packets else [])
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    finally:
        cv2.utils.logging.setLogLevel(level)
    if not capture.isOpened():
        check_fetched(path)
        raise VfoaError(f"{path}: not a readable video; expected a file that FFmpeg opens")
    return capture
