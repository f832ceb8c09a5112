"""``vfoa bench``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def bench(
    experiment: Annotated[str, typer.Argument(help="The experiment whose configurations are measured.")] = "demo",
    clip: Annotated[str | None, typer.Option(help="On this clip; the experiment's first if not given.")] = None,
    limit: Annotated[int, typer.Option(min=2, help="Frames to measure.")] = 20,
    out: Annotated[Path | None, typer.Option(help="Write the tables to this Markdown file too.")] = None,
) -> None:
    """Measure ms per stage, frames a second, disparity errors, attention, scoring, the gaze filter."""
    from rich.console import Console

    from harness.bench.attention import time_attention
    from harness.bench.gaze_filter import gaze_filter_table, measure_gaze_filter
    from harness.bench.scoring import time_scoring
    from harness.bench.stages import measure_stages
    from harness.bench.stereo import measure_stereo
    from harness.bench.sweep import time_sweep
    from harness.bench.tables import attention_table, scoring_table, stages_table, stereo_table, sweep_table
    from harness.clips.manifest import load_manifest
    from harness.files import atomic_write
    from harness.report.formats import to_markdown, to_rich
    from harness.runs import provenance
    from harness.runs.experiment import load_experiment

    chosen = load_experiment(experiment, clips=(clip,) if clip else ())
    manifest = load_manifest(chosen.clips[0])
    opened = manifest.open()
    frames = list(opened.frames)[:limit]
    stages = measure_stages(manifest, chosen.configurations, frames, "light")
    tables = [stages_table(manifest.name, stages)]
    if opened.truth(frames[0]).disparity is not None:
        tables.append(stereo_table(manifest.name, measure_stereo(opened, chosen.configurations, frames)))
    tables.append(
        attention_table(
            [
                time_attention(cones_cm=(10.0,), boxes=20, subjects=1),
                time_attention(cones_cm=(10.0, 25.0), boxes=20, subjects=3),
            ]
        )
    )
    tables.append(sweep_table(time_sweep()))
    tables.append(scoring_table([time_scoring(subjects=1), time_scoring(subjects=3)]))
    tables.append(gaze_filter_table(measure_gaze_filter()))
    for table in tables:
        Console().print(to_rich(table))
    if out:
        machine = ", ".join(f"{key} {value}" for key, value in {**provenance.host(), **provenance.versions()}.items())
        command = f"vfoa bench {experiment} --limit {limit}" + (f" --clip {clip}" if clip else "")
        head = f"# Benchmark\n\n`{command}`: {machine}.\n\n"
        atomic_write(out, head + "\n".join(to_markdown(table, level=2) for table in tables))
