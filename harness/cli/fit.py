"""``vfoa fit``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.completion import experiment_and_clip_names
from harness.cli.options import Replace
from harness.cli.terminal import say

if TYPE_CHECKING:
    from harness.run.directory import RunDirectory


def fit(
    what: Annotated[
        str,
        typer.Argument(
            metavar="EXPERIMENT | RUN",
            help="An experiment with labelled clips, or the directory of its run.",
            autocompletion=experiment_and_clip_names,
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="The file to write; EXPERIMENT-fitted.toml if not given.")] = None,
    config: Annotated[
        str | None,
        typer.Option("--config", metavar="NAME", help="The configuration to fit; the first posterior if none."),
    ] = None,
    replace: Replace = False,
) -> None:
    """Fit the posterior's settings to labelled clips: errors, bias, how heads follow, dwell times, share of nowhere.

    Each clip is also judged with settings fitted on the others. Use the file with ``vfoa run X --preset FILE``.
    """
    from harness.cli.terminal import print_reports
    from harness.files import atomic_write, check_new
    from harness.report.fit import fit_tables, fitted_text
    from harness.score.fit_posterior import fit_posterior
    from harness.score.fit_source import read_labelled

    inputs = list(_inputs(what))
    if out is not None:
        check_new(out, replace=replace, hint=", or another --out", inputs=inputs)
    directory = _directory(what)
    found = read_labelled(directory, config)
    path = out or Path(f"{found.experiment}-fitted.toml")
    check_new(path, replace=replace, hint=", or another --out", inputs=inputs)
    fitted = fit_posterior(found)
    atomic_write(path, fitted_text(fitted))
    print_reports(fit_tables(fitted))
    say(f"{path}: vfoa run EXPERIMENT --preset {path}")


def _inputs(what: str) -> Iterator[Path]:
    """The files that are read: of the run or the experiment, and of its clips."""
    from harness.clips.manifest import load_manifest
    from harness.data_folders import find
    from harness.run.directory import RunDirectory
    from harness.run.experiment import load_experiment
    from vfoa.errors import VfoaError

    run = RunDirectory(Path(what))
    if run.manifest.is_file():
        yield from run.inputs
        clips = [each["name"] for each in run.read_manifest()["clips"]]
    else:
        yield find("experiments", what) or Path(what)
        clips = list(load_experiment(what).clips)
    for clip in clips:
        with suppress(VfoaError):  # the clip of a finished run may be gone
            yield from load_manifest(clip).files


def _directory(what: str) -> RunDirectory:
    """Return the run of that name, or run the experiment without recordings."""
    from harness.cli.terminal import frames_bar
    from harness.run.directory import RunDirectory
    from harness.run.experiment import load_experiment
    from harness.run.runner import prepare, run_plan

    if (Path(what) / "manifest.json").is_file():
        return RunDirectory(Path(what))
    plan = prepare(load_experiment(what))
    with frames_bar(plan.frames, plan.experiment.name) as progress:
        return run_plan(plan, Path("runs") / plan.experiment.name, workers=1, progress=progress, beside=True)
