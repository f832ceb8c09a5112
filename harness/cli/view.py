"""``vfoa view``, ``export-failure``, ``catalog``: open recordings, step through failures, write frames, serve runs."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
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
    composed_name,
    run_directories,
    run_folder,
)
from harness.cli.terminal import ended_by_signals, say, say_forwarding, signals_as_ctrl_c, vfoa_command
from vfoa.errors import VfoaError, did_you_mean, listed

if TYPE_CHECKING:
    from harness.record.composed import Composed, RecordedClip
    from harness.record.web_app import Routes
    from harness.score.judged_subjects import JudgedSubject
    from harness.score.score import Scores
    from harness.score.verdicts import Verdict


def view(
    run: Recordings,
    clip: OneClip = None,
    config: OneConfiguration = None,
    frame: Annotated[int | None, typer.Option(metavar="FRAME", help="Open the first recording at this frame.")] = None,
    subject: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Show this person's tab. With --failures: only of this person.",
            callback=composed_name,
        ),
    ] = None,
    web: Annotated[bool, typer.Option("--web", help="Open it in the browser; Ctrl-C ends it.")] = False,
    failures: Annotated[
        bool, typer.Option("--failures", help="Step from one wrong frame to the next by keys; with --web, by links.")
    ] = False,
    compare: Annotated[
        tuple[str, str] | None, typer.Option(metavar="K1 K2", help="Open two configurations of --clip side by side.")
    ] = None,
    screenshot: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Write a screenshot of the first recording; needs no display.")
    ] = None,
    replace: Replace = False,
) -> None:
    """Open a run's recordings in the Rerun viewer: one for each clip, with a tab for each configuration."""
    from harness.files.io import check_new
    from harness.record import viewer
    from harness.record.composed import find_recordings
    from harness.record.web_app import open_path
    from harness.run.directory import RunDirectory

    folder = run_folder(run)
    if failures:
        if frame is not None or screenshot is not None or compare is not None:
            raise VfoaError("view: --failures selects the frames: leave out --frame, --compare and --screenshot")
        with ended_by_signals():
            (browse_failures if web else step_through)(folder, clip, config, subject)
        return
    if screenshot is not None:
        if web:
            raise VfoaError("view: --web writes no file: leave out --screenshot")
        inputs = [folder, *RunDirectory(folder).inputs]
        check_new(screenshot, replace=replace, hint=", or another --screenshot", inputs=inputs)
        if screenshot.suffix.lower() != ".png":
            raise VfoaError(f"--screenshot {screenshot}: found the suffix {screenshot.suffix!r}; expected .png")
    if compare is None:
        recordings = find_recordings(folder, clip, config, subject)
    else:
        recordings = [_compared(folder, clip, config, subject, compare)]
    first, *others = recordings
    if frame is not None:
        first.expect_frame(frame)
    if screenshot is not None:
        with signals_as_ctrl_c():
            viewer.screenshot(first, frame, screenshot)
    elif web:
        paths = [open_path(first.name, frame, first.subject), *(open_path(other.name) for other in others)]
        browse(recordings, paths, more=_label_routes(folder))
    else:
        with ended_by_signals():
            viewer.show(recordings, frame)


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

    if clip is None or config is not None or compare[0] == compare[1] or run.is_file():
        raise VfoaError("view --compare: expected a run's directory, --clip, no --config, and two configurations")
    for configuration in compare:
        find_clips(run, clip, configuration)
    (recorded,) = find_clips(run, clip, None)
    recorded.expect_subject(subject)
    return replace(recorded.compare(*compare), subject=subject)


KEYS = "Enter or n: next, p: previous, w: the label is wrong, q: quit"


def step_through(run: Path, clip: str | None, configuration: str | None, subject: str | None) -> None:
    """Open the viewer at a run's first wrong frame, and step to others by keys; None: of all."""
    if not sys.stdin.isatty():
        raise VfoaError(
            "view --failures: expected a terminal to read keys from, found none; --failures --web has links"
        )
    from harness.record import viewer
    from harness.run.directory import RunDirectory
    from harness.score.finished_run import read_scores

    say(KEYS)
    place: int | None = 0
    while place is not None:
        recordings = _recorded(run, clip, configuration, subject)
        scores = read_scores(RunDirectory(run))
        wrong = _that_can_be_shown(wrong_verdicts(scores, clip, configuration, subject), recordings)
        if not wrong:
            say(_nothing_to_show(scores, clip, configuration, subject))
            return
        shown = {each.files.clip: each.compose() for each in recordings}
        place, is_corrected = min(place, len(wrong) - 1), False
        with viewer.opened(instead="--failures --web has a link to each wrong frame, for any browser") as go_to:
            while place is not None and not is_corrected:
                at = wrong[place]
                go_to(shown[at.clip], at.frame, (at.configuration, at.subject))
                say(describe(wrong, place))
                key = _key()
                # the viewer would keep the old content of a corrected recording: it is opened again
                is_corrected = key == "w" and _correct(run, at)
                place = place if is_corrected else next_place(key, place, len(wrong))


