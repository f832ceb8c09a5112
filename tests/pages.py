"""Pages that show commands and what these print."""

from __future__ import annotations

import re
from collections.abc import Iterator

BLOCK = re.compile(r"^```(?P<kind>\w*)(?: title=\"(?P<title>[^\"]+)\")?\n(?P<text>.*?)^```", re.MULTILINE | re.DOTALL)
"""A block of a page; one with a title is a file."""


def steps(page: str) -> Iterator[tuple[str, str]]:
    """The commands of a page's blocks, each with the output printed below it.

    A block below ``<!-- not executed: REASON -->`` is left out.
    """
    for block in re.finditer(
        r"^(<!-- not executed:.*?-->\n+)?```(?:console)?\n(.*?)^```", page, re.MULTILINE | re.DOTALL
    ):
        if block[1] is None:
            for step in re.split(r"^\$ ", block[2], flags=re.MULTILINE)[1:]:
                command, _, expected = step.partition("\n")
                yield command, expected


def parts(page: str) -> Iterator[tuple[str, tuple[str, str] | None]]:
    """The page in parts that end where it shows a file: each with the file's name and text, the last part with None."""
    begin = 0
    for block in BLOCK.finditer(page):
        if block["title"]:
            yield page[begin : block.start()], (block["title"], block["text"])
            begin = block.end()
    yield page[begin:], None


def shape(text: str) -> list[list[str]]:
    """The words of each line, every number and token as ``0`` and every rule left out."""
    lines = [re.sub(r"token=\S+|[+-]?\d[\d.,]*", "0", line).split() for line in text.splitlines()]
    return [words for words in lines if words and not re.fullmatch(r"[─-]+", words[0])]


def is_shown_by(printed: str, expected: str) -> bool:
    """Whether a page shows what was printed, apart from numbers and line breaks; ``...`` stands for any lines."""
    parts = re.split(r"^\.\.\.$", expected, flags=re.MULTILINE)
    pattern = r".*".join(re.escape(_flat(part)) for part in parts)
    return re.fullmatch(pattern, _flat(printed), re.DOTALL) is not None


def _flat(text: str) -> str:
    return "".join(f"{word} " for line in shape(text) for word in line)


_RATES = re.compile(r"^ \S+ +\d+ +\d+\.\d .*$", re.MULTILINE)


def rates(text: str) -> list[float | str]:
    """The cells of the rows of tables of rates (name, n, FRR %, ...), for ``pytest.approx``."""
    cells = [cell for row in _RATES.findall(text) for cell in row.split()]
    return [float(cell) if re.fullmatch(r"[\d.]+", cell) else cell for cell in cells]
