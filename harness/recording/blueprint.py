"""The layout in which a recording opens: what is seen, from where, and what each curve is called."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from harness.recording import Size, entities
from vfoa.geometry import box_corners
from vfoa.types import CUES, Float, Scene

FROM_MIDDLE = (0.46, -0.4, -0.55)
"""Where the viewer's eye is, in diagonals of the scene from its middle: right of the camera, above, and behind it."""

MOST_PLOTS = 3
"""Subjects with a plot of their own; with more, one plot has all the curves."""


def blueprint(
    scene: Scene | None, subjects: Sequence[str], rate_hz: float | None, size: Size, *, follow: bool = False
) -> rrb.Blueprint:
    """The layout for a recording whose first frame is ``scene``, with the subjects that are known by name.

    ``follow``: the viewer goes on to each new frame as it comes.
    """
    images = rrb.Tabs(_left_view(subjects), *_stereo_views(size), name="Images", active_tab=0)
    documents = rrb.Tabs(
        rrb.TextDocumentView(origin=entities.SUMMARY, name="This frame"),
        rrb.TextLogView(origin=entities.LOG, name="Failures"),
        rrb.TextDocumentView(origin=entities.GUIDE, name="How to read this"),
        active_tab=0,
    )
    lanes = rrb.StateTimelineView(origin=entities.VERDICT, name="Truth, prediction, verdict")
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(images, _world_view(scene), row_shares=[5, 6]),
            rrb.Vertical(documents, *_plots(subjects), lanes, row_shares=_shares(len(_plots(subjects)))),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(timeline="frame", play_state="following" if follow else "paused", fps=rate_hz, state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def _left_view(subjects: Sequence[str]) -> rrb.Spatial2DView:
    # the subjects stand in the world; under the camera's pin-hole the view projects them into the image, where all
    # rays would hide the scene and the cones' outlines do not
    rays = [f"- {entities.cue_3d(name, cue, 'rays')}" for name in subjects for cue in CUES]
    contents = [f"{entities.CAMERA}/**", f"- {entities.DEPTH}/**", f"{entities.SUBJECTS}/**", *rays]
    return rrb.Spatial2DView(origin=entities.CAMERA, contents=contents, name="Left image")


def _stereo_views(size: Size) -> list[rrb.Spatial2DView]:
    views = [
        rrb.Spatial2DView(origin=entities.DISPARITY, name="Disparity"),
        rrb.Spatial2DView(origin=entities.RIGHT, name="Right image"),
    ]
    if size == "full":
        views.append(rrb.Spatial2DView(origin=entities.CONFIDENCE, name="Confidence"))
        views.append(rrb.Spatial2DView(origin=entities.CAMERA, contents=[f"{entities.DEPTH}/**"], name="Depth"))
    return views


def _world_view(scene: Scene | None) -> rrb.Spatial3DView:
    hidden = (entities.DEPTH, entities.MASKS, entities.TARGETS_2D, entities.HEADS_2D)
    return rrb.Spatial3DView(
        origin=entities.WORLD,
        contents=[f"{entities.WORLD}/**", *(f"- {path}/**" for path in hidden)],
        name="Scene in metres",
        line_grid=False,
        eye_controls=orbital_eye(*eye_controls(scene)),
    )


def orbital_eye(position: Float, look_target: Float) -> rrb.EyeControls3D:
    """An eye that a mouse turns about what it looks at, with the camera's up."""
    return rrb.EyeControls3D(kind=rrb.Eye3DKind.Orbital, position=position, look_target=look_target, eye_up=(0, -1, 0))


def eye_controls(scene: Scene | None) -> tuple[Float, Float]:
    """Position (3,) and look-at point (3,) of an eye that sees the whole scene, as :func:`eye_for` has it."""
    seen = [] if scene is None else [box_corners(target.box) for target in scene.targets if target.box is not None]
    if scene is not None:
        seen += [person.eye_origin_left[None] for person in scene.people if person.eye_origin_left is not None]
    return eye_for(seen)


def eye_for(seen: Sequence[Float]) -> tuple[Float, Float]:
    """Position (3,) and look-at point (3,) of an eye that sees all of some points, each (N, 3), camera frame, metres.

    From above and to the side of the left camera, so that depth, which the image hides, is seen.
    """
    points = np.concatenate(seen) if seen else np.array([[-0.5, -0.3, 1.0], [0.5, 0.3, 2.0]])
    low, high = points.min(axis=0), points.max(axis=0)
    middle, extent = (low + high) / 2, max(float(np.linalg.norm(high - low)), 0.2)
    return middle + extent * np.array(FROM_MIDDLE), middle


def _plots(subjects: Sequence[str]) -> list[rrb.Tabs | rrb.TimeSeriesView]:
    if not 0 < len(subjects) <= MOST_PLOTS:
        return [_plot(entities.ATTENTION, "Attention", legend=True)]
    return [_tabs(name, legend=len(subjects) == 1) for name in subjects]


def _tabs(subject: str, *, legend: bool) -> rrb.Tabs:
    views = (("total", f"Attention of {subject}"), ("gaze", "by gaze"), ("head", "by head"))
    return rrb.Tabs(
        *(_plot(entities.curves(subject, value), name, legend=legend) for value, name in views), active_tab=0
    )


def _plot(origin: str, name: str, *, legend: bool) -> rrb.TimeSeriesView:
    # the axis fits the data: who wins matters, and with narrow cones all values are small. A low plot has no room
    # for a legend; its colours are those of the boxes
    corner = rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=legend)
    return rrb.TimeSeriesView(origin=origin, name=name, plot_legend=corner)


def _shares(plots: int) -> list[float]:
    return [4.4, *([4.0 / plots] * plots), 1.2 + 0.5 * plots]


GUIDE = """\
# How to read this recording

Each frame asks: **what does each person look at?** The table *This frame* has the answer, the truth, and the cause of
a failure; the lanes below show both over time.

- **Left image**: masks and boxes of the targets, in one colour per target everywhere; white boxes are heads.
- **Scene in metres**: each target's points and 3D box, as the left camera saw them. A number at a name is the
  attention it gets, 0 to 1.
- **Yellow** is the gaze, **blue** is the head: an arrow, its cones, and their rays. Rays that hit a box are bright and
  end there; rays that hit nothing are dim.
- A **green line** leads from the eyes to what the person truly looks at; a **red line** to the wrong answer.
- **Attention**: one curve per target; the highest is the answer. The tabs beside it show the part of each cue.

A gap in a curve or lane: in these frames there was nothing to say.
"""


def guide() -> rr.TextDocument:
    """The page that explains the views."""
    return rr.TextDocument(GUIDE, media_type=rr.MediaType.MARKDOWN)
