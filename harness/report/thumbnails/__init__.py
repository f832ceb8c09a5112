"""Thumbnails for the report page: a small picture of each frame, and what each configuration found in it.

Every frame has one, right or wrong: labels that are edited later decide which of them the page shows, and the page is
then made without a clip or a model::

    thumbnails/<clip>/<frame>.webp                  the left image, made small, once for all configurations
    thumbnails/<clip>__<configuration>.jsonl        a line a frame: boxes, heads and cones in the picture's pixels

``writer.py`` is the observer that writes them in a run, ``reader.py`` finds those of the wrong frames.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

FOLDER = "thumbnails"

Box = tuple[int, int, int, int]
"""Left, top, right, bottom in a picture's pixels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ThumbnailSubject:
    """A person in a picture. ``lines`` are a cue (``gaze``, ``head``) and the x, y, x, y ... of a line each."""

    name: str | None
    head: Box
    focus: int | None
    lines: list[tuple[str, list[int]]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Thumbnail:
    """What one configuration saw in a frame. ``boxes`` are an instance's id, its name and its box each."""

    frame: int
    size: tuple[int, int]
    boxes: list[tuple[int, str, Box]]
    subjects: list[ThumbnailSubject]


def picture_path(run: Path, clip: str, frame: int) -> Path:
    """The picture of a frame."""
    return run / FOLDER / clip / f"{frame}.webp"


def lines_path(run: Path, clip: str, configuration: str) -> Path:
    """What a configuration saw in a clip."""
    return run / FOLDER / f"{clip}__{configuration}.jsonl"
