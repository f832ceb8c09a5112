"""``vfoa view``, ``export-failure``, ``catalog``: open recordings, write frames, serve runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated
from urllib.parse import urlsplit

import typer

from harness.cli.options import (
    OneClip,
    OneConfiguration,
    Port,
    Recordings,
    Replace,
    Run,
    Where,
    composed_name,
    conditions,
    run_directories,
    run_folder,
)
from harness.cli.terminal import ended_by_signals, say, say_forwarding, say_relabelled, signals_as_ctrl_c
from harness.files.safe_names import vfoa_command
from vfoa.errors import VfoaError, did_you_mean, listed

if TYPE_CHECKING:
    from harness.record.composed import Composed
    from harness.record.web_app import Routes

MOST_OPENED = 20
"""Most clips that are opened at once: a viewer with hundreds of recordings takes minutes to open."""


def view(
    run: Recordings,
    clip: OneClip = None,
    config: OneConfiguration = None,
    frame: Annotated[int | None, typer.Option(metavar="FRAME", help="Open the first recording at this frame.")] = None,
    subject: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Show this person's tab. Default: with --frame that of the first person who is wrong there. "
            "With --failures: only of this person.",
            callback=composed_name,
        ),
    ] = None,
    web: Annotated[bool, typer.Option("--web", help="Open it in the browser; Ctrl-C ends it.")] = False,
    failures: Annotated[
        bool, typer.Option("--failures", help="Step from one wrong frame to the next by keys; with --web, by links.")
    ] = False,
    error: Annotated[
        str | None,
        typer.Option("--error", metavar="TYPE", help="With --failures: only of this error type, such as outscored."),
    ] = None,
    where: Where = None,
    compare: Annotated[
        tuple[str, str] | None, typer.Option(metavar="K1 K2", help="Open two configurations of a clip side by side.")
    ] = None,
    screenshot: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Write a screenshot of the first recording; needs no display.")
    ] = None,
    replace: Replace = False,
) -> None:
    """Open a run's recordings in the Rerun viewer: one for each clip, with a tab for each configuration."""
    from harness.cli.failures import Chosen, browse_failures, step_through
    from harness.cli.serving import browse
    from harness.files.io import check_new
    from harness.record import viewer
    from harness.record.composed import by_name, find_recordings
    from harness.record.web_app import open_path
    from harness.run.directory import RunDirectory

    folder = run_folder(run)
    if failures:
        if frame is not None or screenshot is not None or compare is not None:
            raise VfoaError("view: --failures selects the frames: leave out --frame, --compare and --screenshot")
        chosen = Chosen(
            clip=clip, configuration=config, subject=subject, error_type=_error_type(error), where=conditions(where)
        )
        with ended_by_signals():
            (browse_failures if web else step_through)(folder, chosen)
        return
    if error is not None or where:
        raise VfoaError("view: --error and --where choose wrong frames: add --failures")
    if screenshot is not None:
        if web:
            raise VfoaError("view: --web writes no file: leave out --screenshot")
        inputs = [folder, *RunDirectory(folder).inputs]
        check_new(screenshot, replace=replace, hint=", or another --screenshot", inputs=inputs)
        if screenshot.suffix.lower() != ".png":
            raise VfoaError(f"--screenshot {screenshot}: found the suffix {screenshot.suffix!r}; expected .png")
    if frame is not None and subject is None and folder.is_dir():
        subject = _first_wrong(folder, clip, config, compare, frame)
    if compare is None:
        recordings = find_recordings(folder, clip, config, subject)
    else:
        recordings = [_compared(folder, clip, config, subject, compare)]
    if len(recordings) > MOST_OPENED:
        say(f"vfoa: the first {MOST_OPENED} of {len(recordings)} clips; --clip opens another one", err=True)
    recordings = recordings[:MOST_OPENED]
    first, *others = recordings
    if frame is not None:
        first.expect_frame(frame)
    if folder.is_file():
        _say_whole(folder)
    say_relabelled(folder, clip)
    if screenshot is not None:
        with signals_as_ctrl_c():
            viewer.screenshot(first, frame, screenshot)
    elif web:
        paths = [open_path(first.name, frame, first.subject), *(open_path(other.name) for other in others)]
        browse(by_name(recordings), paths, more=_label_routes(folder))
    else:
        with ended_by_signals():
            viewer.show(recordings, frame)


def _first_wrong(
    run: Path, clip: str | None, config: str | None, compare: tuple[str, str] | None, frame: int
) -> str | None:
    """The first subject who is wrong in a frame of the recording that opens first; None if nobody is."""
    from harness.record.composed import find_clips
    from harness.record.frame_reading import first_wrong

    first, *_ = find_clips(run, clip, config)
    shown = [first] if compare is None else [first.under(name) for name in compare]
    return next((subject for each in shown if (subject := first_wrong(each, frame)) is not None), None)


