"""What perception found, in images: the stereo pair, disparity, depth, masks and heads."""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from harness.recording import Size, entities
from harness.recording.frame_log import FrameLog
from harness.recording.labels import Colour, Colours, subject_names
from harness.recording.once import once
from harness.runs.results import FrameRecord
from vfoa.geometry import depth_from_disparity
from vfoa.types import Disparity, Image, Map, Percepts, StereoFrame, StereoRig

JPEG_QUALITY = 85
IMAGE_PLANE_M = 0.25
DISPARITY_STEPS_PER_PX = 8
"""A light recording rounds disparities to this: below what a matcher resolves, and half the bytes."""


def log_images(log: FrameLog, frame: StereoFrame, size: Size) -> None:
    """The camera and both views; the right one at half size in a light recording."""
    rig = frame.rig
    log.keep(entities.CAMERA, lambda: _pinhole(rig), key=rig, static=False)
    log.log(entities.IMAGE, once(_jpeg, frame.left))
    log.log(entities.RIGHT, once(_right, frame.right, size))


def _right(right: Image, size: Size) -> rr.EncodedImage:
    return _jpeg(right if size == "full" else cv2.resize(right, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))


def _pinhole(rig: StereoRig) -> rr.Pinhole:
    return rr.Pinhole(
        image_from_camera=rig.camera_matrix,
        resolution=(rig.width_px, rig.height_px),
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=IMAGE_PLANE_M,
    )


def log_disparity(log: FrameLog, percepts: Percepts, size: Size) -> None:
    """The disparity in pixels; in a full recording also its confidence, and the depth in millimetres.

    A light recording holds every second row and column: picked, not averaged, so that edges stay edges.
    """
    disparity, rig = percepts.disparity, percepts.rig
    log.log(entities.DISPARITY, once(_disparity, disparity, size))
    if size == "light":
        return
    log.log(entities.DEPTH, once(_depth, disparity, rig))
    if disparity.confidence is not None:
        log.log(entities.CONFIDENCE, once(_confidence, disparity.confidence))


def _disparity(disparity: Disparity, size: Size) -> rr.DepthImage:
    longest = float(np.nanmax(disparity.disparity_px)) if disparity.known_share > 0 else 1.0
    shown = disparity.disparity_px if size == "full" else _rounded(disparity)
    return rr.DepthImage(shown, colormap=rr.components.Colormap.Turbo, depth_range=(0, longest))


def _confidence(confidence: Map) -> rr.Image:
    return rr.Image(np.rint(255 * np.nan_to_num(confidence)).astype(np.uint8), color_model="L")


def log_masks(log: FrameLog, percepts: Percepts, record: FrameRecord, colours: Colours) -> None:
    """The masks, one class per name, so that a name keeps its colour when the segmenter renumbers its instances."""
    names = {target.instance_id: target.name for target in record.targets}
    instances = percepts.instances
    class_of_id = np.zeros(max((each.id for each in instances.instances), default=0) + 1, dtype=np.uint16)
    for instance in instances.instances:
        class_of_id[instance.id] = colours.class_of(names.get(instance.id, instance.label))
    known = colours.known
    log.keep(entities.WORLD, lambda: class_context(known), key=tuple(known))
    table = class_of_id.astype(np.uint8) if len(known) < 256 else class_of_id
    log.log(entities.MASKS, once(_masks, instances.ids, table.tobytes(), table.dtype.str))


def _masks(ids: NDArray[np.uint16], class_of_id: bytes, kind: str) -> rr.SegmentationImage:
    return rr.SegmentationImage(np.frombuffer(class_of_id, kind)[ids], opacity=0.35)


def class_context(known: dict[str, Colour]) -> rr.AnnotationContext:
    """Names and colours of the classes, which :attr:`harness.recording.labels.Colours.known` has in their order."""
    # not by time: every class is there from the start for the viewer, and a class never changes its name
    names = enumerate(known.items(), start=1)
    return rr.AnnotationContext([(0, "", (0, 0, 0, 0)), *((number, name, colour) for number, (name, colour) in names)])


def log_heads(log: FrameLog, record: FrameRecord) -> None:
    """The box of every subject's head, with the subject's name."""
    names = subject_names(record)
    for subject in record.subjects:
        name = names[subject.track_id]
        path = entities.head_box(name)
        log.keep(path, partial(_head_style, name), key="style")
        u0, v0, u1, v1 = subject.head_box_px
        corners = np.array([[u0, v0], [u1, v1]])
        log.log(
            path, rr.Boxes2D.from_fields(centers=corners.mean(axis=0)[None], half_sizes=np.diff(corners, axis=0) / 2)
        )


def _head_style(name: str) -> rr.Boxes2D:
    return rr.Boxes2D.from_fields(labels=[name], colors=[(255, 255, 255)])


def _jpeg(image: Image) -> rr.EncodedImage:
    # OpenCV's encoder writes the same bytes as Rerun's own path through Pillow, in a fraction of the time
    _, encoded = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return rr.EncodedImage(contents=encoded.tobytes(), media_type="image/jpeg")


def _rounded(disparity: Disparity) -> NDArray[np.float16]:
    sampled = disparity.disparity_px[::2, ::2]
    return (np.rint(sampled * DISPARITY_STEPS_PER_PX) / DISPARITY_STEPS_PER_PX).astype(np.float16)


def _depth(disparity: Disparity, rig: StereoRig) -> rr.DepthImage:
    """Depth in millimetres, in Rerun's form: 0 is unknown, and all beyond 65.5 m is at 65.5 m."""
    millimetres = 1000 * depth_from_disparity(disparity.disparity_px, rig)
    return rr.DepthImage(np.nan_to_num(np.clip(millimetres, 1, 65535), nan=0).astype(np.uint16), meter=1000)
