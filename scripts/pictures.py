"""Draw the pictures of the documents: ``python scripts/pictures.py`` writes docs/pictures/*.svg.

Equal code gives equal bytes. Text stays text, so that a reader can search and select it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, FancyBboxPatch, Polygon, Rectangle

from harness.score.statistics import wilson_interval
from vfoa.cones import cue_weights
from vfoa.geometry import fov_from_radius

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "pictures"
STYLE = {
    "svg.hashsalt": "vfoa",
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
}
GAZE, HEAD, GREY, RIGHT, WRONG = "#c99700", "#2f6fde", "#666666", "#2e8b57", "#c0392b"


def pipeline() -> Figure:
    """The three calls of a frame, what flows between them, and what is remembered."""
    figure, axes = _canvas(10, 4.2)
    boxes = [
        (0.1, 3.0, "stereo matching", "stereo"),
        (0.1, 2.2, "segmentation", "segmentation"),
        (0.1, 1.4, "head detection", "heads"),
        (0.1, 0.6, "head pose", "head_pose"),
        (0.1, -0.2, "gaze", "gaze"),
        (4.0, 2.2, "clouds and 3D boxes", "reconstruction"),
        (4.0, 1.0, "eye origins", "reconstruction"),
        (7.5, 2.6, "tracking", "tracking"),
        (7.5, 1.6, "gaze filter", "gaze_filter"),
        (7.5, 0.6, "attention", "attention"),
    ]
    for x, y, title, table in boxes:
        axes.add_patch(FancyBboxPatch((x, y), 2.3, 0.6, boxstyle="round,pad=0.02", fc="#eef2fb", ec="#8899bb"))
        axes.text(x + 1.15, y + 0.38, title, ha="center", va="center")
        axes.text(x + 1.15, y + 0.14, f"[{table}]", ha="center", va="center", color=GREY, fontsize=8)
    for x, title, gives in (
        (0.1, "perceive", "Percepts"),
        (4.0, "reconstruct", "Scene"),
        (7.5, "attend", "FrameResult"),
    ):
        axes.text(x + 1.15, 3.85, title, ha="center", fontsize=12, weight="bold")
        axes.text(x + 1.15, -0.55, f"→ {gives}", ha="center", color=GREY)
    for x in (2.5, 6.4):
        axes.annotate("", (x + 1.0, 1.9), (x + 0.1, 1.9), arrowprops={"arrowstyle": "-|>", "color": GREY})
    axes.annotate(
        "", (8.0, 3.25), (9.3, 3.25), arrowprops={"arrowstyle": "-|>", "color": GREY, "connectionstyle": "arc3,rad=.5"}
    )
    axes.text(8.65, 3.62, "memory", ha="center", color=GREY, fontsize=8)
    axes.set(xlim=(-0.1, 10.1), ylim=(-0.8, 4.1))
    return figure


def frames() -> Figure:
    """The camera frame, pixels, and disparity."""
    figure = Figure(figsize=(10, 3.4), layout="constrained")
    camera, image, depth = figure.subplots(1, 3)
    for axes in (camera, image):
        axes.axis("off")
        axes.set_aspect("equal")
    for (u, v), name, colour in (
        ((1, 0), "x right", WRONG),
        ((0, -1), "y down", RIGHT),
        ((0.62, 0.5), "z forward", HEAD),
    ):
        camera.annotate("", (u, v), (0, 0), arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2})
        camera.text(1.15 * u, 1.15 * v, name, color=colour, ha="center", va="center")
    camera.add_patch(Polygon([(-0.25, -0.2), (0.25, -0.2), (0.12, 0.12), (-0.12, 0.12)], fc="#dddddd", ec=GREY))
    camera.set(xlim=(-0.6, 1.6), ylim=(-1.3, 1.0), title="Camera frame: left camera, metres")
    image.add_patch(Rectangle((0, 0), 8, 5, fc="none", ec=GREY))
    image.add_patch(Rectangle((2, 1.2), 3, 2.2, fc="#eef2fb", ec=HEAD))
    image.text(2, 1.0, "(u0, v0)", ha="center", va="bottom", color=HEAD, fontsize=9)
    image.text(5, 3.6, "(u1, v1)", ha="center", va="top", color=HEAD, fontsize=9)
    for name, (u, v) in {"u": (2.2, -0.5), "v": (-0.5, 2.2)}.items():
        start = (0, v) if name == "u" else (u, 0)
        image.annotate("", (u, v), start, arrowprops={"arrowstyle": "-|>", "color": GREY})
        image.text(u + 0.3 * (name == "u"), v + 0.35 * (name == "v"), name, ha="center", va="center", color=GREY)
    image.set(xlim=(-1, 8.5), ylim=(5.5, -1), title="Pixels: (0, 0) is a pixel's centre")
    disparity = np.linspace(9, 120, 200)
    depth.plot(disparity, 896 * 0.1 / disparity, color=HEAD)
    depth.set(xlabel="disparity d, px", ylabel="depth z, m", title="z = fx · B / d   (fx = 896 px, B = 0.1 m)")
    return figure


def cones() -> Figure:
    """A subject between two targets, seen from above: a cone about the gaze and one about the head."""
    figure, axes = _canvas(8, 4.0)
    gaze, head = np.deg2rad(12.0), np.deg2rad(-6.0)
    for angle, colour, radius in ((gaze, GAZE, 0.25), (head, HEAD, 0.25)):
        half = fov_from_radius(radius) / 2
        edge = [(0.0, 0.0), *((2.9 * np.cos(angle + s * half), 2.9 * np.sin(angle + s * half)) for s in (-1, 1))]
        axes.add_patch(Polygon(edge, fc=colour, ec=colour, alpha=0.18))
        for share in np.linspace(-1, 1, 9):
            end = angle + share * half
            axes.plot([0, 2.9 * np.cos(end)], [0, 2.9 * np.sin(end)], color=colour, lw=0.5)
    axes.add_patch(Ellipse((-0.13, 0), 0.26, 0.22, fc="white", ec="black"))
    axes.add_patch(Rectangle((2.0, 0.28), 0.35, 0.45, fc="#dff3e6", ec=RIGHT))
    axes.add_patch(Rectangle((1.9, -0.55), 0.35, 0.35, fc="#f2f2f2", ec=GREY))
    axes.text(2.17, 0.8, "cup: hit by rays of the gaze", ha="center", color=RIGHT)
    axes.text(2.07, -0.68, "book: hit by rays of the head", ha="center", va="top", color=GREY)
    axes.text(0.9, 0.8, "cone about the gaze", color=GAZE, ha="center")
    axes.text(0.9, -0.7, "cone about the head", color=HEAD, ha="center")
    axes.text(-0.13, -0.25, "eyes", ha="center", va="top")
    axes.set(xlim=(-0.5, 3.2), ylim=(-1.1, 1.45))
    axes.set_aspect("equal")
    return figure


def weights() -> Figure:
    """The paper's adaptive weights over the angle between gaze and head."""
    figure = Figure(figsize=(6, 2.8), layout="constrained")
    axes = figure.subplots()
    angles = np.linspace(0, 60, 601)
    found = [
        cue_weights({"gaze": np.array([0.0, 0, 1]), "head": np.array([np.sin(a), 0, np.cos(a)])}, "adaptive")
        for a in np.deg2rad(angles)
    ]
    for cue, colour in (("gaze", GAZE), ("head", HEAD)):
        axes.plot(angles, [each[cue] for each in found], color=colour, label=f"w_{cue}")
    axes.set(xlabel="angle between gaze and head, °", ylabel="weight", ylim=(0, 1), title="Adaptive weights")
    axes.legend(frameon=False)
    return figure


def intervals() -> Figure:
    """The width of Wilson's interval by the number of independent frames."""
    figure = Figure(figsize=(6, 2.8), layout="constrained")
    axes = figure.subplots()
    counts = np.unique(20 * np.geomspace(1, 100, 60).astype(int))
    for share, colour in ((0.5, HEAD), (0.8, RIGHT), (0.95, GAZE)):
        found = [wilson_interval(round(share * n), int(n)) for n in counts]
        axes.fill_between(
            counts, [100 * i.low for i in found], [100 * i.high for i in found], color=colour, alpha=0.25, lw=0
        )
        axes.axhline(100 * share, color=colour, lw=1)
    axes.set(xscale="log", xlabel="independent frames", ylabel="FRR, %", ylim=(0, 100), title="Wilson's 95 % interval")
    return figure


def _canvas(width: float, height: float) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots()
    axes.axis("off")
    return figure, axes


PICTURES: tuple[Callable[[], Figure], ...] = (pipeline, frames, cones, weights, intervals)


def draw(folder: Path) -> None:
    """Write every picture into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(STYLE):
        for make in PICTURES:
            make().savefig(folder / f"{make.__name__}.svg", metadata={"Date": None, "Creator": None})


if __name__ == "__main__":
    draw(FOLDER)
