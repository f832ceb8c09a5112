"""``vfoa annotate``: label a clip in a page on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import Clip, NoOpen, Port, RunConfiguration


def annotate(
    clip: Clip,
    run: Annotated[Path | None, typer.Option(metavar="RUN", help="Show outlines and suggestions of this run.")] = None,
    config: RunConfiguration = None,
    annotator: Annotated[
        str | None, typer.Option(metavar="ANNOTATOR", help="Label CLIP@ANNOTATOR.csv, not CLIP.csv.")
    ] = None,
    uncertain_first: Annotated[
        bool, typer.Option("--uncertain-first", help="Go through the frames from the least certain one on.")
    ] = False,
    blind: Annotated[bool, typer.Option("--blind", help="Show no suggestions.")] = False,
    port: Port = 0,
    no_open: NoOpen = False,
) -> None:
    """Serve the labelling page. Every change is saved at once; Ctrl-C ends it."""
    from harness.annotate.server import PageServer
    from harness.annotate.session import Session
    from harness.local_server import ended_by_sigterm, open_browser

    session = Session(
        clip, run=run, configuration=config, annotator=annotator, blind=blind, uncertain_first=uncertain_first
    )
    if session.notice:
        typer.echo(session.notice, err=True)
    server = PageServer(session, port)
    typer.echo(f"{session.path}\n{server.address}")
    if not no_open:
        open_browser(server.address)
    try:
        with ended_by_sigterm():
            server.run()
    finally:
        session.close()
