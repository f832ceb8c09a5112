"""``vfoa export-failure``: a few frames of a recording as a small file, for sharing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import OneClip, OneConfiguration, Recordings, run_folder
from harness.cli.terminal import say


def export_failure(
    run: Recordings,
    frame: Annotated[int, typer.Option(help="The frame, in the source's own numbers.")],
    clip: OneClip = None,
    config: OneConfiguration = None,
    subject: Annotated[str | None, typer.Option(help="Open it with this person's tab in front.")] = None,
    margin: Annotated[int, typer.Option(help="Frames to keep on either side.")] = 10,
    out: Annotated[
        Path | None,
        typer.Option(metavar="RRD", help="File to write. Default: named after clip, configuration and frame."),
    ] = None,
    replace: Annotated[bool, typer.Option("--replace", help="Overwrite the file of --out.")] = False,
) -> None:
    """Write one frame and its neighbours as a small recording."""
    from dataclasses import replace as changed

    from harness.files.io import check_new
    from harness.record.composed import find_clips
    from harness.record.excerpt import write_excerpt
    from vfoa.errors import VfoaError

    found = find_clips(run_folder(run), clip, config)
    pairs = [f"{each.files.clip}, {layers.configuration}" for each in found for layers in each.layers]
    if len(pairs) > 1:
        raise VfoaError(f"{run}: expected one recording, found {'; '.join(pairs)}: choose with --clip and --config")
    found[0].expect_subject(subject)
    recording = changed(found[0].compose(), subject=subject)
    excerpt = out or Path(f"{recording.name}__{frame}.rrd")
    check_new(excerpt, replace=replace or out is None, hint=", or another --out", inputs=recording.files)
    write_excerpt(recording, found[0].rate_hz, frame, margin, excerpt)
    say(f"{excerpt}: {excerpt.stat().st_size / 1e6:.1f} MB")
