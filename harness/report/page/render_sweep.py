"""Pages without frames: ``report.html`` of a sweep, and the page of ``vfoa compare``, which has the same tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from harness.report.comparisons import comparison_table
from harness.report.formats import Table
from harness.report.page.packing import pack_json
from harness.report.page.render import plain_table, script, template
from harness.report.sweep_grid import grid_of
from harness.score.comparison import Comparison
from harness.score.sweep.runner import Sweep
from vfoa.types import Float

MOST_ROWS = 20_000
"""More configurations are only in ``sweep.csv``."""


def render_sweep(sweep: Sweep, tables: Sequence[Table]) -> str:
    """Return the page as text; those of the ``tables`` with more than :data:`MOST_ROWS` rows are left out.

    Its data object, read by ``sweep.js``: ``sweep`` is ``{per, across, rows, columns, numbers, row_numbers, mean,
    best}`` as in :class:`harness.report.sweep_grid.SweepGrid`, null for a missing combination.
    """
    grid = grid_of(sweep)
    shown = [table for table in tables if len(table.rows) <= MOST_ROWS]
    best = max(sweep.rows, key=lambda row: row.correct)
    setting = ", ".join(f"{key} {value}" for key, value in best.factors.items())
    data: dict[str, Any] = {
        "per": grid.per,
        "across": grid.across,
        "rows": grid.rows,
        "columns": grid.columns,
        "numbers": grid.numbers,
        "row_numbers": grid.row_numbers,
        "mean": _plain(grid.mean),
        "best": _plain(grid.best),
    }
    return template("sweep.html.jinja").render(
        title=f"Sweep {sweep.name}",
        facts=[
            f"{len(sweep.rows):,} configurations".replace(",", " "),
            f"{', '.join(sweep.clips)}: {sweep.frames} frames",
            f"n = {sweep.rows[0].n} labelled frames of subjects",
        ],
        verdict=f"The best of them is right in {100 * best.frr:.1f} % of the frames: {setting}. "
        "The best of many is best by luck, too: choose on some clips, report on others.",
        titles=[table.title for table in shown],
        notes=sweep.notes,
        data={"sweep": data},
        packs={"tables": pack_json([plain_table(table) for table in shown])},
        script=script("sweep"),
    )


def render_comparison(comparisons: Sequence[Comparison]) -> str:
    """Return the page of comparisons of several runs: a row for each pair, to be sorted by any column."""
    names = {name for each in comparisons for name in (each.reference, each.configuration)}
    told = [each.sentence for each in comparisons if each.is_significant]
    table = comparison_table(comparisons)
    return template("sweep.html.jinja").render(
        title="Comparison of runs",
        facts=[f"{len(names)} configurations", f"{len(comparisons)} pairs"],
        verdict=" ".join(f"{sentence}." for sentence in told[:MOST_SENTENCES])
        or "No two of them differ significantly.",
        titles=[table.title],
        notes=(),
        data={},
        packs={"tables": pack_json([plain_table(table)])},
        script=script("compare"),
    )


MOST_SENTENCES = 3
"""Most significant differences that the head of a comparison's page names; the table has all."""


def _plain(rates: Float) -> list[list[float | None]]:
    return [[None if rate != rate else round(rate, 4) for rate in row] for row in rates.tolist()]
