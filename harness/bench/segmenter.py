"""A segmenter beside the loop, compared with one in it: frames per second, ms a frame, FRR and age of the masks."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from harness.bench.realtime import Row, Speed, configuration_of, measure_speed
from harness.clips.manifest import ClipManifest
from harness.report.formats import UNKNOWN, Table
from harness.run.experiment import load_experiment
from harness.run.plan import prepare
from harness.run.results import read_results
from harness.run.runner import run_plan
from harness.score.finished_run import read_scores
from vfoa.onnx import Provider

IN_THE_LOOP = "in the loop"
"""The row whose frames per second divide those of the others."""

_SEGMENTED = Row(what="beside the loop", matcher="sgbm", preset="realtime", has_models=True, has_segmenter=True)
ROWS = (
    replace(_SEGMENTED, what="in the loop, every frame", changes=("segmentation.every=1", "segmentation.delay=0")),
    replace(_SEGMENTED, what=IN_THE_LOOP, changes=("segmentation.delay=0",)),
    _SEGMENTED,
    replace(_SEGMENTED, what="none: masks in memory", has_segmenter=False),
)
"""The real-time preset with models. The last row is what is left without a segmenter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MaskAges:
    """The masks of the frames of a scored run: their ages in seconds, 0 for masks found in the frame itself.

    ``correct`` of ``labelled`` (frame, subject) pairs are right.
    """

    ages_s: tuple[float, ...]
    correct: int
    labelled: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmenterRow:
    """One row: its speed, and the masks of a scored run; None for masks in memory."""

    speed: Speed
    masks: MaskAges | None


def measure_segmenter(
    experiment: str,
    manifest: ClipManifest,
    frames: Sequence[int],
    threads: int,
    *,
    provider: Provider = "cpu",
    overrides: tuple[str, ...] = (),
    rows: Sequence[Row] = ROWS,
    rounds: int = 3,
) -> list[SegmenterRow]:
    """Measure the speed of every row as :func:`harness.bench.realtime.measure_speed` does; score those that segment."""
    speeds = measure_speed(
        experiment, manifest, frames, threads, rows=rows, provider=provider, overrides=overrides, rounds=rounds
    )
    ages = _scored(experiment, manifest, len(frames), [row for row in rows if row.has_segmenter], provider, overrides)
    return [SegmenterRow(speed=speed, masks=ages.get(row.what)) for row, speed in zip(rows, speeds, strict=True)]


def _scored(
    experiment: str,
    manifest: ClipManifest,
    limit: int,
    rows: Sequence[Row],
    provider: Provider,
    overrides: tuple[str, ...],
) -> dict[str, MaskAges]:
    """Run the rows as one experiment, whose results depend on no machine, and score it."""
    configurations = tuple(
        replace(configuration_of(experiment, manifest.name, row, overrides).on(provider), name=row.what) for row in rows
    )
    loaded = load_experiment(experiment, clips=(manifest.name,), overrides=overrides)
    plan = prepare(replace(loaded, configurations=configurations, published=None), limit=limit)
    with tempfile.TemporaryDirectory() as folder:
        directory = run_plan(plan, Path(folder) / "run", workers=1, progress=lambda clip: None)
        records = list(read_results(directory.results))
        rates = {row.configuration: row for row in read_scores(directory).by_clip()}
    return {
        row.what: MaskAges(
            ages_s=tuple(record.masks_age_s or 0.0 for record in records if record.configuration == row.what),
            correct=rates[row.what].correct if row.what in rates else 0,
            labelled=rates[row.what].n if row.what in rates else 0,
        )
        for row in rows
    }


def segmenter_table(clip: str, threads: int, rows: Sequence[SegmenterRow], load: float) -> Table:
    """One row per way to segment."""
    base = next(row.speed.fps for row in rows if row.speed.what == IN_THE_LOOP)
    return Table(
        title=f"A segmenter beside the loop on {clip}, one process with {threads} threads",
        columns=("segmenter", "frames/s", "ratio", "ms a frame", "CPU ms", "age of masks s", "FRR %", "n"),
        rows=tuple(
            (
                row.speed.what,
                f"{row.speed.fps:.1f}",
                f"{row.speed.fps / base:.2f}",
                f"{row.speed.frame_ms[0]:.0f} / {row.speed.frame_ms[1]:.0f}",
                f"{row.speed.cpu_ms:.0f}",
                *_masks(row.masks),
            )
            for row in rows
        ),
        words=1,
        notes=(
            "The real-time preset with models, from images in memory to attention. Ms a frame: from the end of a frame "
            "to that of the next, median / 95th percentile. CPU ms: of a frame, over all threads. All rows are "
            "measured in turn, three times; the best of three counts. Load of the machine before, in processes: "
            f"{load:.1f}.",
            "Age: from the frame in which the masks were found to the frame that uses them, median / greatest. "
            "segmentation.every and segmentation.delay decide it, not speed. Age and FRR are those of a scored run.",
        ),
    )


def _masks(masks: MaskAges | None) -> tuple[str, str, str]:
    if masks is None:
        return UNKNOWN, UNKNOWN, UNKNOWN
    age = f"{np.median(masks.ages_s):.2f} / {max(masks.ages_s):.2f}"
    if not masks.labelled:
        return age, UNKNOWN, UNKNOWN
    return age, f"{100 * masks.correct / masks.labelled:.1f}", str(masks.labelled)
