"""``vfoa clips add``: recognise recordings, write their manifests, and say what is missing for a table."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from harness.cli.options import Json, named_once
from harness.cli.run import experiment_of
from harness.cli.terminal import MOST_ROWS, print_json, print_table, say
from harness.files.groups import grouped
from harness.files.safe_names import vfoa_command
from vfoa.errors import VfoaError, counted, listed

if TYPE_CHECKING:
    from harness.clips.add import Added
    from harness.pipeline.stage_files.other_programs import Part, Program
    from harness.sources import Clip, MeasuredClip

MOST_FAILURES = 10
"""Most paths that cannot be added whose errors are printed; the others are named."""
MOST_NAMED = 4
"""Most clips that the next commands name one by one; more are named by patterns."""


def add_clip(
    paths: Annotated[
        list[str],
        typer.Argument(metavar="PATH", help="Recordings, folders of images, scenes of Sintel: a clip of each."),
    ],
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
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Calibration file; give it twice for one file per camera, and a third time for how these stand.",
        ),
    ] = None,
    fx: Annotated[
        float | None, typer.Option(metavar="PX", help="Of a rectified pair instead: focal length, pixels.")
    ] = None,
    cx: Annotated[float | None, typer.Option(metavar="PX", help="Column of the principal point, pixels.")] = None,
    cy: Annotated[float | None, typer.Option(metavar="PX", help="Row of the principal point, pixels.")] = None,
    fov: Annotated[
        float | None,
        typer.Option(
            "--fov-deg",
            metavar="DEGREES",
            help="Instead of these three: horizontal field of view of one image, degrees (data sheet of the camera).",
        ),
    ] = None,
    baseline: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="Distance of the two cameras, metres; alone, it replaces the one of the calibration file.",
        ),
    ] = None,
    subjects: Annotated[
        list[str] | None, typer.Option("--subject", metavar="NAME", help="A person who looks; several: left to right.")
    ] = None,
    targets: Annotated[
        list[str] | None,
        typer.Option("--target", metavar="NAME[=CATEGORY]", help="What is looked at, such as mug=cup."),
    ] = None,
    openface: Annotated[
        Path | None, typer.Option(metavar="FILE", help="OpenFace 2's CSV of the left view: its heads and gazes.")
    ] = None,
    gaze3d: Annotated[
        Path | None, typer.Option(metavar="FILE", help="gaze3d's CSV of the left view: its heads and gazes.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Recognise the source at a path; write a manifest and an empty annotation file.

    Several paths make a clip each, with the same settings and people. One that fails is named; the others are added.
    """
    from harness.clips.add import add_clip as add
    from harness.clips.add import distinct_names
    from harness.files.parsing import parse_assignment
    from harness.files.remote import is_address

    if address := next(filter(is_address, paths), None):
        raise VfoaError(
            f"clips add: {address}: expected a path on this machine: add a copy there, then set `root` in the manifest "
            "to the address"
        )
    source: dict[str, Any] = dict(parse_assignment(text, "pass=final") for text in overrides or ())
    numbers = {"fx_px": fx, "cx_px": cx, "cy_px": cy, "baseline_m": baseline}
    source |= _calibration(calibration, numbers, fov)
    of_one = {"--name": name, "--openface": openface, "--gaze3d": gaze3d}
    if len(paths) > 1 and (given := [option for option, value in of_one.items() if value is not None]):
        raise VfoaError(f"{given[0]}: found {len(paths)} paths; expected one: the option is of a single clip")
    if openface is not None:
        _check_images(Path(paths[0]), adapter, source, openface)
    faces = _faces_experiment(openface, gaze3d)

    who, what = _names("--subject", subjects, "person"), _names("--target", targets, None)

    def added(path: str, name: str | None) -> Added:
        return add(Path(path), name=name, adapter=adapter, source=source, subjects=who, targets=what, more_files=faces)

    if len(paths) == 1:
        one = added(paths[0], name)
        print_json(asdict(one)) if as_json else _print(one)
        return
    clips, failed = [], list[str]()
    for path, of_path in distinct_names(paths).items():
        try:
            clips.append(added(path, of_path))
        except VfoaError as error:
            failed.append(path)
            if len(failed) <= MOST_FAILURES:
                say(f"not added: {error}", err=True)
    if more := failed[MOST_FAILURES:]:
        say(f"not added: {counted(len(more), 'path')} more: {listed(more)}", err=True)
    if as_json:
        print_json([asdict(clip) for clip in clips])
    elif clips:
        _print_all(clips)
    if failed:
        raise typer.Exit(2)


