"""``vfoa annotate``: label a clip in a page on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def annotate(
    clip: Annotated[str, typer.Argument(metavar="CLIP", help="The clip's name, or its manifest.")],
    run: Annotated[Path | None, typer.Option(help="A run: its outlines and suggestions are shown.")] = None,
    config: Annotated[str | None, typer.Option(help="The run's configuration, where it has several.")] = None,
    annotator: Annotated[
        str | None, typer.Option(metavar="NAME", help="Write annotations/CLIP@NAME.csv instead of the clip's own file.")
    ] = None,
    uncertain_first: Annotated[
        bool, typer.Option("--uncertain-first", help="Begin with the frames in which the run was least sure.")
    ] = False,
    blind: Annotated[bool, typer.Option("--blind", help="Show no suggestions.")] = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="0: any that is free.")] = 0,
    no_open: Annotated[bool, typer.Option("--no-open", help="Print the address only; open no browser.")] = False,
) -> None:
    """Serve a page on which to say who looks at what. Every change is saved at once; Ctrl-C ends it."""
    from harness.annotate.server import PageServer
    from harness.annotate.session import Session
    from harness.local_server import ended_by_sigterm, open_browser

    session = Session(
        clip, run=run, configuration=config, annotator=annotator, blind=blind, uncertain_first=uncertain_first
    )
    server = PageServer(session, port)
    typer.echo(f"{session.path}\n{server.address}")
    if not no_open:
        open_browser(server.address)
    try:
        with ended_by_sigterm():
            server.run()
    finally:
        session.close()
