"""``vfoa view``: look at a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def view(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run's directory, or one .rrd file.")],
    clip: Annotated[str | None, typer.Option(help="Only recordings of this clip.")] = None,
    config: Annotated[str | None, typer.Option(help="Only recordings under this configuration.")] = None,
    frame: Annotated[int | None, typer.Option(help="Open the first recording at this frame.")] = None,
    web: Annotated[bool, typer.Option("--web", help="Show it in a browser; Ctrl-C ends it.")] = False,
    failures: Annotated[
        bool, typer.Option("--failures", help="Go from wrong frame to wrong frame, by keys in this terminal.")
    ] = False,
    screenshot: Annotated[
        Path | None,
        typer.Option(metavar="PNG", help="Draw the first recording into a file; needs no display."),
    ] = None,
) -> None:
    """Open a run's recordings in the Rerun viewer; with several, the first is in front and all are listed."""
    from harness.cli.failures import step_through
    from harness.recording import find_recordings, viewer
    from vfoa.errors import VfoaError

    if failures:
        if web or frame is not None or screenshot is not None:
            raise VfoaError("view: --failures chooses the frames itself: leave out --web, --frame and --screenshot")
        step_through(run, clip, config)
        return
    recordings = find_recordings(run, clip, config)
    if web and (frame is not None or screenshot is not None):
        raise VfoaError("view: --web cannot open at a frame or draw a file: leave out --frame and --screenshot")
    if screenshot is not None:
        viewer.screenshot(recordings[0], frame, screenshot)
    elif web:
        viewer.serve_web(recordings)
    else:
        viewer.show(recordings, frame)
