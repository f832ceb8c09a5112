"""What a frame shows in space: clouds, boxes, eyes, cones, rays, hits; its attention curves, and marks in the image."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache, partial

import numpy as np
import rerun as rr

from harness.labels.labels import NOWHERE
from harness.record import entities
from harness.record.appearance import (
    ARROW_M,
    CUE_COLOURS,
    Colour,
    Colours,
    attention_by_name,
    cone_wires,
    distinct_names,
    reach_m,
    subject_names,
    target_names,
    totals_by_name,
)
from harness.record.frame_log import FrameLog
from harness.record.images import class_context, png
from harness.run.records import FrameRecord
from vfoa.geometry import quaternion
from vfoa.types import CUES, Attention, Cone, Disparity, FrameResult, Rays, Scene

CLOUD_POINTS = 100
"""Most points of a cloud: enough to show its shape and its outliers."""

_STEPS = 128
"""The disparities of a frame are rounded to at most this many steps, as many as colours can show."""

_WHITE: Colour = (255, 255, 255)
_EYE = {"radii": rr.Radius.ui_points(5), "colors": [_WHITE]}
_CLOUD = {"radii": rr.Radius.ui_points(1.5)}
_BOX = {
    "fill_mode": rr.components.FillMode.MajorWireframe,
    "radii": rr.Radius.ui_points(1.5),
    "show_labels": True,
}
_TARGET = {"radii": rr.Radius.ui_points(0.75)}
_CAPTION = {"radii": rr.Radius.ui_points(1.5), "show_labels": True}


def log_attention(
    log: FrameLog,
    configuration: str,
    result: FrameResult,
    record: FrameRecord,
    colours: Colours,
    known: Sequence[str],
    *,
    probabilistic: bool,
) -> None:
    """Log all subjects of a frame under a configuration. ``known`` are the names of the manifest, in its order.

    ``probabilistic``: attention is a probability, and looking at nothing has the rest up to 1.
    """
    names = subject_names(record)
    for attention in result.attentions:
        path = entities.subject_3d(configuration, names[attention.subject.track_id])
        reach = reach_m(attention, result.scene)
        _log_eyes(log, path, attention)
        cones, rays = attention.cones, attention.rays
        _log_cones(log, path, cones, reach)
        if rays is not None:
            _log_rays(log, path, cones, rays, reach)
    _log_curves(log, configuration, record, names, colours, known, probabilistic=probabilistic)
    _log_heads(log, configuration, record, names)
    _log_targets_2d(log, configuration, record, colours)


def _log_eyes(log: FrameLog, path: str, attention: Attention) -> None:
    eyes = attention.subject.person.eye_origin_left
    if eyes is None:
        return
    log.row(f"{path}/origin", rr.Points3D, style=_EYE, positions=eyes[None])
    for cue in CUES:
        direction = attention.subject.direction(cue)
        if direction is not None:
            arrow, style = f"{path}/{cue}/direction", _style(3, CUE_COLOURS[cue])
            log.row(arrow, rr.Arrows3D, style=style, origins=eyes[None], vectors=ARROW_M * direction[None])


def _log_cones(log: FrameLog, path: str, cones: Sequence[Cone], reach: float) -> None:
    wires = cone_wires(cones, reach).astype(np.float32)
    for cue in CUES:
        ours = [cone.cue == cue for cone in cones]
        if any(ours):
            style = _style(0.75, _dim(CUE_COLOURS[cue], 0.7))
            log.row(f"{path}/{cue}/cones", rr.LineStrips3D, style=style, strips=wires[ours])


def _log_rays(log: FrameLog, path: str, cones: Sequence[Cone], rays: Rays, reach: float) -> None:
    """Log rays: hits are bright and end where they first enter a box; misses are dim and as long as the cone.

    Every second miss is left out: the cone shows where they all are.
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
        for part, strips, colour in (
            ("rays", lines[ours & hit], bright),
            ("missed_rays", lines[ours & ~hit][::2], dim),
        ):
            if len(strips):
                log.row(f"{path}/{cue}/{part}", rr.LineStrips3D, style=_style(0.5, colour), strips=strips)
        ray, target = np.nonzero(np.isfinite(entry) & ours[:, None])
        if len(ray):
            points = rays.origin_left + rays.directions[ray] * entry[ray, target, None]
            log.row(f"{path}/{cue}/hits", rr.Points3D, style=_style(2.5, bright), positions=points)


def _log_curves(
    log: FrameLog,
    configuration: str,
    record: FrameRecord,
    names: dict[int, str],
    colours: Colours,
    known: Sequence[str],
    *,
    probabilistic: bool,
) -> None:
    """Log the curves of each subject: one entity for all names of the manifest, one for each other name.

    An entity takes 4 kB, however few its frames. A value that was not measured is NaN, which leaves a gap.
    """
    for subject in record.subjects:
        values = attention_by_name(record, subject, probabilistic=probabilistic)
        person = names[subject.track_id]
        curves: dict[str, dict[str, float]] = {
            "total": totals_by_name(record, subject, probabilistic=probabilistic),
            **{
                cue: {name: number for name, value in values.items() if (number := getattr(value, cue)) is not None}
                for cue in CUES
            },
        }
        for what, by_name in curves.items():
            nowhere = (NOWHERE,) if probabilistic and what == "total" else ()
            others = [name for name in dict.fromkeys((*known, *nowhere)) if name != person]
            numbers = np.array([by_name.pop(name, np.nan) for name in others])
            if not np.isnan(numbers).all():
                path = entities.curves(configuration, person, what)
                log.keep(path, partial(_lines, others, colours), key="style")
                log.row(path, rr.Scalars, scalars=numbers)
            for name, number in by_name.items():
                path = entities.curves(configuration, person, what, name)
                log.keep(path, partial(_lines, [name], colours), key="style")
                log.number(path, number)


