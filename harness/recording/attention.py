"""Where each subject looks: eye origin, directions, cones, rays, hits, and the attention curves."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import rerun as rr

from harness.recording import entities
from harness.recording.cones import cone_wire, reach_m
from harness.recording.frame_log import FrameLog
from harness.recording.labels import CUE_COLOURS, Colour, Colours, attention_by_name, subject_names
from harness.runs.results import FrameRecord
from vfoa.types import CUES, Attention, Cone, FrameResult, Rays

ARROW_M = 0.25


def log_attention(log: FrameLog, result: FrameResult, record: FrameRecord, colours: Colours) -> None:
    """All subjects of a frame."""
    names = subject_names(record)
    for attention in result.attentions:
        name = names[attention.subject.track_id]
        reach = reach_m(attention, result.scene)
        _log_eyes(log, attention, name)
        _log_cones(log, attention, name, reach)
        if attention.rays is not None:
            _log_rays(log, attention.cones, attention.rays, name, reach)
    _log_curves(log, record, names, colours)


def _log_eyes(log: FrameLog, attention: Attention, name: str) -> None:
    eyes = attention.subject.person.eye_origin_left
    if eyes is None:
        return
    path = entities.subject_3d(name, "origin")
    log.keep(path, _marker_style, key="style")
    log.log(path, rr.Points3D.from_fields(positions=eyes[None]))
    for cue in CUES:
        direction = attention.subject.direction(cue)
        if direction is not None:
            path = entities.cue_3d(name, cue, "direction")
            log.keep(path, partial(_arrow_style, CUE_COLOURS[cue]), key="style")
            log.log(path, rr.Arrows3D.from_fields(origins=eyes[None], vectors=ARROW_M * direction[None]))


def _log_cones(log: FrameLog, attention: Attention, name: str, reach: float) -> None:
    for cue in CUES:
        wires = [cone_wire(cone, reach) for cone in attention.cones if cone.cue == cue]
        if wires:
            lines = np.stack(wires).astype(np.float32)
            path = entities.cue_3d(name, cue, "cones")
            log.keep(path, partial(_line_style, 0.75, _dim(CUE_COLOURS[cue], 0.7)), key="style")
            log.log(path, rr.LineStrips3D.from_fields(strips=lines))


def _log_rays(log: FrameLog, cones: Sequence[Cone], rays: Rays, name: str, reach: float) -> None:
    """Rays that hit are bright and end where they first enter a box; rays that miss are dim, as long as the cone."""
    of_cone = np.array([cone.cue for cone in cones])
    entry = rays.entry_m
    first = np.fmin.reduce(entry, axis=1) if entry.shape[1] else np.full(len(entry), np.nan)
    hit = np.isfinite(first)
    ends = rays.origin_left + rays.directions * np.where(hit, first, reach)[:, None]
    lines = np.stack([np.broadcast_to(rays.origin_left, ends.shape), ends], axis=1)
    for cue in CUES:
        ours = of_cone[rays.cone_index] == cue
        if not ours.any():
            continue
        bright, dim = CUE_COLOURS[cue], _dim(CUE_COLOURS[cue], 0.2)
        colours = np.where(hit[ours, None], bright, dim).astype(np.uint8)
        # one array of strips costs a tenth of a list of them
        path = entities.cue_3d(name, cue, "rays")
        log.keep(path, partial(_line_style, 0.5), key="style")
        log.log(path, rr.LineStrips3D.from_fields(strips=lines[ours], colors=colours))
        ray, target = np.nonzero(np.isfinite(entry) & ours[:, None])
        if len(ray):
            points = rays.origin_left + rays.directions[ray] * entry[ray, target, None]
            path = entities.cue_3d(name, cue, "hits")
            log.keep(path, partial(_hit_style, bright), key="style")
            log.log(path, rr.Points3D.from_fields(positions=points))


def _log_curves(log: FrameLog, record: FrameRecord, names: dict[int, str], colours: Colours) -> None:
    """One curve per value that was measured."""
    for subject in record.subjects:
        name = names[subject.track_id]
        for target, value in attention_by_name(record, subject).items():
            for what, number in (("total", value.total), ("gaze", value.gaze), ("head", value.head)):
                if number is not None:
                    path = entities.curve(name, what, target)
                    log.keep(path, partial(_style, target, colours.of(target)), key="style")
                    log.number(path, number)


# What never changes of an entity is logged once, and not by time: it also outlives the entity's clearing.


def _marker_style() -> rr.Points3D:
    return rr.Points3D.from_fields(radii=rr.Radius.ui_points(5), colors=[(255, 255, 255)])


def _hit_style(colour: Colour) -> rr.Points3D:
    return rr.Points3D.from_fields(radii=rr.Radius.ui_points(2.5), colors=[colour])


def _arrow_style(colour: Colour) -> rr.Arrows3D:
    return rr.Arrows3D.from_fields(radii=rr.Radius.ui_points(3), colors=[colour])


def _line_style(points: float, colour: Colour | None = None) -> rr.LineStrips3D:
    return rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(points), colors=None if colour is None else [colour])


def _style(target: str, colour: Colour) -> rr.SeriesLines:
    return rr.SeriesLines(names=target, colors=[colour], widths=2)


def _dim(colour: Colour, share: float) -> Colour:
    red, green, blue = colour
    return int(red * share), int(green * share), int(blue * share)