def _key() -> str:
    """The key that is pressed; ``q`` for Ctrl-C and Ctrl-D."""
    try:
        return str(typer.prompt("", default="n", show_default=False, prompt_suffix="> ")).strip().lower()
    except typer.Abort:
        return "q"


def next_place(key: str, place: int, count: int) -> int | None:
    """The place, 0 to ``count`` - 1, that a key leads to; None ends. Both ends stay, and so does every other key."""
    match key:
        case "q":
            return None
        case "" | "n":
            return min(place + 1, count - 1)
        case "p":
            return max(place - 1, 0)
    return place


def describe(wrong: Sequence[Verdict], place: int) -> str:
    """One line: position among the wrong frames, clip, configuration, frame, subject, truth, prediction, error type."""
    verdict = wrong[place]
    where = f"{verdict.clip}, {verdict.configuration}, frame {verdict.frame}"
    predicted = "no prediction" if verdict.predicted is None else f"predicted {verdict.predicted}"
    answer = f"{verdict.subject} looks at {verdict.truth}, {predicted} ({verdict.error_type})"
    return f"{place + 1}/{len(wrong)}  {where}: {answer}"


def _correct(run: Path, wrong: Verdict) -> bool:
    """Ask for the right target of a frame, and write it; return False if nothing was written."""
    from harness.annotate.correction import Correction, choices, correct, look_around
    from harness.run.directory import RunDirectory

    directory = RunDirectory(run)
    try:
        look = look_around(directory, wrong.clip, wrong.subject, wrong.frame)
        names = ", ".join(choices(directory, wrong.clip, wrong.subject))
        say(f"{names}; FIRST-LAST for other frames than the whole look, {look.first}-{look.last}")
        answer = typer.prompt("right target [FIRST-LAST], or nothing", default="", show_default=False).strip()
        if not answer:
            return False
        target, first, last = _target_and_frames(answer, look.first, look.last)
        correction = Correction(clip=wrong.clip, subject=wrong.subject, target=target, first=first, last=last)
        say(f"{correct(directory, correction)}: {correction}. Tables, page and recordings are updated.")
    except (VfoaError, typer.Abort) as error:
        say(f"vfoa: {error or 'nothing was changed'}", err=True)
        return False
    return True


def _target_and_frames(answer: str, first: int, last: int) -> tuple[str, int, int]:
    """Parse a target and the frames: ``red cup`` for the look, which has these ends, ``red cup 12-20`` for others."""
    if match := re.fullmatch(r"(.+)\s+(\d+)-(\d+)", answer):
        return match[1], int(match[2]), int(match[3])
    return answer, first, last


def browse_failures(run: Path, clip: str | None, configuration: str | None, subject: str | None) -> None:
    """Serve the recordings of a run, and a page that steps through its wrong frames beside the web viewer."""
    from harness.annotate.correction import correction_routes
    from harness.record.composed import served_recordings
    from harness.record.web_app import failures_routes
    from harness.run.directory import RunDirectory
    from harness.score.finished_run import read_scores

    directory = RunDirectory(run)
    recorded = _recorded(run, clip, configuration, subject)

    def wrong() -> list[Verdict]:
        return wrong_verdicts(read_scores(directory), clip, configuration, subject)

    scores = read_scores(directory)
    found = wrong_verdicts(scores, clip, configuration, subject)
    if not (shown := _that_can_be_shown(found, recorded)):
        say(_nothing_to_show(scores, clip, configuration, subject))
        return
    recordings, known = served_recordings(run), iter([found])  # the page that opens now shows what was counted
    say(f"{len(shown)} wrong frames")
    failures = failures_routes(lambda: next(known, None) or wrong(), recordings)
    browse(recordings.values(), ["/"], more=(*failures, *correction_routes(directory)))


def _recorded(run: Path, clip: str | None, configuration: str | None, subject: str | None) -> list[RecordedClip]:
    """The recordings of each clip of a run; an unknown name is an error."""
    from harness.record.composed import find_clips

    clips = find_clips(run, clip, configuration)
    subjects = list(dict.fromkeys(name for recorded_clip in clips for name in recorded_clip.subjects))
    if subject is not None and subject not in subjects:
        raise VfoaError(f"{run}: no subject {subject!r}; {did_you_mean(subject, subjects)}")
    return clips


