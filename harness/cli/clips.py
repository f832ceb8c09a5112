"""``vfoa clips``: list, check, export and fetch clips; adding them is in :mod:`harness.cli.clip_adding`."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.clip_adding import add_clip
from harness.cli.options import Clip, Json, clip_and_family_names
from harness.cli.terminal import MOST_ROWS, bytes_bar, exit_if_interrupted, frames_bar, print_json, print_table, say
from harness.files.groups import grouped
from vfoa.errors import VfoaError, check_known, counted, listed

if TYPE_CHECKING:
    from harness.clips.check import ClipCheck
    from harness.clips.listing import ClipRow


app = typer.Typer(help="Add clips, list them, and check that they can be used.", no_args_is_help=True)
app.command(name="add", short_help="Make a clip from a folder, video, recording or scene.")(add_clip)


@app.command(name="list", short_help="List every clip.")
def list_clips(as_json: Json = False) -> None:
    """List every clip: those of the working directory, then those of the package."""
    from harness.clips.listing import list_clips as find_clips

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
            help="Clips or families by name, or .toml files. Default: of the working directory, else of the package.",
            autocompletion=clip_and_family_names,
        ),
    ] = None,
    every_frame: Annotated[
        bool, typer.Option("--every-frame", help="Decode all frames; count and name damaged ones.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Open clips, decode three frames of each, check calibration, rectification and labels; exit 2 if one fails."""
    from harness.clips.check import check_clip
    from harness.clips.listing import clips_at_hand, clips_named

    names, left_out = clips_named(clips) if clips else clips_at_hand()
    checks = [check_clip(clip, every_frame=every_frame) for clip in names]
    if as_json:
        print_json([asdict(check) for check in checks])
    else:
        _print_checks(checks)
        for line in left_out:
            say(f"not checked: {line}")
    if any(check.problems for check in checks):
        raise typer.Exit(2)


@app.command(name="export", short_help="Write a clip's rectified images for other programs.")
def export_clip(
    clip: Clip,
    to: Annotated[Path, typer.Argument(metavar="FOLDER|FILM", help="New folder; or a film (.mp4) of the left view.")],
    right: Annotated[bool, typer.Option("--right", help="Also write the right images.")] = False,
    jpeg: Annotated[bool, typer.Option("--jpg", help="Write JPEG (quality 95), not PNG.")] = False,
    limit: Annotated[int | None, typer.Option(metavar="N", min=1, help="Write only the first N frames.")] = None,
) -> None:
    """Write a clip's rectified images as files named by frame, their times, and its camera, for other programs.

    The masks, faces and disparities that they make of these images are read as stage outputs (datasets/README.md).
    ELAN and BORIS label films: FILM writes one of a clip that is none.
    """
    from harness.clips.export import export_film, export_images
    from harness.clips.manifest import load_manifest
    from harness.sources import MeasuredClip

    is_film = to.suffix.lower() == ".mp4"
    if is_film and (right or jpeg):
        raise VfoaError(f"{to}: a film has neither right images nor JPEG; expected a folder, or no such option")
    opened = load_manifest(clip).open()
    if isinstance(opened, MeasuredClip):
        raise VfoaError(f"{clip}: found a clip of measurements; expected one with images")
    frames = opened.frames[:limit]
    with exit_if_interrupted([f"interrupted; nothing is left in {to}"]), frames_bar(len(frames), clip) as advance:
        if is_film:
            export_film(opened, to, frames, progress=lambda: advance(clip))
        else:
            export_images(opened, to, frames, as_jpeg=jpeg, with_right=right, progress=lambda: advance(clip))
    say(f"{to}: {counted(len(frames), 'frame')}, {frames[0]} to {frames[-1]}, rectified")


