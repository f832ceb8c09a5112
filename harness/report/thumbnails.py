"""Thumbnails for the report page: a small picture of each frame, and what each configuration found in it.

Every frame has one, right or wrong: labels that are edited later decide which of them the page shows, and the page is
then made without a clip or a model::

    thumbnails/<clip>/<frame>.webp                  the left image, made small, once for all configurations
    thumbnails/<clip>__<configuration>.jsonl        a line a frame: boxes, heads and cones in the picture's pixels

``writer.py`` writes them in a run; :func:`read_thumbnails` finds those of the wrong frames.
"""

from __future__ import annotations

import base64
import io
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import compress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, BinaryIO, Self

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from harness.files.io import replacing
from harness.record.appearance import cone_wires, reach_m
from harness.run.frame_sink import FinishedFrame, SinkState
from harness.run.records import FrameRecord
from harness.score.verdicts import Verdict
from vfoa.errors import VfoaError
from vfoa.geometry import project
from vfoa.types import CUES, Attention, Float, FrameResult, Image, Scene, StereoRig

if TYPE_CHECKING:
    import msgspec


FOLDER = "thumbnails"

Box = tuple[int, int, int, int]
"""Left, top, right, bottom in a picture's pixels."""
BUDGET_BYTES = 1_000_000
"""Most bytes of all thumbnails of a page: with them, a page stays under 3 MB."""

