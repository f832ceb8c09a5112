"""``vfoa clips``: what clips there are, and whether they can be used."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.clip_add import add_clip

if TYPE_CHECKING:
    from harness.clips.check import ClipCheck, ClipRow

app = typer.Typer(help="Add clips, list them, and check that they can be used.", no_args_is_help=True)
app.command(name="add")(add_clip)

Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


@app.command(name="list")
def list_clips(as_json: Json = False) -> None:
    """List every clip: the working directory's own, then those that came with the package."""
    from harness.clips.check import list_clips as find_clips

    rows = find_clips()
    if as_json:
        _print_json(rows)
    else:
        _print_list(rows)


@app.command(name="check")
def check_clips(
    clips: Annotated[list[str] | None, typer.Argument(metavar="[CLIP]...", help="Names or .toml files.")] = None,
    as_json: Json = False,
) -> None:
    """Open clips, decode three frames of each, check calibration, rectification and labels; exit 2 if one fails."""
    from harness.clips.check import check_clip
    from harness.clips.locate import names

    checks = [check_clip(clip) for clip in clips or names("datasets")]
    if as_json:
        _print_json(checks)
    else:
        _print_checks(checks)
    if any(check.problems for check in checks):
        raise typer.Exit(2)


@app.command(name="fetch")
def fetch_clips(
    source: Annotated[str, typer.Argument(metavar="SOURCE", help="What to fetch: sintel.")],
    into: Annotated[Path | None, typer.Option(help="The folder; $VFOA_DATA/sintel if not given.")] = None,
) -> None:
    """Download MPI Sintel's official archives and unpack them; a fetch that was cut goes on where it stopped."""
    from harness.cli.progress import bytes_bar
    from harness.clips.locate import expand
    from harness.clips.sintel_archives import ARCHIVES, fetch_sintel
    from vfoa.errors import VfoaError

    if source != "sintel":
        raise VfoaError(f"clips fetch: found {source!r}; expected 'sintel'")
    root = into or expand("${VFOA_DATA}/sintel", Path.cwd(), "clips fetch")
    for part, archive in ARCHIVES.items():
        with bytes_bar(archive) as progress:
            fetch_sintel(root, (part,), progress=progress)
    typer.echo(f"sintel: {root}")


def _print_json(values: list[ClipRow] | list[ClipCheck]) -> None:
    import json
    from dataclasses import asdict

    typer.echo(json.dumps([asdict(value) for value in values], indent=2, ensure_ascii=False))


def _print_list(rows: list[ClipRow]) -> None:
    _print_table(
        ["clip", "adapter", "frames", "subjects", "targets", "licence", "labels"],
        [
            [
                row.name,
                row.adapter,
                row.frames,
                ", ".join(row.subjects),
                ", ".join(row.targets),
                row.licence,
                row.labels,
            ]
            for row in rows
        ],
        wrapped={"subjects", "targets", "licence"},
    )
    for row in rows:
        if row.problem:
            typer.echo(f"{row.name}: {row.problem}")


def _print_checks(checks: list[ClipCheck]) -> None:
    _print_table(
        ["clip", "frames", "size", "B m", "rows off", "labels", ""],
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
    for check in checks:
        for line in (*check.problems, *(f"note: {note}" for note in check.notes)):
            typer.echo(f"{check.name}: {line}")


def _rounded(value: float | None, digits: int) -> str | None:
    return None if value is None else f"{value:.{digits}f}"


def _print_table(header: list[str], rows: list[list[object]], wrapped: Collection[str] = ()) -> None:
    """Print a table; only the columns named in ``wrapped`` may be broken into lines."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for name in header:
        table.add_column(name, no_wrap=name not in wrapped, overflow="fold", min_width=len(name))
    for row in rows:
        table.add_row(*(Text("-" if cell in (None, "") else str(cell)) for cell in row))
    Console().print(table)