@app.command(name="fetch", short_help="Download clips: MPI Sintel, people, or stereo pictures.")
def fetch_clips(
    source: Annotated[
        str, typer.Argument(metavar="SOURCE", help="What to fetch: sintel, idiap_vfoa, vr_objects or opencv_stereo.")
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="DIRECTORY", help="Directory to fetch into. Default: $VFOA_DATA/SOURCE.")
    ] = None,
) -> None:
    """Download clips from their original sites. An interrupted download resumes.

    sintel: the official archives of MPI Sintel, unpacked. idiap_vfoa: two files of idiap/vfoa, and its ground
    truth as labels of the clip idiap_vfoa. vr_objects: 83 MB of jov2023-vr-objects, and the clips
    kitchen_p09 ... office_p19 as tables of measurements with labels. opencv_stereo: 13 pairs of a
    calibration board, samples of OpenCV.
    """
    from harness.clips import fetch
    from harness.clips.manifest import FETCHED
    from harness.files.remote import expand

    repositories: dict[str, tuple[str, str, str, Callable[[Path], None]]] = {
        "idiap_vfoa": (fetch.IDIAP_LICENCE, fetch.IDIAP_HOME, "", _import_idiap),
        "vr_objects": (fetch.VR_LICENCE, fetch.VR_HOME, "data", _convert_vr_objects),
        "opencv_stereo": (fetch.OPENCV_LICENCE, fetch.OPENCV_HOME, "", lambda root: None),
    }
    check_known(source, FETCHED, "clips fetch: no")
    if out is None and not os.environ.get("VFOA_DATA"):
        raise VfoaError(
            "clips fetch: the environment variable VFOA_DATA is not set; set it to your folder of data sets, in which "
            "runs find the clips, or give --out DIRECTORY"
        )
    root = out or expand(f"${{VFOA_DATA}}/{source}", Path.cwd(), "clips fetch")
    if source in repositories:
        licence, home, folder, finish = repositories[source]
        say(f"licence: {licence}")
        with bytes_bar(source) as progress:
            files = (fetch.HEADS, fetch.LABELS) if source == "idiap_vfoa" else fetch.listed_files(source)
            fetch.fetch_files(root / folder, files, home, progress)
        finish(root)
    else:
        with bytes_bar(source) as progress:
            fetch.fetch_sintel(root, progress=progress)
    say(f"{source}: {root}")


def _import_idiap(root: Path) -> None:
    """Print the files' checksums; write the ground truth as labels of the clip, unless it has some."""
    from harness.annotate.convert import import_labels, open_exchange
    from harness.clips.fetch import HEADS, LABELS
    from harness.clips.manifest import load_manifest

    for file in (HEADS, LABELS):
        say(f"{root / file.name}: sha256 {file.sha256}")
    manifest = load_manifest("idiap_vfoa")
    place = manifest.annotations.place()
    if place.exists():
        say(f"{place}: exists already and is kept")
        return
    manifest = manifest.with_root(root)
    imported = import_labels(root / LABELS.name, "idiap_vfoa", open_exchange(manifest), manifest, replace=False)
    say(f"{place}: {counted(len(imported.labels.ranges), 'range')} of {', '.join(imported.labels.subjects)}")


def _convert_vr_objects(root: Path) -> None:
    """Write each session as tables of measurements with labels."""
    from harness.labels.files import write_annotations
    from harness.pipeline.ground_truth import true_labels
    from harness.sources.measured.tables import write_measured
    from harness.sources.measured.vr_objects import VrObjectsClip

    for session in sorted(path for path in root.glob("data/*/*/*") if path.is_dir()):
        room, person, _ = session.parts[-3:]
        clip = VrObjectsClip(VrObjectsClip.Settings(), session)
        place = root / f"{room.removesuffix('_laser')}_p{int(person):02}"
        place.mkdir(exist_ok=True)
        write_measured(place, clip.measurements)
        write_annotations(place / "labels.csv", true_labels(clip, unknown=""))
        say(f"{place}: {counted(len(clip.frames), 'frame')}")


def _print_list(rows: list[ClipRow]) -> None:
    from harness.clips.listing import unset_lines

    print_table(
        ["clip", "adapter", "frames", "people", "targets", "labels", "licence"],
        [
            [row.name, row.adapter, row.frames, len(row.subjects), len(row.targets), row.labels, row.licence]
            for row in rows
        ],
        shortened="licence",
    )
    for row in rows:
        if row.problem and not row.unset:
            say(f"{row.name}: {row.problem}")
    for line in unset_lines({row.name: row.unset for row in rows}):
        say(line)


def _print_checks(checks: list[ClipCheck]) -> None:
    """Print the checks, of many those that fail before others, then each problem and note with its clips."""
    shown = checks
    if len(checks) > MOST_ROWS:
        shown = sorted(checks, key=lambda check: not check.problems)[:MOST_ROWS]
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
            for check in shown
        ],
    )
    if len(shown) < len(checks):
        failing = sum(bool(check.problems) for check in checks)
        say(f"{len(shown)} of {len(checks)} clips, of which {failing} fail: those that fail first.")
    lines = {check.name: (*check.problems, *(f"note: {note}" for note in check.notes)) for check in checks}
    for line, clips in grouped((line, name) for name, of_clip in lines.items() for line in of_clip).items():
        say(f"{listed(clips)}: {line}")


def _rounded(value: float | None, digits: int) -> str | None:
    return None if value is None else f"{value:.{digits}f}"
