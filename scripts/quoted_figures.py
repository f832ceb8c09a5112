"""Figures that documents quote from the committed reports: written from them, so that neither goes stale.

python -m scripts.quoted_figures           writes every quoted figure and table of the documents (make figures)
python -m scripts.quoted_figures --check   exits with 1 where a document differs from its report (make docs)

A document marks what it quotes by comments, which a reader does not see. One figure: report, title of the table, cells
that begin the row, column. A table: the same, with all columns that are shown and the rows that begin with the cells.

    <!-- figure: reports/demo.md | Focus recognition rate | (all), sgbm-two | FRR % -->80.5<!-- end -->
    <!-- table: reports/demo.md | Focus recognition rate | (all) | Configuration, n, FRR % -->
    ...
    <!-- end -->

A title may be shortened to its beginning; * in a cell stands for any text.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
QUOTE = re.compile(r"<!-- (?P<kind>figure|table): (?P<source>[^>]*?) -->(?P<quoted>.*?)<!-- end -->", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Table:
    """A table of a report: its title, header and rows of texts."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def starting(self, cells: tuple[str, ...]) -> list[tuple[str, ...]]:
        """The rows that begin with these cells, in which * stands for any text."""
        return [row for row in self.rows if len(row) >= len(cells) and all(map(fnmatchcase, row, cells))]


@cache
def tables(report: Path) -> tuple[Table, ...]:
    """Every table of a report, with the heading before it as its title."""
    title, found, lines = "", [], []
    for line in [*report.read_text(encoding="utf-8").splitlines(), ""]:
        if line.startswith("|"):
            lines.append(tuple(cell.strip().replace("\\", "") for cell in re.split(r"(?<!\\)\|", line.strip())[1:-1]))
        elif lines:
            found.append(Table(title, lines[0], tuple(lines[2:])))
            lines = []
        if line.startswith("#"):
            title = line.lstrip("# ")
    return tuple(found)


def quoted(kind: str, source: str) -> str:
    """Return the text of a quote from its report.

    Raises
    ------
    ValueError
        If the report has no such table, row or column, or several rows for one figure.
    """
    report, title, cells, columns = (part.strip() for part in source.split("|"))
    start = tuple(cell.strip() for cell in cells.split(",")) if cells else ()
    names = [name.strip() for name in columns.split(",")]
    for table in tables(ROOT / report):
        if table.title.startswith(title) and table.starting(start) and set(names) <= set(table.header):
            break
    else:
        raise ValueError(f"{report}: no table {title!r} with a row of {cells!r} and columns {columns!r}")
    rows = [[row[table.header.index(name)] for name in names] for row in table.starting(start)]
    if kind == "table":
        numeric = ["---:" if all(re.match(r"[-–\d.]", row[i]) for row in rows) else "---" for i in range(len(names))]
        lines = [names, numeric, *rows]
        return "\n" + "".join(f"| {' | '.join(line)} |\n" for line in lines)
    if len(rows) != 1:
        raise ValueError(f"{source}: {len(rows)} rows; expected one")
    return rows[0][0]


def renewed(text: str) -> str:
    """Return a document with every quote as its report has it now."""

    def replaced(match: re.Match[str]) -> str:
        return f"<!-- {match['kind']}: {match['source']} -->{quoted(match['kind'], match['source'])}<!-- end -->"

    return QUOTE.sub(replaced, text)


def main() -> None:
    """Write the documents, or check them."""
    stale = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        if (new := renewed(text)) != text:
            stale.append(page.relative_to(ROOT).as_posix())
            if "--check" not in sys.argv[1:]:
                page.write_text(new, encoding="utf-8")
    if "--check" in sys.argv[1:] and stale:
        sys.exit(
            f"figures differ from their reports in {', '.join(stale)}: `make figures`, then read the text around them"
        )


if __name__ == "__main__":
    main()
