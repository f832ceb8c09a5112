"""Reading recordings back: one line for one that is damaged, as one is that a run was killed in."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rerun.error_utils import RerunWarning

from vfoa.errors import VfoaError


@contextmanager
def reading(recording: Path) -> Iterator[None]:
    """Within the block, what Rerun's reader says against a recording is a :class:`VfoaError` that names it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RerunWarning)  # of a missing footer: what is read is whole, or an error
            yield
    except (RuntimeError, ValueError) as error:
        raise VfoaError(f"{recording}: not a whole recording: {str(error).splitlines()[0]}") from None
