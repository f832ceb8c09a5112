"""The layer of a reconstruction: its disparity, and each target's cloud and 3D box in metres."""

from __future__ import annotations

import numpy as np
import rerun as rr

from harness.record import Size, entities
from harness.record.appearance import Colours, target_names
from harness.record.frame_log import FrameLog
from harness.record.images import class_context, encoded_depth, png
from harness.run.records import FrameRecord
from vfoa.geometry import depth_from_disparity, quaternion
from vfoa.types import Box3D, Disparity, Map, Percepts, Scene, StereoFrame

LIGHT_POINTS = 100
"""Most points of a cloud in a light recording: enough to show its shape and its outliers."""

_COLOURS = rr.components.Colormap.Turbo

_STEPS = 128
"""A light recording rounds the disparities of a frame to at most this many steps, as many as colours can show."""


def log_disparity(log: FrameLog, name: str, frame: StereoFrame, percepts: Percepts, size: Size) -> None:
    """Log the disparity in pixels; in a full recording also its confidence, and the depth in millimetres.

    A light recording holds every second row and column: picked, not averaged, so that edges stay sharp. Without a right
    image there is no disparity to show: the measured depth is in the layer of the images.
    """
    if frame.right is None:
        return
    disparity, rig = percepts.disparity, percepts.rig
    longest = float(np.nan_to_num(np.fmax.reduce(disparity.disparity_px, axis=None), nan=1.0))
    if size == "light":
        _log_light_disparity(log, entities.disparity(name), disparity, longest)
        return
    whole = rr.DepthImage(disparity.disparity_px, colormap=_COLOURS, depth_range=(0, longest))
    log.log(entities.disparity(name), whole)
    log.log(entities.depth(name), encoded_depth(depth_from_disparity(disparity.disparity_px, rig)))
    if disparity.confidence is not None:
        log.log(entities.confidence(name), _confidence(disparity.confidence))


def _log_light_disparity(log: FrameLog, path: str, disparity: Disparity, longest: float) -> None:
    per_px = float(np.clip(2.0 ** np.floor(np.log2(_STEPS / max(longest, 1))), 1, 8))
    steps = np.rint(disparity.disparity_px[::2, ::2] * per_px)
    log.row(
        path,
        rr.EncodedDepthImage,
        blob=[png(np.nan_to_num(np.clip(steps, 1, 65535), nan=0).astype(np.uint16))],
        media_type=["image/png"],
        meter=[per_px],
        colormap=[_COLOURS],
        depth_range=[(0, longest * per_px)],
    )


def _confidence(confidence: Map) -> rr.Image:
    return rr.Image(np.rint(255 * np.nan_to_num(confidence)).astype(np.uint8), color_model="L")


def log_targets(log: FrameLog, name: str, scene: Scene, record: FrameRecord, colours: Colours, size: Size) -> None:
    """Log the cloud and the box of every target, in its colour and with its name."""
    names = target_names(record)
    base = {target.instance_id: target.name for target in record.targets}
    for target in scene.targets:
        number = target.instance.id
        points = target.points_left
        if size == "light" and len(points) > LIGHT_POINTS:
            points = points[np.linspace(0, len(points) - 1, LIGHT_POINTS).astype(np.intp)]
        class_id = colours.class_of(base[number])
        if len(points):
            path = entities.points(name, number)
            log.keep(path, _cloud_style, key="style")
            if size == "full":
                log.log(path, rr.Points3D.from_fields(positions=points, class_ids=class_id))
            else:
                log.row(path, rr.Points3D, positions=points, class_ids=[class_id])
        if target.box is not None:
            path = entities.box(name, number)
            log.keep(path, _box_style, key="style")
            _log_box(log, path, target.box, names[number], class_id)
    known = colours.known
    log.keep(entities.scene(name), lambda: class_context(known), key=tuple(known))


# Values of an entity that never change are static: they are logged once, and outlive the clearing of the entity.


def _cloud_style() -> rr.Points3D:
    return rr.Points3D.from_fields(radii=rr.Radius.ui_points(1.5))


def _box_style() -> rr.Boxes3D:
    return rr.Boxes3D.from_fields(
        fill_mode=rr.components.FillMode.MajorWireframe, radii=rr.Radius.ui_points(1.5), show_labels=True
    )


def _log_box(log: FrameLog, path: str, box: Box3D, name: str, class_id: int) -> None:
    log.row(
        path,
        rr.Boxes3D,
        centers=box.center_m[None],
        half_sizes=box.half_size_m[None],
        quaternions=[quaternion(box.left_from_box)],
        labels=[name],
        class_ids=[class_id],
    )
