"""The worked examples of CONTRIBUTING.md as files, for the linter and the type checker of ``make check``."""

from __future__ import annotations

import re
import sys
from pathlib import Path

HEADINGS = ("A method of attention", "A metric", "A panel of the report", "An entity in the recording")


def example(heading: str) -> str:
    """Return the first Python block under a heading.

    Raises
    ------
    ValueError
        If there is none.
    """
    text = (Path(__file__).parent.parent / "CONTRIBUTING.md").read_text(encoding="utf-8")
    _, _, section = text.partition(f"\n## {heading}\n")
    found = re.search(r"^```python\n(.*?)^```", section.partition("\n## ")[0], re.DOTALL | re.MULTILINE)
    if not found:
        raise ValueError(f"CONTRIBUTING.md: no example under {heading!r}")
    return found[1]


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for title in HEADINGS:
        (folder / f"{title.rpartition(' ')[2]}.py").write_text(example(title), encoding="utf-8")
