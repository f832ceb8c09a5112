"""``vfoa view``: look at a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import OneClip, OneConfiguration, Recordings


def view(
    run: Recordings,
    clip: OneClip = None,
    config: OneConfiguration = None,
    frame: Annotated[int | None, typer.Option(help="Open the first recording at this frame.")] = None,
    web: Annotated[bool, typer.Option("--web", help="Show it in a browser; Ctrl-C ends it.")] = False,
    failures: Annotated[
        bool, typer.Option("--failures", help="Go from wrong frame to wrong frame, by keys in this terminal.")
    ] = False,
    compare: Annotated[
        tuple[str, str] | None,
        typer.Option(metavar="K1 K2", help="Write two configurations of --clip side by side into one, and open that."),
    ] = None,
    screenshot: Annotated[
        Path | None,
        typer.Option(metavar="PNG", help="Draw the first recording into a file; needs no display."),
    ] = None,
) -> None:
    """Open a run's recordings in the Rerun viewer; with several, the first is in front and all are listed."""
    from harness.cli.failures import step_through
    from harness.local_server import ended_by_sigterm, sigterm_as_ctrl_c
    from harness.recording import find_recordings, viewer
    from vfoa.errors import VfoaError

    if failures:
        if web or frame is not None or screenshot is not None or compare is not None:
            raise VfoaError(
                "view: --failures chooses the frames itself: leave out --web, --frame, --compare and --screenshot"
            )
        with ended_by_sigterm():
            step_through(run, clip, config)
        return
    if web and screenshot is not None:
        raise VfoaError("view: --web draws no file: leave out --screenshot")
    recordings = find_recordings(run, clip, config) if compare is None else [_side_by_side(run, clip, config, compare)]
    if frame is not None:
        _expect_frame(run, recordings[0], frame)
    if screenshot is not None:
        with sigterm_as_ctrl_c():
            viewer.screenshot(recordings[0], frame, screenshot)
    elif web:
        _browse(recordings, frame)
    else:
        with ended_by_sigterm():
            viewer.show(recordings, frame)


def _browse(recordings: list[Path], frame: int | None) -> None:
    from harness.cli.browse import browse
    from harness.recording.site import open_path

    first, *others = recordings
    browse(recordings, [open_path(first.stem, frame), *(open_path(other.stem, None) for other in others)])


def _expect_frame(run: Path, recording: Path, frame: int) -> None:
    """Refuse a frame that the run does not have; the viewer would go to the nearest and say nothing."""
    from harness.runs.directory import RunDirectory, pair_of
    from vfoa.errors import VfoaError

    if not RunDirectory(run).manifest.is_file():
        return
    frames = {clip["name"]: clip["frames"] for clip in RunDirectory(run).read_manifest()["clips"]}
    known = frames[pair_of(recording.stem)[0]]
    if frame not in known:
        raise VfoaError(f"{recording}: found no frame {frame}; expected one of {min(known)} to {max(known)}")


def _side_by_side(run: Path, clip: str | None, config: str | None, compare: tuple[str, str]) -> Path:
    """Write the recording of both configurations into the run's directory."""
    from harness.recording import VERSUS, find_recordings
    from harness.recording.side_by_side import write_side_by_side
    from vfoa.errors import VfoaError

    if clip is None or config is not None or compare[0] == compare[1] or run.is_file():
        raise VfoaError("view --compare: expected a run's directory, --clip, no --config, and two configurations")
    found = {configuration: find_recordings(run, clip, configuration)[0] for configuration in compare}
    path = run / f"{clip}__{VERSUS.join(compare)}.rrd"
    write_side_by_side(clip, found, path)
    typer.echo(f"wrote {path}")
    return path
