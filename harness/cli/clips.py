"""``vfoa clips``: add, list, check and fetch clips."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.clip_add import add_clip
from harness.cli.completion import clip_names
from harness.cli.options import Json
from harness.cli.terminal import print_json, print_table, say

if TYPE_CHECKING:
    from harness.clips.check import ClipCheck, ClipRow

app = typer.Typer(help="Add clips, list them, and check that they can be used.", no_args_is_help=True)
app.command(name="add", short_help="Make a clip from a folder, video, recording or scene.")(add_clip)


@app.command(name="list", short_help="List every clip.")
def list_clips(as_json: Json = False) -> None:
    """List every clip: those of the working directory, then those of the package."""
    from harness.clips.check import list_clips as find_clips

    rows = find_clips()
    if as_json:
        print_json([asdict(row) for row in rows])
    else:
        _print_list(rows)


@app.command(name="check", short_help="Decode frames; check calibration, rectification, labels.")
def check_clips(
    clips: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="CLIP",
            help="Clips by name, or .toml files. Default: those of the working directory, else of the package.",
            autocompletion=clip_names,
        ),
    ] = None,
    every_frame: Annotated[
        bool, typer.Option("--every-frame", help="Decode all frames; count and name damaged ones.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Open clips, decode three frames of each, check calibration, rectification and labels; exit 2 if one fails."""
    from harness.clips.check import check_clip, clips_at_hand

    at_hand = None if clips else clips_at_hand()
    checks = [check_clip(clip, every_frame=every_frame) for clip in (at_hand.clips if at_hand else clips or ())]
    if as_json:
        print_json([asdict(check) for check in checks])
    else:
        _print_checks(checks)
        for variable, absent in at_hand.elsewhere.items() if at_hand else ():
            say(f"not checked, {variable} is not set: {', '.join(absent)}")
        if at_hand and at_hand.packaged:
            say(f"not checked: {len(at_hand.packaged)} clips that came with vfoa; name one to check it")
    if any(check.problems for check in checks):
        raise typer.Exit(2)


@app.command(name="fetch", short_help="Download clips: MPI Sintel, or real people of three sources.")
def fetch_clips(
    source: Annotated[
        str, typer.Argument(metavar="SOURCE", help="What to fetch: sintel, idiap_vfoa, vr_objects or opencv_stereo.")
    ],
    out: Annotated[Path | None, typer.Option(help="The folder; $VFOA_DATA/SOURCE if not given.")] = None,
) -> None:
    """Download clips from their original sites. An interrupted download resumes.

    ``sintel``: the official archives of MPI Sintel, unpacked. ``idiap_vfoa``: two files of idiap/vfoa, and its ground
    truth as labels of the clip ``idiap_vfoa``. ``vr_objects``: 83 MB of jov2023-vr-objects, and the clips
    ``kitchen_p09`` ... ``office_p19`` as tables of measurements with labels. ``opencv_stereo``: 13 pairs of a
    calibration board, samples of OpenCV.
    """
    from harness.remote import expand
    from vfoa.errors import VfoaError, did_you_mean

    fetchers = {
        "sintel": _fetch_sintel,
        "idiap_vfoa": _fetch_idiap,
        "vr_objects": _fetch_vr_objects,
        "opencv_stereo": _fetch_opencv,
    }
    if source not in fetchers:
        raise VfoaError(f"clips fetch: no {source!r}; {did_you_mean(source, fetchers)}")
    root = out or expand(f"${{VFOA_DATA}}/{source}", Path.cwd(), "clips fetch")
    fetchers[source](root)
    say(f"{source}: {root}")


def _fetch_sintel(root: Path) -> None:
    from harness.cli.terminal import bytes_bar
    from harness.clips.fetch import ARCHIVES, fetch_sintel

    for part, archive in ARCHIVES.items():
        with bytes_bar(archive) as progress:
            fetch_sintel(root, (part,), progress=progress)


