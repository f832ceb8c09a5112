"""``vfoa report``: a run's page, on disk or from a server that also opens its recordings."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import typer

from harness.cli.options import NoOpen, Port, Run, run_folder
from harness.cli.terminal import say


def report(
    run: Run,
    serve: Annotated[
        bool,
        typer.Option(
            "--serve", help="Serve the page on this machine: a click on a frame opens its recording; Ctrl-C ends it."
        ),
    ] = False,
    port: Port = 0,
    no_open: NoOpen = False,
) -> None:
    """Write a run's report page from its results and the present labels."""
    from harness.report.write import report_page, rescore
    from harness.run.directory import RunDirectory
    from vfoa.errors import VfoaError

    folder = run_folder(run)
    directory = RunDirectory(folder)
    if not serve and (port or no_open):
        raise VfoaError("report: --port and --no-open are for --serve: leave them out, or add it")
    if not serve:
        rescore(directory)
        say(f"Page: {directory.path / 'report.html'}")
        return
    from harness.annotate.correction_page import correction_routes
    from harness.cli.browse import browse
    from harness.record.composed import served_recordings

    recordings = served_recordings(folder)
    page = partial(report_page, directory, {pair: each.name for pair, each in recordings.items()})
    page()  # so that an error in the run is reported here, and not in the browser
    more = correction_routes(directory)
    browse(recordings.values(), ["/"], page=page, more=more, port=port, no_open=no_open)
