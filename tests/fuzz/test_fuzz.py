"""Every parser on files that are almost right: an answer, or one line that names the file, in bounded time and memory.

`make fuzz` tries many more. What once failed stays in ``corpus/PARSER/``; a file there is a test.
"""

from __future__ import annotations

import os
import resource
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import pytest
from hypothesis import HealthCheck, Phase, given, settings

from tests.fuzz.mutations import damaged
from tests.fuzz.parsers import PARSERS, Parser
from tests.fuzz.states import Read
from vfoa.errors import VfoaError

CASES = int(os.environ.get("VFOA_FUZZ_CASES", "0"))
"""Examples of each parser; 0: a few, always the same, as part of the suite."""
SECONDS = 5.0 if CASES else 60.0
"""Processor time of an example; the suite runs on loaded machines."""
MEMORY_BYTES = 1 << 30
"""Memory of an example, in addition to that of the process."""
LONGEST_MESSAGE = 4000
KEPT = Path(__file__).with_name("corpus")


class TooSlowError(BaseException):
    """Out of time. No Exception, so that no parser catches it."""


@contextmanager
def bounded(seconds: float, extra_bytes: int) -> Iterator[None]:
    """A block that ends with :class:`TooSlowError` or MemoryError rather than take more than that."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise TooSlowError

    limits = resource.getrlimit(resource.RLIMIT_AS)
    handler = signal.signal(signal.SIGPROF, stop)
    if sys.platform == "linux":
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + extra_bytes, limits[1]))
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, handler)
        resource.setrlimit(resource.RLIMIT_AS, limits)


def check(parser: Parser, path: Path, data: bytes, seconds: float = SECONDS) -> None:
    """Write an example and read it. After a failure, or the end of the process, the file is the one to keep."""
    path.write_bytes(data)
    try:
        with bounded(seconds, MEMORY_BYTES):
            parser.read(path)
    except VfoaError as error:
        message = str(error)
        assert len(message.splitlines()) == 1, message
        assert len(message) <= LONGEST_MESSAGE
        assert path.name in message or not parser.names_file, message
    except TooSlowError:
        pytest.fail(f"more than {seconds:g} s of processor time: {path}")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.mark.parametrize("parser", PARSERS, ids=lambda each: each.name)
def test_an_almost_right_file_is_read_or_refused_in_one_line(parser: Parser, folder: Path) -> None:
    whole = parser.corpus(folder / parser.folder / "made")
    path = folder / parser.folder / "case" / parser.file_name
    path.parent.mkdir()
    for data in whole:
        path.write_bytes(data)
        parser.read(path)  # a whole file is not refused

    @settings(
        max_examples=CASES or 10,
        derandomize=not CASES,
        database=None,
        phases=[Phase.generate, Phase.shrink],
        suppress_health_check=list(HealthCheck),
    )
    @given(damaged(whole, parser.kind))
    def almost_right(data: bytes) -> None:
        check(parser, path, data)

    almost_right()


@pytest.mark.parametrize(
    ("parser", "kept"),
    [(each, kept) for each in PARSERS for kept in sorted((KEPT / each.folder).glob("*"))],
    ids=lambda each: each.name,
)
def test_what_once_failed_does_not_fail_again(parser: Parser, kept: Path, tmp_path: Path) -> None:
    check(parser, tmp_path / parser.file_name, kept.read_bytes())


def test_every_kept_file_is_of_a_parser() -> None:
    assert {path.name for path in KEPT.iterdir()} <= {parser.folder for parser in PARSERS}
    assert len({parser.folder for parser in PARSERS}) == len(PARSERS)


def _refuse(path: Path) -> None:
    raise VfoaError(f"{path}: wrong")


def _refuse_without_a_name(path: Path) -> None:
    raise VfoaError("wrong")


def _fail(path: Path) -> None:
    raise KeyError("mine")


def _never_end(path: Path) -> None:
    while True:
        pass


def _take_everything(path: Path) -> int:
    return len(bytearray(1 << 44))


@pytest.mark.parametrize(
    ("read", "found"),
    [
        (_refuse_without_a_name, AssertionError),
        (_fail, KeyError),
        (_never_end, pytest.fail.Exception),
        (_take_everything, MemoryError),
    ],
)
def test_what_counts_as_a_finding(read: Read, found: type[BaseException], tmp_path: Path) -> None:
    path, before = tmp_path / "mine.txt", resource.getrlimit(resource.RLIMIT_AS)
    for harmless in (Path.read_bytes, _refuse):
        check(Parser("mine", path.name, "a", harmless), path, b"a")
    with pytest.raises(found):
        check(Parser("mine", path.name, "a", read), path, b"a", 0.2)
    assert (resource.getrlimit(resource.RLIMIT_AS), signal.getitimer(signal.ITIMER_PROF)) == (before, (0, 0))
