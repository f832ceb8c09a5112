"""``vfoa annotations``: labels in and out, and between annotators."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.options import Clip, Replace, RunConfiguration

if TYPE_CHECKING:
    from harness.adapters import Clip as AdapterClip
    from harness.annotations.labels import Labels
    from harness.clips.manifest import ClipManifest

app = typer.Typer(help="Check, exchange and compare who looks at what.", no_args_is_help=True)


class Gaps(StrEnum):
    """What frames without a label mean."""

    ignore = "ignore"
    none = "none"


class MergeRule(StrEnum):
    """How labels are merged; :mod:`harness.annotations.merge` says what each does."""

    agree = "agree"
    first = "first"
    adjudicate = "adjudicate"


Annotators = Annotated[
    list[str] | None, typer.Argument(metavar="ANNOTATOR", help="All the clip has if not given; CLIP is CLIP.csv.")
]
ClipOption = Annotated[str, typer.Option("--clip", metavar="CLIP", help="The clip's name, or its .toml file.")]
Annotator = Annotated[
    str | None, typer.Option(metavar="ANNOTATOR", help="Whose labels: CLIP@ANNOTATOR.csv; CLIP.csv if not given.")
]
Format = Annotated[
    str,
    typer.Option(
        "--format", help="elan, boris, boris-aggregated, cvat, videoattentiontarget, childplay, or another package's."
    ),
]
Fps = Annotated[float | None, typer.Option(min=0.001, help="The rate the other program has; the clip's if not given.")]
Offset = Annotated[
    float, typer.Option(help="Where the clip begins in the other program: seconds, or frames if it counts frames.")
]
FromRun = Annotated[
    Path | None,
    typer.Option("--run", metavar="RUN", help="A run whose heads and boxes are used; the clip's truth if not given."),
]


@app.command(name="import")
def import_(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The other program's file.")],
    format_: Format,
    clip: ClipOption,
    annotator: Annotator = None,
    fps: Fps = None,
    offset: Offset = 0.0,
    rename: Annotated[
        list[str] | None, typer.Option(metavar="THEIRS=OURS", help="A name that is another one in the manifest.")
    ] = None,
    gaps: Annotated[Gaps, typer.Option(help="What frames without a label, between two labels, mean.")] = Gaps.ignore,
    target: Annotated[
        str | None, typer.Option(help="In formats of points: what is looked at where nothing that has a name is found.")
    ] = None,
    run: FromRun = None,
    config: RunConfiguration = None,
    replace: Replace = False,
) -> None:
    """Read the labels of another program; say what they lose."""
    from harness.annotation_formats.convert import import_labels, open_exchange
    from harness.clips.manifest import load_manifest

    manifest = load_manifest(clip)
    exchange = open_exchange(
        manifest,
        fps=fps,
        offset=offset,
        renamed=dict(_pair(each) for each in rename or ()),
        gaps=gaps.value,
        run=run,
        configuration=config,
        unnamed=target,
    )
    place = manifest.annotations.place(annotator)
    imported = import_labels(file, format_, exchange, place, replace=replace)
    for note in imported.notes:
        typer.echo(f"- {note}", err=True)
    typer.echo(f"{place}: {len(imported.labels.ranges)} ranges of {', '.join(imported.labels.subjects)}")


@app.command(name="export", short_help="Write labels for another program.")
def export(
    clip: Clip,
    to: Annotated[Path, typer.Argument(metavar="FILE", help="The file to write.")],
    format_: Format,
    annotator: Annotator = None,
    fps: Fps = None,
    offset: Offset = 0.0,
    run: FromRun = None,
    config: RunConfiguration = None,
) -> None:
    """Write labels for another program; say what its format cannot hold."""
    from harness.annotation_formats.convert import export_labels, open_exchange
    from harness.clips.manifest import load_manifest

    manifest = load_manifest(clip)
    exchange = open_exchange(manifest, fps=fps, offset=offset, run=run, configuration=config)
    for note in export_labels(manifest, annotator, format_, exchange, to):
        typer.echo(f"- {note}", err=True)
    typer.echo(str(to))


@app.command(name="check", short_help="Read a clip's label files; name the first mistake.")
def check(clip: Clip, annotator: Annotator = None) -> None:
    """Read a clip's labels, and those of each annotator unless one is named; the first mistake ends it."""
    from harness.annotations.timeline import timeline_of
    from harness.clips.manifest import load_manifest

    manifest = load_manifest(clip)
    timeline = timeline_of(manifest.open())
    for name in (annotator,) if annotator else (None, *manifest.annotations.annotators()):
        labels = manifest.labels(timeline, name)
        if labels is not None:
            counts = ", ".join(f"{each} {len(labels.of(each))}" for each in labels.subjects) or "no ranges"
            typer.echo(f"{manifest.annotations.place(name)}: {counts}")


