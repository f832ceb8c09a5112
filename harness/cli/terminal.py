"""The terminal: tables, JSON, progress bars on stderr, and the signals that end a command."""

from __future__ import annotations

import json
import math
import re
import signal
import sys
import textwrap
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from harness.files.safe_names import shown, vfoa_command
from harness.processes import interrupt
from vfoa.errors import listed

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress, ProgressColumn, TaskID

    from harness.report.formats import Table
    from harness.score.score import Scores


def say(text: str = "", *, err: bool = False, nl: bool = True) -> None:
    """Print text that may hold names of files, clips and people; control characters in it have no effect."""
    typer.echo(shown(text), err=err, nl=nl)


def print_table(
    header: Sequence[str], rows: Iterable[Sequence[object]], wrapped: Collection[str] = (), shortened: str | None = None
) -> None:
    """Print a table of text: no wider than the terminal if it can be, else as wide as its cells are.

    Columns named in ``wrapped`` are broken into lines, and cells of the column ``shortened`` are cut.
    """
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console, table = Console(), Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    texts = [["-" if cell in (None, "") else shown(str(cell)) for cell in row] for row in rows]
    least = 0
    for name, *cells in zip(header, *texts, strict=True):
        is_flexible = name in (*wrapped, shortened)
        table.add_column(name, no_wrap=not is_flexible, overflow="fold", min_width=len(name))
        least += max(map(len, (name,) if is_flexible else (name, *cells))) + _GAP
    for row in texts:
        cells = [Text(cell) for cell in row]
        for name, cell in zip(header, cells, strict=True):
            cell.no_wrap, cell.overflow = (True, "ellipsis") if name == shortened else (None, None)
        table.add_row(*cells)
    if least > console.width:
        console.width = _WIDEST
    console.print(table)


def print_report(table: Table, *, bold: int | None = None) -> None:
    """Print one table of a report without its notes, one row in bold; in parts if it is wider than the terminal."""
    from rich.console import Console

    from harness.report.formats import in_parts, to_rich

    console = Console()
    for part in in_parts(table, console.width):
        printed = to_rich(part)
        if bold is not None:
            printed.rows[bold].style = "bold"
        console.print(printed)


MOST_ROWS = 40
"""Most rows of a table of which the whole is elsewhere."""


def first_rows(table: Table, others: str) -> Table:
    """The table, or its first rows and a note if it has many; ``others`` says where the others are."""
    if len(table.rows) <= MOST_ROWS:
        return table
    note = f"The first {MOST_ROWS} of {len(table.rows)} {others}."
    return replace(table, rows=table.rows[:MOST_ROWS], notes=(*table.notes, note))


def print_reports(tables: Iterable[Table]) -> None:
    """Print the tables of a report, each with its notes and a blank line."""
    from rich.console import Console
    from rich.table import Table as RichTable
    from rich.text import Text

    console = Console()
    for table in tables:
        if table.rows:
            print_report(table)
        else:
            console.print(f"{table.title}: nothing to show", highlight=False)
        if table.rows and table.notes:
            notes = RichTable.grid(padding=(0, 1, 0, 0))
            for note in table.notes:
                notes.add_row("-", Text(note))
            console.print(notes)
        console.print()


def print_json(value: object) -> None:
    """Print JSON, indented; other types (a path) as text, numbers without a value as null."""
    say(json.dumps(_without_nan(value), indent=2, ensure_ascii=False, default=str))


