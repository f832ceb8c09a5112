"""The worked examples of CONTRIBUTING.md, as source code."""

from __future__ import annotations

import re

from tests.repository import REPOSITORY


def example(heading: str) -> str:
    """The first Python block under a heading."""
    text = (REPOSITORY / "CONTRIBUTING.md").read_text(encoding="utf-8")
    section = text.split(f"\n## {heading}\n", 1)[1].split("\n## ", 1)[0]
    found = re.search(r"^```python\n(.*?)^```", section, re.DOTALL | re.MULTILINE)
    assert found, heading
    return found[1]
