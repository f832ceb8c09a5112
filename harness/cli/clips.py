"""``vfoa clips``: what clips there are, and whether they can be used."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.clip_add import add_clip
from harness.cli.options import Json
from harness.cli.printing import print_json, print_table

if TYPE_CHECKING:
    from harness.clips.check import ClipCheck, ClipRow

app = typer.Typer(help="Add clips, list them, and check that they can be used.", no_args_is_help=True)
app.command(name="add", short_help="Make a clip of a folder, video, recording or scene.")(add_clip)


@app.command(name="list", short_help="List every clip that there is.")
def list_clips(as_json: Json = False) -> None:
    """List every clip: the working directory's own, then those that came with the package."""
    from harness.clips.check import list_clips as find_clips

    rows = find_clips()
    if as_json:
        print_json([asdict(row) for row in rows])
    else:
        _print_list(rows)


@app.command(name="check", short_help="Decode frames; check calibration, rectification, labels.")
def check_clips(
    clips: Annotated[
        list[str] | None, typer.Argument(metavar="CLIP", help="Names, or .toml files; all that are at hand if none.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Open clips, decode three frames of each, check calibration, rectification and labels; exit 2 if one fails."""
    from harness.clips.check import check_clip, clips_at_hand

    chosen, elsewhere = (clips, {}) if clips else clips_at_hand()
    checks = [check_clip(clip) for clip in chosen]
    if as_json:
        print_json([asdict(check) for check in checks])
    else:
        _print_checks(checks)
        for variable, absent in elsewhere.items():
            typer.echo(f"not checked, {variable} is not set: {', '.join(absent)}")
    if any(check.problems for check in checks):
        raise typer.Exit(2)


@app.command(name="fetch", short_help="Download and unpack MPI Sintel.")
def fetch_clips(
    source: Annotated[str, typer.Argument(metavar="SOURCE", help="What to fetch: sintel.")],
    out: Annotated[Path | None, typer.Option(help="The folder; $VFOA_DATA/sintel if not given.")] = None,
) -> None:
    """Download MPI Sintel's official archives and unpack them; a fetch that was cut goes on where it stopped."""
    from harness.cli.progress import bytes_bar
    from harness.clips.locate import expand
    from harness.clips.sintel_archives import ARCHIVES, fetch_sintel
    from vfoa.errors import VfoaError

    if source != "sintel":
        raise VfoaError(f"clips fetch: found {source!r}; expected 'sintel'")
    root = out or expand("${VFOA_DATA}/sintel", Path.cwd(), "clips fetch")
    for part, archive in ARCHIVES.items():
        with bytes_bar(archive) as progress:
            fetch_sintel(root, (part,), progress=progress)
    typer.echo(f"sintel: {root}")


def _print_list(rows: list[ClipRow]) -> None:
    print_table(
        ["clip", "adapter", "frames", "people", "things", "labels", "licence"],
        [
            [row.name, row.adapter, row.frames, len(row.subjects), len(row.targets), row.labels, row.licence]
            for row in rows
        ],
        shortened={"licence"},
    )
    for row in rows:
        if row.problem:
            typer.echo(f"{row.name}: {row.problem}")


def _print_checks(checks: list[ClipCheck]) -> None:
    print_table(
        ["clip", "frames", "size", "baseline m", "row error px", "labels", ""],
        [
            [
                check.name,
                check.frames,
                check.size_px and "x".join(map(str, check.size_px)),
                _rounded(check.baseline_m, 4),
                _rounded(check.vertical_error_px, 2),
                check.labels,
                "fails" if check.problems else "ok",
            ]
            for check in checks
        ],
    )
    said: dict[str, list[str]] = {}
    for check in checks:
        for line in (*check.problems, *(f"note: {note}" for note in check.notes)):
            said.setdefault(line, []).append(check.name)
    for line, clips in said.items():
        typer.echo(f"{', '.join(clips)}: {line}")


def _rounded(value: float | None, digits: int) -> str | None:
    return None if value is None else f"{value:.{digits}f}"
