"""Frames of a video file, exact in any order: frames are identified by their time stamps; seeking is verified."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from harness.files.digests import settled_stamp
from harness.files.safe_names import shell_command
from harness.sources import check_number
from harness.sources.media.film import Film
from vfoa.errors import VfoaError
from vfoa.types import Image

_RAW_SUFFIXES = frozenset({".h264", ".264", ".h265", ".265", ".hevc", ".mjpeg", ".mjpg"})
"""Of streams as an encoder gives them (Raspberry Pi), which hold no times."""
_JPEG = b"\xff\xd8\xff"
VIDEO_SUFFIXES = _RAW_SUFFIXES | {
    *(".mp4", ".avi", ".mkv", ".mov", ".m4v", ".webm", ".mpg", ".mpeg", ".wmv", ".asf", ".flv", ".3gp", ".mxf"),
    *(".ts", ".mts", ".m2ts"),  # .mts: AVCHD, of camcorders
    *(".vob", ".mod", ".m2v", ".dv", ".3g2", ".qt", ".ogv", ".y4m", ".divx"),
}

STEP = 32
"""Most frames ahead that are decoded one by one; beyond that, seek."""

_MARGINS = (STEP // 2, 2 * STEP, 8 * STEP)
"""Frames before the wanted one to seek to: the pictures next to a key frame may need those before it, and in streams
without an index a search ends behind a key frame."""

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
    frames have no time, and whether the container states more frames than can be read (FFmpeg's estimate from a
    duration that the frames fill does not count).

    Raises
    ------
    VfoaError
        If the file is missing, is not a video, or has no frame.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        stamp = settled_stamp([("", str(path))])
        index = _indexed(path) if stamp is None else _kept(path, stamp)
        self.frames, self.rate_hz, self.notes = range(len(index.stamps)), index.rate_hz, index.notes
        self.times_ns = tuple(at - index.times_ns[0] for at in index.times_ns)
        self._stamps, self._turn = index.stamps, index.turn
        self._film: Film | None = None
        self._position = -1
        self._picture: Any = None

    def __getstate__(self) -> dict[str, Any]:
        kept = {name: value for name, value in self.__dict__.items() if name != "_places"}
        return {**kept, "_film": None, "_position": -1, "_picture": None}

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
        return self._turn.apply(self._pixels(place))

    def _pixels(self, place: int) -> Image:
        """The picture at this position as the file has it, not turned."""
        film = self._film
        if film is None or not 0 <= place - self._position <= STEP:
            film = self._jump(place)
        while self._position < place:
            if (picture := film.next_picture()) is None:
                self._film = None
                raise self._undecodable(place)
            self._position, self._picture = self._places.get(picture.pts, self._position + 1), picture
        if self._position > place or self._picture is None or self._picture.pts != self._stamps[place]:
            raise self._undecodable(place)
        return film.rgb(self._picture)

    def _jump(self, place: int) -> Film:
        """Go to a frame at or before ``place``: by a seek if the time stamp proves where it led, else to the start."""
        for margin in _MARGINS if place > STEP and self._can_seek else ():
            film = self._film = self._film or Film(self.path)
            picture = film.seek(self._stamps[max(place - margin, 0)])
            at = -1 if picture is None else self._places.get(picture.pts, -1)
            if 0 <= at <= place:
                self._position, self._picture = at, picture
                return film
        self._film, self._position, self._picture = Film(self.path), -1, None
        return self._film

    @cached_property
    def _places(self) -> dict[int | None, int]:
        """The positions of frames by their time stamp, if no other frame has it."""
        count = Counter(self._stamps)
        return {stamp: place for place, stamp in enumerate(self._stamps) if stamp is not None and count[stamp] == 1}

    @cached_property
    def _can_seek(self) -> bool:
        """Whether a key frame in the middle can be decoded alone.

        A coder may refresh pictures part by part (x264's intra-refresh): a decoder can begin at each refresh, but
        pictures are whole only after it.
        """
        with Film(self.path) as film:
            return film.decodes_alone(self._stamps[len(self._stamps) // 2])

    def _undecodable(self, place: int) -> VfoaError:
        return VfoaError(f"{self.path}: frame {place} cannot be decoded; the file is damaged there")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Index:
    """What a file holds: the stamp and the time of each frame, its rate, how it is shown, and notes.

    ``stamps`` are the file's own, in its ticks, None where it has none; ``times_ns`` ascend. See :class:`Video`.
    """

    stamps: tuple[int | None, ...]
    times_ns: tuple[int, ...]
    rate_hz: float | None
    turn: Turn
    notes: tuple[str, ...]


def _without_times(path: Path, found: str) -> VfoaError:
    """The error of a stream that no container gives times, with the command that does."""
    film = shell_command("ffmpeg", "-r", "RATE", "-i", path, "-c", "copy", Path(f"{path.stem}.mp4"))
    return VfoaError(f"{path}: {found}; expected a film: `{film}`")


def _indexed(path: Path) -> _Index:
    """Find out what a file holds: its packets are read, and some of its frames decoded."""
    with Film(path) as film, path.open("rb") as file:
        if file.read(len(_JPEG)) == _JPEG:  # FFmpeg gives these the times of 25 frames per second
            raise _without_times(path, "a raw stream of JPEG pictures, which have no times")
        stated, claimed, tick_ns = film.stated_hz, film.stated_frames, film.tick_ns
        packets = film.packet_stamps()
    known = sorted(stamp for stamp in packets if stamp is not None)
    stamps = _frames_of_packets(path, packets, known) or _frames(path)
    if not stamps:
        raise VfoaError(f"{path}: no frame can be read; expected a video that is not damaged")
    if len(stamps) > 1 and len(set(stamps)) == 1:
        raise _without_times(path, f"its {len(stamps)} frames have no times (a raw stream?)")
    in_time = packets if packets == known and len(packets) == len(stamps) else stamps  # AVI counts its packets
    times_ns, untimed = _ascending([None if stamp is None else round(stamp * tick_ns) for stamp in in_time], stated)
    span_s = (times_ns[-1] - times_ns[0]) / 1e9
    mean = round((len(stamps) - 1) / span_s, 3) if span_s > 0 else None
    agrees = mean is None or abs((stated or 0) / mean - 1) < RATE_TOLERANCE
    is_estimate = not agrees and mean and stated and abs(claimed / stated * mean / len(stamps) - 1) < RATE_TOLERANCE
    turn, notes = _shown(path)
    if claimed > len(stamps) and not is_estimate:
        notes.append(f"{path.name}: the container says {claimed} frames, {len(stamps)} can be read")
    if untimed:
        frames = f"{len(untimed)} frames (from {untimed[0]} on)" if len(untimed) > 1 else f"frame {untimed[0]}"
        notes.append(f"{path.name}: {frames} without a time of its own: one step after the frame before")
    if turn != UPRIGHT:
        notes.append(f"{path.name}: pictures are {turn}, as the file says")
    rate_hz = stated if agrees and stated else mean
    return _Index(stamps=tuple(stamps), times_ns=tuple(times_ns), rate_hz=rate_hz, turn=turn, notes=tuple(notes))


def _frames_of_packets(path: Path, packets: Sequence[int | None], known: Sequence[int]) -> list[int | None]:
    """The stamps of packets in ascending order, if each is one of a frame; none if that cannot be told.

    It can if decoding starts and ends with the first and the last packet: edit lists and cuts hide some packets. Where
    packets ascend and pictures are reordered, the first pictures ascend, too, unless their stamps count the packets.
    """
    if not known or len(set(known)) != len(packets):
        return []
    with Film(path) as film:
        looked_at = 2 * STEP if film.reorders and packets == known else 1
        first = [picture.pts for picture in islice(film.pictures(), looked_at)]
        if first[:1] != known[:1] or None in first or first != sorted(first):
            return []
        for margin in (1, *_MARGINS):
            end = film.last_picture(known[max(len(known) - margin, 0)])
            if end is not None:
                return [*known] if end.pts == known[-1] else []
    return []


def _frames(path: Path) -> list[int | None]:
    """The stamps of all frames, by decoding them."""
    with Film(path) as film:
        return [picture.pts for picture in film.pictures()]


def _ascending(stamps_ns: Sequence[int | None], stated_hz: float | None) -> tuple[list[int], list[int]]:
    """The times of frames in order, and the positions of those without a stamp after the time before.

    Of streams that were joined the stamps go back; a picture that leaves the decoder at the end may have none.
    """
    known = [stamp for stamp in stamps_ns if stamp is not None]
    step_ns = round(1e9 / stated_hz) if stated_hz else max(1, int(np.median(np.diff(known)))) if known[1:] else 1
    times_ns, untimed = [known[0] if known else 0], list[int]()
    for place, stamp in enumerate(stamps_ns[1:], start=1):
        if stamp is None or stamp <= times_ns[-1]:
            untimed.append(place)
            stamp = times_ns[-1] + step_ns
        times_ns.append(stamp)
    return times_ns, untimed


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
    with Film(path) as film:
        picture, aspect = film.next_picture(), film.pixel_aspect
    if picture is None:
        raise VfoaError(f"{path}: no frame can be read; expected a video that is not damaged")
    notes = []
    if picture.interlaced_frame:
        whole = shell_command("ffmpeg", "-i", path, "-vf", "bwdif=0", "-crf", "15", Path(f"{path.stem}_whole.mp4"))
        notes.append(f"{path.name}: pictures are interlaced, their odd and even rows are of two times: `{whole}`")
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
