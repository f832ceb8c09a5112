"""``vfoa clips add``: a path becomes a clip, without a text editor."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from harness.cli.options import Json
from harness.cli.terminal import print_json, say

if TYPE_CHECKING:
    from harness.clips.add import Added


def add_clip(
    path: Annotated[str, typer.Argument(metavar="PATH", help="A recording, a folder of images, a scene of Sintel.")],
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="Name of the clip. Default: made from the path.")
    ] = None,
    adapter: Annotated[
        str | None, typer.Option(metavar="ADAPTER", help="Adapter to read it with, where several can.")
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="A setting of the adapter, such as pass=final."),
    ] = None,
    calibration: Annotated[
        list[Path] | None, typer.Option(metavar="FILE", help="Calibration file; give it twice for one file per camera.")
    ] = None,
    fx: Annotated[float | None, typer.Option(help="Of a rectified pair instead: focal length, pixels.")] = None,
    cx: Annotated[float | None, typer.Option(help="Column of the principal point, pixels.")] = None,
    cy: Annotated[float | None, typer.Option(help="Row of the principal point, pixels.")] = None,
    baseline: Annotated[
        float | None,
        typer.Option(help="Distance of the two cameras, metres; alone, it replaces the one of the calibration file."),
    ] = None,
    subjects: Annotated[
        list[str] | None, typer.Option("--subject", metavar="NAME", help="A person who looks; several: left to right.")
    ] = None,
    targets: Annotated[
        list[str] | None,
        typer.Option("--target", metavar="NAME[=CATEGORY]", help="What is looked at, such as mug=cup."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Recognise the source at a path; write a manifest and an empty annotation file."""
    from harness.clips.add import add_clip as add
    from harness.files.parsing import parse_assignment
    from harness.remote import is_address
    from vfoa.errors import VfoaError

    if is_address(path):
        raise VfoaError(
            f"clips add: {path}: expected a path on this machine: add a copy there, then set `root` in the manifest to "
            "the address"
        )
    source: dict[str, Any] = dict(parse_assignment(text, "pass=final") for text in overrides or ())
    numbers = {"fx_px": fx, "cx_px": cx, "cy_px": cy, "baseline_m": baseline}
    added = add(
        Path(path),
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
    """The settings of a calibration given on the command line."""
    from vfoa.errors import VfoaError

    files = [os.path.abspath(os.path.expanduser(file)) for file in given or ()]
    missing = [name.rpartition("_")[0] for name, value in numbers.items() if value is None]
    baseline = {} if numbers["baseline_m"] is None else {"baseline_m": numbers["baseline_m"]}
    if missing == ["fx", "cx", "cy"] or len(missing) == len(numbers):
        return baseline | ({"calibration": files[0] if len(files) == 1 else files} if files else {})
    if files:
        raise VfoaError("--calibration and --fx --cx --cy: found both; expected one of them")
    if missing and missing != ["baseline"]:
        raise VfoaError(f"--{missing[0]}: missing; expected all of --fx --cx --cy, and --baseline of a pair")
    return {"camera": {name: value for name, value in numbers.items() if value is not None}}


def _names(given: list[str] | None, category: str | None) -> dict[str, str]:
    """``NAME`` or ``NAME=CATEGORY`` as name -> category; by default the name itself, or ``category`` if given."""
    parts = [text.partition("=") for text in given or ()]
    return {name: found or category or name for name, _, found in parts}


def _print(added: Added) -> None:
    rate = added.rate_hz
    say(f"{added.adapter}: {added.layout}")
    say(f"  frames       {added.frames}, {added.first_frame} to {added.last_frame}")
    say(f"  rate         {'not known' if rate is None else f'{rate:g} Hz'}")
    _print_rig(added)
    if added.has_depth:
        say("  depth        measured; a run takes it with --set stereo.matcher=sensor")
    for note in added.notes:
        say(f"  note         {note}")
    say(f"wrote {added.manifest}\nwrote {added.annotations}")
    for line in _next_steps(added):
        say(line)


def _next_steps(added: Added) -> Iterator[str]:
    """What is missing for a table, and the commands that bring it, in order: each works when the ones before it ran."""
    if not added.subjects:
        yield "missing for a table: people who look, things looked at, labels of who looks at what"
        yield "next: the same command with names: people from left to right, things by the segmenter's category"
        yield f"      {shlex.join(['vfoa', *sys.argv[1:]])} --subject anna --target mug=cup"
        return
    things = "" if added.targets else "things looked at (key `t` of `vfoa annotate` adds one), "
    yield f"missing for a table: {things}labels of who looks at what"
    yield f"next: vfoa clips check {added.name}"
    if added.rig is None:  # there is nothing to see on the labelling page
        yield f"next: write {added.annotations} (annotations/README.md), or vfoa labels import FILE --clip {added.name}"
    else:
        yield f"next: vfoa annotate {added.name}"
    options, fetch = _run_options(added)
    if fetch:
        yield f"next: {fetch}"
    yield f"next: vfoa run {added.name}{options}"


def _run_options(added: Added) -> tuple[str, str | None]:
    """Options that a run of this clip needs here, and the command that fetches weights that nothing replaces."""
    from harness.run.experiment import load_experiment
    from harness.stages.weights.readiness import missing_weights

    if added.rig is None:
        return " --preset measured", None
    sensor = "" if added.has_right else " --set stereo.matcher=sensor"
    (default,) = load_experiment("default", clips=(added.name,)).configurations
    missing = [each for choice in default.choices.values() if choice and (each := missing_weights([choice]))]
    options = [option.partition(" (")[0] for each in missing for option in each.instead[:1]]
    models = [name for each in missing if not each.instead for name in each.models]
    return " ".join([sensor, *options]), f"vfoa models fetch {' '.join(models)}" if models else None


def _print_rig(added: Added) -> None:
    """Print the camera or, for a clip without images, the people and objects measured."""
    rig = added.rig
    if rig is None:
        say(f"  people       {', '.join(added.subjects)}")
        say(f"  objects      {', '.join(added.targets) or 'none'}")
        return
    distance = f", baseline {rig.baseline_m:.4g} m" if added.has_right else ""
    say(f"  size         {rig.width_px}x{rig.height_px}")
    say(f"  calibration  {added.calibration}: fx {rig.fx_px:.5g} px{distance}")
