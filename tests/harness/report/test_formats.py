from __future__ import annotations

import csv
import io

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from harness.files.safe_names import plain_cell
from harness.report.formats import Table, csv_cell, in_parts, to_csv, to_latex, to_markdown, to_rich

TABLE = Table(
    title="A_b & 5 %",
    columns=("Name", "n", "FRR %"),
    words=1,
    rows=(("sgbm_two|[x]", "50", "42–69"), ('a, "b" $1 \\ ~^<>{}#', "7", "–")),
    notes=("clip_one: *made* for 100 %.",),
)
printable = st.text(st.characters(blacklist_categories=("Cc", "Cs", "Zl", "Zp")), max_size=12)


@given(rows=st.lists(st.tuples(printable, printable), max_size=4))
def test_csv_is_read_back_as_it_was(rows: list[tuple[str, str]]) -> None:
    table = Table(title="", columns=("a", "b"), words=2, rows=tuple(rows))
    assert [tuple(row) for row in csv.reader(io.StringIO(to_csv(table)))] == [
        ("a", "b"),
        *(tuple(map(plain_cell, row)) for row in rows),
    ]


@given(text=st.text(st.characters(blacklist_categories=("Cs",)), min_size=1))
def test_a_cell_alone_is_read_back_as_it_was(text: str) -> None:
    assert list(csv.reader(io.StringIO(f"{csv_cell(text)},x\n", newline=""))) == [[plain_cell(text), "x"]]


def test_markdown_begins_with_what_the_table_is_and_its_notes() -> None:
    lines = to_markdown(TABLE).splitlines()
    assert lines[:4] == ["# A_b & 5 %", "", r"- clip_one: \*made\* for 100 %.", ""]
    assert lines[4].split() == ["|", "Name", "|", "n", "|", "FRR", "%", "|"]


def test_markdown_rows_have_as_many_cells_as_columns_whatever_they_hold() -> None:
    lines = [line for line in to_markdown(TABLE).splitlines() if line.startswith("|")]
    assert [line.replace(r"\|", "").count("|") for line in lines] == [4, 4, 4, 4]
    assert len({len(line) for line in lines}) == 1
    assert lines[1].endswith("-: |")


def test_an_empty_table_says_so() -> None:
    assert to_markdown(Table(title="<T>", columns=("a",), words=1, rows=())) == "# &lt;T>\n\nNothing to show.\n"


def test_latex_has_booktabs_rules_and_nothing_left_to_escape() -> None:
    text = to_latex(TABLE, label="tab:frr")
    assert [rule for rule in (r"\toprule", r"\midrule", r"\bottomrule") if text.count(rule) == 1] == [
        r"\toprule",
        r"\midrule",
        r"\bottomrule",
    ]
    assert r"\begin{tabular}{lrr}" in text
    assert r"{}sgbm\_two\textbar{}[x] & 50 & 42--69 \\" in text
    assert r"\$1 \textbackslash{} \textasciitilde{}\textasciicircum{}\textless{}\textgreater{}\{\}\#" in text
    assert r"\caption{A\_b \& 5 \%}" in text
    assert r"clip\_one: *made* for 100 \%.\par" in text


def test_latex_sets_groups_of_rows_apart() -> None:
    rows = (("a", "one", "1"), ("a", "two", "2"), ("b", "one", "3"))
    grouped = Table(title="T", columns=("Clip", "Name", "n"), words=2, rows=rows)
    body = to_latex(grouped, label="t").split(r"\midrule")[1].split(r"\bottomrule")[0].split()
    assert [word for word in body if word in (r"\addlinespace", "1", "2", "3")] == ["1", "2", r"\addlinespace", "3"]
    scattered = Table(title="T", columns=("Step", "n"), words=1, rows=(("a", "1"), ("b", "2"), ("a", "3")))
    assert "addlinespace" not in to_latex(scattered, label="t")


def test_a_terminal_never_cuts_a_number() -> None:
    long = Table(title="T", columns=("Name", "n"), words=1, rows=(("x" * 200, "1234567890"),))
    console = Console(width=40, file=io.StringIO(), color_system=None)
    console.print(to_rich(long))
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "1234567890" in text
    assert text.count("x") == 200
    assert max(map(len, text.splitlines())) <= 40


def test_mark_up_in_names_is_printed_not_obeyed() -> None:
    console = Console(width=80, file=io.StringIO(), color_system=None)
    console.print(to_rich(TABLE))
    assert "sgbm_two|[x]" in console.file.getvalue()  # type: ignore[attr-defined]


def test_every_row_has_a_cell_for_every_column() -> None:
    with pytest.raises(ValueError, match="expected 2 cells"):
        Table(title="T", columns=("a", "b"), words=1, rows=(("1",),))


@given(st.integers(40, 200), st.lists(st.text("x", min_size=1, max_size=30), max_size=12))
def test_a_table_is_no_wider_than_the_terminal_and_loses_nothing(width: int, numbers: list[str]) -> None:
    table = Table(
        title="t",
        columns=("name", *numbers),
        rows=(("a word or two", *(f"{i}" for i in range(len(numbers)))),),
        words=1,
    )
    parts = in_parts(table, width)
    assert [cell for part in parts for cell in part.rows[0][1:]] == [str(i) for i in range(len(numbers))]
    assert [name for part in parts for name in part.columns[1:]] == numbers
    assert parts[0].title == ("t" if len(parts) == 1 else f"t (part 1 of {len(parts)})")
    for part in parts:
        assert part.rows[0][0] == "a word or two"
        console = Console(width=width, file=io.StringIO())
        console.print(to_rich(part))
        printed = console.file.getvalue()
        assert all(column in printed for column in part.columns[1:])
        assert "a word" in printed
