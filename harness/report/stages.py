"""Each stage over a run: how far it is off the truth, and how long it takes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from harness.files.groups import grouped
from harness.report.formats import UNKNOWN, Table, number
from harness.run.columns import MeasureColumns
from harness.run.directory import Pair, RunDirectory
from harness.run.grid import base_of
from harness.run.table_files import numbers_of
from harness.run.timings import read_timings
from harness.score.oracle_ablation import without_oracles
from harness.score.score import Scores
from vfoa.scoring import ALL
from vfoa.types import Float

_NOTES = (
    "Against the clip's truth, before any filter over time. Disparity: median over frames of the frame's median error, "
    "mean share of errors over 2 px, mean share of pixels with a disparity.",
    "IoU: mean; an object without mask, box or head counts 0. Centre: median distance of the boxes' centres. A true "
    "box is of the whole body, seen or not, so that what is seen cannot reach 1.",
    "Eyes, head, gaze: median and 95th percentile of the eye origin's distance and of the directions' angles.",
)


def stage_measures_table(scores: Scores) -> Table:
    """One row per clip and configuration, and one over all clips; no rows without ground truth."""
    return Table.of(
        "Stages against the truth",
        "Clip | Configuration | Disparity px | Over 2 px % | Known % | Mask IoU | Box IoU | Centre cm | Head box IoU | "
        "Eyes cm | Eyes 95 % | Head deg | Head 95 % | Gaze deg | Gaze 95 %",
        ((clip or ALL, name, *_cells(found)) for (clip, name), found in pooled_measures(scores.measures).items()),
        words=2,
        notes=_NOTES,
    )


def terminal_measures(table: Table, scores: Scores) -> Table:
    """Of :func:`stage_measures_table`: the rows over all clips without the oracle ablation, and columns that fit."""
    shown = without_oracles(scores.configurations)
    rows = [row for row in table.rows if row[0] == ALL] or table.rows
    chosen = replace(table, rows=tuple(row for row in rows if row[1] in shown)).only(
        ("Configuration", "Disparity px", "Over 2 px %", "Known %", "Box IoU", "Eyes cm", "Head deg", "Gaze deg")
    )
    return Table.of(
        table.title,
        "Configuration | Disp. px | > 2 px % | Known % | IoU | Eyes cm | Head ° | Gaze °",  # fits 80 characters
        chosen.rows,
        words=1,
        notes=(
            "Medians: errors of disparity, eye origin, head and gaze direction. > 2 px: share of disparities that far "
            "off; known: pixels with a disparity; IoU: 3D boxes and the true ones, mean.",
        ),
    )


def object_measures_table(scores: Scores) -> Table:
    """One row per clip, object and configuration: the quality of its mask and its box."""
    return Table.of(
        "Objects against the ground truth",
        "Clip | Object | Configuration | Frames | Mask IoU | Box IoU | Centre cm",
        ((*key, len(found), *_object_cells(found)) for key, found in _measures_by_object(scores.measures).items()),
        words=3,
        notes=_NOTES[1:2],
    )


def pooled_measures(parts: Mapping[Pair, MeasureColumns]) -> dict[tuple[str | None, str], MeasureColumns]:
    """The measures of each (clip, configuration) and, of several clips, of all together under the clip None.

    The seeds of a configuration are taken together, here and below; what is pooled has no ids and names.
    """
    groups = grouped(
        ((clip, base_of(configuration)), part) for (clip, configuration), part in parts.items() if part.frames
    )
    of_all = grouped((name, part) for (_, name), group in groups.items() for part in group)
    pooled: dict[tuple[str | None, str], MeasureColumns] = {key: _pooled(group) for key, group in groups.items()}
    if len({clip for clip, _ in groups}) > 1:
        pooled |= {(None, name): _pooled(group) for name, group in of_all.items()}
    return pooled


def _pooled(group: Iterable[MeasureColumns]) -> MeasureColumns:
    group = [*group]
    return MeasureColumns(
        frames=sum(part.frames for part in group),
        disparities=np.concatenate([part.disparities for part in group]),
        objects=np.concatenate([part.objects for part in group]),
        people=np.concatenate([part.people for part in group]),
    )


def _measures_by_object(parts: Mapping[Pair, MeasureColumns]) -> dict[tuple[str, str, str], Float]:
    """The measures (n, 3) of each (clip, true object, configuration), the object by the run's own name for it."""
    names: dict[tuple[str, int], str] = {}
    for (clip, _), part in parts.items():
        for truth_id, name in part.names.items():
            names.setdefault((clip, truth_id), name)
    by_object = grouped(
        (
            (clip, names.get((clip, truth_id), f"{label}#{truth_id}"), base_of(configuration)),
            part.objects[part.truth_ids == truth_id],
        )
        for (clip, configuration), part in parts.items()
        for truth_id, label in part.labels.items()
    )
    in_order = sorted(by_object.items(), key=lambda item: item[0][:2])
    return {key: np.concatenate(found) for key, found in in_order}


def _cells(measures: MeasureColumns) -> Iterator[str]:
    error_px, over_2_px, known = measures.disparities.T
    yield _printed(error_px, np.median, digits=2)
    yield _printed(over_2_px, np.mean, 100)
    yield _printed(known, np.mean, 100)
    yield from _object_cells(measures.objects)
    head_box_iou, *errors = measures.people.T
    yield _printed(head_box_iou, np.mean, digits=2)
    for values, scale in zip(errors, (100, 1, 1), strict=True):
        yield _printed(values, np.median, scale)
        yield _printed(values, _percentile_95, scale)


def _object_cells(objects: Float) -> tuple[str, str, str]:
    mask_iou, box_iou, center_error_m = objects.T
    return (
        _printed(mask_iou, np.mean, digits=2),
        _printed(box_iou, np.mean, digits=2),
        _printed(center_error_m, np.median, 100),
    )


def _printed(values: Float, statistic: Any, scale: float = 1, digits: int = 1) -> str:
    """A statistic of the known values, as text."""
    known = values[~np.isnan(values)]
    return number(float(statistic(known)), digits, scale) if len(known) else UNKNOWN


def _percentile_95(values: Float) -> float:
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
            rows=tuple((stage.replace("_", " "), *(number(ms, 1) for ms in row)) for stage, row in self.ms.items()),
            notes=(
                "On the machine of the run, with all its other work going on; a stage that configurations share "
                "was computed once.",
            ),
        )


def stage_times(directory: RunDirectory) -> StageTimes:
    """Read the time per stage of a run; none if it has no times. Raises the errors of :func:`read_timings`."""
    table = read_timings(directory, ["configuration", "stage", "ms"])
    names, stages = (table.column(name).combine_chunks().dictionary_encode() for name in ("configuration", "stage"))
    configurations = tuple(names.dictionary.to_pylist())
    of_stages = stages.dictionary.to_pylist()
    keys = numbers_of(stages.indices, 0) * len(configurations) + numbers_of(names.indices, 0)
    ends = np.cumsum(np.bincount(keys, minlength=len(of_stages) * len(configurations)))
    ms_of_all = numbers_of(table.column("ms").combine_chunks(), 0)
    groups = np.split(ms_of_all[np.argsort(keys.astype(np.min_scalar_type(len(ends))), kind="stable")], ends[:-1])
    medians = [round(float(np.median(ms)), 1) if len(ms) else None for ms in groups]
    per_stage = len(configurations)
    return StageTimes(
        configurations=configurations,
        ms={stage: medians[row * per_stage : (row + 1) * per_stage] for row, stage in enumerate(of_stages)},
    )
