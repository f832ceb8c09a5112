"""Tables and pictures of a report. Tables are printed to a terminal, CSV, Markdown or LaTeX; equal ones as equal bytes.

Panels are more foldable sections of the page under "More measures": one file and one line of :data:`PANELS` each. A
panel is a function of the scores that gives a table or a picture. Another distribution adds one through the
entry-point group ``vfoa.panels``.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from operator import itemgetter
from typing import TYPE_CHECKING, Protocol

from harness.files.safe_names import plain_cell
from harness.score.statistics import Interval
from vfoa.registry import Registry

if TYPE_CHECKING:
    from rich.table import Table as RichTable

    from harness.score.score import Scores

UNKNOWN = "–"
"""Printed instead of a number without a value; CSV has an empty cell."""


_LEAST_WORDS = 24
"""A column of words that is wider is wrapped before a table is split."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Text in rows and columns, every number already in its printed form.

    ``words`` is the number of leading columns that hold words; all others are numbers and are aligned to the right.
    ``notes`` are shown with the table, each one sentence or more.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: int
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"Table {self.title!r}: expected {len(self.columns)} cells, found {row}")

    @classmethod
    def of(
        cls, title: str, columns: str, rows: Iterable[Iterable[object]], *, words: int, notes: Sequence[str] = ()
    ) -> Table:
        """A table of values that are printed as they are. The names of the columns are separated by ``|``."""
        names = tuple(column.strip() for column in columns.split("|"))
        cells = tuple(tuple(map(str, row)) for row in rows)
        return cls(title=title, columns=names, rows=cells, words=words, notes=tuple(notes))

    def only(self, columns: Sequence[str]) -> Table:
        """The table with these columns alone, in this order."""
        places = [self.columns.index(column) for column in columns]
        rows = tuple(tuple(row[place] for place in places) for row in self.rows)
        return replace(self, columns=tuple(columns), rows=rows)


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """An SVG drawing on the page. ``svg`` is only the ``<svg>`` element, without scripts or links to other files.

    ``notes`` are shown with it, each one sentence or more.
    """

    title: str
    svg: str
    notes: tuple[str, ...] = ()


class Panel(Protocol):
    """One section of the page."""

    def __call__(self, scores: Scores) -> Table | Picture:
        """Draw the panel for a run. A table without rows is left out of the page."""
        ...


PANELS = Registry(kind="report panel", builtin={}, group="vfoa.panels")


def draw_panels(scores: Scores) -> list[Table | Picture]:
    """Draw every panel: those of this project, then those of other distributions, sorted."""
    panels: list[Panel] = [PANELS.load(name) for name in PANELS.builtin_first()]
    return [panel(scores) for panel in panels]


