"""Layouts in which recordings open: one configuration, several, or two side by side; with a tab for each person."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import AbsoluteTimeRange

from harness.record import entities
from harness.record.layers import LayerNames
from vfoa.geometry import box_corners, unit
from vfoa.types import CUES, Float, Scene

FROM_MIDDLE = np.array([0.46, -0.4, -0.55]) / np.linalg.norm([0.46, -0.4, -0.55])
"""The unit vector from the middle of the scene to the viewer's eye: right of the camera, above, and behind it."""

HALF_VIEW = np.tan(np.radians(26)) * np.array([1.2, 1])
"""Tangents of half of the angles, across and down, in which the scene is seen: Rerun shows 55 degrees down, and the
view is wider than high."""

LEAST_M = 0.2
"""Distance of the eye to the nearest point of a small scene, metres."""

MOST_TABS = 8
"""Most subjects with tabs of their own; if there are more, all share one tab, beside that of the one asked for."""

EVERYONE = "Everyone"


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipContent:
    """The content of a clip's recording: the kinds of its images, the extent of its scene, and how it is played.

    ``per_second`` is how many numbers of frames a second has.
    ``eye`` is the position (3,) and the look-at point (3,) of the viewer's eye, camera frame, metres. ``span`` is the
    first and the last frame, None if they are not known yet; ``opens_at`` the frame that is shown first, None for the
    first one. ``is_from_0``: its times begin near 0, unlike those of
    a clock. ``curves`` are the entity paths of attention that have values; ``probabilistic`` the configurations in
    which these are probabilities.
    """

    has_images: bool
    has_right: bool
    has_measured_depth: bool
    eye: tuple[Float, Float]
    per_second: float
    span: tuple[int, int] | None = None
    opens_at: int | None = None
    is_from_0: bool = True
    curves: frozenset[str] = frozenset()
    probabilistic: frozenset[str] = frozenset()

    def has_curves(self, path: str) -> bool:
        """Whether there are values at an entity path, or below it."""
        return any(curve == path or curve.startswith(f"{path}/") for curve in self.curves)


def clip_layout(
    layers: Sequence[LayerNames], shown: ClipContent, subjects: Sequence[str], first: str | None
) -> rrb.Blueprint:
    """One configuration of a clip, or several as tabs; the tab of the subject ``first`` is in front (None: any)."""
    parts = [_by_subject(subjects, first, partial(_wide, layer, shown)) for layer in layers]
    if len(parts) == 1:
        return _blueprint(parts[0], shown)
    named = [rrb.Vertical(part, name=layer.configuration) for part, layer in zip(parts, layers, strict=True)]
    return _blueprint(rrb.Tabs(*named, active_tab=0), shown)


def file_layout(layers: LayerNames, shown: ClipContent) -> rrb.Blueprint:
    """One configuration in few views, without tabs by person: in each file for those who open it without vfoa.

    The layout of three people's tabs would take 300 kB, this one takes 60.
    """
    return _blueprint(_wide(layers, shown, None, most=1), shown)


def comparison_layout(
    pair: Sequence[LayerNames], shown: ClipContent, subjects: Sequence[str], first: str | None
) -> rrb.Blueprint:
    """Two configurations of a clip side by side, in columns of the same layout, so that rows can be compared."""
    columns = _by_subject(
        subjects, first, lambda who: rrb.Horizontal(*(_column(layers, shown, who) for layers in pair))
    )
    return _blueprint(columns, shown)


