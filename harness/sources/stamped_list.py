"""Lists of images with their times in TUM RGB-D's format: ``timestamp filename``, in seconds.

``associations.txt``, which TUM's ``associate.py`` writes, has both images of a frame in a line::

    1305031102.175304 rgb/1305031102.175304.png 1305031102.160407 depth/1305031102.160407.png
"""

from __future__ import annotations

from decimal import Decimal, InvalidOperation
from pathlib import Path

from harness.files.io import read_text
from vfoa.errors import VfoaError


def read_stamped_list(path: Path, word: str = "") -> dict[int, Path]:
    """Files by their time in ns, ascending; lines that begin with ``#`` are left out.

    ``word``: of lines with two images, take the one whose path has this word, or the other one if neither has it.

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
        cells = text.split()
        if len(cells) == 4 and word:  # ICL-NUIM has depth first
            cells = max(cells[:2], cells[2:], key=lambda pair: word in pair[1].lower())
        time, name = cells[0], text.partition(" ")[2].strip() if len(cells) != 2 else cells[1]
        try:
            stamp_ns = round(Decimal(time) * 10**9)
        except (InvalidOperation, ValueError, OverflowError):
            raise VfoaError(f"{path}:{number}: found {text!r}; expected a time in seconds and a file") from None
        if not name:
            raise VfoaError(f"{path}:{number}: found {text!r}; expected a time in seconds and a file")
        if stamp_ns in found:
            raise VfoaError(f"{path}:{number}: the time {time} occurs twice")
        found[stamp_ns] = path.parent / name
    if not found:
        raise VfoaError(f"{path}: no images; expected lines of a time in seconds and a file")
    return dict(sorted(found.items()))
