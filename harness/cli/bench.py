"""``vfoa bench``."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import Overrides, ProviderName, Replace, bench_sections, clip_names, experiment_and_clip_names
from harness.cli.run import experiment_of
from harness.cli.terminal import print_reports, say
from harness.files.safe_names import vfoa_command
from vfoa.errors import VfoaError, check_known

ONLY_HELP = "Measure only this: stages, stereo, realtime, attention or gpu (several times for more)."


def bench(
    experiment: Annotated[
        str,
        typer.Argument(
            metavar="EXPERIMENT | CLIP",
            help="An experiment whose configurations are measured, or a clip: those of `vfoa run CLIP`.",
            autocompletion=experiment_and_clip_names,
        ),
    ] = "demo",
    clip: Annotated[
        str | None,
        typer.Option(
            metavar="CLIP",
            help="Measure on this clip. Default: the experiment's first clip.",
            autocompletion=clip_names,
        ),
    ] = None,
    limit: Annotated[int, typer.Option(metavar="N", min=2, help="Number of frames to measure.")] = 20,
    provider: ProviderName = "cpu",
    overrides: Overrides = None,
    only: Annotated[
        list[str] | None, typer.Option(metavar="SECTION", help=ONLY_HELP, autocompletion=bench_sections)
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write the tables to this Markdown file.")
    ] = None,
    overwrite: Replace = False,
) -> None:
    """Measure the speed of stages, matchers, attention and networks, and the errors of matchers."""
    from harness.bench import SECTIONS, Bench
    from harness.clips.manifest import load_manifest
    from harness.files.io import atomic_write, check_new
    from harness.pipeline.weights import locate_weights
    from harness.report.formats import to_markdown
    from harness.run.experiment import is_experiment
    from harness.run.plan import fetch_command
    from harness.sources import MeasuredClip
    from vfoa.onnx import check_provider

    for section in only or ():
        check_known(section, SECTIONS, "bench: --only: no")
    check_provider(provider)
    changes = tuple(overrides or ())
    loaded = experiment_of([experiment], (clip,) if clip else (), changes, None)
    name = experiment if is_experiment(experiment) else "default"
    manifest = load_manifest(loaded.clips[0])
    of_clip = (configuration.for_clip(manifest.name) for configuration in loaded.configurations)
    chosen = replace(loaded, configurations=tuple(configuration.on(provider) for configuration in of_clip))
    if out:
        check_new(out, replace=overwrite, hint=", or another --out", inputs=manifest.files)
    opened = manifest.open()
    sections = _of_measurements(only, manifest.name) if isinstance(opened, MeasuredClip) else only or list(SECTIONS)
    if {*sections} - {"stereo", "realtime"}:  # which need no networks, or leave rows without them out
        choices = [choice for configuration in chosen.configurations for choice in configuration.stages]
        locate_weights(choices, fetch_command(loaded.clips[0]) if name == "default" else None)
    given = Bench(
        name=name,
        experiment=chosen,
        manifest=manifest,
        frames=tuple(opened.frames[:limit]),
        provider=provider,
        overrides=changes,
    )
    tables = []
    for section in sections:
        of_section = SECTIONS[section](given)
        print_reports(of_section)
        tables += of_section
    if out:
        atomic_write(out, _heading() + "\n".join(to_markdown(table, level=2) for table in tables))


def _of_measurements(only: list[str] | None, clip: str) -> list[str]:
    """The sections for a clip without images: those that were asked for, or all that need none."""
    from harness.bench import OF_IMAGES, SECTIONS

    if wrong := [section for section in only or () if section in OF_IMAGES]:
        raise VfoaError(f"bench: --only: {wrong[0]}: {clip} holds measurements; expected a clip with images")
    say(f"{clip} holds measurements: without {', '.join(OF_IMAGES)}, which are of images.")
    return [section for section in only or SECTIONS if section not in OF_IMAGES]


def _heading() -> str:
    """The first lines of the file of tables: the command, and the machine that has measured."""
    from harness.run.plan import host, versions

    machine = ", ".join(f"{key} {value}" for key, value in {**host(), **versions()}.items())
    load = f"Load of the machine at the end, in processes: {os.getloadavg()[0]:.1f}."
    return f"# Benchmark\n\n`{vfoa_command(*sys.argv[1:])}`: {machine}. {load}\n\n"
