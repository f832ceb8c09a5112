"""Errors with a message of one line."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager


class VfoaError(Exception):
    """Bad input. The message is one line: the file, key, row or topic, what was found, what was expected.

    The command line prints it and exits with 2. Any other exception is a bug and keeps its traceback. A message may
    quote a file or a library: line ends and control characters are escaped, and a long message is shortened in the
    middle.
    """

    def __init__(self, line: str) -> None:
        super().__init__(_one_line(line))


@contextmanager
def located(where: object) -> Iterator[None]:
    """Begin the messages of errors in the block with a place: a file, a frame."""
    try:
        yield
    except VfoaError as error:
        raise VfoaError(f"{where}: {error}") from None


@contextmanager
def reported_as(problem: object) -> Iterator[None]:
    """Turn errors of libraries in the block into a :class:`VfoaError`: the problem, then the error's first line."""
    try:
        yield
    except VfoaError:
        raise
    except Exception as error:
        raise VfoaError(f"{problem}: {first_line(error)}") from None


def first_line(error: Exception) -> str:
    """An error's text in one line; its kind if it has no text."""
    return (str(error) or type(error).__name__).splitlines()[0]


_LONGEST = 2000
"""Most characters of a message."""


def _one_line(text: str) -> str:
    if not text.isprintable():
        text = "".join(
            character if character.isprintable() else character.encode("unicode_escape").decode() for character in text
        )
    half = _LONGEST // 2
    return text if len(text) <= _LONGEST else f"{text[:half]} [...] {text[-half:]}"


class StageError(VfoaError):
    """A stage raised an exception that is no :class:`VfoaError`: a bug, no memory, or a file that cannot be opened.

    ``trace`` is the whole traceback; ``frame`` is the number of the frame, None while it is not known.
    """

    def __init__(self, line: str, trace: str = "") -> None:  # pickle gives the line alone, then sets the rest
        super().__init__(line)
        self.trace = trace
        self.frame: int | None = None

    def __str__(self) -> str:
        return super().__str__() if self.frame is None else f"frame {self.frame}: {super().__str__()}"


def check_known(name: object, known: Collection[object], problem: str) -> None:
    """Raise a :class:`VfoaError` if a name is not known: ``"<problem> 'sgmb'; did you mean 'sgbm'? ..."``."""
    if name not in known:
        raise VfoaError(f"{problem} {name!r}; {did_you_mean(str(name), map(str, known))}")


def did_you_mean(name: str, expected: Iterable[str]) -> str:
    """Return what was expected instead of ``name``, the nearest name first: ``"did you mean 'sgbm'? ..."``.

    Capitals do not count: ``CUP`` is near ``cup``.
    """
    names = sorted({*expected})
    by_folded = {each.casefold(): each for each in reversed(names)}
    near = difflib.get_close_matches(name.casefold(), by_folded, n=1)
    hint = f"did you mean {by_folded[near[0]]!r}? " if near else ""
    return f"{hint}expected one of: {listed(names) or '(none)'}"


def counted(n: int, what: str) -> str:
    """A number and its noun, which gets an s: ``"1 frame"``, ``"2 frames"``."""
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def listed(names: Sequence[str], most: int = 40) -> str:
    """Names for a message, with commas; of more than ``most`` the first ones, and the number of the others."""
    more = len(names) - most
    return ", ".join(names) if more <= 0 else f"{', '.join(names[:most])} and {more} more"
