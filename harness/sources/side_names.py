"""Names that differ only in the side: left and right, l and r, aloeL and aloeR, cam0 and cam1, I1_ and I2_."""

from __future__ import annotations

import glob
import re
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

_WORD = re.compile(r"left|right", re.IGNORECASE)
_LETTER = re.compile(r"(?<![A-Za-z])[lr](?![A-Za-z])", re.IGNORECASE)
_SUFFIX = re.compile(r"(?<=[a-z0-9])[LR](?![A-Za-z])")
_CAMERA = re.compile(
    r"(?<![A-Za-z])(?:camera|cam|image|img|im|i|infra|view|sensor|video)[_-]?(\d{1,2})(?!\d)", re.IGNORECASE
)
_NUMBERED_VIEW = re.compile(r"(im|view)(\d+)(\.[^.]+)")
_DIGITS = re.compile(r"\d+")

_NUMBERED_VIEWS = (("im", (0, 1), 1), ("im", (2, 6), 8), ("view", (1, 5), 6))
"""Middlebury's pairs: the word, the numbers of left and right, and the greatest number beside them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sides:
    """Globs of two sides, and the names that each of them matches."""

    left: str
    right: str
    left_names: tuple[str, ...]
    right_names: tuple[str, ...]


def pair_names(names: Iterable[str], *, numbered: bool) -> tuple[Sides, ...]:
    """Return every way to find two sides in names (of files, or paths of folders), most pairs first.

    ``numbered``: runs of digits beside the side may differ within a side (frame numbers) and are ``*`` in the globs.
    Cameras are paired as (0, 1), (2, 3), or as (1, 2) if there is no 0.
    """
    ways: defaultdict[tuple[str, str, str], defaultdict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    for name in sorted(names):
        for start, end, way in _sides_in(name):
            before, after = (_globbed(part, numbered) for part in (name[:start], name[end:]))
            if way == "camera" and numbered and "*" not in before + after:
                continue  # image_1, image_2 ...: a sequence, not a pair of cameras
            ways[way, before, after][name[start:end]].add(name)
    found = [pair for key, sides in ways.items() for pair in _pairs(key, sides)]
    return tuple(sorted(found, key=lambda pair: -min(len(pair.left_names), len(pair.right_names))))


def numbered_views(names: Iterable[str]) -> tuple[tuple[str, str], ...]:
    """Middlebury's pairs among the files of one folder: im0 and im1, im2 and im6, view1 and view5.

    A folder that also holds the word with a greater number is a sequence.
    """
    by_word: defaultdict[tuple[str, str], dict[int, str]] = defaultdict(dict)
    for name in names:
        if match := _NUMBERED_VIEW.fullmatch(name):
            by_word[match[1], match[3]][int(match[2])] = name
    return tuple(
        (files[left], files[right])
        for (word, _), files in by_word.items()
        for wanted, (left, right), last in _NUMBERED_VIEWS
        if word == wanted and {left, right} <= files.keys() and max(files) <= last
    )


def _sides_in(name: str) -> Iterable[tuple[int, int, str]]:
    ways = (("word", _WORD, 0), ("letter", _LETTER, 0), ("letter", _SUFFIX, 0), ("camera", _CAMERA, 1))
    for way, pattern, group in ways:
        for match in pattern.finditer(name):
            yield match.start(group), match.end(group), way


def _pairs(key: tuple[str, str, str], sides: dict[str, set[str]]) -> Iterable[Sides]:
    way, before, after = key
    for side in sorted(sides):
        other = _opposite(way, side, sides)
        if other in sides:
            yield Sides(
                left=f"{before}{side}{after}",
                right=f"{before}{other}{after}",
                left_names=tuple(sorted(sides[side])),
                right_names=tuple(sorted(sides[other])),
            )


def _opposite(way: str, side: str, sides: dict[str, set[str]]) -> str | None:
    """The right side's word for a left side's, None for a right side."""
    if way == "camera":
        number = int(side)
        is_left = number % 2 == 0 or f"{number - 1:0{len(side)}d}" not in sides
        return f"{number + 1:0{len(side)}d}" if is_left else None
    words = {"left": "right", "Left": "Right", "LEFT": "RIGHT", "l": "r", "L": "R"}
    return words.get(side)


def _globbed(part: str, numbered: bool) -> str:
    return _DIGITS.sub("*", glob.escape(part)) if numbered else part
