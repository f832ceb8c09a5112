"""A sweep's tables and figure: equal rows give equal bytes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import matplotlib as mpl
import numpy as np

from harness.files.io import write_together
from harness.report.figures import figure_files
from harness.report.formats import Table, to_csv, to_markdown
from harness.report.page.render_sweep import render_sweep
from harness.report.plots.style import STYLE
from harness.report.plots.sweep_heatmap import draw_sweep
from harness.score.sweep.runner import Sweep, SweepRow


def write_sweep(out: Path, sweep: Sweep) -> None:
    """Write ``sweep.csv`` (a row per configuration), ``sweep.md`` (the best), the figure (SVG, PNG) and the page."""
    best, effects, rows = best_table(sweep), effects_table(sweep), _all_rows(sweep)
    pages = [to_markdown(best), to_markdown(effects, level=2), "![rate over the sweep](sweep.svg)\n"]
    with mpl.rc_context(STYLE):
        figures = figure_files(out / "sweep", draw_sweep(sweep))
    write_together(
        {
            out / "report.html": render_sweep(sweep, [best, effects, rows]),
            out / "sweep.csv": to_csv(rows),
            out / "sweep.md": "\n".join(pages),
            **figures,
        }
    )


def best_table(sweep: Sweep) -> Table:
    """The best configuration for each value of the sweep's ``per``; of equal ones, the first in the grid."""
    rows = []
    for label, members in _grouped(sweep.rows, sweep.view.per):
        best = max(members, key=lambda row: row.correct)
        factors = best.factors
        setting = ", ".join(f"{_short(key)} {value}" for key, value in factors.items() if key != sweep.view.per)
        rows.append((label, setting, f"{best.frr:.1%}", f"{best.wilson.low:.1%} to {best.wilson.high:.1%}"))
    return Table(
        title=f"Best of {len(sweep.rows):,} configurations per {sweep.view.per}",
        columns=(_short(sweep.view.per), "best setting", "FRR", "Wilson 95 %"),
        rows=tuple(rows),
        words=2,
        notes=(
            f"{', '.join(sweep.clips)}: {sweep.frames} frames, n = {sweep.rows[0].n} labelled (frame, subject) pairs.",
            *sweep.notes,
        ),
    )


def effects_table(sweep: Sweep) -> Table:
    """The mean rate and the best one of each value of each factor, over all values of the others."""
    rows = []
    for key in sweep.rows[0].factors:
        for label, members in _grouped(sweep.rows, key):
            rates = [row.frr for row in members]
            rows.append((key, label, f"{np.mean(rates):.1%}", f"{max(rates):.1%}"))
    return Table(
        title="Each factor by itself", columns=("factor", "value", "mean FRR", "best FRR"), rows=tuple(rows), words=2
    )


def _all_rows(sweep: Sweep) -> Table:
    keys = tuple(sweep.rows[0].factors)
    return Table(
        title=sweep.name,
        columns=(*keys, "n", "correct", "predicted", "frr", "wilson_low", "wilson_high"),
        rows=tuple(
            (
                *(row.factors[key] for key in keys),
                *(str(count) for count in (row.n, row.correct, row.predicted)),
                *(f"{share:.6f}" for share in (row.frr, row.wilson.low, row.wilson.high)),
            )
            for row in sweep.rows
        ),
        words=len(keys),
    )


def _grouped(rows: Iterable[SweepRow], key: str) -> Iterator[tuple[str, list[SweepRow]]]:
    """The rows by their label of one factor, in the order of the grid."""
    groups: dict[str, list[SweepRow]] = {}
    for row in rows:
        groups.setdefault(row.factors[key], []).append(row)
    yield from groups.items()


def _short(key: str) -> str:
    """Short name of a key. Keys of several stages (``gaze.error_deg``, ``head_pose.error_deg``) keep their table."""
    return key if key.endswith(".error_deg") else key.partition(".")[2]
