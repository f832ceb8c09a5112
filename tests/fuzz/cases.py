"""One case of a parser: a mutated file, read within bounds of time and memory, and what became of it."""

from __future__ import annotations

import resource
import signal
import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from random import Random
from types import FrameType

from tests.fuzz.mutations import mutate
from tests.fuzz.parsers import Parser
from vfoa.errors import VfoaError

SECONDS = 5.0
"""Processor time that a case may take."""
MEMORY_BYTES = 1 << 30
"""Memory that a case may take in addition to that of the process."""


class TooSlowError(BaseException):
    """Out of time. No Exception, so that no parser catches it."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A finding about a parser: the error in one line, its place, and the whole traceback."""

    line: str
    where: str
    trace: str = ""


def case_bytes(parser: Parser, corpus: Sequence[bytes], seed: int, number: int) -> bytes:
    """The file of one case: the first ones are the corpus itself."""
    if number < len(corpus):
        return corpus[number]
    rng = Random(f"{seed}/{parser.name}/{number}")
    return mutate(rng, rng.choice(corpus), corpus, parser.kind)


def try_case(parser: Parser, path: Path, data: bytes, seconds: float = SECONDS) -> Finding | None:
    """Write a case and read it; None where the parser answers, or says in one line what is wrong with the file."""
    path.write_bytes(data)
    try:
        with bounded(seconds, MEMORY_BYTES):
            parser.read(path)
    except VfoaError as error:
        return _judge(parser, path, str(error))
    except TooSlowError as error:
        return Finding(f"more than {seconds:g} s", _innermost(error), traceback.format_exc())
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        text = str(error).splitlines() or [""]
        return Finding(f"{type(error).__name__}: {text[0][:200]}", _innermost(error), traceback.format_exc())
    return None


def _judge(parser: Parser, path: Path, message: str) -> Finding | None:
    if "\n" in message or "\r" in message:
        return Finding("a message of several lines", "message", message)
    if len(message) > 4000:
        return Finding("a message of more than 4000 characters", "message", message)
    if parser.names_file and path.name not in message:
        return Finding("a message without the file's name", "message", message)
    return None


def _innermost(error: BaseException) -> str:
    """The last place of the trace that is in the project; what is grouped as one finding."""
    places = [
        f"{Path(each.filename).name}:{each.name}"
        for each in traceback.extract_tb(error.__traceback__)
        if "/harness/" in each.filename or "/vfoa/" in each.filename
    ]
    return places[-1] if places else "outside"


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
