"""``vfoa bench``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

ONLY_HELP = "Measure only this: stages, stereo, attention, memory ... (several times for more)."


def bench(
    experiment: Annotated[
        str, typer.Argument(metavar="EXPERIMENT", help="The experiment whose configurations are measured.")
    ] = "demo",
    clip: Annotated[
        str | None, typer.Option(metavar="CLIP", help="On this clip; the experiment's first if not given.")
    ] = None,
    limit: Annotated[int, typer.Option(min=2, help="Frames to measure.")] = 20,
    only: Annotated[list[str] | None, typer.Option(metavar="SECTION", help=ONLY_HELP)] = None,
    out: Annotated[Path | None, typer.Option(help="Write the tables to this Markdown file too.")] = None,
) -> None:
    """Measure what stages, matchers, attention, recordings and scores cost, against plain ways of doing the same."""
    from harness.bench.sections import SECTIONS, Bench
    from harness.cli.printing import print_report
    from harness.clips.manifest import load_manifest
    from harness.files import atomic_write
    from harness.report.formats import to_markdown
    from harness.runs import provenance
    from harness.runs.experiment import load_experiment
    from vfoa.errors import VfoaError, did_you_mean

    for name in only or ():
        if name not in SECTIONS:
            raise VfoaError(f"bench: --only: no {name!r}; {did_you_mean(name, SECTIONS)}")
    chosen = load_experiment(experiment, clips=(clip,) if clip else ())
    manifest = load_manifest(chosen.clips[0])
    frames = tuple(manifest.open().frames[:limit])
    given = Bench(name=experiment, experiment=chosen, manifest=manifest, frames=frames)
    tables = []
    for name in only or SECTIONS:
        for table in SECTIONS[name](given):
            print_report(table)
            tables.append(table)
    if out:
        machine = ", ".join(f"{key} {value}" for key, value in {**provenance.host(), **provenance.versions()}.items())
        options = [*(["--clip", clip] if clip else []), *(f"--only {name}" for name in only or ())]
        command = " ".join(["vfoa bench", experiment, "--limit", str(limit), *options])
        load = f"Load of the machine at the end, in processes: {os.getloadavg()[0]:.1f}."
        head = f"# Benchmark\n\n`{command}`: {machine}. {load}\n\n"
        atomic_write(out, head + "\n".join(to_markdown(table, level=2) for table in tables))
