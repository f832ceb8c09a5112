"""What each stage took, from a run's ``timings.csv``."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from harness.files import read_text
from harness.report.formats import UNKNOWN, Table
from vfoa.errors import VfoaError

_COLUMNS = ["clip", "configuration", "frame", "stage", "ms"]


def stage_times_table(timings: Path) -> Table:
    """Median milliseconds a frame, a row per stage and a column per configuration, over all clips.

    Raises
    ------
    VfoaError
        If the file is not a run's timings. A missing one gives no rows: scores need none.
    """
    times: dict[str, dict[str, list[float]]] = {}
    configurations: dict[str, None] = {}
    if timings.is_file():
        rows = csv.reader(io.StringIO(read_text(timings), newline=""))
        if (header := next(rows, [])) != _COLUMNS:
            raise VfoaError(f"{timings}:1: expected the columns {','.join(_COLUMNS)}, found {','.join(header)}")
        try:
            for _, configuration, _, stage, ms in rows:
                configurations.setdefault(configuration)
                times.setdefault(stage, {}).setdefault(configuration, []).append(float(ms))
        except ValueError as error:
            raise VfoaError(f"{timings}:{rows.line_num}: not a stage's time: {error}") from None
    return Table(
        title="Stage times, median ms a frame",
        columns=("Stage", *configurations),
        words=1,
        rows=tuple(
            (stage.replace("_", " "), *(_median(found.get(name, [])) for name in configurations))
            for stage, found in times.items()
        ),
        notes=(
            "On the machine of the run, with all its other work going on; a stage that configurations share "
            "was computed once.",
        ),
    )


def _median(ms: list[float]) -> str:
    return f"{float(np.median(ms)):.1f}" if ms else UNKNOWN
