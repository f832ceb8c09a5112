"""A finished sweep from its files: ``sweep.csv`` and ``sweep.json``."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

from harness.files.io import read_text
from harness.run.experiment import SweepView
from harness.score.sweep.runner import Sweep, SweepRow
from vfoa.errors import VfoaError

COUNTS = ("n", "correct", "predicted")


def is_sweep(directory: Path) -> bool:
    """Whether a directory holds a sweep, and no run."""
    return (directory / "sweep.json").is_file() and not (directory / "manifest.json").exists()


def read_sweep(directory: Path) -> Sweep:
    """Read the sweep that :func:`harness.report.sweep.write_sweep` wrote.

    Raises
    ------
    VfoaError
        If one of its files is missing, truncated, or of an older version.
    """
    path = directory / "sweep.json"
    try:
        described = json.loads(read_text(path))
        about = described["sweep"]
        view = SweepView.model_validate({key: about[key] for key in ("per", "across")})
    except (ValueError, KeyError, TypeError):
        raise VfoaError(f"{path}: expected the sweep's view, as `vfoa run` writes it; run the sweep again") from None
    rows = _rows(directory / "sweep.csv")
    for key in (view.per, view.across):
        if key not in rows[0].factors:
            raise VfoaError(f"{directory / 'sweep.csv'}: expected a column {key!r}; found {', '.join(rows[0].factors)}")
    return Sweep(
        name=described["experiment"],
        clips=tuple(about["clips"]),
        frames=about["frames"],
        notes=tuple(about["notes"]),
        view=view,
        rows=rows,
    )


def _rows(path: Path) -> tuple[SweepRow, ...]:
    table = csv.DictReader(io.StringIO(read_text(path), newline=""))
    columns = list(table.fieldnames or ())
    if missing := [name for name in COUNTS if name not in columns]:
        raise VfoaError(f"{path}:1: expected the column {missing[0]!r}; found {', '.join(columns)}")
    keys = columns[: columns.index("n")]
    rows = []
    for row in table:
        try:
            counts = {name: int(row[name]) for name in COUNTS}
        except (TypeError, ValueError):
            raise VfoaError(f"{path}:{table.line_num}: expected counts in the columns {', '.join(COUNTS)}") from None
        rows.append(SweepRow(factors={key: row[key] for key in keys}, **counts))
    if not rows:
        raise VfoaError(f"{path}: expected a row per configuration, found none")
    return tuple(rows)