@app.command(name="agreement", short_help="Compare annotators: kappa, confusion, where they differ.")
def agreement(
    clip: Clip,
    annotators: Annotators = None,
    out: Annotated[Path | None, typer.Option(help="Write the tables to this folder too: CSV, and one .md.")] = None,
) -> None:
    """Compare annotators: kappa with its interval, per target, confusion, and a list of where they differ."""
    from harness.annotations.agreement import compare_annotators
    from harness.cli.printing import print_reports
    from harness.clips.manifest import load_manifest
    from harness.files import atomic_write
    from harness.report.agreement import agreement_tables
    from harness.report.formats import to_csv, to_markdown

    manifest = load_manifest(clip)
    opened = manifest.open()
    labels = _labels_by_annotator(manifest, opened, annotators or [])
    found = compare_annotators(labels, opened.frames, opened.rate_hz, manifest.name)
    tables = agreement_tables(manifest.name, labels, found, opened.frames)
    print_reports(tables.values())
    if out:
        for name, table in tables.items():
            atomic_write(out / f"{name}.csv", to_csv(table))
        atomic_write(out / "agreement.md", "\n".join(to_markdown(table, level=2) for table in tables.values()))


@app.command(name="merge", short_help="Make one file of several annotators'.")
def merge(
    clip: Clip,
    annotators: Annotators = None,
    rule: Annotated[
        MergeRule, typer.Option(help="What becomes of frames on which they differ.")
    ] = MergeRule.adjudicate,
    to: Annotated[str | None, typer.Option(metavar="ANNOTATOR", help="Write CLIP@ANNOTATOR.csv, not CLIP.csv.")] = None,
    replace: Replace = False,
) -> None:
    """Make one file of several annotators': agree (else ignore), first (in the order given), or adjudicate."""
    from harness.annotations.files import write_annotations
    from harness.annotations.merge import merge_labels, to_decide
    from harness.clips.manifest import load_manifest
    from vfoa.errors import VfoaError

    manifest = load_manifest(clip)
    opened = manifest.open()
    labels = _labels_by_annotator(manifest, opened, annotators or [])
    place = manifest.annotations.place(to)
    if place.is_file() and not replace:
        raise VfoaError(f"{place}: is there already; expected --replace, or another --to")
    merged = merge_labels(labels, opened.frames, rule.value)
    write_annotations(place, merged)
    typer.echo(f"{place}: {len(merged.ranges)} ranges of {', '.join(labels)}")
    if left := to_decide(merged):
        typer.echo(f"- {len(left)} ranges are to be decided, the first at frame {left[0].first_frame}.")


def _labels_by_annotator(manifest: ClipManifest, clip: AdapterClip, annotators: list[str]) -> dict[str, Labels]:
    """The labels of those named (the clip's own name stands for CLIP.csv), or of all annotators the clip has."""
    from harness.annotations.timeline import timeline_of
    from vfoa.errors import VfoaError

    names = annotators or list(manifest.annotations.annotators())
    if not annotators and len(names) < 2 and manifest.annotations.find() is not None:
        names = [manifest.name, *names]
    if len(set(names)) < 2:
        raise VfoaError(f"{manifest.name}: labels of {', '.join(names) or 'nobody'}; expected two annotators or more")
    timeline = timeline_of(clip)
    files = manifest.annotations
    found = {}
    for name in names:
        path = files.find() if name == manifest.name else files.expect(name)
        if path is None:
            raise VfoaError(f"{manifest.name}: no annotations; expected {files.place()}")
        found[name] = manifest.read(path, timeline, allow_gaps=True)
    return found


def _pair(text: str) -> tuple[str, str]:
    from vfoa.errors import VfoaError

    theirs, equals, ours = text.rpartition("=")
    if not (equals and theirs):
        raise VfoaError(f"--rename {text}: expected THEIRS=OURS")
    return theirs, ours