def _log_heads(log: FrameLog, configuration: str, record: FrameRecord, names: dict[int, str]) -> None:
    """Log the box of every subject's head, with the subject's name."""
    for subject in record.subjects:
        if subject.head_box_px is None:
            continue
        name = names[subject.track_id]
        low, high = np.array(subject.head_box_px).reshape(2, 1, 2)
        log.row(
            entities.head_box(configuration, name),
            rr.Boxes2D,
            style={"labels": [name], "colors": [_WHITE]},
            centers=(low + high) / 2,
            half_sizes=(high - low) / 2,
        )


def _log_targets_2d(log: FrameLog, configuration: str, record: FrameRecord, colours: Colours) -> None:
    """Log one batch of 2D boxes around the masks, so that the image names all targets without a pointer over them."""
    seen = [(target, target.box_px) for target in record.targets if target.box_px is not None]
    if not seen:
        return
    shades = np.array([colours.of(target.name) for target, _ in seen], dtype=np.uint8)
    corners = np.array([box_px for _, box_px in seen]).reshape(-1, 2, 2)
    middles, half_sizes = corners.mean(axis=1), (corners[:, 1] - corners[:, 0]) / 2
    path = entities.image_marks(configuration, "targets")
    log.row(f"{path}/box2d", rr.Boxes2D, style=_TARGET, centers=middles, half_sizes=half_sizes, colors=shades)
    # the viewer puts a box's caption below the box, which is often below the image
    captions = _captions(record, target_names(record))
    labels = [captions[target.instance_id] for target, _ in seen]
    log.row(f"{path}/caption", rr.Points2D, style=_CAPTION, positions=middles, labels=labels, colors=shades)


def _captions(record: FrameRecord, names: Mapping[int, str]) -> dict[int, str]:
    """``bird 0.42`` with one subject; with several only the name, since the values would hide the scene."""
    if len(record.subjects) != 1:
        return dict(names)
    totals = {value.instance_id: value.total for value in record.subjects[0].attention if value.total > 0}
    return {number: f"{name} {totals[number]:.2f}" if number in totals else name for number, name in names.items()}


@cache
def _style(points: float, colour: Colour) -> dict[str, object]:
    return {"radii": rr.Radius.ui_points(points), "colors": [colour]}


def _lines(names: Sequence[str], colours: Colours) -> rr.SeriesLines:
    return rr.SeriesLines(names=names, colors=[colours.of(name) for name in names], widths=[2] * len(names))


def _dim(colour: Colour, share: float) -> Colour:
    red, green, blue = colour
    return int(red * share), int(green * share), int(blue * share)


def log_disparity(log: FrameLog, name: str, disparity: Disparity) -> None:
    """Log every second row and column of the disparity, in pixels: picked, not averaged, so that edges stay sharp."""
    longest = float(np.nan_to_num(np.fmax.reduce(disparity.disparity_px, axis=None), nan=1.0))
    per_px = float(np.clip(2.0 ** np.floor(np.log2(_STEPS / max(longest, 1))), 1, 8))
    steps = np.rint(disparity.disparity_px[::2, ::2] * per_px)
    log.row(
        entities.disparity(name),
        rr.EncodedDepthImage,
        blob=[png(np.nan_to_num(np.clip(steps, 1, 65535), nan=0).astype(np.uint16))],
        media_type=["image/png"],
        meter=[per_px],
        colormap=[rr.components.Colormap.Turbo],
        depth_range=[(0, longest * per_px)],
    )


def log_targets(log: FrameLog, name: str, scene: Scene, colours: Colours) -> None:
    """Log the cloud and the box of every target, in its colour and with its name."""
    names = distinct_names(scene.names)
    for target in scene.targets:
        number, points = target.instance.id, target.points_left
        if len(points) > CLOUD_POINTS:
            points = points[np.linspace(0, len(points) - 1, CLOUD_POINTS).astype(np.intp)]
        class_ids = [colours.class_of(scene.names[number])]
        if len(points):
            path = entities.points(name, number)
            log.row(path, rr.Points3D, style=_CLOUD, positions=points, class_ids=class_ids)
        if target.box is not None:
            log.row(
                entities.box(name, number),
                rr.Boxes3D,
                style=_BOX,
                centers=target.box.center_m[None],
                half_sizes=target.box.half_size_m[None],
                quaternions=[quaternion(target.box.left_from_box)],
                labels=[names[number]],
                class_ids=class_ids,
            )
    known = colours.known
    log.keep(entities.scene(name), lambda: class_context(known), key=tuple(known))