def _fetch_idiap(root: Path) -> None:
    from harness.annotate.convert import import_labels, open_exchange
    from harness.cli.terminal import bytes_bar
    from harness.clips.fetch import HEADS, IDIAP_HOME, IDIAP_LICENCE, LABELS, fetch_files
    from harness.clips.manifest import load_manifest

    say(f"licence: {IDIAP_LICENCE}")
    with bytes_bar("idiap_vfoa") as progress:
        fetch_files(root, (HEADS, LABELS), IDIAP_HOME, progress)
    for file in (HEADS, LABELS):
        say(f"{root / file.name}: sha256 {file.sha256}")
    manifest = load_manifest("idiap_vfoa")
    place = manifest.annotations.place()
    if place.exists():
        say(f"{place}: exists already and is kept")
        return
    manifest = manifest.with_root(root)
    imported = import_labels(root / LABELS.name, "idiap_vfoa", open_exchange(manifest), manifest, replace=False)
    say(f"{place}: {len(imported.labels.ranges)} ranges of {', '.join(imported.labels.subjects)}")


def _fetch_vr_objects(root: Path) -> None:
    from harness.cli.terminal import bytes_bar
    from harness.clips.fetch import VR_HOME, VR_LICENCE, fetch_files, listed_files
    from harness.labels.files import write_annotations
    from harness.sources.measured.tables import write_measured
    from harness.sources.measured.vr_objects import VrObjectsClip
    from harness.stages.ground_truth.oracle import true_labels

    say(f"licence: {VR_LICENCE}")
    files = listed_files("vr_objects")
    with bytes_bar("vr_objects") as progress:
        fetch_files(root / "data", files, VR_HOME, progress)
    for session in sorted({Path(file.name).parts[:3] for file in files}):
        room, person, _ = session
        clip = VrObjectsClip(VrObjectsClip.Settings(), root.joinpath("data", *session))
        place = root / f"{room.removesuffix('_laser')}_p{int(person):02}"
        place.mkdir(exist_ok=True)
        write_measured(place, clip.measurements)
        write_annotations(place / "labels.csv", true_labels(clip, unknown=""))
        say(f"{place}: {len(clip.frames)} frames")


def _fetch_opencv(root: Path) -> None:
    from harness.cli.terminal import bytes_bar
    from harness.clips.fetch import OPENCV_HOME, OPENCV_LICENCE, fetch_files, listed_files

    say(f"licence: {OPENCV_LICENCE}")
    with bytes_bar("opencv_stereo") as progress:
        fetch_files(root, listed_files("opencv_stereo"), OPENCV_HOME, progress)


def _print_list(rows: list[ClipRow]) -> None:
    print_table(
        ["clip", "adapter", "frames", "people", "targets", "labels", "licence"],
        [
            [row.name, row.adapter, row.frames, len(row.subjects), len(row.targets), row.labels, row.licence]
            for row in rows
        ],
        shortened={"licence"},
    )
    for row in rows:
        if row.problem:
            say(f"{row.name}: {row.problem}")


def _print_checks(checks: list[ClipCheck]) -> None:
    print_table(
        ["clip", "check", "frames", "size", "baseline m", "row error px", "labels"],
        [
            [
                check.name,
                "fails" if check.problems else "ok",
                check.frames,
                check.size_px and "x".join(map(str, check.size_px)),
                _rounded(check.baseline_m, 4),
                _rounded(check.vertical_error_px, 2),
                check.labels,
            ]
            for check in checks
        ],
    )
    said: dict[str, list[str]] = {}
    for check in checks:
        for line in (*check.problems, *(f"note: {note}" for note in check.notes)):
            said.setdefault(line, []).append(check.name)
    for line, clips in said.items():
        say(f"{', '.join(clips)}: {line}")


def _rounded(value: float | None, digits: int) -> str | None:
    return None if value is None else f"{value:.{digits}f}"
