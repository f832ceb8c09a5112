"""One frame of a recording as arrays: the left image, its masks, the clouds of the targets, and a person's cones."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rerun.chunk import RrdReader

from harness.record import entities
from harness.record.composed import RecordedClip
from harness.record.images import decoded, key_frame_every
from harness.record.reading import reading
from vfoa.types import CUES, Cue, Float, Image


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameContent:
    """What a recording shows in a frame; what was not recorded is None or empty.

    ``masks`` are (H, W, 4) RGBA, transparent where nothing is. ``clouds`` (N, 3) are by instance id and ``cones``,
    lines (N, 3), by cue; camera frame, metres.
    """

    image: Image | None
    masks: NDArray[np.uint8] | None
    clouds: dict[int, Float]
    cones: dict[Cue, list[Float]]


def read_frame(clip: RecordedClip, configuration: str, subject: str, frame: int) -> FrameContent:
    """Read what the recording of a clip shows of a configuration and a subject in a frame.

    Raises
    ------
    VfoaError
        If a file is damaged.
    """
    (layers,) = clip.under(configuration).layers
    images, scene = clip.files.images, clip.files.reconstruction(layers.reconstruction)
    attention = clip.files.attention(configuration)
    clouds = {}
    for path, points in _values(scene, f"{entities.scene(layers.reconstruction)}/**", "Points3D:positions", frame):
        clouds[int(path.split("/")[-2])] = np.array(points, dtype=np.float64).reshape(-1, 3)
    cones: dict[Cue, list[Float]] = {}
    for cue in CUES:
        path = f"{entities.subject_3d(configuration, subject)}/{cue}/cones"
        for _, strips in _values(attention, path, "LineStrips3D:strips", frame):
            cones[cue] = [np.array(strip, dtype=np.float64) for strip in strips]
    return FrameContent(
        image=_image(images, clip, frame),
        masks=_picture(images, entities.masks(layers.masks), frame, "RGBA"),
        clouds=clouds,
        cones=cones,
    )


def first_wrong(clip: RecordedClip, frame: int) -> str | None:
    """The first subject whose answer is wrong in a frame, under the first configuration that has one; None if none is.

    Raises
    ------
    VfoaError
        If a layer of verdicts is damaged.
    """
    for layers in clip.layers:
        file = clip.files.verdicts(layers.configuration)
        for subject in clip.subjects:
            path = entities.verdict(layers.configuration, subject, "error_type")
            if any(_values(file, path, "TextDocument:text", frame)):
                return subject
    return None


def _values(
    file: Path, content: str, component: str, frame: int, first: int | None = None
) -> Iterator[tuple[str, Any]]:
    """Yield the entity path and the value of every row of these frames (``first`` to ``frame``), by chunk."""
    if not file.is_file():
        return
    with reading(file):
        for chunk in RrdReader(file).stream().filter(content=content, components=component):
            batch = chunk.to_record_batch()
            if "frame" not in batch.schema.names or component not in batch.schema.names:
                continue
            numbers = batch.column("frame").cast("int64").to_pylist()
            for row, number in enumerate(numbers):
                if (frame if first is None else first) <= number <= frame:
                    value = batch.column(component)[row].as_py()
                    if value:
                        yield chunk.entity_path, value


def _picture(file: Path, path: str, frame: int, mode: str) -> NDArray[np.uint8] | None:
    """The encoded picture of an entity in a frame."""
    from PIL import Image as Picture

    for _, (blob,) in _values(file, path, "EncodedImage:blob", frame):
        with Picture.open(io.BytesIO(bytes(blob))) as picture:
            return np.array(picture.convert(mode))
    return None


def _image(file: Path, clip: RecordedClip, frame: int) -> Image | None:
    """The left image: a picture, or decoded from the key frame before."""
    picture = _picture(file, entities.IMAGE, frame, "RGB")
    if picture is not None or frame not in clip.frames:
        return picture
    every = key_frame_every(clip.rate_hz)
    first = clip.frames[clip.frames.index(frame) // every * every]
    samples = [bytes(sample) for _, (sample,) in _values(file, entities.IMAGE, "VideoStream:sample", frame, first)]
    return decoded(samples) if samples else None
