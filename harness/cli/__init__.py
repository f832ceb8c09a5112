"""The command line: one file per verb, heavy imports inside the verb.

A known error is one line on stderr and exit code 2; anything else is a bug and keeps its traceback.
"""

from __future__ import annotations

import io
import os
import sys
from typing import NoReturn

import typer

from harness.cli import annotation_files, cache, clips, models
from harness.cli.annotate import annotate
from harness.cli.bench import bench
from harness.cli.calibrate import calibrate
from harness.cli.compare import compare
from harness.cli.demo import demo
from harness.cli.export_failure import export_failure
from harness.cli.init import init
from harness.cli.live import live
from harness.cli.report import report
from harness.cli.run import run
from harness.cli.score import score
from harness.cli.simulate import simulate
from harness.cli.view import view
from vfoa.errors import StageError, VfoaError

app = typer.Typer(
    name="vfoa",
    help="Who looks at what, in metres: run, score and scrub 3D Visual Focus of Attention.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command(short_help="Run the paper's table on rendered clips; downloads nothing.")(demo)
app.command(short_help="Run clips under configurations; print the FRR table.")(run)
app.command(short_help="Run on the newest frames of a source, as they come.")(live)
app.command(short_help="Score a run again, without images or models.")(score)
app.command(short_help="Write a run's page, or serve it with its recordings.")(report)
app.command(short_help="Look at a run's recordings in the Rerun viewer.")(view)
app.command(short_help="Write the frames around one into a small recording.")(export_failure)
app.command(short_help="Compare configurations, of one run or of several.")(compare)
app.command(short_help="Measure what each part costs.")(bench)
app.command(short_help="Label a clip in a page: who looks at what.")(annotate)
app.command(short_help="Calibrate two cameras from pictures of a board.")(calibrate)
app.command(short_help="Check the paper's five synthetic cases.")(simulate)
app.command(short_help="Make a working directory with the data folders.")(init)
app.add_typer(annotation_files.app, name="annotations")
app.add_typer(cache.app, name="cache")
app.add_typer(clips.app, name="clips")
app.add_typer(models.app, name="models", short_help="List, fetch, check and export models.")


def main() -> None:
    """Run the command line."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a file's name need not be text
    try:
        app()
    except StageError as error:  # of a verb that has no run's directory to keep the traceback in
        print(error.trace, end="", file=sys.stderr)  # noqa: T201
        _refuse(str(error))
    except VfoaError as error:
        _refuse(str(error))
    except BrokenPipeError:
        # whoever read the output has enough of it; the interpreter would complain when it closes stdout
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(1) from None
    except OSError as error:
        # a full disk, a folder that may not be written: nothing of the program's, and nothing half-written is left
        place = f"{error.filename}: " if error.filename else ""
        _refuse(f"{place}{error.strerror or error}")


def _refuse(message: str) -> NoReturn:
    print(f"vfoa: {message}", file=sys.stderr)  # noqa: T201
    raise SystemExit(2) from None
