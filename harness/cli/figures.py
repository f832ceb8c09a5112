"""``vfoa figures``: figures of runs for a paper."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import Replace, Runs, clip_names, composed_name, configuration_names, run_folder
from harness.cli.terminal import say


def figures(
    runs: Runs,
    out: Annotated[Path, typer.Option(metavar="DIRECTORY", help="Directory to write the files into.")],
    clip: Annotated[
        str | None,
        typer.Option(metavar="CLIP", help="Figure failure: a wrong frame of this clip.", autocompletion=clip_names),
    ] = None,
    config: Annotated[
        str | None,
        typer.Option(
            metavar="CONFIGURATION",
            help="Figure failure: a wrong frame under this configuration.",
            autocompletion=configuration_names,
        ),
    ] = None,
    subject: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Figure failure: a wrong frame of this person.", callback=composed_name),
    ] = None,
    frame: Annotated[int | None, typer.Option(metavar="FRAME", help="Figure failure: this frame.")] = None,
    replace: Replace = False,
) -> None:
    """Draw figures of runs for a paper: SVG and PDF, in the width of one column and of two. Needs vfoa[figures].

    FRR of all configurations with intervals, FRR by clip, error types, confusion, calibration and the learning curve of
    the logit, each over all clips; several runs share a figure. One failure is a strip of image, scene and attention.
    """
    from harness.files.io import check_new
    from harness.report.figures.files import Wanted, check_matplotlib, figure_files, figures_of, write_figures
    from harness.run.directory import RunDirectory

    check_matplotlib()
    folders = [run_folder(run) for run in runs]
    for file in figure_files(out):
        check_new(file, replace=replace, hint=", or another --out", inputs=RunDirectory(folders[0]).inputs)
    drawn = figures_of(folders, Wanted(clip=clip, configuration=config, subject=subject, frame=frame))
    files = write_figures(drawn, out)
    for note in drawn.missing:
        say(f"Left out: {note}")
    say(f"{len(files)} files in {out}: {', '.join(drawn.drawn)}")
