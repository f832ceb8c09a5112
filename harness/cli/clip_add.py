"""``vfoa clips add``: a path becomes a clip, without a text editor."""

from __future__ import annotations

import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from harness.cli.options import Json
from harness.cli.printing import print_json

if TYPE_CHECKING:
    from harness.clips.add import Added


def add_clip(
    path: Annotated[Path, typer.Argument(metavar="PATH", help="A recording, a folder of images, a scene of Sintel.")],
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="What to call the clip; a word made of the path if not given.")
    ] = None,
    adapter: Annotated[
        str | None, typer.Option(metavar="ADAPTER", help="The adapter that is to read it, where several can.")
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="A setting of the adapter, such as pass=final."),
    ] = None,
    calibration: Annotated[
        list[Path] | None, typer.Option(metavar="FILE", help="The calibration file; twice for a file a camera.")
    ] = None,
    fx: Annotated[float | None, typer.Option(help="Or, of a rectified pair: focal length, pixels.")] = None,
    cx: Annotated[float | None, typer.Option(help="Column of the principal point, pixels.")] = None,
    cy: Annotated[float | None, typer.Option(help="Row of the principal point, pixels.")] = None,
    baseline: Annotated[float | None, typer.Option(help="Distance of the two cameras, metres.")] = None,
    subjects: Annotated[
        list[str] | None, typer.Option("--subject", metavar="NAME", help="A person who looks; several: left to right.")
    ] = None,
    targets: Annotated[
        list[str] | None,
        typer.Option("--target", metavar="NAME[=CATEGORY]", help="What is looked at, such as mug=cup."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Look at a path, say what was found, and write a manifest and an annotation file to start from."""
    from harness.clips.add import add_clip as add
    from harness.toml_text import parse_assignment

    source: dict[str, Any] = dict(parse_assignment(text, "pass=final") for text in overrides or ())
    numbers = {"fx_px": fx, "cx_px": cx, "cy_px": cy, "baseline_m": baseline}
    added = add(
        path,
        name=name,
        adapter=adapter,
        source=source | _calibration(calibration, numbers),
        subjects=_names(subjects, "person"),
        targets=_names(targets, None),
    )
    if as_json:
        print_json(asdict(added))
    else:
        _print(added)


def _calibration(given: list[Path] | None, numbers: dict[str, float | None]) -> dict[str, Any]:
    """The settings of a calibration that was given on the command line."""
    from vfoa.errors import VfoaError

    files = [os.path.abspath(os.path.expanduser(file)) for file in given or ()]
    missing = [name.rpartition("_")[0] for name, value in numbers.items() if value is None]
    if len(missing) == len(numbers):
        return {"calibration": files[0] if len(files) == 1 else files} if files else {}
    if files:
        raise VfoaError("--calibration and --fx --cx --cy --baseline: found both; expected one of them")
    if missing:
        raise VfoaError(f"--{missing[0]}: missing; expected all of --fx --cx --cy --baseline")
    return {"camera": numbers}


def _names(given: list[str] | None, category: str | None) -> dict[str, str]:
    """``NAME`` or ``NAME=CATEGORY`` as name -> category; a name without one is its own, or the one given here."""
    parts = [text.partition("=") for text in given or ()]
    return {name: found or category or name for name, _, found in parts}


def _print(added: Added) -> None:
    rig, rate = added.rig, added.rate_hz
    typer.echo(f"{added.adapter}: {added.layout}")
    typer.echo(f"  frames       {added.frames}, {added.first_frame} to {added.last_frame}")
    typer.echo(f"  size         {rig.width_px}x{rig.height_px}")
    typer.echo(f"  rate         {'not known' if rate is None else f'{rate:g} Hz'}")
    typer.echo(f"  calibration  {added.calibration}: fx {rig.fx_px:.5g} px, baseline {rig.baseline_m:.4g} m")
    for note in added.notes:
        typer.echo(f"  note         {note}")
    typer.echo(f"wrote {added.manifest}\nwrote {added.annotations}")
    # Who is in the clip is not seen in its files: without subjects there is nothing to label.
    for verb in ("clips check", "annotate", "run") if added.subjects else ("clips check", "run"):
        typer.echo(f"next: vfoa {verb} {added.name}")
    if not added.subjects:
        typer.echo(
            f"nobody can be labelled yet: write [subjects.NAME] into {added.manifest.name}, or remove both files and "
            "add the clip again with --subject NAME"
        )