def to_csv(table: Table) -> str:
    """Header and rows, RFC 4180 with LF; title and notes are left out."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([table.columns, *(map(plain_cell, row) for row in table.rows)])
    return text.getvalue()


def to_markdown(table: Table, *, level: int = 1) -> str:
    """A heading, the notes, and the table."""
    head = f"{'#' * level} {_markdown(table.title)}\n\n"
    notes = "".join(f"- {_markdown(note)}\n" for note in table.notes)
    if not table.rows:
        return f"{head}{notes}{chr(10) * bool(notes)}Nothing to show.\n"
    cells = [[_markdown(cell) for cell in row] for row in (table.columns, *table.rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(table.columns))]
    rule = ["-" * max(width, 3) if i < table.words else "-" * max(width - 1, 2) + ":" for i, width in enumerate(widths)]
    lines = [_aligned(cells[0], widths, table.words), rule, *(_aligned(row, widths, table.words) for row in cells[1:])]
    return f"{head}{notes}{chr(10) * bool(notes)}" + "".join(f"| {' | '.join(line)} |\n" for line in lines)


LATEX_HEAD = "% needs \\usepackage{booktabs}\n"
"""The first line of a file of tables."""


def to_latex(table: Table, *, label: str) -> str:
    r"""A floating table with booktabs rules; needs ``\usepackage{booktabs}``. The notes are below it.

    Groups of rows that begin with the same word are separated by a little space.
    """
    lines = [
        r"\begin{table}",
        r"\centering\small\setlength{\tabcolsep}{4pt}",
        rf"\caption{{{_latex(table.title)}}}",
        rf"\label{{{label}}}",
        rf"\begin{{tabular}}{{{'l' * table.words}{'r' * (len(table.columns) - table.words)}}}",
        r"\toprule",
        _latex_row(table.columns),
        r"\midrule",
        *_latex_body(table),
        r"\bottomrule",
        r"\end{tabular}",
        *([r"\par\medskip\raggedright\footnotesize"] if table.notes else []),
        *(rf"{_latex(note)}\par" for note in table.notes),
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def in_parts(table: Table, width: int) -> tuple[Table, ...]:
    """Split the table into parts no wider than ``width``: each has all word columns, and as many others as fit."""
    widths = [max(map(len, column)) + 2 for column in zip(table.columns, *table.rows, strict=True)]
    room = width - sum(min(own, _LEAST_WORDS) for own in widths[: table.words]) - 1
    parts: list[list[int]] = [[]]
    for i in range(table.words, len(widths)):
        if parts[-1] and sum(widths[j] for j in parts[-1]) + widths[i] > room:
            parts.append([])
        parts[-1].append(i)
    chosen = [[*range(table.words), *part] for part in parts]
    return tuple(
        replace(
            table,
            title=table.title + (f" (part {number} of {len(chosen)})" if len(chosen) > 1 else ""),
            columns=tuple(table.columns[i] for i in part),
            rows=tuple(tuple(row[i] for i in part) for row in table.rows),
        )
        for number, part in enumerate(chosen, start=1)
    )


def to_rich(table: Table) -> RichTable:
    """The table for a terminal: numbers are never cut or wrapped; words are wrapped if it is narrow."""
    from rich import box
    from rich.markup import escape
    from rich.table import Table as RichTable

    printed = RichTable(title=escape(table.title), box=box.SIMPLE_HEAD, title_justify="left", padding=(0, 1, 0, 0))
    for i, name in enumerate(table.columns):
        is_word = i < table.words
        printed.add_column(escape(name), justify="left" if is_word else "right", no_wrap=not is_word, overflow="fold")
    for row in table.rows:
        printed.add_row(*(escape(cell) for cell in row))
    return printed


def csv_cell(text: str) -> str:
    """One cell as :func:`to_csv` writes it, for tables that are too long to hold in memory as cells."""
    text = plain_cell(text)
    return '"' + text.replace('"', '""') + '"' if re.search('[",\r\n]', text) else text


def number(value: float | None, digits: int, scale: float = 1) -> str:
    """A number for people; :data:`UNKNOWN` without a value."""
    return UNKNOWN if value is None or math.isnan(value) else f"{scale * value:.{digits}f}"


def shortened(name: str, width: int) -> str:
    """The name, with as much of its middle left out as this width needs."""
    if len(name) <= width:
        return name
    end = max(width - 1, 0) // 2
    return f"{name[: max(width - 1 - end, 0)]}…{name[len(name) - end :]}"


def percent(share: float | None) -> str:
    """A share in percent, for people."""
    return number(share, 1, 100)


def percent_range(interval: Interval) -> str:
    """The ends of an interval of a share in whole percent, for people."""
    return interval_range(interval, ".0f", 100, "–")


def p_value(p: float) -> str:
    """A p value in two significant digits, for people."""
    return "<0.001" if p < 0.001 else f"{p:.2g}"


def points(share: float) -> str:
    """A difference of shares in points, for people."""
    return UNKNOWN if math.isnan(share) else f"{100 * share:+.1f}"


def points_range(interval: Interval | None) -> str:
    """The ends of an interval of a difference in points; empty for no interval."""
    return "" if interval is None else interval_range(interval, "+.1f", 100)


def interval_range(interval: Interval, form: str, scale: float = 1, between: str = " to ") -> str:
    """The ends of an interval, for people; :data:`UNKNOWN` if they are not known."""
    if math.isnan(interval.low):
        return UNKNOWN
    return f"{scale * interval.low:{form}}{between}{scale * interval.high:{form}}"


def csv_share(value: float | None) -> str:
    """A share for programs: six decimals, empty without a value."""
    return "" if value is None or math.isnan(value) else f"{value:.6f}"


def _aligned(cells: Sequence[str], widths: Iterable[int], words: int) -> list[str]:
    return [
        cell.ljust(max(width, 3)) if i < words else cell.rjust(max(width, 3))
        for i, (cell, width) in enumerate(zip(cells, widths, strict=True))
    ]


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _markdown(text: str) -> str:
    """Escape characters that would end a cell or be read as mark-up."""
    return re.sub(r"([\\`*|\[\]#]|(?<!\w)_|_(?!\w))", r"\\\1", _one_line(text)).replace("<", "&lt;")


_LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "–": "--",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    "°": r"\textdegree{}",
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
}


def _latex(text: str) -> str:
    return "".join(_LATEX.get(sign, sign) for sign in _one_line(text))


def _latex_body(table: Table) -> Iterator[str]:
    groups = [list(rows) for _, rows in groupby(table.rows, key=itemgetter(0))]
    grouped = len({rows[0][0] for rows in groups}) == len(groups) < len(table.rows)
    for i, rows in enumerate(groups):
        if grouped and i:
            yield r"\addlinespace"
        yield from map(_latex_row, rows)


def _latex_row(cells: Iterable[str]) -> str:
    # a bracket after \\ would be read as its optional argument, so every row begins with an empty group
    return f"{{}}{' & '.join(_latex(cell) for cell in cells)} \\\\"