def _blueprint(content: rrb.Container, shown: ClipContent) -> rrb.Blueprint:
    return rrb.Blueprint(
        content,
        _time_panel(shown),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def _time_panel(shown: ClipContent) -> rrb.TimePanel:
    panel = partial(rrb.TimePanel, timeline="frame", fps=shown.per_second, state="collapsed")
    if shown.opens_at is None:
        return panel(play_state="paused")
    # the viewer opens at the first frame, unless it plays others: it plays this one until the cursor is moved
    chosen = AbsoluteTimeRange(shown.opens_at, shown.opens_at)
    return panel(play_state="playing", loop_mode="selection", time_selection=chosen)


def _by_subject(names: Sequence[str], first: str | None, build: Callable[[str | None], rrb.Container]) -> rrb.Container:
    """A tab for each person, and one for all of them (None)."""
    if len(names) > MOST_TABS:
        names = [name for name in names if name == first]
    elif len(names) == 1:
        return build(names[0])
    if not names:
        return build(None)
    tabs = [rrb.Vertical(build(name), name=name) for name in names]
    active = names.index(first) if first in names else 0
    return rrb.Tabs(*tabs, rrb.Vertical(build(None), name=EVERYONE), active_tab=active)


def _wide(layers: LayerNames, shown: ClipContent, subject: str | None, *, most: int | None = None) -> rrb.Horizontal:
    """The 3D scene on the left, images and plots on the right; at most ``most`` images and documents."""
    images = _images(layers, shown, subject)[:most]
    scene = rrb.Vertical(rrb.Tabs(*images, active_tab=0), _world(layers, shown, subject), row_shares=[5, 6])
    meaning = rrb.Vertical(
        rrb.Tabs(*_documents(layers)[:most], active_tab=0),
        _plots(layers, subject, shown),
        _states(layers, subject, shown),
        row_shares=[4.1, 3.5, 2.2],
    )
    return rrb.Horizontal(scene if images else _world(layers, shown, subject), meaning, column_shares=[3, 2])


def _column(layers: LayerNames, shown: ClipContent, subject: str | None) -> rrb.Vertical:
    """One configuration from top to bottom."""
    images = _images(layers, shown, subject)[:1]
    below = rrb.Tabs(*_documents(layers)[:1], _plot(layers, shown, subject, "total"), active_tab=0)
    parts: list[rrb.Container | rrb.View] = [
        *images,
        _world(layers, shown, subject),
        below,
        _states(layers, subject, shown),
    ]
    return rrb.Vertical(*parts, row_shares=[5, 5, 3.4, 3.8][-len(parts) :], name=layers.configuration)


def _images(layers: LayerNames, shown: ClipContent, subject: str | None) -> list[rrb.Spatial2DView]:
    if not shown.has_images:
        return []
    views = [_left_image(layers, subject)]
    if shown.has_right:
        views.append(rrb.Spatial2DView(origin=entities.disparity(layers.reconstruction), name="Disparity"))
        views.append(rrb.Spatial2DView(origin=entities.RIGHT, name="Right image"))
    if shown.has_measured_depth:
        views.append(_camera_view([entities.MEASURED_DEPTH], "Measured depth"))
    return views


def _left_image(layers: LayerNames, subject: str | None) -> rrb.Spatial2DView:
    # the world is projected into the image: all rays would hide the scene, the outlines of cones do not
    marks = [
        entities.IMAGE,
        entities.masks(layers.masks),
        f"{entities.image_marks(layers.configuration)}/**",
        f"{_of_subject(entities.subject_3d, layers, subject)}/**",
        f"{_of_subject(entities.answer_3d, layers, subject)}/**",
    ]
    hidden = [
        entities.subject_3d(layers.configuration, subject, cue, part) for cue in CUES for part in _RAYS if subject
    ]
    return _camera_view([*marks, *(f"- {path}" for path in hidden)], f"Left image, {layers.configuration}")


_RAYS = ("rays", "missed_rays", "hits")


def _camera_view(contents: Sequence[str], name: str) -> rrb.Spatial2DView:
    return rrb.Spatial2DView(origin=entities.CAMERA, contents=[entities.CAMERA, *contents], name=name)


def _world(layers: LayerNames, shown: ClipContent, subject: str | None) -> rrb.Spatial3DView:
    contents = [
        entities.WORLD,
        entities.CAMERA,
        entities.IMAGE,
        f"{entities.scene(layers.reconstruction)}/**",
        f"{_of_subject(entities.subject_3d, layers, subject)}/**",
        f"{_of_subject(entities.answer_3d, layers, subject)}/**",
    ]
    return rrb.Spatial3DView(
        origin=entities.WORLD,
        contents=contents,
        name=f"Scene in metres, {subject or EVERYONE.lower()}",
        line_grid=False,
        eye_controls=orbital_eye(*shown.eye),
    )


def _of_subject(path: Callable[..., str], layers: LayerNames, subject: str | None) -> str:
    return path(layers.configuration, *([subject] if subject else []))


def _documents(layers: LayerNames) -> list[rrb.TextDocumentView | rrb.TextLogView]:
    return [
        rrb.TextDocumentView(origin=entities.summary(layers.configuration), name="This frame"),
        rrb.TextLogView(origin=entities.log(layers.configuration), name="Failures"),
        rrb.TextDocumentView(origin=entities.GUIDE, name="How to read this"),
    ]


def _plots(layers: LayerNames, subject: str | None, shown: ClipContent) -> rrb.Tabs | rrb.TimeSeriesView:
    """The attention to each target, and a tab for the part of each cue that was measured."""
    room, span = None, shown.span
    # room for the legend, which would hide the first frames; on the timeline of times, it is there from 0 on
    if span is not None and shown.is_from_0:
        left = rrb.TimeRangeBoundary.absolute(seq=int(span[0] - _LEGEND_SHARE * (span[1] - span[0])))
        # the range holds on the timeline of times, too, where a last frame would be some nanoseconds
        room = rrb.TimeAxis(view_range=rr.TimeRange(start=left, end=rrb.TimeRangeBoundary.infinite()))
    if subject is None:
        return _plot(layers, shown, None, "total", room, legend=True)
    cues = [cue for cue in CUES if shown.has_curves(entities.curves(layers.configuration, subject, cue))]
    plots = [_plot(layers, shown, subject, value, room, legend=True) for value in ("total", *cues)]
    return rrb.Tabs(*plots, active_tab=0)


_LEGEND_SHARE = 0.22
"""Room left of a plot's first frame, as a share of all frames."""


def _plot(
    layers: LayerNames,
    shown: ClipContent,
    subject: str | None,
    value: str,
    room: rrb.TimeAxis | None = None,
    *,
    legend: bool = False,
) -> rrb.TimeSeriesView:
    # values of narrow cones are all small, and who wins matters: their vertical axis fits the data
    axis = rrb.ScalarAxis(range=(0, 1)) if layers.configuration in shown.probabilistic else None
    corner, contents = rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=legend), ["$origin/**"]
    if subject is None:
        # of each person the total alone: the parts of the cues have the same names and colours
        origin, name = f"{entities.ATTENTION}/{rr.escape_entity_path_part(layers.configuration)}", "Attention"
        own = sorted(path for path in shown.curves if path.startswith(f"{origin}/"))
        contents += [f"- {path}" for path in own if not entities.is_total(path)]
    else:
        origin = entities.curves(layers.configuration, subject, value)
        name = f"Attention of {subject}" if value == "total" else f"by {value}"
    return rrb.TimeSeriesView(origin=origin, contents=contents, name=name, plot_legend=corner, axis_x=room, axis_y=axis)


