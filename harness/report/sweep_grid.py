"""A sweep as a grid: rates by the values of two factors, numbers separated from words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from harness.score.sweep.runner import Sweep
from vfoa.types import Float


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepGrid:
    """Rates (rows, columns) over all other settings: their mean, and the best of them.

    Rows are the values of the sweep's ``per``, columns those of ``across``: numbers first, ascending, then words such
    as ``10.4+25.6``. ``numbers`` counts the columns that are numbers; ``row_numbers`` are the rows' values, None if
    they are words.
    """

    per: str
    across: str
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    numbers: int
    row_numbers: tuple[float, ...] | None
    mean: Float
    best: Float


def grid_of(sweep: Sweep) -> SweepGrid:
    """Return the grid of a sweep; a missing combination is NaN."""
    per, across = sweep.view.per, sweep.view.across
    rows = _ordered(list(dict.fromkeys(row.factors[per] for row in sweep.rows)))
    columns = _ordered(list(dict.fromkeys(row.factors[across] for row in sweep.rows)))
    rates: dict[tuple[str, str], list[float]] = {}
    for row in sweep.rows:
        rates.setdefault((row.factors[per], row.factors[across]), []).append(row.frr)
    known = [[rates.get((row, column), [np.nan]) for column in columns] for row in rows]
    values = [number(row) for row in rows]
    return SweepGrid(
        per=per,
        across=across,
        rows=tuple(rows),
        columns=tuple(columns),
        numbers=sum(number(column) is not None for column in columns),
        row_numbers=None if None in values else tuple(value for value in values if value is not None),
        mean=np.array([[np.mean(cell) for cell in row] for row in known]),
        best=np.array([[np.max(cell) for cell in row] for row in known]),
    )


def number(label: str) -> float | None:
    """A label as a number; None for words."""
    try:
        return float(label)
    except ValueError:
        return None


def edges(values: Sequence[float]) -> list[float]:
    """Borders of cells around increasing numbers, half way between them."""
    if len(values) < 2:
        return [each + side for each in values for side in (-0.5, 0.5)]
    middles = [(before + after) / 2 for before, after in pairwise(values)]
    return [values[0] - (middles[0] - values[0]), *middles, values[-1] + (values[-1] - middles[-1])]


def _ordered(labels: list[str]) -> list[str]:
    """Sort numbers first, ascending, then words."""
    numbers = [label for label in labels if number(label) is not None]
    return [*sorted(numbers, key=float), *(label for label in labels if label not in numbers)]
