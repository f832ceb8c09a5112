"""``vfoa labels``: check, import, export and compare labels; undo changes; export predictions."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from harness.cli.options import (
    Clip,
    Replace,
    RunConfiguration,
    annotation_formats,
    clip_names,
    clip_names_and_run_directories,
    named_once,
    run_folder,
    written_formats,
)
from harness.cli.terminal import first_rows, print_reports, say
from vfoa.errors import VfoaError, counted

if TYPE_CHECKING:
    from harness.clips.manifest import ClipManifest
    from harness.labels.labels import Labels
    from harness.sources import AnyClip

app = typer.Typer(
    help="Check, import, export and compare labels; undo changes; export a run's predictions.",
    no_args_is_help=True,
)


Annotators = Annotated[
    list[str] | None,
    typer.Argument(metavar="ANNOTATOR", help="Annotators. Default: all of the clip; CLIP means CLIP.csv."),
]
ClipOption = Annotated[
    str,
    typer.Option("--clip", metavar="CLIP", help="Clip by name, or its .toml file.", autocompletion=clip_names),
]
Annotator = Annotated[
    str | None,
    typer.Option(metavar="ANNOTATOR", help="Labels of this annotator, CLIP@ANNOTATOR.csv. Default: CLIP.csv."),
]
Fps = Annotated[
    float | None,
    typer.Option(metavar="HZ", min=0.001, help="Frames per second in the other program. Default: the clip's."),
]
Offset = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS",
        help="Where the clip begins in the other program, seconds. Default: as its file and the film say.",
    ),
]


@app.command(name="import", short_help="Read the labels of another program.")
def import_(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The other program's file.")],
    clip: ClipOption,
    format_: Annotated[
        str | None,
        typer.Option(
            "--format",
            metavar="FORMAT",
            help="boris, coco, csv, cvat, datavyu, elan, idiap_vfoa, label_studio, observer, praat, pupil_cloud, "
            "table, via, or a package's. Default: as the file's name says (.boris, .eaf, .opf, .TextGrid, "
            "aoi_fixations.csv).",
            autocompletion=annotation_formats,
        ),
    ] = None,
    annotator: Annotator = None,
    fps: Fps = None,
    offset: Offset = None,
    rename: Annotated[
        list[str] | None,
        typer.Option(
            metavar="THEIRS=OURS",
            help="Rename a label: their name to the manifest's, or to nothing, which leaves its labels out. "
            "SUBJECT:THEIRS=OURS: only targets of one subject.",
        ),
    ] = None,
    gaps: Annotated[
        Literal["ignore", "none"], typer.Option(help="Meaning of frames without a label between two labels.")
    ] = "ignore",
    until_next: Annotated[
        bool,
        typer.Option(
            "--until-next", help="Table: rows have no end, and hold until the person's next row (or the clip's end)."
        ),
    ] = False,
    observation: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="BORIS, Observer: observation to read, if the file has several. Pupil Cloud, table: recording. "
            "Label Studio: id of the annotation.",
        ),
    ] = None,
    film: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="ELAN, BORIS, Datavyu, Label Studio, VIA: film that shows the clip, if the file has several.",
        ),
    ] = None,
    modifier: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help='What names targets. BORIS, Observer: set of modifiers, "none": leave modifiers out. Datavyu: code. '
            "CVAT, VIA: attribute.",
        ),
    ] = None,
    confirm: Annotated[
        bool, typer.Option("--confirm", help="Confirm suggestions (a run's predictions), so that they are scored.")
    ] = False,
    replace: Annotated[bool, typer.Option("--replace", help="Replace labels of the subjects in the file.")] = False,
) -> None:
    """Read the labels of another program; print what is left out, and what is replaced."""
    from harness.annotate.convert import import_labels, open_exchange
    from harness.clips.manifest import load_manifest
    from harness.labels.formats import format_of

    name = format_of(file) if format_ is None else format_
    manifest, renamed = load_manifest(clip), named_once("--rename", map(_pair, rename or ()))
    exchange = open_exchange(
        manifest,
        fps=fps,
        offset=offset,
        renamed=renamed,
        gaps=gaps,
        until_next=until_next,
        film=film,
        observation=observation,
        modifier=modifier,
    )
    place = manifest.annotations.place(annotator)
    imported = import_labels(file, name, exchange, manifest, annotator, replace=replace, confirm=confirm)
    for note in imported.notes:
        say(f"- {note}", err=True)
    if imported.labels.ranges:
        say(f"{place}: {counted(len(imported.labels.ranges), 'range')} of {', '.join(imported.labels.subjects)}")
    if imported.drawn.tracks:
        say(f"{manifest.annotations.place_drawn()}: {imported.drawn.counts}")


@app.command(name="export", short_help="Write labels, or a run's predictions, for another program.")
def export(
    source: Annotated[
        str,
        typer.Argument(
            metavar="CLIP|RUN",
            help="A clip's name or .toml file, or a run's directory.",
            autocompletion=clip_names_and_run_directories,
        ),
    ],
    to: Annotated[
        Path | None, typer.Argument(metavar="FILE", help="File to write. Default for a run: RUN/labels/CLIP__CONFIG.")
    ] = None,
    *,
    format_: Annotated[
        str,
        typer.Option("--format", metavar="FORMAT", help="elan, csv, or a package's.", autocompletion=written_formats),
    ],
    annotator: Annotator = None,
    clip: Annotated[
        str | None, typer.Option(metavar="CLIP", help="Of a run: only this clip.", autocompletion=clip_names)
    ] = None,
    fps: Fps = None,
    offset: Offset = None,
    config: RunConfiguration = None,
    replace: Replace = False,
) -> None:
    """Write a clip's labels, or a run's predictions, for another program; print what its format cannot hold.

    Predictions are marked as suggestions if the format allows it. Correct them, then import them with --confirm.
    """
    from harness.annotate.convert import export_labels, export_predictions, open_exchange
    from harness.clips.manifest import load_manifest
    from harness.run.directory import RunDirectory

    folder = run_folder(source)
    if RunDirectory(folder).manifest.is_file():
        if annotator:
            raise VfoaError("--annotator: predictions of a run have no annotator; leave it out, or name a clip")
        for written, left_out in export_predictions(
            folder, format_, clip=clip, configuration=config, to=to, fps=fps, offset=offset, replace=replace
        ):
            _print_export(written, left_out)
        return
    if to is None:
        raise VfoaError(f"{source}: no run's directory; expected FILE, the file to write the clip's labels to")
    manifest = load_manifest(source)
    exchange = open_exchange(manifest, fps=fps, offset=offset)
    notes = export_labels(manifest, annotator, format_, exchange, to, replace=replace)
    _print_export(to, notes)


def _print_export(path: Path, notes: Iterable[str]) -> None:
    for note in notes:
        say(f"- {note}", err=True)
    say(str(path))


@app.command(name="check", short_help="Read a clip's label files; name the first error.")
def check(clip: Clip, annotator: Annotator = None) -> None:
    """Read a clip's labels (of every annotator by default) and drawn shapes; stop at the first error."""
    from harness.clips.manifest import load_manifest
    from harness.labels.labels import timeline_of

    manifest = load_manifest(clip)
    files, timeline = manifest.annotations, timeline_of(manifest.open())
    drawn = None if annotator else manifest.drawn(timeline.frames)
    names = [annotator] if annotator else [name for name in (None, *files.annotators()) if files.find(name)]
    if not names and drawn is None:
        files.expect(None)
    for name in names:
        path = files.expect(name)
        labels = manifest.read(path, timeline).confirmed()
        counts = [f"{counted(len(labels.of(subject)), 'range')} of {subject}" for subject in labels.subjects]
        say(f"{path}: {', '.join(counts) or 'no ranges'}")
    if drawn is not None:
        say(f"{files.find_drawn()}: {drawn.counts}")


