"""The states that a fault may leave files in: the old content, the new content, or a draft that nobody reads."""

from __future__ import annotations

import csv
import hashlib
import json
import tomllib
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

Snapshot = dict[str, bytes]
"""A file's content by its path in the project; of a large one its digest."""


def snapshot(folder: Path) -> Snapshot:
    """All files of a folder but those of the stage cache, which has checksums of its own."""
    return {
        path.relative_to(folder).as_posix(): _content(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and "stages" not in path.relative_to(folder).parts
    }


def _content(path: Path) -> bytes:
    data = path.read_bytes()
    return data if len(data) < 1 << 16 else hashlib.sha256(data).digest()


def is_draft(path: str) -> bool:
    """Whether a file is by its name none that is read: hidden, not finished, or of stamps of files left alone."""
    parts = PurePosixPath(path).parts
    return any(part.startswith(".") or part == "partial" for part in parts) or parts[-1].endswith(
        (".partial", ".tmp", ".lock", ".noted")
    )


def left_over(found: Iterable[str]) -> list[str]:
    """Files that are no drafts."""
    return [path for path in found if not is_draft(path)]


def what_is_wrong(folder: Path, before: Snapshot, after: Snapshot, varying: Iterable[str]) -> str:
    """The first file that is neither as it was nor as it is to be; empty where there is none."""
    found, differing = snapshot(folder), frozenset(varying)
    for path in before:
        if path in after and path not in found:
            return f"{path}: gone"
    for path, data in found.items():
        if is_draft(path) or data in (before.get(path), after.get(path)):
            continue
        if path not in after:
            return f"{path}: made, and is no file of the verb's"
        if path not in differing:
            return f"{path}: neither as it was nor as it is to be"
        if problem := unread(folder / path):
            return f"{path}: {problem}"
    return ""


def unread(path: Path) -> str:
    """Why a file that differs from run to run is not whole; empty where it is."""
    try:
        if path.suffix == ".json":
            json.loads(path.read_bytes())
        elif path.suffix == ".jsonl":
            [json.loads(line) for line in path.read_bytes().splitlines()]
        elif path.suffix == ".toml":
            tomllib.loads(path.read_text())
        elif path.suffix == ".csv":
            lines = path.read_text().splitlines(keepends=True)
            rows = lines[1:] if lines and lines[0].startswith("#") else lines  # without the line of the version
            widths = {len(row) for row in csv.reader(rows, strict=True)}
            if len(widths) != 1:
                return "rows of different widths"
        elif path.suffix == ".html" and not path.read_text().rstrip().endswith("</html>"):
            return "cut off"
    except ValueError as error:
        return f"cannot be read: {error}"
    return ""
