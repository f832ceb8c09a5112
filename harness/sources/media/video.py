"""Frames of a video file, exact in any order: frames are identified by their time stamps; seeking is verified."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.sources import check_number
from harness.sources.media.images import MOST_PIXELS, too_many_pixels
from vfoa.errors import VfoaError
from vfoa.types import Image

# FFmpeg writes to the terminal; our own errors describe what is wrong with a file. Read when the first video is opened.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
import cv2

VIDEO_SUFFIXES = frozenset({".mp4", ".avi", ".mkv", ".mov", ".m4v", ".webm", ".mpg", ".mpeg", ".wmv", ".ts"})

STEP = 32
"""Most frames ahead that are decoded one by one; beyond that, seek."""

RATE_TOLERANCE = 0.01
"""A stated rate is used if it is this near to the mean of the times, which some containers round to ms."""


class Video:
    """A video's frames by their position, from 0. Reading in order decodes each once. It can be pickled.

    Frames are counted by the packets, or by decoding if these are not conclusive. ``times_ns`` is each frame's time
    since the first one. ``rate_hz`` is the stated rate if the times agree, else their mean rate: phones film with
    varying steps. ``notes``: whether the container states another number of frames (FFmpeg's estimate from a duration
    that the frames fill does not count).

    Raises
    ------
    VfoaError
        If the file is missing, is not a video, or has no frame.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        capture = _open(path)
        size_px = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        if size_px[0] * size_px[1] > MOST_PIXELS:
            raise VfoaError(f"{path}: {too_many_pixels(*size_px)}")
        stamps = sorted(_grabbed(_open(path, packets=True)))
        if not _are_frames(path, stamps):
            stamps = list(_grabbed(_open(path)))
        if not stamps:
            raise VfoaError(f"{path}: no frame can be read; expected a video")
        self.frames = range(len(stamps))
        self.times_ns = tuple(stamp - stamps[0] for stamp in stamps)
        stated, claimed = float(capture.get(cv2.CAP_PROP_FPS)), int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        span_s = self.times_ns[-1] / 1e9
        mean = round((len(stamps) - 1) / span_s, 3) if span_s > 0 else None
        agrees = mean is None or abs(stated / mean - 1) < RATE_TOLERANCE
        self.rate_hz = stated if agrees and np.isfinite(stated) and stated > 0 else mean
        is_estimate = not agrees and mean and abs(claimed / stated * mean / len(stamps) - 1) < RATE_TOLERANCE
        self.notes: tuple[str, ...] = ()
        if claimed > 0 and claimed != len(stamps) and not is_estimate:
            self.notes = (f"{path.name}: the container says {claimed} frames, {len(stamps)} can be read",)
        self._stamps_ns = stamps
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
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)

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
        if place > STEP:
            self._capture = self._capture or _open(self.path)
            self._capture.set(cv2.CAP_PROP_POS_FRAMES, place)
            places = {stamp: number for number, stamp in enumerate(self._stamps_ns)}
            if len(places) == len(self._stamps_ns) and self._capture.grab():
                self._position = places.get(_stamp(self._capture), place + 1)
                if self._position <= place:
                    return
        self._capture, self._position = _open(self.path), -1

    def _undecodable(self, place: int) -> VfoaError:
        return VfoaError(f"{self.path}: frame {place} cannot be decoded; the file is damaged there")


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
        with av.open(str(path)) as container:
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
    """Open a capture; ``packets``: it returns packets undecoded. A rotation noted in the file is not applied."""
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
        raise VfoaError(f"{path}: not a readable video; expected a file that FFmpeg opens")
    return capture