@app.command(name="agreement", short_help="Compare annotators: kappa, confusion, differences.")
def agreement(
    clip: Clip,
    annotators: Annotators = None,
    away: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            min=0,
            help="Compare only frames that are farther than this from any change of a label, such as 0.3.",
        ),
    ] = 0.0,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIRECTORY", help="Directory for the tables, too: CSV, and one .md."),
    ] = None,
    replace: Replace = False,
) -> None:
    """Compare annotators: kappa with its interval, agreement per target, confusion, and a list of differences."""
    from harness.clips.manifest import load_manifest
    from harness.files.io import check_new, write_together
    from harness.report.agreement import agreement_tables
    from harness.report.formats import to_csv, to_markdown
    from harness.score.agreement import compare_annotators

    manifest = load_manifest(clip)
    opened = manifest.open()
    labels = _labels_by_annotator(manifest, opened, annotators or [])
    times_s = [opened.time_ns(frame) / 1e9 for frame in opened.frames]
    comparison = compare_annotators(labels, opened.frames, opened.rate_hz, away, times_s)
    tables = agreement_tables(manifest.name, labels, comparison, opened.frames, away)
    print_reports(first_rows(table, "rows; --out DIR writes all") for table in tables.values())
    if out:
        page = "\n".join(to_markdown(table, level=2) for table in tables.values())
        texts = {out / "agreement.md": page, **{out / f"{name}.csv": to_csv(table) for name, table in tables.items()}}
        for path in texts:
            check_new(path, replace=replace, hint=", or another --out", inputs=manifest.files)
        write_together(texts)