def _check_images(path: Path, adapter: str | None, source: dict[str, Any], openface: Path) -> None:
    """Check that a path can be read; for the film of one camera, say that OpenFace's table is a clip by itself."""
    from harness.clips.add import recognise

    try:
        recognise(Path(os.path.abspath(path.expanduser())), adapter, source)
    except VfoaError as error:
        alone = vfoa_command("clips", "add", openface)
        raise VfoaError(f"{error}; or, for a film of one camera, a clip without images: {alone}") from None


def _faces_experiment(
    openface: Path | None, gaze3d: Path | None
) -> Callable[[Added, Clip | MeasuredClip], dict[Path, str]] | None:
    """Makes the experiment of a clip with heads and gazes from another program; None without such a program."""
    from harness.files.io import read_text
    from harness.files.parsing import toml_value
    from harness.pipeline.stage_files.other_programs import check_program, parts_in, read_part
    from harness.run.experiment import default_configuration

    if openface is None and gaze3d is None:
        return None
    if openface is not None and gaze3d is not None:
        raise VfoaError("--openface and --gaze3d: found both; expected one of them")
    program: Program = "gaze3d" if openface is None else "openface"
    table = Path(os.path.abspath((openface or gaze3d or Path()).expanduser()))
    check_program(table, program)

    def experiment(added: Added, clip: Clip | MeasuredClip) -> dict[Path, str]:
        if added.rig is None:
            raise VfoaError(f"--{program}: found {added.layout}, a clip of measurements; expected a clip with images")
        parts = parts_in(table, program)
        lines = [
            f"# Heads, head poses and gazes of {program}, made by `vfoa clips add`",
            f"clips = [{toml_value(added.name)}]",
            "[defaults.attention]",  # as of any clip: presets and --set come before it
            f"method = {toml_value(default_configuration().attend.attention.method)}",
            "[[configuration]]",
            f'name = "{program}"',
            f'stereo.matcher = "{"sgbm" if added.has_right else "sensor"}"',
            'segmentation.model = "rf_detr_seg"',
            "drawn = { targets = true, heads = true }",
        ]
        keys: dict[Part, str] = {"heads": "detector", "head_pose": "model", "gaze": "model"}
        for part, key in keys.items():
            if part in parts or part == "heads":
                read = read_part(table, program, part, clip.frames)  # for its errors
                if part == "heads" and (note := _note_on_end(read.cells["frame"], clip.frames)):
                    say(f"note: {table}: {note}", err=True)
                settings = {key: "files", "root": str(table.parent), "file": table.name}
                settings |= {} if part == "heads" else {"heads": table.name}
                cells = ", ".join(f"{name} = {toml_value(value)}" for name, value in settings.items())
                lines.append(f"{part} = {{ {cells} }}")
            else:
                lines.append(f'{part}.{key} = "none"')
        text = "\n".join(lines) + "\n"
        path = Path.cwd() / "experiments" / f"{added.name}.toml"
        if path.exists() and read_text(path) != text:
            raise VfoaError(f"{path}: an experiment of this name exists; expected another name: --name NAME")
        return {path: text}

    return experiment


def _note_on_end(of_faces: Sequence[str], frames: Sequence[int]) -> str:
    """A note on faces that end in the clip's first half: those of pictures at another rate are on the wrong frames."""
    last = 1 + frames.index(max(map(int, of_faces), default=frames[0]))
    if 2 * last >= len(frames):
        return ""
    return (
        f"no face after frame {last} of the clip's {len(frames)}: its n-th frame is the clip's; expected the table of "
        "all of them, not of pictures at a lower rate (fps=)"
    )


def _calibration(given: list[Path] | None, numbers: dict[str, float | None], fov_deg: float | None) -> dict[str, Any]:
    """The settings of a calibration given on the command line."""
    files = [os.path.abspath(os.path.expanduser(file)) for file in given or ()]
    missing = [name.rpartition("_")[0] for name, value in numbers.items() if value is None]
    baseline = {} if numbers["baseline_m"] is None else {"baseline_m": numbers["baseline_m"]}
    if fov_deg is not None:
        found = ["--calibration"] if files else [f"--{name}" for name in ("fx", "cx", "cy") if name not in missing]
        if found:
            raise VfoaError(f"--fov-deg and {' '.join(found)}: found both; expected one of them")
        return {"camera": {"fov_deg": fov_deg, **baseline}}
    if missing == ["fx", "cx", "cy"] or len(missing) == len(numbers):
        return baseline | ({"calibration": files[0] if len(files) == 1 else files} if files else {})
    if files:
        raise VfoaError("--calibration and --fx --cx --cy: found both; expected one of them")
    if missing and missing != ["baseline"]:
        raise VfoaError(
            f"--{missing[0]}: missing; expected all of --fx --cx --cy (or --fov-deg), and --baseline of a pair"
        )
    return {"camera": {name: value for name, value in numbers.items() if value is not None}}


