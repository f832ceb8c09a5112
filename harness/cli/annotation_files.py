"""``vfoa annotations``: labels in and out, and between annotators."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(help="Check, exchange and compare who looks at what.", no_args_is_help=True)


class Gaps(StrEnum):
    """What frames without a label mean."""

    ignore = "ignore"
    none = "none"


Clip = Annotated[str, typer.Argument(metavar="CLIP", help="The clip's name, or its .toml file.")]
ClipOption = Annotated[str, typer.Option("--clip", metavar="CLIP", help="The clip's name, or its .toml file.")]
Annotator = Annotated[str | None, typer.Option(help="Whose labels: CLIP@ANNOTATOR.csv; CLIP.csv if not given.")]
Format = Annotated[
    str,
    typer.Option("--format", help="elan, boris, boris-aggregated, cvat, or another package's."),
]
Fps = Annotated[float | None, typer.Option(min=0.001, help="The rate the other program has; the clip's if not given.")]
Offset = Annotated[
    float, typer.Option(help="Where the clip begins in the other program: seconds, or frames if it counts frames.")
]
Run = Annotated[Path | None, typer.Option(help="A run whose heads and boxes are used; the clip's truth if not given.")]
Config = Annotated[str | None, typer.Option("--config", help="Which of the run's configurations.")]


@app.command(name="import")
def import_(
    file: Annotated[Path, typer.Argument(help="The other program's file.")],
    format_: Format,
    clip: ClipOption,
    annotator: Annotator = None,
    fps: Fps = None,
    offset: Offset = 0.0,
    rename: Annotated[
        list[str] | None, typer.Option(metavar="THEIRS=OURS", help="A name that is another one in the manifest.")
    ] = None,
    gaps: Annotated[Gaps, typer.Option(help="What frames without a label, between two labels, mean.")] = Gaps.ignore,
    run: Run = None,
    config: Config = None,
    replace: Annotated[bool, typer.Option("--replace", help="Write over labels that are there.")] = False,
) -> None:
    """Read the labels of another program; say what they lose."""
    from harness.annotation_formats.convert import import_labels, open_exchange
    from harness.manifest import load_manifest

    manifest = load_manifest(clip)
    exchange = open_exchange(
        manifest,
        fps=fps,
        offset=offset,
        renamed=dict(_pair(each) for each in rename or ()),
        gaps=gaps.value,
        run=run,
        configuration=config,
    )
    place = manifest.annotations.place(annotator)
    imported = import_labels(file, format_, exchange, place, replace=replace)
    for note in imported.notes:
        typer.echo(f"- {note}", err=True)
    typer.echo(f"{place}: {len(imported.labels.ranges)} ranges of {', '.join(imported.labels.subjects)}")


@app.command(name="export")
def export(
    clip: Clip,
    to: Annotated[Path, typer.Argument(metavar="FILE", help="The file to write.")],
    format_: Format,
    annotator: Annotator = None,
    fps: Fps = None,
    offset: Offset = 0.0,
    run: Run = None,
    config: Config = None,
) -> None:
    """Write labels for another program; say what its format cannot hold."""
    from harness.annotation_formats.convert import export_labels, open_exchange
    from harness.manifest import load_manifest

    manifest = load_manifest(clip)
    exchange = open_exchange(manifest, fps=fps, offset=offset, run=run, configuration=config)
    for note in export_labels(manifest, annotator, format_, exchange, to):
        typer.echo(f"- {note}", err=True)
    typer.echo(str(to))


@app.command(name="check")
def check(clip: Clip, annotator: Annotator = None) -> None:
    """Read a clip's labels, and those of each annotator unless one is named; the first mistake ends it."""
    from harness.manifest import load_manifest
    from harness.timeline import timeline_of

    manifest = load_manifest(clip)
    timeline = timeline_of(manifest.open())
    for name in (annotator,) if annotator else (None, *manifest.annotations.annotators()):
        labels = manifest.labels(timeline, name)
        if labels is not None:
            counts = ", ".join(f"{each} {len(labels.of(each))}" for each in labels.subjects) or "no ranges"
            typer.echo(f"{manifest.annotations.place(name)}: {counts}")


def _pair(text: str) -> tuple[str, str]:
    from vfoa.errors import VfoaError

    theirs, equals, ours = text.rpartition("=")
    if not (equals and theirs):
        raise VfoaError(f"--rename {text}: expected THEIRS=OURS")
    return theirs, ours