def _states(layers: LayerNames, subject: str | None, shown: ClipContent) -> rrb.StateTimelineView:
    origin, window = _of_subject(entities.verdict, layers, subject), None
    if shown.span is not None and shown.per_second > _MOST_NUMBERS:
        half = min(round(_HALF_WINDOW_S * shown.per_second), shown.span[1] - shown.span[0])
        before, after = (rrb.TimeRangeBoundary.cursor_relative(seq=numbers) for numbers in (-half, half))
        window = rrb.TimeAxis(view_range=rr.TimeRange(start=before, end=after))
    return rrb.StateTimelineView(origin=origin, name="Truth, prediction, verdict", time_view=window)


_MOST_NUMBERS, _HALF_WINDOW_S = 10_000, 10.0
"""The viewer shows a thousand numbers of frames about the cursor, which are a microsecond of frames that are time
stamps. If a second has more numbers than this, it shows these seconds before and after the cursor, or the clip."""


def orbital_eye(position: Float, look_target: Float) -> rrb.EyeControls3D:
    """An eye that the mouse turns around its look-at point, with the camera's up direction."""
    return rrb.EyeControls3D(kind=rrb.Eye3DKind.Orbital, position=position, look_target=look_target, eye_up=(0, -1, 0))


def eye_of_scene(scene: Scene) -> tuple[Float, Float]:
    """Position (3,) and look-at point (3,) of an eye that sees the whole scene: see :func:`eye_on`."""
    boxes = [target.box for target in scene.targets if target.box is not None]
    eyes = [person.eye_origin_left[None] for person in scene.people if person.eye_origin_left is not None]
    return eye_on([*box_corners(boxes), *eyes])