_Place = tuple[str, str]
_Frame = tuple[str, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class ThumbnailSubject:
    """A person in a picture. ``lines`` are a cue (``gaze``, ``head``) and the points x, y, x, y ... of each line."""

    name: str | None
    head: Box
    focus: int | None
    lines: list[tuple[str, list[int]]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Thumbnail:
    """The objects and people that one configuration saw in a frame; ``boxes`` are an instance's id, name and box."""

    frame: int
    size: tuple[int, int]
    boxes: list[tuple[int, str, Box]]
    subjects: list[ThumbnailSubject]


def picture_path(run: Path, clip: str, frame: int) -> Path:
    """The file of a frame's picture."""
    return run / FOLDER / clip / _picture_name(frame)


def _picture_name(frame: int) -> str:
    return f"{frame}.webp"


def lines_path(run: Path, clip: str, configuration: str) -> Path:
    """The file of everything that a configuration saw in a clip."""
    return run / FOLDER / f"{clip}__{configuration}.jsonl"


@dataclass(frozen=True, slots=True, kw_only=True)
class Thumbnails:
    """The pictures and marks of the wrong frames that a page shows. ``pictures`` are data URIs by (clip, frame).

    ``seen`` holds each configuration's :class:`Thumbnail`, by (clip, configuration, frame); ``wrong`` counts the wrong
    frames that have a picture, of which a page may have room for fewer.
    """

    pictures: Mapping[_Frame, str] = field(default_factory=dict)
    seen: Mapping[tuple[str, str, int], Thumbnail] = field(default_factory=dict)
    wrong: int = 0


def read_thumbnails(
    run: Path,
    verdicts: Iterable[Verdict],
    names_now: Mapping[str, Mapping[str, str]] | None = None,
    budget: int = BUDGET_BYTES,
) -> Thumbnails:
    """Read the thumbnails of the frames in which somebody was judged wrong.

    ``names_now`` are the present names of renamed targets, by clip and name in the thumbnails.

    If all of them take more than ``budget`` bytes, every second one is read, or every third ...: as many as fit. A run
    without thumbnails has none here.

    Raises
    ------
    VfoaError
        If one of their files cannot be read.
    """
    wrong: dict[_Place, dict[int, None]] = {}
    for verdict in verdicts:
        if verdict.outcome == "wrong":
            wrong.setdefault((verdict.clip, verdict.configuration), {})[verdict.frame] = None
    lines = {place: _lines_of(lines_path(run, *place), frames) for place, frames in wrong.items()}
    sizes = _sizes(run, lines)
    chosen = _fitting(sizes, budget)
    return Thumbnails(
        pictures={each: _data_uri(picture_path(run, *each)) for each in chosen},
        seen={
            (clip, configuration, frame): _renamed(
                _decode(line, lines_path(run, clip, configuration)), (names_now or {}).get(clip, {})
            )
            for (clip, configuration), found in lines.items()
            for frame, line in found.items()
            if (clip, frame) in chosen
        },
        wrong=len(sizes),
    )


def _renamed(thumbnail: Thumbnail, names: Mapping[str, str]) -> Thumbnail:
    return replace(thumbnail, boxes=[(key, names.get(name, name), box) for key, name, box in thumbnail.boxes])


def _lines_of(path: Path, frames: Mapping[int, None]) -> dict[int, bytes]:
    """The lines of these frames, not yet decoded."""
    found: dict[int, bytes] = {}
    if path.is_file():
        with path.open("rb") as file:
            for line in file:
                if (number := _number(line, path)) in frames:
                    found[number] = line
    return found


_LINE = re.compile(rb'\{"frame":(\d+),')


def _number(line: bytes, path: Path) -> int:
    """The frame of a line, from its beginning: decoding all lines takes longer than all else."""
    found = _LINE.match(line)
    if not found:
        raise VfoaError(f"{path}: not the thumbnails of a run: found a line without a frame")
    return int(found[1])


def _sizes(run: Path, lines: Mapping[_Place, Mapping[int, bytes]]) -> dict[_Frame, int]:
    """The bytes that each frame with a picture takes in a page, clip by clip in the order of the frames."""
    sizes: dict[_Frame, int] = {}
    for (clip, _), found in lines.items():
        for frame, line in found.items():
            sizes[clip, frame] = sizes.get((clip, frame), 0) + len(line)
    weighed = {}
    for clip in dict.fromkeys(clip for clip, _ in lines):
        folder = str(picture_path(run, clip, 0).parent)  # text: a path for each picture costs more than its size
        for frame in sorted(frame for of, frame in sizes if of == clip):
            with suppress(OSError):  # no picture
                size = os.stat(f"{folder}/{_picture_name(frame)}").st_size
                weighed[clip, frame] = sizes[clip, frame] + 4 * size // 3
    return weighed


def _fitting(sizes: Mapping[_Frame, int], budget: int) -> dict[_Frame, None]:
    frames: Sequence[_Frame] = list(sizes)
    step = 1
    while sum(sizes[each] for each in frames[::step]) > budget and step < len(frames):
        step += 1
    return dict.fromkeys(frames[::step])


def _data_uri(path: Path) -> str:
    return f"data:image/webp;base64,{base64.b64encode(path.read_bytes()).decode()}"


def _decode(line: bytes, path: Path) -> Thumbnail:
    import msgspec

    try:
        return _decoder().decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise VfoaError(f"{path}: not the thumbnails of a run: {error}") from None


@cache
def _decoder() -> msgspec.json.Decoder[Thumbnail]:
    import msgspec

    return msgspec.json.Decoder(Thumbnail)


WIDTH_PX = 360
QUALITY = 52
METHOD = 2
"""WebP's effort, 0 (fastest) to 6: the default, 4, takes twice as long for as many bytes and 0.5 dB less noise."""
ARROW_M = 0.25
NEAR_M = 0.05
"""A line that comes nearer to the camera's plane than this is not drawn: it would extend to infinity."""
RIM = 16


class ThumbnailWriter:
    """Writes the thumbnails of one clip and configuration; older ones are replaced when it ends."""

    def __init__(self, run: Path, clip: str, configuration: str, resumed: SinkState | None = None) -> None:
        self._run, self._clip, self._resumed = run, clip, resumed
        self._path = lines_path(run, clip, configuration)
        self._partial = self._path.with_name(self._path.name + ".partial")
        self._encoder = msgspec.json.Encoder()
        self._file: BinaryIO

    def __enter__(self) -> Self:
        picture_path(self._run, self._clip, 0).parent.mkdir(parents=True, exist_ok=True)
        self._file = self._partial.open("r+b" if self._resumed else "wb")
        if self._resumed:
            self._file.truncate(self._resumed.files[self._name])
            self._file.seek(0, os.SEEK_END)
        return self

    def state(self) -> SinkState:
        """The extent of the lines' file; each picture has a file of its own."""
        self._file.flush()
        return SinkState(files={self._name: self._file.tell()})

    @property
    def _name(self) -> str:
        return self._partial.relative_to(self._run).as_posix()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()
        if kind is None:
            self._partial.replace(self._path)

    def write(self, frame: FinishedFrame) -> None:
        """Write one frame."""
        images = frame.frame
        if images is None:
            return
        path = picture_path(self._run, self._clip, images.index)
        if not path.exists():  # another configuration has written it
            with replacing(path) as draft:  # another process may be writing it
                draft.write_bytes(picture(images.left))
        self._file.write(self._encoder.encode(thumbnail(images.rig, frame.result, frame.record)) + b"\n")


def picture(left: Image) -> bytes:
    """A left image as a small WebP file."""
    from PIL import Image as Picture

    file = io.BytesIO()
    Picture.fromarray(_small(left)).save(file, "WEBP", quality=QUALITY, method=METHOD)
    return file.getvalue()


def _small(image: Image) -> NDArray[np.uint8]:
    """An image in the size of its picture: halved while it is twice as large, which is fast, and then interpolated."""
    height, width = image.shape[:2]
    size = _size(width, height)
    while width >= 2 * size[0]:
        height, width = height // 2, width // 2
        image = np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


def thumbnail(rig: StereoRig, result: FrameResult, record: FrameRecord) -> Thumbnail:
    """Everything seen in a frame, in the pixels of its picture."""
    size = _size(rig.width_px, rig.height_px)
    scale = size[0] / rig.width_px
    attentions = {each.subject.track_id: each for each in result.attentions}
    return Thumbnail(
        frame=record.frame,
        size=size,
        boxes=[(each.instance_id, each.name, _box(each.box_px, scale)) for each in record.targets if each.box_px],
        subjects=[
            ThumbnailSubject(
                name=each.name,
                head=_box(each.head_box_px, scale),
                focus=each.focus,
                lines=_lines(attentions[each.track_id], result.scene, rig, scale),
            )
            for each in record.subjects
            if each.head_box_px
        ],
    )


def _lines(attention: Attention, scene: Scene, rig: StereoRig, scale: float) -> list[tuple[str, list[int]]]:
    """The cones and directions of a subject as seen in the picture."""
    wires = cone_wires(attention.cones, reach_m(attention, scene), rim=RIM)
    lines = _projected([cone.cue for cone in attention.cones], wires, rig, scale)
    eyes, subject = attention.subject.person.eye_origin_left, attention.subject
    seen = {cue: direction for cue in CUES if (direction := subject.direction(cue)) is not None}
    if eyes is not None and seen:
        arrows = np.array([(eyes, eyes + ARROW_M * direction) for direction in seen.values()])
        lines += _projected(list(seen), arrows, rig, scale)
    return lines


def _projected(cues: Sequence[str], lines: Float, rig: StereoRig, scale: float) -> list[tuple[str, list[int]]]:
    """The lines (N, points, 3) in the camera frame, metres, as seen in the picture; N cues."""
    far = np.asarray((lines[:, :, 2] > NEAR_M).all(axis=1))
    points_px = np.rint((project(lines[far], rig) + 0.5) * scale - 0.5).astype(int)
    return [(cue, line.ravel().tolist()) for cue, line in zip(compress(cues, far), points_px, strict=True)]


def _size(width: int, height: int) -> tuple[int, int]:
    scale = min(1.0, WIDTH_PX / width)
    return round(scale * width), max(round(scale * height), 1)


def _box(box_px: tuple[float, float, float, float], scale: float) -> Box:
    left, top, right, bottom = (round(scale * value) for value in box_px)
    return left, top, right, bottom
