"""Each stage over a run: how far it is off the truth, and how long it takes."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from harness.files.io import read_text
from harness.pipeline.frame_measures import FrameMeasures, PersonMeasure, TargetMeasure
from harness.report.csv_tables import ALL
from harness.report.formats import UNKNOWN, Table
from harness.run.results import MeasureLog
from harness.score.oracle_ablation import without_oracles
from harness.score.score import Scores
from vfoa.errors import VfoaError

_Value = float | None

_TIMINGS = ["clip", "configuration", "frame", "stage", "ms"]
"""The header of ``timings.csv``."""

_NOTES = (
    "Against the clip's truth, before any filter over time. Disparity: median over frames of the frame's median error, "
    "mean share of errors over 2 px, mean share of pixels with a disparity.",
    "IoU: mean; an object without mask, box or head counts 0. Centre: median distance of the boxes' centres. A true "
    "box is of the whole body, seen or not, so that what is seen cannot reach 1.",
    "Eyes, head, gaze: median and 95th percentile of the eye origin's distance and of the directions' angles.",
)


def stage_measures_table(scores: Scores) -> Table:
    """One row per clip and configuration, and one over all clips; no rows without ground truth."""
    return Table(
        title="Stages against the truth",
        columns=(
            *("Clip", "Configuration", "Disparity px", "Over 2 px %", "Known %", "Mask IoU", "Box IoU", "Centre cm"),
            *("Head box IoU", "Eyes cm", "Eyes 95 %", "Head deg", "Head 95 %", "Gaze deg", "Gaze 95 %"),
        ),
        words=2,
        rows=_configuration_rows(scores.measures),
        notes=_NOTES,
    )


_TERMINAL = {
    "Disparity px": "Disp. px",
    "Over 2 px %": "> 2 px %",
    "Known %": "Known %",
    "Box IoU": "IoU",
    "Eyes cm": "Eyes cm",
    "Head deg": "Head °",
    "Gaze deg": "Gaze °",
}
"""The columns for a terminal, and their names there: they leave room for a name within 80 characters."""


def terminal_measures(scores: Scores) -> Table:
    """The rows over all clips, with the columns that fit a terminal or a printed page; without the oracle ablation."""
    table = stage_measures_table(scores)
    shown = without_oracles(scores.configurations)
    rows = [row for row in table.rows if row[0] == ALL] or table.rows
    places = [table.columns.index(name) for name in ("Configuration", *_TERMINAL)]
    return Table(
        title=table.title,
        columns=("Configuration", *_TERMINAL.values()),
        rows=tuple(tuple(row[i] for i in places) for row in rows if row[1] in shown),
        words=1,
        notes=(
            "Medians: errors of disparity, eye origin, head and gaze direction. > 2 px: share of disparities that far "
            "off; known: pixels with a disparity; IoU: 3D boxes and the true ones, mean.",
        ),
    )


def object_measures_table(scores: Scores) -> Table:
    """One row per clip, object and configuration: the quality of its mask and its box."""
    return Table(
        title="Objects against the ground truth",
        columns=("Clip", "Object", "Configuration", "Frames", "Mask IoU", "Box IoU", "Centre cm"),
        words=3,
        rows=_object_rows(scores.measures),
        notes=_NOTES[1:2],
    )


_Rows = tuple[tuple[str, ...], ...]


@lru_cache(maxsize=1)  # tables and page show the same rows, and a long run has a million values
def _configuration_rows(measures: MeasureLog) -> _Rows:
    return tuple((clip or ALL, name, *_cells(frames)) for (clip, name), frames in measures.pooled().items())


@lru_cache(maxsize=1)
def _object_rows(measures: MeasureLog) -> _Rows:
    return tuple((*key, str(len(found)), *_object_cells(found)) for key, found in measures.by_thing().items())


def _cells(frames: Sequence[FrameMeasures]) -> tuple[str, ...]:
    disparities = [each.disparity for each in frames if each.disparity is not None]
    people = [each for frame in frames for each in frame.people]

    def angles(of: Callable[[PersonMeasure], _Value], scale: float = 1) -> tuple[str, str]:
        values = [of(each) for each in people]
        return _printed(values, np.median, scale, 1), _printed(values, _percentile_95, scale, 1)

    return (
        _printed([each.error_px for each in disparities], np.median, 1, 2),
        _printed([each.over_2_px for each in disparities], np.mean, 100, 1),
        _printed([each.known for each in disparities], np.mean, 100, 1),
        *_object_cells([each for frame in frames for each in frame.targets]),
        _printed([each.head_box_iou for each in people], np.mean, 1, 2),
        *angles(lambda each: each.eye_error_m, 100),
        *angles(lambda each: each.head_error_deg),
        *angles(lambda each: each.gaze_error_deg),
    )


def _object_cells(measures: Sequence[TargetMeasure]) -> tuple[str, str, str]:
    boxes: list[_Value] = [each.box_iou for each in measures]
    if any(iou is not None for iou in boxes):
        boxes = [iou or 0.0 for iou in boxes]
    return (
        _printed([each.mask_iou for each in measures], np.mean, 1, 2),
        _printed(boxes, np.mean, 1, 2),
        _printed([each.center_error_m for each in measures], np.median, 100, 1),
    )


def _printed(values: Iterable[_Value], of: Callable[[Sequence[float]], object], scale: float, digits: int) -> str:
    """A statistic of the known values, as text."""
    known = [value for value in values if value is not None]
    return f"{scale * float(of(known)):.{digits}f}" if known else UNKNOWN  # type: ignore[arg-type]


def _percentile_95(values: Sequence[float]) -> float:
    return float(np.percentile(values, 95))


@dataclass(frozen=True, slots=True, kw_only=True)
class StageTimes:
    """Median milliseconds per frame over all clips: by stage, one per configuration; None without such a stage."""

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
    """Read the time per stage of a run.

    Raises
    ------
    VfoaError
        If the file is not a run's timings. A missing file gives no stages: scores need none.
    """
    times: dict[tuple[str, str], list[float]] = {}
    if timings.is_file():
        rows = csv.reader(io.StringIO(read_text(timings), newline=""))
        if (header := next(rows, [])) != _TIMINGS:
            raise VfoaError(f"{timings}:1: expected the columns {','.join(_TIMINGS)}, found {','.join(header)}")
        try:
            for _, configuration, _, stage, ms in rows:
                key = stage, configuration
                if key in times:
                    times[key].append(float(ms))
                else:
                    times[key] = [float(ms)]
        except ValueError as error:
            raise VfoaError(f"{timings}:{rows.line_num}: not a stage's time: {error}") from None
    configurations = tuple(dict.fromkeys(configuration for _, configuration in times))
    medians = {key: round(float(np.median(found)), 1) for key, found in times.items()}
    return StageTimes(
        configurations=configurations,
        ms={
            stage: [medians.get((stage, name)) for name in configurations]
            for stage in dict.fromkeys(stage for stage, _ in times)
        },
    )
