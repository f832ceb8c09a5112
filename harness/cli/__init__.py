"""The command line: one file per verb, heavy imports inside the verb.

A known error is one line on stderr and exit code 2; anything else is a bug and keeps its traceback.
"""

from __future__ import annotations

import sys

import typer

from harness.cli import bench, clips, demo, run, score, view
from vfoa.errors import VfoaError

app = typer.Typer(
    name="vfoa",
    help="Who looks at what, in metres: run, score and scrub 3D Visual Focus of Attention.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command()(demo.demo)
app.command()(run.run)
app.command()(score.score)
app.command()(view.view)
app.command()(bench.bench)
app.add_typer(clips.app, name="clips")


def main() -> None:
    """Run the command line."""
    try:
        app()
    except VfoaError as error:
        print(f"vfoa: {error}", file=sys.stderr)  # noqa: T201
        raise SystemExit(2) from None
