"""``vfoa settings``."""

from __future__ import annotations

from typing import Annotated

import typer

from harness.cli.completion import stage_names
from harness.cli.options import Json
from harness.cli.terminal import say


def settings(
    stage: Annotated[
        str | None,
        typer.Argument(
            metavar="STAGE",
            help="Only a stage or step (stereo), or one choice of it (stereo.sgbm).",
            autocompletion=stage_names,
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Print every setting: key (for --set and for experiments), type, unit, default and meaning."""
    from dataclasses import asdict

    from harness.cli.terminal import print_json, print_table
    from harness.stages.settings_reference import settings_tables

    tables = settings_tables(stage)
    if as_json:
        print_json([asdict(table) for table in tables])
        return
    for table in tables:
        say(f"{table.title}{': ' if table.summary else ''}{table.summary}")
        if table.settings:
            print_table(
                ("Key", "Type", "Unit", "Default", "Meaning"),
                [(each.key, each.type, each.unit, each.default, each.meaning) for each in table.settings],
                wrapped=("Type", "Default", "Meaning"),
            )
        else:
            say("  nothing to set\n")
