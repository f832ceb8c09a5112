"""``vfoa plot``: a figure of a run as a file for a paper."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import Run, run_folder
from harness.cli.terminal import say


class Kind(StrEnum):
    """Kinds of figures."""

    forest = "forest"
    errors = "errors"
    oracle = "oracle"
    sweep = "sweep"
    timeline = "timeline"
    confusion = "confusion"


def plot(
    run: Run,
    kind: Annotated[Kind, typer.Option(help="Figure to draw.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="File to write: .pdf, .svg or .png.")],
    clip: Annotated[
        str | None, typer.Option(metavar="CLIP", help="Clip of a timeline or confusion. Default: the first; all.")
    ] = None,
    subject: Annotated[
        str | None, typer.Option(metavar="SUBJECT", help="Subject of a timeline. Default: the first.")
    ] = None,
    width: Annotated[
        float | None, typer.Option(min=1, metavar="INCHES", help="Width of the figure. Default: that of its kind.")
    ] = None,
    replace: Annotated[bool, typer.Option("--replace", help="Overwrite the file of --out.")] = False,
) -> None:
    """Draw a figure of a run or of a sweep, in a style for print."""
    from harness.files.io import check_new
    from harness.report.figures import check_format, save_figure
    from harness.report.plots.draw import plot_run
    from harness.run.directory import RunDirectory
    from vfoa.errors import VfoaError

    check_format(out)
    folder = run_folder(run)
    check_new(out, replace=replace, hint=", or another --out", inputs=RunDirectory(folder).inputs)
    if not out.parent.is_dir():
        raise VfoaError(f"{out.parent}: found no such folder; expected an existing one for --out")
    figure = plot_run(folder, kind.value, clip=clip, subject=subject)
    if width is not None:
        figure.set_figwidth(width)
    save_figure(out, figure)
    say(f"Figure: {out}")
