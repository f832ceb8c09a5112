"""What a frame shows in space: clouds, boxes, eyes, cones, rays, hits; its attention curves, and marks in the image."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
import rerun as rr

from harness.record import Size, entities
from harness.record.appearance import (
    CUE_COLOURS,
    Colour,
    Colours,
    attention_by_name,
    cone_wires,
    reach_m,
    subject_names,
    target_names,
)
from harness.record.frame_log import FrameLog
from harness.record.images import class_context, encoded_depth, png
from harness.run.records import FrameRecord
from vfoa.geometry import depth_from_disparity, quaternion
from vfoa.types import CUES, Attention, Box3D, Cone, Disparity, FrameResult, Map, Percepts, Rays, Scene, StereoFrame

ARROW_M = 0.25


def log_attention(
    log: FrameLog,
    configuration: str,
    result: FrameResult,
    record: FrameRecord,
    colours: Colours,
    known: Sequence[str],
    size: Size,
) -> None:
    """Log all subjects of a frame under a configuration. ``known`` are the names of the manifest, in its order."""
    names = subject_names(record)
    for attention in result.attentions:
        path = entities.subject_3d(configuration, names[attention.subject.track_id])
        reach = reach_m(attention, result.scene)
        _log_eyes(log, path, attention)
        _log_cones(log, path, attention, reach)
        if attention.rays is not None:
            _log_rays(log, path, attention.cones, attention.rays, reach, size)
    _log_curves(log, configuration, record, names, colours, known)
    _log_heads(log, configuration, record, names)
    _log_targets_2d(log, configuration, record, colours)


def _log_eyes(log: FrameLog, path: str, attention: Attention) -> None:
    eyes = attention.subject.person.eye_origin_left
    if eyes is None:
        return
    log.keep(f"{path}/origin", _marker_style, key="style")
    log.row(f"{path}/origin", rr.Points3D, positions=eyes[None])
    for cue in CUES:
        direction = attention.subject.direction(cue)
        if direction is not None:
            arrow = f"{path}/{cue}/direction"
            log.keep(arrow, partial(_arrow_style, CUE_COLOURS[cue]), key="style")
            log.row(arrow, rr.Arrows3D, origins=eyes[None], vectors=ARROW_M * direction[None])


def _log_cones(log: FrameLog, path: str, attention: Attention, reach: float) -> None:
    wires = cone_wires(attention.cones, reach).astype(np.float32)
    for cue in CUES:
        ours = [cone.cue == cue for cone in attention.cones]
        if any(ours):
            log.keep(f"{path}/{cue}/cones", partial(_line_style, 0.75, _dim(CUE_COLOURS[cue], 0.7)), key="style")
            log.row(f"{path}/{cue}/cones", rr.LineStrips3D, strips=wires[ours])


def _log_rays(log: FrameLog, path: str, cones: Sequence[Cone], rays: Rays, reach: float, size: Size) -> None:
    """Log rays: hits are bright and end where they first enter a box; misses are dim and as long as the cone.

    A light recording has every second miss: the cone shows where they all are.
    """
    of_cone = np.array([cone.cue for cone in cones])
    entry = rays.entry_m
    first = np.fmin.reduce(entry, axis=1) if entry.shape[1] else np.full(len(entry), np.nan)
    hit = np.isfinite(first)
    ends = rays.origin_left + rays.directions * np.where(hit, first, reach)[:, None]
    lines = np.stack([np.broadcast_to(rays.origin_left, ends.shape), ends], axis=1).astype(np.float32)
    for cue in CUES:
        ours = of_cone[rays.cone_index] == cue
        bright, dim = CUE_COLOURS[cue], _dim(CUE_COLOURS[cue], 0.2)
        # two entities, so that a colour is one static value and not one per ray
        for part, chosen, colour in (("rays", ours & hit, bright), ("missed_rays", ours & ~hit, dim)):
            if chosen.any():
                every = 2 if size == "light" and part == "missed_rays" else 1
                log.keep(f"{path}/{cue}/{part}", partial(_line_style, 0.5, colour), key="style")
                log.row(f"{path}/{cue}/{part}", rr.LineStrips3D, strips=lines[chosen][::every])
        ray, target = np.nonzero(np.isfinite(entry) & ours[:, None])
        if len(ray):
            points = rays.origin_left + rays.directions[ray] * entry[ray, target, None]
            log.keep(f"{path}/{cue}/hits", partial(_hit_style, bright), key="style")
            log.row(f"{path}/{cue}/hits", rr.Points3D, positions=points)


def _log_curves(
    log: FrameLog,
    configuration: str,
    record: FrameRecord,
    names: dict[int, str],
    colours: Colours,
    known: Sequence[str],
) -> None:
    """Log the curves of each subject: those of the manifest's names in one entity, any other one in its own.

    An entity takes 4 kB, however few its frames. A value that was not measured is NaN, which leaves a gap.
    """
    for subject in record.subjects:
        values, of = attention_by_name(record, subject), names[subject.track_id]
        others = [name for name in dict.fromkeys(known) if name != of]
        for what in ("total", *CUES):
            found = {name: number for name, value in values.items() if (number := getattr(value, what)) is not None}
            numbers = np.array([found.pop(name, np.nan) for name in others])
            if not np.isnan(numbers).all():
                path = entities.curves(configuration, of, what)
                log.keep(path, partial(_style, others, colours), key="style")
                log.row(path, rr.Scalars, scalars=numbers)
            for name, number in found.items():
                path = entities.curve(configuration, of, what, name)
                log.keep(path, partial(_style, [name], colours), key="style")
                log.number(path, number)


def _log_heads(log: FrameLog, configuration: str, record: FrameRecord, names: dict[int, str]) -> None:
    """Log the box of every subject's head, with the subject's name."""
    for subject in record.subjects:
        if subject.head_box_px is None:
            continue
        name = names[subject.track_id]
        path = entities.head_box(configuration, name)
        log.keep(path, partial(_head_style, name), key="style")
        u0, v0, u1, v1 = subject.head_box_px
        corners = np.array([[u0, v0], [u1, v1]])
        log.row(path, rr.Boxes2D, centers=corners.mean(axis=0)[None], half_sizes=np.diff(corners, axis=0) / 2)


def _log_targets_2d(log: FrameLog, configuration: str, record: FrameRecord, colours: Colours) -> None:
    """Log one batch of 2D boxes around the masks, so that the image names all targets without a pointer over them."""
    seen = [(target, target.box_px) for target in record.targets if target.box_px is not None]
    if not seen:
        return
    shades = np.array([colours.of(target.name) for target, _ in seen], dtype=np.uint8)
    corners = np.array([box_px for _, box_px in seen]).reshape(-1, 2, 2)
    middles, half_sizes = corners.mean(axis=1), (corners[:, 1] - corners[:, 0]) / 2
    captions = _captions(record, target_names(record))
    path = entities.image_marks(configuration, "targets")
    log.keep(f"{path}/box2d", _target_style, key="style")
    log.row(f"{path}/box2d", rr.Boxes2D, centers=middles, half_sizes=half_sizes, colors=shades)
    # the viewer puts a box's caption below the box, which is often below the image
    labels = [captions[target.instance_id] for target, _ in seen]
    log.keep(f"{path}/caption", _caption_style, key="style")
    log.row(f"{path}/caption", rr.Points2D, positions=middles, labels=labels, colors=shades)


def _captions(record: FrameRecord, names: Mapping[int, str]) -> dict[int, str]:
    """``bird 0.42`` with one subject; with several only the name, since the values would hide the scene."""
    if len(record.subjects) != 1:
        return dict(names)
    totals = {value.instance_id: value.total for value in record.subjects[0].attention if value.total > 0}
    return {number: f"{name} {totals[number]:.2f}" if number in totals else name for number, name in names.items()}


# Values of an entity that never change are static: they are logged once, and outlive the clearing of the entity.


def _marker_style() -> rr.Points3D:
    return rr.Points3D.from_fields(radii=rr.Radius.ui_points(5), colors=[(255, 255, 255)])


def _hit_style(colour: Colour) -> rr.Points3D:
    return rr.Points3D.from_fields(radii=rr.Radius.ui_points(2.5), colors=[colour])


def _arrow_style(colour: Colour) -> rr.Arrows3D:
    return rr.Arrows3D.from_fields(radii=rr.Radius.ui_points(3), colors=[colour])


def _line_style(points: float, colour: Colour) -> rr.LineStrips3D:
    return rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(points), colors=[colour])


def _style(names: Sequence[str], colours: Colours) -> rr.SeriesLines:
    return rr.SeriesLines(names=names, colors=[colours.of(name) for name in names], widths=[2] * len(names))


def _dim(colour: Colour, share: float) -> Colour:
    red, green, blue = colour
    return int(red * share), int(green * share), int(blue * share)


def _target_style() -> rr.Boxes2D:
    return rr.Boxes2D.from_fields(radii=rr.Radius.ui_points(0.75))


def _caption_style() -> rr.Points2D:
    return rr.Points2D.from_fields(radii=rr.Radius.ui_points(1.5), show_labels=True)


def _head_style(name: str) -> rr.Boxes2D:
    return rr.Boxes2D.from_fields(labels=[name], colors=[(255, 255, 255)])


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
