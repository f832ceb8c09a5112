"""The sinks that write thumbnails: the picture of every frame, and what each configuration draws over it."""

from __future__ import annotations

import io
from collections.abc import Sequence
from itertools import compress
from pathlib import Path
from typing import BinaryIO, Self

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from harness.files.io import replacing
from harness.pipeline.perception import SharedFrame
from harness.record.appearance import ARROW_M, cone_wires, reach_m
from harness.report.thumbnails import Box, Thumbnail, ThumbnailSubject, lines_path, picture_path
from harness.run.frame_sink import FinishedFrame
from harness.run.records import FrameRecord
from vfoa.geometry import project
from vfoa.types import CUES, Attention, Float, FrameResult, Image, Scene, StereoRig

WIDTH_PX = 360
QUALITY = 52
METHOD = 2
"""WebP's effort, 0 (fastest) to 6: the default, 4, takes twice as long for as many bytes and 0.5 dB less noise."""
NEAR_M = 0.05
"""A line that comes nearer to the camera's plane than this is not drawn: it would extend to infinity."""
RIM = 16


class PictureWriter:
    """Writes a picture of every frame of a clip with images."""

    def __init__(self, run: Path, clip: str) -> None:
        self._run, self._clip = run, clip

    def __enter__(self) -> Self:
        picture_path(self._run, self._clip, 0).parent.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(self, *error: object) -> None:
        """Every picture is whole already."""

    def write(self, frame: SharedFrame) -> None:
        """Write one picture, unless it is there."""
        if frame.frame is None:
            return
        path = picture_path(self._run, self._clip, frame.index)
        if not path.exists():  # an earlier run has written it
            with replacing(path) as draft:  # another process may be writing it
                draft.write_bytes(picture(frame.frame.left))


class ThumbnailWriter:
    """Writes what one configuration draws over the pictures of a clip; older lines are replaced when it ends."""

    def __init__(self, run: Path, clip: str, configuration: str) -> None:
        self._path = lines_path(run, clip, configuration)
        self._partial = self._path.with_name(self._path.name + ".partial")
        self._encoder = msgspec.json.Encoder()
        self._file: BinaryIO

    def __enter__(self) -> Self:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self._partial.open("wb")
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._file.close()
        if kind is None:
            self._partial.replace(self._path)

    def write(self, frame: FinishedFrame) -> None:
        """Write one frame."""
        if frame.camera is not None:
            drawn = thumbnail(frame.camera.rig, frame.result, frame.record)
            self._file.write(self._encoder.encode(drawn) + b"\n")


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
    attentions = {attention.subject.track_id: attention for attention in result.attentions}
    return Thumbnail(
        frame=record.frame,
        size=size,
        boxes=[
            (target.instance_id, target.name, _box(target.box_px, scale)) for target in record.targets if target.box_px
        ],
        subjects=[
            ThumbnailSubject(
                name=subject.name,
                head=_box(subject.head_box_px, scale),
                focus=subject.focus,
                lines=_lines(attentions[subject.track_id], result.scene, rig, scale),
            )
            for subject in record.subjects
            if subject.head_box_px
        ],
    )


def _lines(attention: Attention, scene: Scene, rig: StereoRig, scale: float) -> list[tuple[str, list[int]]]:
    """The cones and directions of a subject as seen in the picture."""
    cones = attention.cones
    wires = cone_wires(cones, reach_m(attention, scene), rim=RIM)
    lines = _projected([cone.cue for cone in cones], wires, rig, scale)
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
