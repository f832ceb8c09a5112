"""Time of each stage of each configuration on a clip: a real run, in one process with one thread."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from harness.clips.manifest import ClipManifest
from harness.pipeline.configuration import Configuration, clouds_of
from harness.pipeline.drawn_stage import DrawnClip
from harness.record.layers import ClipFiles, layer_names
from harness.report.formats import UNKNOWN, Table
from harness.report.sinks import ThumbnailSinks, recordings
from harness.run.directory import RunDirectory
from harness.run.loop import ClipJob, run_clip
from harness.run.timings import join_timings, read_timings

if TYPE_CHECKING:
    import pandas as pd

STAGES = (
    "decode",
    "stereo",
    "segmentation",
    "heads",
    "head_pose",
    "gaze",
    "tracking",
    "reconstruction",
    "attention",
    "measures",
    "recording",
    "answers",
)


ONCE = frozenset({"measures", "recording"})
"""Stages that a run times once for the configurations that share them, at the first of these."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageCosts:
    """One configuration's milliseconds per frame, as if it ran alone: by stage (median, 95th percentile) and in total.

    ``frame_ms`` is without the stages of :data:`ONCE`; ``frames_per_second`` is from its median. ``recording_bytes`` is
    the size per frame of all files that show the configuration, those that it shares with others included.
    """

    configuration: str
    frames: int
    stages_ms: dict[str, tuple[float, float]]
    frame_ms: tuple[float, float]
    recording_bytes: float | None

    @property
    def frames_per_second(self) -> float:
        """Frames per second at the median."""
        return 1e3 / self.frame_ms[0]


def measure_stages(
    manifest: ClipManifest,
    configurations: Sequence[Configuration],
    frames: Sequence[int],
    drawn: DrawnClip | None,
) -> list[StageCosts]:
    """Run the frames under the configurations and read the costs from the run's timings.

    The first frame, in which networks are warmed up and tables are built, is left out. ``drawn`` is what a person drew.
    """
    with tempfile.TemporaryDirectory() as folder:
        directory = RunDirectory(Path(folder))
        job = ClipJob(
            manifest=manifest,
            frames=tuple(frames),
            configurations=tuple(configurations),
            directory=directory,
            clouds=clouds_of(configurations),
            sinks=(recordings(configurations), ThumbnailSinks()),
            drawn=drawn,
        )
        for error in run_clip(job, lambda clip: None).failures.values():
            raise error
        join_timings(directory, job.pairs)
        return _costs(directory, job)


def _costs(directory: RunDirectory, job: ClipJob) -> list[StageCosts]:
    table = read_timings(directory).to_pandas()
    table = table[table["frame"] != job.frames[0]] if len(job.frames) > 1 else table
    layers = layer_names({configuration.name: configuration.plain() for configuration in job.configurations})
    costs = []
    for clip, configuration in job.pairs:
        own = table[table["configuration"] == configuration]
        by_stage = {stage: _typical(rows["ms"]) for stage, rows in own.groupby("stage")}
        files = ClipFiles(run=directory.path, clip=clip).of(layers[configuration])
        costs.append(
            StageCosts(
                configuration=configuration,
                frames=len(job.frames),
                stages_ms={stage: by_stage[stage] for stage in STAGES if stage in by_stage},
                frame_ms=_typical(own[~own["stage"].isin(ONCE)].groupby("frame")["ms"].sum()),
                recording_bytes=sum(file.stat().st_size for file in files) / len(job.frames) if files else None,
            )
        )
    return costs


def _typical(ms: pd.Series[float]) -> tuple[float, float]:
    return float(ms.median()), float(ms.quantile(0.95))


def stages_table(clip: str, rows: Sequence[StageCosts]) -> Table:
    """Milliseconds per stage, median and 95th percentile, frames per second and bytes per frame: a column each."""
    present = [stage for stage in STAGES if any(stage in row.stages_ms for row in rows)]
    return Table(
        title=f"Milliseconds a frame on {clip}",
        columns=("stage", *(row.configuration for row in rows)),
        rows=(
            *((stage, *(_ms(row.stages_ms.get(stage)) for row in rows)) for stage in present),
            ("whole frame", *(_ms(row.frame_ms) for row in rows)),
            ("frames/s", *(f"{row.frames_per_second:.1f}" for row in rows)),
            ("recording, kB a frame", *(_kilobytes(row.recording_bytes) for row in rows)),
        ),
        words=1,
        notes=(
            "Median / 95th percentile of a real run in one process with one thread, each configuration as if alone. "
            "Measures and recording are timed once, at the first of the configurations that share them, and are no "
            "part of the whole frame.",
        ),
    )


def _ms(pair: tuple[float, float] | None) -> str:
    return UNKNOWN if pair is None else f"{pair[0]:.1f} / {pair[1]:.1f}"


def _kilobytes(size: float | None) -> str:
    return UNKNOWN if size is None else f"{size / 1e3:.0f}"
