"""Every parser on files that are almost right: an answer, or one line that names the file, in bounded time and memory.

`make fuzz` tries many more. What once failed stays in ``corpus/PARSER/``; a file there is a test.
"""

from __future__ import annotations

import os
from pathlib import Path
from random import Random

import pytest

from tests.fuzz.cases import Finding, bounded, case_bytes, try_case
from tests.fuzz.parsers import PARSERS, Parser
from tests.fuzz.structured import change_tree
from vfoa.errors import VfoaError

SEED = 2026
KEPT = Path(__file__).with_name("corpus")
SECONDS = 60.0
"""Processor time of a case here, where machines are loaded; `make fuzz` gives 5."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.fixture(autouse=True)
def _no_waiting_for_disks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "fsync", lambda file: None)


@pytest.mark.parametrize("parser", PARSERS, ids=lambda each: each.name)
def test_a_parser_answers_or_says_in_one_line_what_is_wrong(parser: Parser, folder: Path) -> None:
    corpus = parser.corpus(folder / parser.folder / "whole")
    path = folder / parser.folder / "case" / parser.file_name
    path.parent.mkdir()
    for data in corpus:
        path.write_bytes(data)
        parser.read(path)  # a whole file is not refused
    found = {
        number: finding
        for number in range(len(corpus), parser.suite_cases)
        if (finding := try_case(parser, path, case_bytes(parser, corpus, SEED, number), SECONDS))
    }
    assert {number: finding.line for number, finding in found.items()} == {}, next(iter(found.values())).trace


@pytest.mark.parametrize("parser", PARSERS, ids=lambda each: each.name)
def test_what_once_failed_does_not_fail_again(parser: Parser, tmp_path: Path) -> None:
    kept = sorted((KEPT / parser.folder).glob("*"))
    found = {each.name: try_case(parser, tmp_path / parser.file_name, each.read_bytes(), SECONDS) for each in kept}
    assert {name: finding.line for name, finding in found.items() if finding} == {}


def test_every_kept_case_is_of_a_parser() -> None:
    assert {path.name for path in KEPT.iterdir()} <= {parser.folder for parser in PARSERS}
    assert len({parser.folder for parser in PARSERS}) == len(PARSERS)


def _tried(tmp_path: Path, read: object, seconds: float = SECONDS) -> Finding | None:
    parser = Parser("mine", "mine.txt", "text", lambda path: path.write_text("a"), read)  # type: ignore[arg-type]
    return try_case(parser, tmp_path / "mine.txt", b"a", seconds)


def test_what_counts_as_a_finding(tmp_path: Path) -> None:
    def refuse(path: Path) -> None:
        raise VfoaError(f"{path}: wrong")

    def refuse_without_a_name(path: Path) -> None:
        raise VfoaError("wrong")

    def fail(path: Path) -> None:
        raise KeyError("mine")

    def never_end(path: Path) -> None:
        while True:
            pass

    def take_everything(path: Path) -> int:
        return len(bytearray(1 << 44))

    assert _tried(tmp_path, Path.read_bytes) is None
    assert _tried(tmp_path, refuse) is None
    lines = [_tried(tmp_path, each, 0.2) for each in (refuse_without_a_name, fail, never_end, take_everything)]
    assert [finding and finding.line.partition(":")[0] for finding in lines] == [
        "a message without the file's name",
        "KeyError",
        "more than 0.2 s",
        "MemoryError",
    ]


def test_the_same_seed_gives_the_same_case_and_another_one_another(tmp_path: Path) -> None:
    (parser,) = (each for each in PARSERS if each.name == "manifest")
    corpus = parser.corpus(tmp_path)
    cases = [case_bytes(parser, corpus, SEED, number) for number in range(200)]
    assert cases == [case_bytes(parser, corpus, SEED, number) for number in range(200)]
    assert len(set(cases)) > 190
    assert cases != [case_bytes(parser, corpus, SEED + 1, number) for number in range(200)]


def test_trees_are_changed_at_every_place() -> None:
    seen = {str(change_tree(Random(seed), {"a": [1, {"b": 2}], "c": "d"})) for seed in range(300)}
    assert len(seen) > 100


def test_bounds_end_with_the_block() -> None:
    with bounded(60.0, 1 << 20), pytest.raises(MemoryError):
        bytearray(1 << 30)
    assert len(bytearray(1 << 30)) == 1 << 30