def _without_nan(value: object) -> object:
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def print_scores(scores: Scores, run: Path, *, verbose: bool = False) -> None:
    """Print the result of a run: a row for each configuration, what fails, the verdict and the next commands.

    ``verbose``: first the tables by clip and of the stages, with all notes.
    """
    from rich.console import Console

    from harness.report.comparisons import ablation_table, published_table
    from harness.report.stages import stage_measures_table, terminal_measures
    from harness.report.tables import remarks, seeds_table, summary_table, terminal_table, unlabelled_table
    from harness.run.notes import NoteKind

    ablation = ablation_table(scores)
    if verbose:
        stages = terminal_measures(stage_measures_table(scores), scores)
        others = (seeds_table(scores), published_table(scores), ablation, stages)
        print_reports((terminal_table(scores), *(table for table in others if table.rows)))
    console = Console(highlight=False)
    table, best = summary_table(scores)
    if table.rows:
        print_report(table, bold=best)
        for note in table.notes:
            console.print(note, markup=False)
    if ablation.rows and not verbose:
        print_reports([ablation])
    if (answers := unlabelled_table(scores)).rows:
        print_reports([answers if verbose else first_rows(answers, "rows: see the report")])
    unscored = [note for note in remarks(scores) if note.kind == NoteKind.UNLABELLED]
    more = [f"{len(unscored) - _MOST_CLIPS} more clips without labels: see the report."]
    for line in (*map(str, unscored[:_MOST_CLIPS]), *(more if len(unscored) > _MOST_CLIPS else [])):
        _print_wrapped(console, _QUOTED.sub(lambda quoted: quoted[0].replace(" ", _UNBROKEN), f"- {line}"))
    console.print()
    answer, *further = verdict_of_run(scores, run, _UNBROKEN)
    _print_wrapped(console, answer, "bold")
    for line in further:
        _print_wrapped(console, line)
    say(f"Report (all tables: frr.md): {run / 'report.html'}")
    if not scores.is_recorded:
        say("Not recorded: to scrub, run with --recording light.")
    elif scores.wrong_frames:
        say(f"Scrub a failure: {vfoa_command('view', run, '--failures')}")
    else:
        say(f"Scrub: {vfoa_command('view', run)}")


def verdict_of_run(scores: Scores, run: Path, blank: str = " ") -> list[str]:
    """The result of a run in lines, of which a command to view it names its directory; ``blank``: that in commands."""
    from harness.report.advice import VIEW
    from harness.report.verdict import verdict_lines

    def command(match: re.Match[str]) -> str:
        return match[0].replace(VIEW, vfoa_command("view", run)).replace(" ", blank)

    return [_COMMAND.sub(command, line) for line in verdict_lines(scores)]


def _print_wrapped(console: Console, text: str, style: str = "") -> None:
    """Print text in lines of the terminal's width; what has :data:`_UNBROKEN` for blanks stays in one line to copy.

    So does a number with its unit.
    """
    text = _WITH_UNIT.sub(_UNBROKEN, text)
    for line in textwrap.wrap(text, console.width, break_long_words=False, break_on_hyphens=False):
        console.print(line.replace(_UNBROKEN, " "), markup=False, style=style, soft_wrap=True)


_COMMAND = re.compile(r"(vfoa|--set)( [^\s(),;]+)+")
_QUOTED = re.compile(r"`[^`]+`")
_WITH_UNIT = re.compile(r"(?<=\d) (?=%|deg\b|points?\b|s\b|m\b)")
_UNBROKEN = "\ue000"
"""Stands for a blank at which no line breaks: a character that no text has."""

_WIDEST = 1000
"""Most characters of a row of a table."""
_GAP = 2
"""Characters that rich adds to each column: a blank, and its part of the frame."""
_MOST_CLIPS = 3
"""Most clips without labels that are named."""


def say_unknown_names(scores: Scores) -> None:
    """Print the names in the results that a clip's manifest does not know."""
    for clip, names in scores.unknown_names.items():
        if names:
            say(
                f"{clip}: the results name {', '.join(names)}, unknown to its manifest and labels: these answers count "
                "as wrong; run it again",
                err=True,
            )


def say_relabelled(run: Path, clip: str | None = None) -> None:
    """Print which labels (of ``clip``) have changed since the recordings of a finished run got their verdicts."""
    from harness.run.directory import RunDirectory
    from harness.score.finished_run import FinishedRun

    directory = RunDirectory(run)
    if run.is_file() or not directory.read_manifest().finished:
        return
    if clips := FinishedRun.read(directory).relabelled(clip):
        say(
            f"vfoa: {listed(clips)}: labels have changed since the run was scored, and recordings show those of then; "
            f"`{vfoa_command('score', run)}` updates them",
            err=True,
        )


def say_forwarding(port: int) -> None:
    """Tell somebody who is logged in by SSH how to open what is served here."""
    from harness.server.local_server import forwarding

    if command := forwarding(port):
        say(f"On your own machine, first: {command}", err=True)


