"""The one error a user can mend."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class VfoaError(Exception):
    """Bad input. The message is one line: the file, key, row or topic, what was found, what was expected.

    The command line prints it and exits with 2. Any other exception is a bug and keeps its traceback.
    """


def did_you_mean(found: str, expected: Iterable[str]) -> str:
    """Say what was expected instead of ``found``, the nearest name first: ``"; did you mean 'sgbm'? ..."``."""
    names = sorted(expected)
    near = difflib.get_close_matches(found, names, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return f"{hint}expected one of: {', '.join(names) or '(none)'}"
