"""A failure as a strip: the left image with masks and boxes, the scene in 3D, and the attention over time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from harness.labels.labels import NOWHERE, Label
from harness.record.appearance import Colour, Colours, target_names, totals_by_name
from harness.record.frame_reading import FrameContent
from harness.report.figures.style import INK, OFF, RIGHT, SOFT, add_legend_below, canvas, is_wide
from harness.run.records import BoxRecord, FrameRecord
from harness.score.verdicts import Verdict, answered, find_subject, true_targets
from vfoa.types import Cue, Float

CUES = {"gaze": "#c99700", "head": "#2f6fde"}
_MASK_OPACITY = 0.4
_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4)]
"""Edges of a box, between corners whose numbers differ in one bit."""
_SIGNS = np.array([[1 if corner >> axis & 1 else -1 for axis in range(3)] for corner in range(8)], dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class WrongFrame:
    """A wrong frame: verdict and label, what the recording shows, records and verdicts of frames around it, in order.

    ``targets`` are the names of the clip's targets in the order of their colours.
    """

    verdict: Verdict
    label: Label
    content: FrameContent
    records: Sequence[FrameRecord]
    verdicts: Sequence[Verdict]
    targets: Sequence[str]

    @property
    def record(self) -> FrameRecord:
        """The record of the frame itself."""
        return next(record for record in self.records if record.frame == self.verdict.frame)

    @property
    def title(self) -> str:
        """Where it is, and what is wrong."""
        v = self.verdict
        where = f"{v.clip}, {v.configuration}, frame {v.frame}"
        error = (v.error_type or "").replace("_", " ")
        return f"{where}: {v.subject} looks at {v.truth}, answered: {answered(v)} ({error})"

    @cached_property
    def marks(self) -> dict[int, str]:
        """The colour that marks a target as the truth or as the answer, by instance id; the others have none."""
        subject = find_subject(self.record, self.verdict.subject)
        answer = {} if subject is None or subject.focus is None else {subject.focus: OFF}
        return answer | {target.instance_id: RIGHT for target in true_targets(self.record, self.label)}


def strip(failure: WrongFrame, width: float) -> Figure:
    """The three panels, side by side in two columns, below each other in one."""
    colours, wide = Colours(failure.targets), is_wide(width)
    shape = (436, 1024) if failure.content.image is None else failure.content.image.shape
    aspect = shape[0] / shape[1]
    if wide:
        figure = canvas(width, 2.45)
        grid = figure.add_gridspec(1, 3, width_ratios=[1.25, 1, 1])
    else:
        figure = canvas(width, 0.75 + width * aspect + 2.2 + 1.5)
        grid = figure.add_gridspec(3, 1, height_ratios=[width * aspect, 2.2, 1.5])
    _draw_image(figure.add_subplot(grid[0]), failure, colours)
    _draw_scene(figure.add_subplot(grid[1], projection="3d"), failure, colours)
    curves = figure.add_subplot(grid[2])
    _draw_curves(curves, failure, colours)
    figure.suptitle(failure.title, fontsize=7, wrap=True)
    handles = [*curves.get_lines(), *_marks(failure.content.cones)]
    named = [handle for handle in handles if not str(handle.get_label()).startswith("_")]
    add_legend_below(figure, named, columns=7 if wide else 3)
    return figure


def _marks(cues: Iterable[Cue]) -> list[Any]:
    """What the legend says beside the targets; ``cues`` have cones."""
    boxes = ((RIGHT, "true target"), (OFF, "answer"))
    cones = [Line2D([], [], color=CUES[cue], lw=0.8, label=f"cones of the {cue}") for cue in cues]
    return [*(Rectangle((0, 0), 1, 1, fill=False, ec=colour, lw=1.4, label=label) for colour, label in boxes), *cones]


def _css(colour: Colour) -> tuple[float, float, float]:
    """A colour of names as on the dark background of the viewer, a little darker for paper."""
    red, green, blue = (0.82 * part / 255 for part in colour)
    return red, green, blue


def _draw_image(axes: Any, failure: WrongFrame, colours: Colours) -> None:
    content, record = failure.content, failure.record
    axes.set_axis_off()
    axes.set_title("left image", loc="left")
    if content.image is None:
        axes.text(0.5, 0.5, "no image was recorded", ha="center", color=SOFT)
        return
    axes.imshow(content.image, interpolation="bilinear")
    if content.masks is not None:
        masks = content.masks.copy()
        masks[..., 3] = (masks[..., 3] > 0) * int(255 * _MASK_OPACITY)
        axes.imshow(masks, interpolation="nearest")
    names = target_names(record)
    for target in record.targets:
        if target.box_px is None:
            continue
        mark = failure.marks.get(target.instance_id)
        colour = mark or _css(colours.of(target.name))
        _rectangle(axes, target.box_px, colour, 1.4 if mark else 0.6)
        if mark or target.name in failure.targets:
            x, y = target.box_px[0], target.box_px[1]
            axes.text(x + 3, y + 3, names[target.instance_id], color="white", size=5, va="top", bbox=_plate(colour))
    for subject in record.subjects:
        if subject.head_box_px is not None:
            _rectangle(axes, subject.head_box_px, "white", 1.2 if subject.name == failure.verdict.subject else 0.5)


def _plate(colour: Any) -> dict[str, Any]:
    return {"facecolor": colour, "edgecolor": "none", "pad": 0.6, "alpha": 0.85}


def _rectangle(axes: Any, box_px: Sequence[float], colour: Any, width: float) -> None:
    x0, y0, x1, y1 = box_px
    axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, fill=False, ec=colour, lw=width))


def _draw_scene(axes: Any, failure: WrongFrame, colours: Colours) -> None:
    """Boxes, clouds, and the person's cones, in metres: x right, z away from the camera, height up."""
    record, names = failure.record, target_names(failure.record)
    seen: list[Float] = []
    for target in record.targets:
        mark = failure.marks.get(target.instance_id)
        colour = _css(colours.of(target.name))
        if (cloud := failure.content.clouds.get(target.instance_id)) is not None:
            axes.scatter(*_upright(cloud).T, s=0.6, color=colour, lw=0, alpha=0.8, rasterized=True)
        if target.box is None:
            continue
        corners = _upright(_corners(target.box))
        seen.append(corners)
        for edge in _EDGES:
            axes.plot(*corners[list(edge)].T, color=mark or colour, lw=1.2 if mark else 0.5)
        if mark:
            top = corners[corners[:, 2].argmax()]
            axes.text(*top, names[target.instance_id], color=mark, size=5.5)
    for cue, wires in failure.content.cones.items():
        for wire in wires:
            axes.plot(*_upright(wire).T, color=CUES[cue], lw=0.4)
    subject = find_subject(record, failure.verdict.subject)
    if subject is not None and subject.eye_origin_m is not None:
        eyes = _upright(np.array([subject.eye_origin_m]))
        seen.append(eyes)
        axes.scatter(*eyes.T, s=8, color=INK, depthshade=False)
    if seen:
        points = np.concatenate(seen)
        low, high = points.min(axis=0), points.max(axis=0)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        axes.set_box_aspect(np.maximum(high - low, 0.2), zoom=1.15)
    axes.view_init(elev=22, azim=-62)
    axes.set_title("scene in metres", loc="left")
    axes.tick_params(labelsize=5, pad=-3)
    axes.locator_params(nbins=4)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.pane.set(facecolor="white", edgecolor="#d9dde4")


