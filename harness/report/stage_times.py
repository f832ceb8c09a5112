"""Time per stage, from a run's ``timings.csv``."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.files import read_text
from harness.report.formats import UNKNOWN, Table
from vfoa.errors import VfoaError

_COLUMNS = ["clip", "configuration", "frame", "stage", "ms"]


@dataclass(frozen=True, slots=True, kw_only=True)
class StageTimes:
    """Median milliseconds a frame over all clips: by stage, one for each configuration; None where it has no such."""

    configurations: tuple[str, ...]
    ms: dict[str, list[float | None]]

    def table(self) -> Table:
        """A row per stage and a column per configuration."""
        return Table(
            title="Stage times, median ms a frame",
            columns=("Stage", *self.configurations),
            words=1,
            rows=tuple(
                (stage.replace("_", " "), *(UNKNOWN if each is None else f"{each:.1f}" for each in of_stage))
                for stage, of_stage in self.ms.items()
            ),
            notes=(
                "On the machine of the run, with all its other work going on; a stage that configurations share "
                "was computed once.",
            ),
        )


def stage_times(timings: Path) -> StageTimes:
    """Time per stage of a run.

    Raises
    ------
    VfoaError
        If the file is not a run's timings. A missing one gives no stages: scores need none.
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
    return StageTimes(
        configurations=tuple(configurations),
        ms={
            stage: [round(float(np.median(found[name])), 1) if name in found else None for name in configurations]
            for stage, found in times.items()
        },
    )