def _say_whole(file: Path) -> None:
    """Say which command shows the whole recording, if a file is one of its layers in the directory of a run."""
    from harness.record.composed import find_clips

    run = file.parent
    try:
        clips = find_clips(run, None, None)
    except VfoaError:  # no directory of a run
        return
    for clip in clips:
        for layers in clip.layers:
            if file in clip.files.of(layers):
                whole = vfoa_command("view", run, "--clip", clip.files.clip, "--config", layers.configuration)
                say(f"vfoa: {file}: one layer of a recording; all of it: {whole}", err=True)
                return


def _error_type(name: str | None) -> str | None:
    """The error type of this name, as tables and pages have it."""
    from harness.score.verdicts import ERROR_TYPES

    if name is None:
        return None
    key = name.strip().lower().replace(" ", "_")
    if key not in ERROR_TYPES:
        raise VfoaError(f"view: --error: found {name!r}; {did_you_mean(key, ERROR_TYPES)}")
    return key


def _label_routes(run: Path) -> Routes:
    """The form that labels frames of a finished run; none for a recording outside a run, or a run that goes on."""
    from harness.annotate.correction import correction_routes
    from harness.run.directory import RunDirectory

    directory = RunDirectory(run)
    is_finished = run.is_dir() and bool(directory.read_manifest().finished)
    return correction_routes(directory) if is_finished else ()


def _compared(
    run: Path, clip: str | None, config: str | None, subject: str | None, compare: tuple[str, str]
) -> Composed:
    """Two configurations of a clip side by side."""
    from dataclasses import replace

    from harness.record.composed import find_clips
    from harness.run.results import choose

    if config is not None or compare[0] == compare[1] or run.is_file():
        raise VfoaError("view --compare: expected a run's directory, no --config, and two configurations")
    recorded, *others = find_clips(run, clip, None)
    if others:
        clips = listed([each.files.clip for each in (recorded, *others)])
        raise VfoaError(f"{run}: has several clips; choose one with --clip: {clips}")
    recorded.expect_subject(subject)
    names = [layers.configuration for layers in recorded.layers]
    first, second = (choose(names, configuration, run) for configuration in compare)
    return replace(recorded.compare(first, second), subject=subject)


def catalog(
    runs: Annotated[
        list[str],
        typer.Argument(metavar="RUN", help="Directories of runs with recordings.", autocompletion=run_directories),
    ],
    port: Port = 0,
) -> None:
    """Serve runs as datasets of Rerun's catalogue on this machine; Ctrl-C ends it. Needs vfoa[catalog]."""
    from threading import Event

    from harness.record.catalog import serving

    with ended_by_signals(), serving([run_folder(run) for run in runs], port) as catalogue:
        say(f"Serving until Ctrl-C: {', '.join(catalogue.datasets)}")
        say_forwarding(urlsplit(catalogue.address).port or port)
        say(f"Viewer: rerun {catalogue.address}")
        say("Python:")
        say("  from rerun.catalog import CatalogClient")
        say(f'  catalog = CatalogClient("{catalogue.address}")')
        say(f'  catalog.get_dataset("{next(iter(catalogue.datasets))}").segment_table().to_pandas()')
        Event().wait()


def export_failure(
    run: Run,
    frame: Annotated[int, typer.Option(metavar="FRAME", help="The frame, in the source's own numbers.")],
    clip: OneClip = None,
    config: OneConfiguration = None,
    subject: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Open it with this person's tab in front. Default: the first person who is wrong in the frame.",
            callback=composed_name,
        ),
    ] = None,
    margin: Annotated[int, typer.Option(metavar="N", help="Frames to keep on either side.")] = 10,
    out: Annotated[
        Path | None,
        typer.Option(metavar="RRD", help="File to write. Default: named after clip, configuration and frame."),
    ] = None,
    replace: Replace = False,
) -> None:
    """Write one frame and its neighbours as a small recording."""
    from harness.files.io import check_new
    from harness.record.composed import find_clips
    from harness.record.excerpt import write_excerpt
    from harness.record.frame_reading import first_wrong

    folder = run_folder(run)
    first, *others = find_clips(folder, clip, config)
    pairs = [
        f"{recorded.files.clip}, {layers.configuration}" for recorded in (first, *others) for layers in recorded.layers
    ]
    if len(pairs) > 1:
        found = f"{len(pairs)}, of {listed([f'({pair})' for pair in pairs], most=4)}"
        raise VfoaError(f"{run}: expected one recording, found {found}: choose with --clip and --config")
    recording = first.compose()
    excerpt = out or Path(f"{recording.name}__{frame}.rrd")
    check_new(excerpt, replace=replace or out is None, hint=", or another --out", inputs=recording.files)
    say_relabelled(folder, clip)
    write_excerpt(first, subject or first_wrong(first, frame), frame, margin, excerpt)
    say(f"{excerpt}: {excerpt.stat().st_size / 1e6:.1f} MB")
