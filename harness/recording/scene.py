"""The targets in metres: their clouds, their 3D boxes, and their extent in the left image."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from harness.recording import Size, entities
from harness.recording.frame_log import FrameLog
from harness.recording.labels import Colours, target_names
from harness.runs.results import FrameRecord
from vfoa.types import Box3D, Float, Scene

LIGHT_POINTS = 15_000
"""Most points of all clouds of a frame in a light recording."""


def log_targets(log: FrameLog, scene: Scene, record: FrameRecord, colours: Colours, size: Size) -> None:
    """Clouds and boxes; each box says its target's name and how much attention it gets."""
    names = target_names(record)
    base = {target.instance_id: target.name for target in record.targets}
    captions = _captions(record, names)
    kept = _most_points([len(target.points_left) for target in scene.targets], LIGHT_POINTS)
    for target in scene.targets:
        number = target.instance.id
        points = target.points_left
        if size == "light" and len(points) > kept:
            points = points[np.linspace(0, len(points) - 1, kept).astype(np.intp)]
        class_id = colours.class_of(base[number])
        if len(points):
            path = entities.points(number)
            log.keep(path, _cloud_style, key="style")
            log.log(path, rr.Points3D.from_fields(positions=points, class_ids=class_id))
        if target.box is not None:
            path = entities.box(number)
            log.keep(path, _box_style, key="style")
            log.log(path, _box(target.box, captions[number], class_id))
    _log_extents(log, record, captions, colours)


# What never changes of an entity is logged once, and not by time: it also outlives the entity's clearing.


def _cloud_style() -> rr.Points3D:
    return rr.Points3D.from_fields(radii=rr.Radius.ui_points(1.5))


def _box_style() -> rr.Boxes3D:
    return rr.Boxes3D.from_fields(
        fill_mode=rr.components.FillMode.MajorWireframe, radii=rr.Radius.ui_points(1.5), show_labels=True
    )


def _box(box: Box3D, caption: str, class_id: int) -> rr.Boxes3D:
    # arrays and a class instead of Rerun's own values and a colour: half the time
    return rr.Boxes3D.from_fields(
        centers=box.center_m[None],
        half_sizes=box.half_size_m[None],
        quaternions=_quaternion(box.left_from_box)[None],
        labels=[caption],
        class_ids=class_id,
    )


def _quaternion(rotation: Float) -> Float:
    """The quaternion (4,), as (x, y, z, w); that of a box along the camera's axes without the work."""
    if np.array_equal(rotation, np.eye(3)):
        return np.array([0.0, 0.0, 0.0, 1.0])
    return np.asarray(Rotation.from_matrix(rotation).as_quat())


def _log_extents(log: FrameLog, record: FrameRecord, captions: Mapping[int, str], colours: Colours) -> None:
    """One batch of 2D boxes around the masks, so that the image says what is what without a pointer over it."""
    if not record.targets:
        return
    shades = [colours.of(target.name) for target in record.targets]
    boxes = rr.Boxes2D(
        array=[target.box_px for target in record.targets],
        array_format=rr.Box2DFormat.XYXY,
        colors=shades,
        radii=rr.Radius.ui_points(0.75),
    )
    log.log(f"{entities.TARGETS_2D}/box2d", boxes)
    # a box has its caption below itself, which is often below the image
    middles = np.array([target.box_px for target in record.targets]).reshape(-1, 2, 2).mean(axis=1)
    captioned = rr.Points2D(
        middles,
        labels=[captions[target.instance_id] for target in record.targets],
        show_labels=True,
        colors=shades,
        radii=rr.Radius.ui_points(1.5),
    )
    log.log(f"{entities.TARGETS_2D}/caption", captioned)


def _captions(record: FrameRecord, names: Mapping[int, str]) -> dict[int, str]:
    """``bird 0.42`` with one subject; with several the name alone, since the values would hide the scene."""
    if len(record.subjects) != 1:
        return dict(names)
    totals = {value.instance_id: value.total for value in record.subjects[0].attention if value.total > 0}
    return {number: f"{name} {totals[number]:.2f}" if number in totals else name for number, name in names.items()}


def _most_points(sizes: Sequence[int], budget: int) -> int:
    """The most points a cloud may keep so that all together stay within the budget: small clouds stay whole."""
    left = budget
    for index, size in enumerate(sorted(sizes)):
        cap = left // (len(sizes) - index)
        if size > cap:
            return cap
        left -= size
    return budget