def _upright(points: Float) -> Float:
    """Points (N, 3) of the camera frame (x right, y down, z away) as (right, away, up)."""
    return points[:, [0, 2, 1]] * np.array([1.0, 1.0, -1.0])


def _corners(box: BoxRecord) -> Float:
    """The corners (8, 3) of a box, camera frame, metres; ``axes`` are the box's own axes as rows."""
    return np.array(box.center_m) + (_SIGNS * np.array(box.half_size_m)) @ np.array(box.axes)


def _draw_curves(axes: Any, failure: WrongFrame, colours: Colours) -> None:
    """The attention to each target, of a probability also that to none, over what was true and what was answered."""
    who = failure.verdict.subject
    probabilistic = any(verdict.confidence is not None for verdict in failure.verdicts)
    frames = [record.frame for record in failure.records]
    totals: dict[str, list[float]] = {}
    for place, record in enumerate(failure.records):
        if (subject := find_subject(record, who)) is not None:
            for name, total in totals_by_name(record, subject, probabilistic=probabilistic).items():
                totals.setdefault(name, [np.nan] * len(frames))[place] = total
    most = max([0.1, *(value for values in totals.values() for value in values if not np.isnan(value))])
    attended = {name: values for name, values in totals.items() if np.nanmax(values) > 0.02 * most}
    for name, values in attended.items():
        wide = 1.6 if name in (failure.verdict.truth, failure.verdict.predicted) else 0.8
        axes.plot(frames, values, color=_css(colours.of(name)), lw=wide, label=name)
    axes.axvline(failure.verdict.frame, color=INK, lw=0.8, ls=(0, (2, 2)))
    row = 0.13 * most
    lanes = {"truth": [v.truth for v in failure.verdicts], "answer": [v.predicted for v in failure.verdicts]}
    for number, (lane, names) in enumerate(lanes.items()):
        y = -row * (number + 1.15)
        for verdict, target in zip(failure.verdicts, names, strict=True):
            if target is not None and (target in failure.targets or target == NOWHERE):
                fill = _css(colours.of(target))
                axes.add_patch(Rectangle((verdict.frame - 0.5, y), 1, 0.85 * row, fc=fill, ec="none"))
        axes.text(frames[0] - 0.7, y + 0.4 * row, lane, ha="right", va="center", size=5.5)
    axes.axhline(0, color=SOFT, lw=0.5)
    axes.set(xlim=(frames[0] - 0.5, frames[-1] + 0.5), ylim=(-2.4 * row, 1.05 * most))
    axes.set_yticks([tick for tick in axes.get_yticks() if 0 <= tick <= 1.05 * most])
    axes.set(xlabel="frame", ylabel=f"attention of {who}")
    axes.set_title("attention", loc="left")
