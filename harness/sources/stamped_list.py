"""Lists of images with their times in TUM RGB-D's format: ``timestamp filename``, in seconds."""

from __future__ import annotations

from decimal import Decimal, InvalidOperation
from pathlib import Path

from harness.files import read_text
from vfoa.errors import VfoaError


def read_stamped_list(path: Path) -> dict[int, Path]:
    """Files by their time in ns, ascending; lines that begin with ``#`` are left out.

    Raises
    ------
    VfoaError
        If a line is of another form, or a time occurs twice.
    """
    found: dict[int, Path] = {}
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        text = line.strip()
        if not text or text.startswith("#"):
            continue
        time, _, name = text.partition(" ")
        try:
            stamp_ns = round(Decimal(time) * 10**9)
        except (InvalidOperation, ValueError, OverflowError):
            raise VfoaError(f"{path}:{number}: found {text!r}; expected a time in seconds and a file") from None
        if not name.strip():
            raise VfoaError(f"{path}:{number}: found {text!r}; expected a time in seconds and a file")
        if stamp_ns in found:
            raise VfoaError(f"{path}:{number}: the time {time} occurs twice")
        found[stamp_ns] = path.parent / name.strip()
    if not found:
        raise VfoaError(f"{path}: no images; expected lines of a time in seconds and a file")
    return dict(sorted(found.items()))
