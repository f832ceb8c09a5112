"""``vfoa simulate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import Replace
from harness.cli.terminal import say


def simulate(
    out: Annotated[
        Path | None,
        typer.Option(help="Directory for the CSV, the page, the figures and a recording of each case."),
    ] = None,
    replace: Replace = False,
) -> None:
    """Check the paper's five synthetic cases over rays and field of view; print which statements hold."""
    from rich.console import Console

    from harness.cli.terminal import print_report
    from harness.files.io import check_new_folder
    from harness.report.simulation import statements_table, write_simulation
    from vfoa import simulation

    if out is not None:
        check_new_folder(out, replace=replace, hint=", or another --out")
    rows = simulation.simulate()
    found = simulation.statements(rows)
    print_report(statements_table(found))
    n_rays, radius_cm = simulation.best_setting(rows)
    Console().print(f"Best over all cases: {n_rays} rays, radius {radius_cm:g} cm")
    if out is not None:
        from harness.record.cases import record_cases

        write_simulation(out, rows, found)
        first, *_ = record_cases(out / "scenes")
        say(f"Page: {out / 'simulation.md'}\nScenes, one frame a radius: rerun '{first}'")