@app.command(name="undo", short_help="Undo the last change of a clip's labels.")
def undo(
    clip: Clip,
    annotator: Annotator = None,
    redo: Annotated[bool, typer.Option("--redo", help="Redo the change that was undone last.")] = False,
) -> None:
    """Undo the last change of labels, targets or drawing, as z in vfoa annotate does, or an import."""
    from harness.annotate.history import History
    from harness.clips.manifest import load_manifest
    from harness.labels.labels import timeline_of

    manifest = load_manifest(clip)
    path = manifest.annotations.expect(annotator)
    with closing(History(manifest, annotator, timeline_of(manifest.open()))) as history:
        done = history.step_back("redo" if redo else "undo")
    if done is None:
        hint = "it begins anew after another program has changed the file"
        raise VfoaError(f"{path}: its journal has no change to {'redo' if redo else 'undo'}; {hint}")
    say(f"{done} {'redone' if redo else 'undone'}")


def _labels_by_annotator(manifest: ClipManifest, clip: AnyClip, annotators: list[str]) -> dict[str, Labels]:
    """The labels of the named annotators (the clip's own name means CLIP.csv), or of all annotators of the clip."""
    from harness.labels.labels import timeline_of

    names = annotators or list(manifest.annotations.annotators())
    if not annotators and len(names) < 2 and manifest.annotations.find() is not None:
        names = [manifest.name, *names]
    if len(set(names)) < 2:
        found = f"those of {names[0]} alone" if names else "none"
        expected = "two annotators: --annotator NAME of `vfoa annotate` or `vfoa labels import` is for a second one"
        raise VfoaError(f"{manifest.name}: labels: found {found}; expected {expected}")
    timeline = timeline_of(clip)
    paths = {name: manifest.annotations.expect(None if name == manifest.name else name) for name in names}
    return {name: manifest.read(path, timeline, allow_gaps=True) for name, path in paths.items()}


def _pair(text: str) -> tuple[str, str]:
    """Their name and ours, which may be empty, of ``THEIRS=OURS``."""
    theirs, equals, ours = text.rpartition("=")
    if not (equals and theirs):
        raise VfoaError(f"--rename {text}: expected THEIRS=OURS")
    return theirs, ours
