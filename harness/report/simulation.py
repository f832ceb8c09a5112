"""Pages and figures of the simulation: equal rows give equal bytes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.files.io import write_together
from harness.report.figures import figure_files
from harness.report.formats import Table, to_csv, to_markdown
from vfoa.geometry import fov_from_radius
from vfoa.simulation import CASES, Row, Statement, best_setting, setting_sums, tuning_sums

_MOST_RAYS = 40
_CUES = ("gaze", "head", "total")


def statements_table(found: Sequence[Statement]) -> Table:
    """Statements of the paper about its cases, the values found, and whether they hold."""
    return Table(
        title="What the synthetic cases must show",
        columns=("statement", "expected", "found", "holds"),
        rows=tuple((each.claim, each.expected, each.found, "yes" if each.holds else "no") for each in found),
        words=4,
    )


def write_simulation(out: Path, rows: Sequence[Row], found: Sequence[Statement]) -> None:
    """Write ``attention.csv``, ``simulation.md`` and the figures ``curves``, ``tuning``, ``settings`` (SVG, PNG)."""
    figures = {"curves": _curves(rows), "tuning": _tuning(rows), "settings": _settings(rows)}
    n_rays, radius_cm = best_setting(rows)
    best = (
        f"Greatest sum of attention over all cases: {n_rays} rays, {_fov_deg(radius_cm):.1f}° "
        f"(radius {radius_cm:g} cm at 1.10 m). With few rays the sum hangs on where each one falls.\n"
    )
    pictures = "".join(f"\n![{name}]({name}.svg)\n" for name in figures)
    write_together(
        {
            out / "simulation.md": f"{to_markdown(statements_table(found))}\n{best}{pictures}",
            out / "attention.csv": to_csv(_rows_table(rows)),
            **{path: data for name, each in figures.items() for path, data in figure_files(out / name, each).items()},
        }
    )


def _rows_table(rows: Sequence[Row]) -> Table:
    return Table(
        title="Attention in the synthetic cases",
        columns=("case", "object", "n_rays", "radius_cm", *_CUES),
        rows=tuple(
            (r.case, r.object, str(r.n_rays), f"{r.radius_cm:g}", f"{r.gaze:.6f}", f"{r.head:.6f}", f"{r.total:.6f}")
            for r in rows
        ),
        words=2,
    )


def _curves(rows: Sequence[Row]) -> Figure:
    """Gaze, head and total against the field of view, one panel for each object of each case."""
    shown = [(case.name, cube.name) for case in CASES for cube in case.objects]
    figure = Figure(figsize=(12, 8), layout="constrained")
    for axes, (case, thing) in zip(figure.subplots(3, 3, sharex=True, sharey=True).flat, shown, strict=True):
        of = [row for row in rows if (row.case, row.object, row.n_rays) == (case, thing, _MOST_RAYS)]
        for cue in _CUES:
            axes.plot([_fov_deg(row.radius_cm) for row in of], [getattr(row, cue) for row in of], label=cue)
        _name(axes, f"{case}: {thing}", "field of view (°)", "attention")
    figure.axes[0].legend()
    figure.suptitle(f"{_MOST_RAYS} rays")
    return figure


def _tuning(rows: Sequence[Row]) -> Figure:
    """Sums over all cases against the number of rays, and against the field of view."""
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    by_rays, by_radius = tuning_sums(rows, "n_rays"), tuning_sums(rows, "radius_cm")
    left.plot(list(by_rays), list(by_rays.values()))
    _name(left, "Over all cases and fields of view", "rays", "sum of attention")
    right.plot([_fov_deg(radius) for radius in by_radius], list(by_radius.values()))
    _name(right, "Over all cases and rays", "field of view (°)", "sum of attention")
    return figure


def _settings(rows: Sequence[Row]) -> Figure:
    """Heat map of the sum over all cases: number of rays by field of view."""
    sums = setting_sums(rows)
    n_rays, radii = sorted({n for n, _ in sums}), sorted({radius for _, radius in sums})
    figure = Figure(figsize=(7, 5), layout="constrained")
    axes = figure.subplots()
    grid = np.array([[sums[n, radius] for n in n_rays] for radius in radii])
    figure.colorbar(
        axes.pcolormesh(n_rays, [_fov_deg(radius) for radius in radii], grid, shading="nearest", rasterized=True),
        label="sum of attention",
    )
    _name(axes, "Over all cases", "rays", "field of view (°)")
    return figure


def _fov_deg(radius_cm: float) -> float:
    return math.degrees(fov_from_radius(radius_cm / 100))


def _name(axes: Axes, title: str, across: str, up: str) -> None:
    axes.set(title=title, xlabel=across, ylabel=up)
