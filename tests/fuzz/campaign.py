"""Fuzzing in parallel: many cases of every parser, and a table of what was found.

    python -m tests.fuzz.campaign --cases 100000 [--seed 1] [--workers 2] [--only manifest] [--keep FOLDER]

One process for each parser. A case that ends its process, or hangs where no alarm reaches, is a finding, too: the
process that began it is started again behind that case. ``--keep`` stores the file of the first case of each finding.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from tests.fuzz.cases import SECONDS, case_bytes, try_case
from tests.fuzz.parsers import PARSERS, Parser

BATCH = 50
"""Cases between two signs of life."""
SILENCE_SECONDS = 120.0 + BATCH * SECONDS
"""A process that says nothing for so long hangs in a library."""


_FORK = multiprocessing.get_context("fork")
"""Forked processes, which have the parsers' imports already and start fast. No parser runs in the parent."""


@dataclass
class Outcome:
    """The results of one parser's cases: findings by place and line, each with its first case and their number."""

    parser: Parser
    cases: int = 0
    seconds: float = 0.0
    first: dict[str, tuple[int, str]] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)

    def add(self, where: str, number: int, line: str) -> None:
        """Count a finding."""
        self.first.setdefault(where, (number, line))
        self.counts[where] += 1


def fuzz(parser: Parser, cases: int, seed: int, until: float = float("inf")) -> Outcome:
    """All cases of one parser, in processes of their own."""
    outcome, begun = Outcome(parser), time.monotonic()
    while outcome.cases < cases and time.time() < until:
        receiver, sender = _FORK.Pipe(duplex=False)
        process = _FORK.Process(target=_work, args=(sender, parser.name, outcome.cases, cases, seed, until))
        process.start()
        sender.close()
        current = _listen(receiver, outcome)
        process.kill() if process.is_alive() and current is not None else None
        process.join()
        if current is None:
            break
        code = process.exitcode or 0
        line = f"the process ended by signal {-code}" if code < 0 else f"exit {code}, or a hang"
        outcome.add("process", current, line)
        outcome.cases = current + 1
    outcome.seconds = time.monotonic() - begun
    return outcome


def _listen(receiver: Connection, outcome: Outcome) -> int | None:
    """Take in what a process says; the case it was at if it ended before all were tried."""
    current = outcome.cases
    try:
        while receiver.poll(SILENCE_SECONDS):
            kind, *rest = receiver.recv()
            if kind == "finding":
                number, where, line = rest
                outcome.add(where, number, line)
            elif kind == "done":
                outcome.cases = rest[0]
                return None
            else:
                current, outcome.cases = rest[0], rest[0]
    except EOFError:
        pass
    return current


def _work(sender: Connection, name: str, first: int, last: int, seed: int, until: float) -> None:
    parser = next(each for each in PARSERS if each.name == name)
    os.environ["OPENCV_LOG_LEVEL"] = "SILENT"
    devnull = os.open(os.devnull, os.O_WRONLY)
    warnings.simplefilter("error")  # a warning is a line more than the one that is promised
    os.dup2(devnull, 1), os.dup2(devnull, 2)
    os.fsync = lambda file: None  # type: ignore[assignment]  # thousands of small files that nobody keeps
    with tempfile.TemporaryDirectory(dir="/dev/shm" if os.path.isdir("/dev/shm") else None) as folder:
        corpus = parser.corpus(Path(folder, "corpus"))
        path = Path(folder, "case", parser.file_name)
        path.parent.mkdir()
        for data in corpus:
            try_case(parser, path, data, 60.0)  # imports what is imported late
        for number in range(first, last):
            if time.time() > until:
                last = number
                break
            sender.send(("at", number))
            found = try_case(parser, path, case_bytes(parser, corpus, seed, number))
            if found is not None:
                sender.send(("finding", number, f"{found.where}: {found.line.partition(':')[0]}", found.line))
        sender.send(("done", last))


def table(outcomes: Sequence[Outcome], seed: int) -> str:
    """Parser x cases x findings, in Markdown, and every finding below."""
    rows = [f"Seed {seed}.", "", "| Parser | Cases | Findings | Cases with one | s |", "|---|---:|---:|---:|---:|"]
    rows += [
        f"| {each.parser.name} | {each.cases} | {len(each.first)} | {sum(each.counts.values())} | {each.seconds:.0f} |"
        for each in outcomes
    ]
    total = sum(each.cases for each in outcomes)
    rows += [f"| **{len(outcomes)} parsers** | **{total}** | **{sum(len(each.first) for each in outcomes)}** | | |", ""]
    rows += [line for each in outcomes for line in _findings(each)]
    return "\n".join(rows)


def _findings(outcome: Outcome) -> list[str]:
    return [
        f"- {outcome.parser.name}, case {number}, {outcome.counts[where]} times, {where}: {line}"
        for where, (number, line) in outcome.first.items()
    ]


def keep(outcomes: Sequence[Outcome], seed: int, folder: Path) -> None:
    """Store the file of the first case of each finding: FOLDER/PARSER/SEED-CASE."""
    for each in outcomes:
        with tempfile.TemporaryDirectory() as place:
            corpus = each.parser.corpus(Path(place)) if each.first else []
            for number, _ in each.first.values():
                path = folder / each.parser.folder / f"{seed}-{number}"
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(case_bytes(each.parser, corpus, seed, number))


def main(words: Sequence[str] | None = None) -> int:
    """Run a campaign; 1 where something was found."""
    options = argparse.ArgumentParser(prog="python -m tests.fuzz.campaign")
    options.add_argument("--cases", type=int, default=int(os.environ.get("CASES", "100000")))
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    options.add_argument("--only", action="append", default=[], help="Name of a parser, or a part of one.")
    options.add_argument("--minutes", type=float, default=float("inf"), help="Begin no case later.")
    options.add_argument("--keep", type=Path)
    options.add_argument("--out", type=Path)
    given = options.parse_args(words)
    chosen = [each for each in PARSERS if not given.only or any(word in each.name for word in given.only)]
    until = time.time() + 60 * given.minutes

    def one(parser: Parser) -> Any:
        outcome = fuzz(parser, given.cases, given.seed, until)
        told = [f"{parser.name}: {outcome.cases} cases, {len(outcome.first)} findings", *_findings(outcome)]
        print("\n".join(told), file=sys.stderr)  # noqa: T201
        return outcome

    with ThreadPoolExecutor(given.workers) as pool:
        outcomes = list(pool.map(one, chosen))
    text = table(outcomes, given.seed)
    print(text)  # noqa: T201
    if given.out:
        given.out.write_text(text + "\n", encoding="utf-8")
    if given.keep:
        keep(outcomes, given.seed, given.keep)
    return int(any(each.first for each in outcomes))


if __name__ == "__main__":
    raise SystemExit(main())