def _that_can_be_shown(wrong: Sequence[Verdict], recordings: Sequence[RecordedClip]) -> list[Verdict]:
    """The wrong frames with a recording; how many have none is printed."""
    recorded = {(each.files.clip, layer.configuration) for each in recordings for layer in each.layers}
    shown = [verdict for verdict in wrong if (verdict.clip, verdict.configuration) in recorded]
    if left_out := len(wrong) - len(shown):
        say(f"vfoa: {left_out} wrong frames have no recording: they are left out", err=True)
    return shown


def wrong_verdicts(
    scores: Scores, clip: str | None, configuration: str | None, subject: str | None = None
) -> list[Verdict]:
    """The wrong verdicts, grouped by recording and sorted by frame; None: of every clip, configuration, subject."""
    judged = (of_subject.judged for of_subject in _chosen(scores, clip, configuration, subject))
    of_clip = [each.where(each.is_wrong) for each in judged]
    clips, configurations = scores.clips.index, scores.configurations.index
    return sorted(
        (verdict for each in of_clip for verdict in each.verdicts()),
        key=lambda verdict: (clips(verdict.clip), configurations(verdict.configuration), verdict.frame),
    )


def _nothing_to_show(scores: Scores, clip: str | None, configuration: str | None, subject: str | None) -> str:
    """Why there is no failure: also because nothing is labelled."""
    is_scored = any(len(of_subject.frames) for of_subject in _chosen(scores, clip, configuration, subject))
    return "No wrong frame." if is_scored else "Nothing is scored: no frame has a label."


def _chosen(
    scores: Scores, clip: str | None, configuration: str | None, subject: str | None
) -> Iterator[JudgedSubject]:
    """What was judged of a clip, configuration and subject; None: of all."""
    for of_subject in scores.judged_subjects:
        asked = (clip, of_subject.clip), (configuration, of_subject.configuration), (subject, of_subject.subject)
        if all(wanted in (None, name) for wanted, name in asked):
            yield of_subject


def browse(
    recordings: Iterable[Composed],
    paths: Sequence[str],
    *,
    page: Callable[[str], str] | None = None,
    more: Routes = (),
    port: int = 0,
    no_open: bool = False,
) -> None:
    """Serve recordings by their names, and ``more``; print the addresses of ``paths``, and open the first one."""
    from harness.record.viewer import web_viewer_files
    from harness.record.web_app import site
    from harness.server.local_server import LocalServer, open_browser

    with ended_by_signals():
        app = site({recording.name: recording for recording in recordings}, web_viewer_files(), page=page, more=more)
        server = LocalServer(app, port)
        addresses = [server.address_of(path) for path in paths]
        say("\n".join(["Serving until Ctrl-C:", *addresses]))
        say_forwarding(server.port)
        if not no_open:
            open_browser(addresses[0])
        server.run()


def catalog(
    runs: Annotated[
        list[str],
        typer.Argument(metavar="RUN...", help="Directories of runs with recordings.", autocompletion=run_directories),
    ],
    port: Port = 0,
) -> None:
    """Serve runs as datasets of Rerun's catalogue on this machine; Ctrl-C ends it. Needs vfoa[catalog]."""
    from threading import Event

    from harness.record.catalog import serving

    with ended_by_signals(), serving([run_folder(run) for run in runs], port) as catalogue:
        for run in catalogue.unmarked:
            say(f"vfoa: {run}: its recordings have no error types; `{vfoa_command('score', run)}` adds them", err=True)
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
        typer.Option(metavar="NAME", help="Open it with this person's tab in front.", callback=composed_name),
    ] = None,
    margin: Annotated[int, typer.Option(metavar="N", help="Frames to keep on either side.")] = 10,
    out: Annotated[
        Path | None,
        typer.Option(metavar="RRD", help="File to write. Default: named after clip, configuration and frame."),
    ] = None,
    replace: Annotated[bool, typer.Option("--replace", help="Overwrite the file of --out.")] = False,
) -> None:
    """Write one frame and its neighbours as a small recording."""
    from harness.files.io import check_new
    from harness.record.composed import find_clips
    from harness.record.excerpt import write_excerpt

    first, *others = find_clips(run_folder(run), clip, config)
    pairs = [
        f"{recorded.files.clip}, {layers.configuration}" for recorded in (first, *others) for layers in recorded.layers
    ]
    if len(pairs) > 1:
        found = f"{len(pairs)}, of {listed([f'({pair})' for pair in pairs], most=4)}"
        raise VfoaError(f"{run}: expected one recording, found {found}: choose with --clip and --config")
    recording = first.compose()
    excerpt = out or Path(f"{recording.name}__{frame}.rrd")
    check_new(excerpt, replace=replace or out is None, hint=", or another --out", inputs=recording.files)
    write_excerpt(first, subject, frame, margin, excerpt)
    say(f"{excerpt}: {excerpt.stat().st_size / 1e6:.1f} MB")
