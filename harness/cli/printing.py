"""Tables and JSON on the terminal."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from harness.report.formats import Table


def print_table(
    header: Sequence[str],
    rows: Sequence[Sequence[object]],
    wrapped: Collection[str] = (),
    shortened: Collection[str] = (),
) -> None:
    """Print a table; where it is too wide, columns named in ``wrapped`` are broken into lines, ``shortened`` cut."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for name in header:
        table.add_column(name, no_wrap=name not in (*wrapped, *shortened), overflow="fold", min_width=len(name))
    for row in rows:
        cells = [Text("-" if cell in (None, "") else str(cell)) for cell in row]
        for name, cell in zip(header, cells, strict=True):
            if name in shortened:
                cell.no_wrap, cell.overflow = True, "ellipsis"
        table.add_row(*cells)
    Console().print(table)


def print_report(table: Table) -> None:
    """Print one table of a report without its notes, in parts where it is wider than the terminal."""
    from rich.console import Console

    from harness.report.formats import in_parts, to_rich

    console = Console()
    for part in in_parts(table, console.width):
        console.print(to_rich(part))


def print_reports(tables: Iterable[Table]) -> None:
    """Print the tables of a report, each with what a reader must know of it, and a blank line."""
    from rich.console import Console
    from rich.table import Table as RichTable
    from rich.text import Text

    console = Console()
    for table in tables:
        if table.rows:
            print_report(table)
        else:
            console.print(f"{table.title}: nothing to show\n", highlight=False)
        notes = RichTable.grid(padding=(0, 1, 0, 0))
        for note in table.notes:
            notes.add_row("-", Text(note))
        console.print(notes)
        console.print()


def print_json(value: object) -> None:
    """Print JSON, indented; what JSON has no word for (a path) as text."""
    import json

    typer.echo(json.dumps(value, indent=2, ensure_ascii=False, default=str))
