"""``vfoa annotate``: label a clip in a page on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import Clip, NoOpen, Port, RunConfiguration, run_directories, run_folder
from harness.cli.terminal import ended_by_signals, say, say_forwarding, say_unknown_names
from harness.files.safe_names import vfoa_command


def annotate(
    clip: Clip,
    run: Annotated[
        str | None,
        typer.Option(metavar="RUN", help="Show outlines and suggestions of this run.", autocompletion=run_directories),
    ] = None,
    config: RunConfiguration = None,
    annotator: Annotated[
        str | None, typer.Option(metavar="ANNOTATOR", help="Label CLIP@ANNOTATOR.csv, not CLIP.csv.")
    ] = None,
    uncertain_first: Annotated[
        bool, typer.Option("--uncertain-first", help="Show the least certain frames first.")
    ] = False,
    blind: Annotated[bool, typer.Option("--blind", help="Show no suggestions.")] = False,
    port: Port = 0,
    no_open: NoOpen = False,
) -> None:
    """Serve the labelling page. Every change is saved at once; Ctrl-C ends it and scores RUN again."""
    from harness.annotate.app import PageServer
    from harness.annotate.session import Session
    from harness.server.local_server import open_browser

    folder = run_folder(run) if run else None
    session = Session(
        clip, run=folder, configuration=config, annotator=annotator, blind=blind, uncertain_first=uncertain_first
    )
    if session.notice:
        say(session.notice, err=True)
    server = PageServer(session, port)
    before = session.digest()
    say("\n".join(filter(None, (str(session.path), server.address, session.advice))))
    say_forwarding(server.port)
    if not no_open:
        open_browser(server.address)
    try:
        with ended_by_signals():
            server.run()
    finally:
        session.close()
    if folder is not None and session.digest() != before:
        _score_again(folder, annotator)


def _score_again(run: Path, annotator: str | None) -> None:
    """Score a run again with the changed labels, if it is scored against them."""
    from harness.report.write import refresh
    from harness.run.directory import RunDirectory

    directory = RunDirectory(run)
    if directory.read_manifest().scored_annotator == annotator:
        scores = refresh(directory)
        say(f"{run}: tables, page and recordings are updated")
        say_unknown_names(scores)
    else:
        again = vfoa_command("score", run, *(("--annotator", annotator) if annotator else ()))
        say(f"{run} is scored against other labels; `{again}` scores it against these")
