"""``vfoa view``: open a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.options import OneClip, OneConfiguration, Recordings, Replace, run_folder

if TYPE_CHECKING:
    from harness.record.composed import Composed


def view(
    run: Recordings,
    clip: OneClip = None,
    config: OneConfiguration = None,
    frame: Annotated[int | None, typer.Option(help="Open the first recording at this frame.")] = None,
    subject: Annotated[str | None, typer.Option(help="Show this person's tab.")] = None,
    web: Annotated[bool, typer.Option("--web", help="Open it in the browser; Ctrl-C ends it.")] = False,
    failures: Annotated[
        bool,
        typer.Option("--failures", help="Step from one wrong frame to the next by keys; with --web, by links."),
    ] = False,
    compare: Annotated[
        tuple[str, str] | None,
        typer.Option(metavar="K1 K2", help="Open two configurations of --clip side by side."),
    ] = None,
    screenshot: Annotated[
        Path | None,
        typer.Option(metavar="PNG", help="Write a screenshot of the first recording; needs no display."),
    ] = None,
    replace: Replace = False,
) -> None:
    """Open a run's recordings in the Rerun viewer: one for each clip, with a tab for each configuration."""
    from harness.cli.failures import browse_failures, step_through
    from harness.files.io import check_new
    from harness.record import viewer
    from harness.record.composed import find_recordings
    from harness.run.directory import RunDirectory
    from harness.server.local_server import ended_by_sigterm, sigterm_as_ctrl_c
    from vfoa.errors import VfoaError

    folder = run_folder(run)
    if failures:
        if frame is not None or screenshot is not None or compare is not None:
            raise VfoaError("view: --failures selects the frames: leave out --frame, --compare and --screenshot")
        if web:
            browse_failures(folder, clip, config)
            return
        with ended_by_sigterm():
            step_through(folder, clip, config)
        return
    if web and screenshot is not None:
        raise VfoaError("view: --web writes no file: leave out --screenshot")
    if screenshot is not None:
        inputs = [folder, *RunDirectory(folder).inputs]
        check_new(screenshot, replace=replace, hint=", or another --screenshot", inputs=inputs)
    if compare is None:
        recordings = find_recordings(folder, clip, config, subject)
    else:
        recordings = [_compared(folder, clip, config, subject, compare)]
    if frame is not None:
        recordings[0].expect_frame(frame)
    if screenshot is not None:
        with sigterm_as_ctrl_c():
            viewer.screenshot(recordings[0], frame, screenshot)
    elif web:
        _browse(recordings, frame)
    else:
        with ended_by_sigterm():
            viewer.show(recordings, frame)


def _browse(recordings: list[Composed], frame: int | None) -> None:
    from harness.cli.browse import browse
    from harness.record.web_app import open_path

    first, *others = recordings
    paths = [open_path(first.name, frame, first.subject), *(open_path(other.name) for other in others)]
    browse(recordings, paths)


def _compared(
    run: Path, clip: str | None, config: str | None, subject: str | None, compare: tuple[str, str]
) -> Composed:
    """Two configurations of a clip side by side."""
    from dataclasses import replace

    from harness.record.composed import find_clips
    from vfoa.errors import VfoaError

    if clip is None or config is not None or compare[0] == compare[1] or run.is_file():
        raise VfoaError("view --compare: expected a run's directory, --clip, no --config, and two configurations")
    for configuration in compare:
        find_clips(run, clip, configuration)
    (found,) = find_clips(run, clip, None)
    found.expect_subject(subject)
    return replace(found.compare(*compare), subject=subject)