LINE_EVERY_S = 60.0
"""Seconds between two lines of progress where stderr is no terminal: a log of a cluster or of CI."""


_SETTLED_S = 5.0
"""Seconds from the first frame on that do not count for the rate: frames of an earlier run are reported at once."""


@contextmanager
def frames_bar(total: int, what: str, unit: str = "frames") -> Iterator[Callable[[str], None]]:
    """Yield a function to call after each frame with the clip's name; it draws a bar, or prints a line a minute."""
    if not sys.stderr.isatty():
        yield _lines(total, unit)
        return
    from rich.progress import MofNCompleteColumn, ProgressColumn, Task, TimeRemainingColumn
    from rich.text import Text

    class RateColumn(ProgressColumn):
        """Frames, or what else is counted, per second in the last half minute."""

        def render(self, task: Task) -> Text:
            return Text(f"{task.speed or 0:.1f} {unit}/s")

    with _bar(what, total, MofNCompleteColumn(), RateColumn(), TimeRemainingColumn()) as (bar, task):
        yield lambda clip: bar.update(task, advance=1, description=shown(clip))


def verdicts_bar(total: int, what: str) -> AbstractContextManager[Callable[[str], None]]:
    """The same for the recordings that get their verdicts."""
    return frames_bar(total, what, "recordings")


def _lines(total: int, unit: str) -> Callable[[str], None]:
    """A function to call after each frame with the clip's name: it prints how far the run is, a line a minute.

    The rate is that since the line before. What comes before the first frame does not count: long clips open slowly.
    """
    printed_s = time.monotonic()
    done = done_before = 0
    first_s = since_s = math.inf

    def advance(clip: str) -> None:
        nonlocal printed_s, done, done_before, first_s, since_s
        done += 1
        now_s = time.monotonic()
        first_s = min(first_s, now_s)
        if now_s - first_s < _SETTLED_S:
            done_before, since_s = done, now_s
        elif done < total and now_s - printed_s >= LINE_EVERY_S and now_s - since_s >= _SETTLED_S:
            rate = (done - done_before) / (now_s - since_s)
            left_min = (total - done) / rate / 60
            printed_s, done_before, since_s = now_s, done, now_s
            say(f"{clip}: {done} of {total} {unit}, {rate:.1f} {unit}/s, about {left_min:.0f} min left", err=True)

    return advance


@contextmanager
def bytes_bar(what: str) -> Iterator[Callable[[int, int | None], None]]:
    """Yield a function to call with the bytes received and the total bytes, None if unknown."""
    from rich.progress import DownloadColumn, TimeRemainingColumn, TransferSpeedColumn

    with _bar(what, None, DownloadColumn(), TransferSpeedColumn(), TimeRemainingColumn()) as (bar, task):
        yield lambda done, total: bar.update(task, completed=done, total=total)


@contextmanager
def _bar(what: str, total: int | None, *columns: ProgressColumn) -> Iterator[tuple[Progress, TaskID]]:
    """Show a progress bar on stderr while it is a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    console = Console(stderr=True)
    shape = TextColumn("{task.description}"), BarColumn(), *columns
    with Progress(*shape, console=console, transient=True, disable=not sys.stderr.isatty()) as bar:
        yield bar, bar.add_task(shown(what), total=total)


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """End the block, and nothing more, on the signals of :func:`signals_as_ctrl_c` and on Ctrl-C."""
    with suppress(KeyboardInterrupt), signals_as_ctrl_c():
        yield


@contextmanager
def signals_as_ctrl_c() -> Iterator[None]:
    """Within the block SIGTERM and SIGHUP raise :class:`KeyboardInterrupt`: child processes are stopped on the way out.

    SIGHUP stays ignored under nohup.
    """
    signals = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    handled = [number for number in signals if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, interrupt) for number in handled}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def exit_if_interrupted(notices: Collection[str]) -> Iterator[None]:
    """End with exit code 130 on Ctrl-C, SIGTERM and SIGHUP, and print what is kept and how to continue."""
    try:
        with signals_as_ctrl_c():
            yield
    except KeyboardInterrupt:
        for notice in notices or ["interrupted before the first frame of the experiment"]:
            say(f"vfoa: {notice}", err=True)
        raise typer.Exit(130) from None
