"""A run's ``frr.md`` without the rows of single clips, for reports of many clips.

python -m scripts.rows_of_all runs/people > reports/people.md
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from pathlib import Path


def rows_of_all(lines: Iterable[str]) -> Iterator[str]:
    """Yield the lines of a report; of a table by clip, only the rows over all clips. Tables by subject are left out."""
    by_clip = by_subject = False
    for line in lines:
        if line.startswith("#"):
            by_subject = "by subject" in line
        if by_subject:
            continue
        if line.startswith("| Clip "):
            by_clip = True
        elif not line.startswith("|"):
            by_clip = False
        if not by_clip or line.startswith(("| Clip ", "| ---", "| (all) ")):
            yield line


if __name__ == "__main__":
    text = (Path(sys.argv[1]) / "frr.md").read_text(encoding="utf-8")
    sys.stdout.writelines(f"{line}\n" for line in rows_of_all(text.splitlines()))
