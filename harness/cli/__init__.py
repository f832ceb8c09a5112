"""The command line: a file per group of commands, heavy imports inside the commands.

A known error is one line on stderr and exit code 2; anything else is a bug and keeps its traceback.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Annotated, Any, NoReturn

import typer
from pydantic import ValidationError
from typer.core import TyperArgument
from typer.main import get_command

from harness.cli import answers, clips, labels, models, setup
from harness.cli.annotate import annotate
from harness.cli.bench import bench
from harness.cli.calibrate import calibrate
from harness.cli.figures import figures
from harness.cli.fit import fit
from harness.cli.run import demo, run
from harness.cli.scores import compare, plan, report, score
from harness.cli.terminal import say
from harness.cli.view import catalog, export_failure, view
from harness.files.safe_names import shown
from harness.processes import keep_working_directory_out
from vfoa.errors import StageError, VfoaError
from vfoa.validation import expected_and_found

app = typer.Typer(
    name="vfoa",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


_WrongCommandLine: Any = typer.BadParameter.__mro__[2]
"""Click's error of a command line. Typer has its own copy of Click, or an older one the package."""


_NO_MEMORY = ("failed to map", "annot allocate memory", "error return without exception set")
"""Parts of errors of the loader of libraries, and of Python itself, that has no memory left for a MemoryError."""


def _type_in_help(argument: Any, ctx: Any) -> str | None:
    """The type that the help shows behind an argument's name: its choices, but no type of Python (``<list[str]>``)."""
    return str(argument.display_type(ctx)) if argument.type_descriptor.is_choice else None


TyperArgument.display_type_rich = _type_in_help  # type: ignore[assignment, method-assign]


def _print_version(wanted: bool) -> None:
    if wanted:
        from vfoa import __version__

        say(f"vfoa {__version__}")
        raise typer.Exit


@app.callback()
def _vfoa(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Who looks at what, in metres: run, score and scrub 3D Visual Focus of Attention."""


app.command(short_help="Run the paper's table on rendered clips; downloads nothing.")(demo)
app.command(short_help="Run clips under configurations; print the FRR table.")(run)
app.command(short_help="Score a run again, without images or models.")(score)
app.command(short_help="Write a run's report page, or serve it with its recordings.")(report)
app.command(short_help="Open a run's recordings in the Rerun viewer.")(view)
app.command(short_help="Write one frame and its neighbours as a small recording.")(export_failure)
app.command(short_help="Serve runs as datasets of Rerun's catalogue.")(catalog)
app.command(short_help="Compare configurations, of one run or of several.")(compare)
app.command(short_help="Draw figures of runs for a paper, as SVG and PDF.")(figures)
app.command(short_help="Say how many clips it takes to see a difference.")(plan)
app.command(short_help="Fit attention's weights to labelled clips.")(fit)
app.command(short_help="Measure the speed of each stage.")(bench)
app.command(short_help="Label a clip in the browser: who looks at what.")(annotate)
app.command(short_help="Calibrate two cameras from pictures of a board.")(calibrate)
app.command(short_help="Check what running needs on this machine.")(setup.doctor)
app.command(short_help="Make a working directory with the data folders.")(setup.init)
app.command(short_help="Print every setting: type, unit, default, meaning.")(setup.settings)
app.add_typer(labels.app, name="labels", short_help="Check, import, export and compare labels.")
app.add_typer(answers.app, name="answers", short_help="Write a run's answers for another program.")
app.add_typer(setup.cache_app, name="cache")
app.add_typer(clips.app, name="clips")
app.add_typer(models.app, name="models", short_help="List, fetch, check and export models.")


@cache
def commands() -> Any:
    """The program's commands, as Click has them: ``app`` builds them anew for each call."""
    return get_command(app)


def main() -> None:
    """Run the command line."""
    keep_working_directory_out()
    _open_closed()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a file's name need not be valid text
    with one_line_errors():
        _check_working_directory()
        raise SystemExit(commands()(prog_name="vfoa", standalone_mode=False) or 0)


@contextmanager
def one_line_errors() -> Iterator[None]:
    """Turn known errors in the block into one line on stderr, and end the program."""
    try:
        yield
    except StageError as error:  # a command without a run's directory, in which the traceback would be saved
        print(error.trace, end="", file=sys.stderr)  # noqa: T201
        _refuse(str(error))
    except VfoaError as error:
        _refuse(str(error))
    except _WrongCommandLine as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            error.show()
            raise SystemExit(error.exit_code) from None
        named = _command_of(sys.argv[1:])
        advice = f"vfoa {named} -h".replace("  ", " ")
        _refuse(f"{named}{': ' if named else ''}{_wrong(error)}; see `{advice}`")
    except typer.Abort:
        _refuse("nothing was changed")
    except BrokenPipeError:
        # the reader of the output has closed it; the interpreter would complain when it closes stdout
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(1) from None
    except OSError as error:
        # a full disk or a read-only folder is no fault of the program, and nothing half-written is left
        place = f"{error.filename}: " if error.filename else ""
        _refuse(f"{place}{error.strerror or error}")
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except (ImportError, SystemError) as error:
        if not any(sign in str(error) for sign in _NO_MEMORY):
            raise
        _refuse(f"not enough memory to load a library: {error}")
    except MemoryError as error:
        _refuse(f"not enough memory: {str(error) or 'none left'}")


def _command_of(words: list[str]) -> str:
    """The words of a command line that name a command; errors of Click's parser have no context that says it."""
    command, named = commands(), []
    for word in words:
        if (command := getattr(command, "commands", {}).get(word)) is None:
            break
        named.append(word)
    return " ".join(named)


def _wrong(error: Any) -> str:
    """What is wrong on a command line, in the words of errors about files instead of pydantic's."""
    if isinstance(error.__cause__, ValidationError):
        message = f"{error.param.opts[0]}: {expected_and_found(error.__cause__.errors()[0])}"
    else:
        message = error.format_message()
    return message.rstrip(".")


def _check_working_directory() -> None:
    try:
        os.getcwd()
    except FileNotFoundError:
        raise VfoaError("the working directory no longer exists; change to another one") from None


def _open_closed() -> None:
    """Give a program that was started without stdout or stderr (``2>&-``) one that discards everything."""
    for number, name in ((1, "stdout"), (2, "stderr")):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            if nowhere != number:
                os.dup2(nowhere, number)
            setattr(sys, name, os.fdopen(number, "w", closefd=False))


def _refuse(message: str) -> NoReturn:
    print(f"vfoa: {shown(message)}", file=sys.stderr)  # noqa: T201
    raise SystemExit(2) from None