def _names(option: str, given: list[str] | None, category: str | None) -> dict[str, str]:
    """``NAME`` or ``NAME=CATEGORY`` as name -> category; by default the name itself, or ``category`` if given."""
    parts = [text.partition("=") for text in given or ()]
    return named_once(option, ((name, own or category or name) for name, _, own in parts))


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
    for line in _next_steps([added]):
        say(line)


def _print_all(clips: Sequence[Added]) -> None:
    """Print what was found in several clips, and what each kind of them needs."""
    sizes = [clip.rig and f"{clip.rig.width_px}x{clip.rig.height_px}" for clip in clips]
    baselines = [clip.rig and clip.has_right and f"{clip.rig.baseline_m:.4g}" for clip in clips]
    rows = [
        [clip.name, clip.adapter, clip.frames, size, baseline or None, clip.calibration]
        for clip, size, baseline in zip(clips, sizes, baselines, strict=True)
    ]
    print_table(
        ["clip", "adapter", "frames", "size", "baseline m", "calibration"], rows[:MOST_ROWS], shortened="calibration"
    )
    if len(rows) > MOST_ROWS:
        say(f"The first {MOST_ROWS} of {len(rows)} clips: `vfoa clips list` has all.")
    for note, of_note in grouped((note, clip.name) for clip in clips for note in clip.notes).items():
        say(f"note: {listed(of_note)}: {note}")
    kinds = grouped(((clip.rig is None, clip.has_right, bool(clip.targets)), clip) for clip in clips)
    for alike in kinds.values():
        for line in _next_steps(alike):
            say(line)


def _next_steps(clips: Sequence[Added]) -> Iterator[str]:
    """What is missing for a table, and the commands that add it, in the order in which they must run.

    The clips are all with images, or all without, and need the same options.
    """
    from harness.clips.families import patterns_of
    from harness.labels.formats import FORMATS

    added, words = clips[0], [clip.name for clip in clips]
    names = shlex.join(words if len(words) <= MOST_NAMED else patterns_of(words))
    if not added.subjects:
        yield "missing for a table: people who look, objects they look at, labels of who looks at what"
        yield "next: the same command with names: people from left to right, objects by the segmenter's category"
        yield f"      {vfoa_command(*sys.argv[1:])} --subject anna --target mug=cup"
        return
    adding = "key `t` of `vfoa annotate`" if added.rig else "`--name NEW --set 'objects={lamp={center_m=[X,Y,Z]}}'`"
    objects = "" if added.targets else f"objects they look at ({adding} adds one), "
    yield f"missing for a table: {objects}labels of who looks at what"
    yield f"next: vfoa clips check {names}"
    if added.rig is None:  # there is nothing to see on the labelling page
        own = added.adapter if added.adapter in FORMATS else "FORMAT"  # of the program that measured the heads
        command = f"vfoa labels import FILE --clip {added.name} --format {own}"
        yield f"next: write {added.annotations} (annotations/README.md), or {command}"
    else:
        yield f"next: vfoa annotate {added.name}"
        if len(clips) > 1:
            yield f"      then {listed(words[1:], MOST_NAMED)}"
    options, fetch = _run_options(added)
    if fetch:
        yield f"next: {fetch}"
    yield f"next: vfoa run {names}{options}"


def _run_options(added: Added) -> tuple[str, str | None]:
    """Options that a run of this clip needs on this machine, and the command that fetches its models.

    If other networks can stand in for all that are missing, options choose them, and there is nothing to fetch.
    """
    from harness.pipeline.weights import missing_weights
    from harness.run.experiment import is_experiment
    from harness.run.plan import fetch_command, needed_stages

    if added.rig is None:
        return " --preset measured", None
    has_own = is_experiment(added.name)  # which says the matcher
    sensor = "" if added.has_right or has_own else " --set stereo.matcher=sensor"
    missing = missing_weights(needed_stages(experiment_of([added.name], (), (), None)))
    if missing is None:
        return sensor, None
    networks = [stage.options for stage in missing.instead if stage and stage.licences]
    if len(networks) < len(missing.instead):
        return sensor, fetch_command(added.name)
    return " ".join([sensor, *networks]), None


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
