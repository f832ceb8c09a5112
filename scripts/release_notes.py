"""Print the release notes of a version: its section of CHANGELOG.md.

Usage: ``python scripts/release_notes.py [VERSION]``; without one, the section "Unreleased".
"""

from __future__ import annotations

import sys
from pathlib import Path

CHANGELOG = Path(__file__).parent.parent / "CHANGELOG.md"


def release_notes(changelog: str, version: str) -> str:
    """The text below the heading of a version, up to the next version.

    Raises
    ------
    SystemExit
        If the changelog has no such heading.
    """
    sections: dict[str, list[str]] = {}
    current: list[str] = []
    for line in changelog.splitlines():
        if line.startswith("## "):
            name = line.removeprefix("## ").split(" - ")[0].strip("[] ")
            current = sections.setdefault(name, [])
        else:
            current.append(line)
    if version not in sections:
        raise SystemExit(f"{CHANGELOG.name}: no version {version!r}; found: {', '.join(sections)}")
    return "\n".join(sections[version]).strip()


if __name__ == "__main__":
    sys.stdout.write(release_notes(CHANGELOG.read_text(encoding="utf-8"), (sys.argv[1:] or ["Unreleased"])[0]) + "\n")
