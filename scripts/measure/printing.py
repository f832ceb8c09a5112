"""Tables of measurements on the terminal, as Markdown."""

from __future__ import annotations

from rich.console import Console

from harness.report.formats import Table, to_markdown


def print_tables(*tables: Table) -> None:
    """Print tables as they are committed to ``reports/``."""
    for table in tables:
        Console().print(to_markdown(table), soft_wrap=True)
