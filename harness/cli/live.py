"""``vfoa live``."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from datetime import datetime
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.run import Recording
from harness.cli.terminal import say

if TYPE_CHECKING:
    from harness.clips.manifest import ClipManifest
    from harness.run.experiment import Experiment
    from harness.sources.live import LiveSource

SOURCE_HELP = "An .mcap file that is being written, a clip to play at its own pace, or the left camera."
SOURCE_OPTION_HELP = "Settings of an .mcap file, as in [source] of a clip: left=/front/left/image ..."
OUT_HELP = "The run's directory. Default: runs/live-<time>."


def live(
    source: Annotated[str, typer.Argument(help=SOURCE_HELP, metavar="RECORDING.mcap | CLIP | CAMERA")],
    right: Annotated[
        str | None, typer.Option(metavar="CAMERA", help="The right camera: a number, or a stream's address.")
    ] = None,
    calibration: Annotated[Path | None, typer.Option(metavar="FILE", help="The cameras' calibration file.")] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--source", metavar="KEY=VALUE", help=SOURCE_OPTION_HELP)
    ] = None,
    experiment: Annotated[
        str, typer.Option(metavar="EXPERIMENT", help="Experiment, by name or file, whose configuration is run.")
    ] = "default",
    config: Annotated[
        str | None, typer.Option(metavar="CONFIGURATION", help="Configuration of the experiment, if it has several.")
    ] = None,
    preset: Annotated[
        str, typer.Option(metavar="NAME", help="A bundle of settings over the defaults; none for none.")
    ] = "realtime",
    overrides: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a setting.")] = None,
    out: Annotated[Path | None, typer.Option(help=OUT_HELP)] = None,
    recording: Annotated[Recording, typer.Option(help="Size of the Rerun recording.")] = Recording.light,
    viewer: Annotated[bool, typer.Option("--viewer", help="Show every frame in a Rerun viewer.")] = False,
    connect: Annotated[
        str | None, typer.Option(metavar="URL", help="Show every frame in the viewer at rerun+http://HOST:PORT/proxy.")
    ] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Stop after N frames.")] = None,
    threads: Annotated[int, typer.Option(min=0, help="Threads; 0: one per core.")] = 0,
) -> None:
    """Run on the newest frame of a live source until it ends or Ctrl-C is pressed."""
    from harness.cli.terminal import frames_bar
    from harness.report.sinks import composed_sinks
    from harness.run.directory import RunDirectory
    from harness.run.experiment import load_experiment
    from harness.run.live import run_live
    from vfoa.errors import VfoaError

    if recording.size is None and (viewer or connect):
        raise VfoaError("live: --recording none leaves nothing for a viewer: leave out --viewer and --connect")
    opened, manifest, frames = _open(source, right, calibration, tuple(settings or ()))
    chosen = _only(
        load_experiment(experiment, clips=(manifest.name,), overrides=tuple(overrides or ()), preset=preset), config
    )
    directory = RunDirectory(out or Path("runs") / f"live-{datetime.now():%Y%m%d-%H%M%S}")
    stopped = Event()
    watching = _viewer() if viewer else nullcontext(connect)
    with _ended_by_signals(stopped), watching as address, frames_bar(limit or 0, "live") as progress:
        report = run_live(
            opened,
            manifest,
            chosen,
            directory,
            stopped=stopped,
            frames=frames,
            sinks=composed_sinks(chosen.configurations, recording.size, watched_at=address),
            limit=limit,
            threads=threads or os.cpu_count() or 1,
            progress=progress,
        )
    say(f"{report}\nKept: {directory.path}  (vfoa view {directory.path})")


def _viewer() -> AbstractContextManager[str]:
    """Yield the address of a new Rerun viewer, which is closed at the end of the run."""
    from harness.record.viewer import listening

    return listening()


def _open(
    source: str, right: str | None, calibration: Path | None, settings: tuple[str, ...]
) -> tuple[LiveSource, ClipManifest, Sequence[int] | None]:
    """The source, the manifest with its names, and, if a clip is played, its frame numbers."""
    from harness.clips.manifest import as_clip_name, load_manifest, make_manifest
    from harness.sources.live import CameraPair, PlayedClip, open_capture
    from vfoa.errors import VfoaError

    if settings and (right is not None or not source.endswith(".mcap")):
        raise VfoaError("live: --source is for an .mcap file; expected none")
    if right is not None:
        if calibration is None:
            raise VfoaError("live: two cameras need --calibration FILE")
        manifest = make_manifest({"name": "cameras", "adapter": "cameras"}, Path("cameras.toml"))
        return CameraPair(open_capture(source), open_capture(right), calibration), manifest, None
    if calibration is not None:
        raise VfoaError("live: --calibration is for two cameras; expected --right too, or no --calibration")
    if source.endswith(".mcap"):
        name = as_clip_name(Path(source).stem, default="recording")
        data = {"name": name, "adapter": "mcap", "source": {"recording": Path(source).name}}
        return _tail(Path(source), settings), make_manifest(data, Path(f"{name}.toml")), None
    manifest = load_manifest(source)
    clip = manifest.open_images()
    return PlayedClip(clip, str(manifest.path)), manifest, clip.frames


def _tail(path: Path, settings: tuple[str, ...]) -> LiveSource:
    from harness.files.parsing import parse_assignment
    from harness.sources.recordings.mcap_tail import McapTail
    from harness.sources.recordings.topics import RecordingSettings
    from vfoa.errors import VfoaError
    from vfoa.validation import parse

    given = dict(parse_assignment(text, "left=/front/left/image", "--source") for text in settings)
    if unused := sorted(given.keys() & {"recording", "start_s", "end_s"}):
        raise VfoaError(f"live: --source {unused[0]}: has no meaning for a growing recording; expected none")
    return McapTail(path, parse(RecordingSettings, given, "live", "--source"))


def _only(experiment: Experiment, config: str | None) -> Experiment:
    """Return the experiment with only one configuration."""
    from dataclasses import replace

    from vfoa.errors import VfoaError, did_you_mean

    by_name = {each.name: each for each in experiment.configurations}
    if config is None and len(by_name) > 1:
        raise VfoaError(
            f"live: {experiment.name} has several configurations; say --config, one of: {', '.join(by_name)}"
        )
    if config is not None and config not in by_name:
        raise VfoaError(f"live: {experiment.name} has no configuration {config!r}; {did_you_mean(config, by_name)}")
    return replace(experiment, configurations=(by_name[config or next(iter(by_name))],))


@contextmanager
def _ended_by_signals(stopped: Event) -> Iterator[None]:
    """Let the first Ctrl-C or SIGTERM end the run and keep everything; the second one aborts it."""

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    def stop(number: int, frame: object) -> None:
        stopped.set()
        restore()

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        restore()