def eye_on(seen: Sequence[Float]) -> tuple[Float, Float]:
    """Position (3,) and look-at point (3,) of the nearest eye that sees all points, each (N, 3), camera frame, metres.

    It is above and to the side of the left camera, so that depth, which the image hides, is visible.
    """
    points = np.concatenate(seen) if seen else np.array([[-0.5, -0.3, 1.0], [0.5, 0.3, 2.0]])
    right = unit(np.cross(FROM_MIDDLE, [0, 1, 0]))
    axes = np.array([right, np.cross(right, FROM_MIDDLE), -FROM_MIDDLE])
    places = points @ axes.T
    aside, ahead = places[:, :2], places[:, 2]
    # an eye at 0 sees a point, across and down, if it is between low and high; farther back these are farther apart
    low, high = _sides(aside, HALF_VIEW * ahead[:, None])
    nearest = min(float(((high - low) / (2 * HALF_VIEW)).min()), float(ahead.min()) - LEAST_M)
    middle = _middle(aside, ahead - nearest)
    position = np.array([*middle, nearest]) @ axes
    return position, position + ((ahead.min() + ahead.max()) / 2 - nearest) * axes[2]


def _sides(aside: Float, half: Float) -> tuple[Float, Float]:
    """The places (2,) between which an eye has all points within these distances (N, 2) of the middle of its view."""
    return (aside - half).max(axis=0), (aside + half).min(axis=0)


def _middle(aside: Float, distance: Float) -> Float:
    """The place (2,) of an eye whose view reaches as far to one side as to the other, by bisection of its tangents."""
    least, most = np.zeros(2), HALF_VIEW
    for _ in range(40):
        tangents = (least + most) / 2
        low, high = _sides(aside, tangents * distance[:, None])
        least, most = np.where(low > high, tangents, least), np.where(low > high, most, tangents)
    return np.mean(_sides(aside, most * distance[:, None]), axis=0)


GUIDE = """\
# How to read this recording

**What does each person look at?** The table *This frame* has the answer, the truth, and the error type of a wrong
frame. The timelines below show truth, answer and verdict over time.

- **Left image**: masks and boxes of the targets, in one colour per target everywhere; white boxes are heads. With one
  person, the number at a name is the target's attention, 0 to 1.
- **Scene in metres**: each target's points and 3D box, as the left camera saw them.
- **Yellow** is the gaze, **blue** is the head: an arrow, and of the method `cones` its cones and their rays. Rays that
  hit a box are bright and end at the first one; of those that hit nothing every second is there, and dim.
- **Green** marks what the person truly looks at, **red** a wrong answer: a box, and a line from the eyes to it.
  Of several objects of the true name, all are green if the label and the answer do not say which one is meant.
- **Attention**: one curve per target, and with probabilities a grey one of looking at *none*; the highest is the
  answer. Of several objects of a name it is the highest of them, of probabilities their sum; the answer is the
  likeliest of them. The tabs beside it show the part of each cue.

A gap in a curve or a timeline: there is no value in these frames.
"""


def guide() -> rr.TextDocument:
    """The page that explains the views."""
    return rr.TextDocument(GUIDE, media_type=rr.MediaType.MARKDOWN)
