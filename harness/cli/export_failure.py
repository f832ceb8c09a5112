"""``vfoa export-failure``: a few frames of a recording, to send to a colleague."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import OneClip, OneConfiguration, Recordings


def export_failure(
    run: Recordings,
    frame: Annotated[int, typer.Option(help="The frame in the middle, in the source's own numbers.")],
    clip: OneClip = None,
    config: OneConfiguration = None,
    margin: Annotated[int, typer.Option(help="Frames to keep on either side.")] = 10,
    out: Annotated[
        Path | None, typer.Option(metavar="RRD", help="The file to write; named after what it holds if not given.")
    ] = None,
) -> None:
    """Write the frames around one of them into a small recording of their own."""
    from harness.recording import find_recordings
    from harness.recording.excerpt import write_excerpt
    from vfoa.errors import VfoaError

    recordings = find_recordings(run, clip, config)
    if len(recordings) > 1:
        names = ", ".join(path.stem for path in recordings)
        raise VfoaError(f"{run}: expected one recording, found {names}: choose with --clip and --config")
    excerpt = out or Path(f"{recordings[0].stem}__{frame}.rrd")
    write_excerpt(recordings[0], frame, margin, excerpt)
    typer.echo(f"{excerpt}: {excerpt.stat().st_size / 1e6:.1f} MB")
