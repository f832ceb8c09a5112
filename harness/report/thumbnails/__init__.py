"""Thumbnails for the report page: a small picture of each frame, and what each configuration found in it.

Every frame has one, right or wrong: labels that are edited later decide which of them the page shows, and the page is
then made without a clip or a model::

    thumbnails/<clip>/<frame>.webp                  the left image, made small, once for all configurations
    thumbnails/<clip>__<configuration>.jsonl        a line a frame: boxes, heads and cones in the picture's pixels

``writer.py`` writes them in a run; :func:`read_thumbnails` finds those of the wrong frames.
"""

from __future__ import annotations

import base64
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from vfoa.errors import VfoaError

FOLDER = "thumbnails"

Box = tuple[int, int, int, int]
"""Left, top, right, bottom in a picture's pixels."""
BUDGET_BYTES = 2_000_000
"""Most bytes of all thumbnails in a page on disk: with them, it stays under 3 MB."""
SERVED_BYTES = 20 * BUDGET_BYTES
"""Most bytes of those in a page that is served on the same machine."""
_PACKED = 4
"""How many times fewer bytes the marks of a frame take in a page, which packs them."""

_Frame = tuple[str, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class ThumbnailSubject:
    """A person in a picture. ``lines`` are a cue (``gaze``, ``head``) and the points x, y, x, y ... of each line."""

    name: str | None
    head: Box
    focus: int | None
    lines: list[tuple[str, list[int]]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Thumbnail:
    """The objects and people that one configuration saw in a frame; ``boxes`` are an instance's id, name and box."""

    frame: int
    size: tuple[int, int]
    boxes: list[tuple[int, str, Box]]
    subjects: list[ThumbnailSubject]


def picture_path(run: Path, clip: str, frame: int) -> Path:
    """The file of a frame's picture."""
    return run / FOLDER / clip / f"{frame}.webp"


def lines_path(run: Path, clip: str, configuration: str) -> Path:
    """The file of everything that a configuration saw in a clip."""
    return run / FOLDER / f"{clip}__{configuration}.jsonl"


@dataclass(frozen=True, slots=True, kw_only=True)
class Thumbnails:
    """The pictures and marks of the wrong frames that a page shows. ``pictures`` are data URIs by (clip, frame).

    ``seen`` holds each configuration's :class:`Thumbnail`, by (clip, configuration, frame); ``wrong`` counts the wrong
    frames that have a picture, of which a page may have room for fewer: a page on disk shows the files of the others.
    """

    pictures: Mapping[_Frame, str] = field(default_factory=dict)
    seen: Mapping[tuple[str, str, int], Thumbnail] = field(default_factory=dict)
    wrong: int = 0


def read_thumbnails(
    run: Path,
    wrong: Mapping[tuple[str, str], Collection[int]],
    names_now: Mapping[str, Mapping[str, str]] | None = None,
    budget: int = BUDGET_BYTES,
) -> Thumbnails:
    """Read the thumbnails of the frames in which somebody was judged wrong.

    ``wrong`` are these frames by clip and configuration. ``names_now`` are the present names of renamed targets, by
    clip and name in the thumbnails.

    If all of them take more than ``budget`` bytes, every second one is read, or every third ...: as many as fit. A run
    without thumbnails has none here.

    Raises
    ------
    VfoaError
        If one of their files cannot be read.
    """
    lines = {
        (*place, frame): line
        for place, frames in wrong.items()
        for frame, line in _lines(lines_path(run, *place))
        if frame in frames
    }
    sizes = _sizes(run, lines)
    chosen = _fitting(sizes, budget)
    return Thumbnails(
        pictures={frame: _data_uri(picture_path(run, *frame)) for frame in chosen},
        seen={
            (clip, configuration, frame): _renamed(
                _decode(line, lines_path(run, clip, configuration)), (names_now or {}).get(clip, {})
            )
            for (clip, configuration, frame), line in lines.items()
            if (clip, frame) in chosen
        },
        wrong=len(sizes),
    )


def _renamed(thumbnail: Thumbnail, names: Mapping[str, str]) -> Thumbnail:
    return replace(thumbnail, boxes=[(key, names.get(name, name), box) for key, name, box in thumbnail.boxes])


_LINE = re.compile(rb'\{"frame":(\d+),')


def _lines(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield frames and lines; only the frame is decoded, because decoding all lines takes longer than all else."""
    if path.is_file():
        with path.open("rb") as file:
            for line in file:
                if not (match := _LINE.match(line)):
                    raise VfoaError(f"{path}: not the thumbnails of a run: found a line without a frame")
                yield int(match[1]), line


def _sizes(run: Path, lines: Mapping[tuple[str, str, int], bytes]) -> dict[_Frame, int]:
    """The bytes that each frame with a picture takes in a page, in order."""
    texts = Counter[_Frame]()
    for (clip, _, frame), line in lines.items():
        texts[clip, frame] += len(line) // _PACKED
    sizes = {}
    for clip, frame in sorted(texts):
        with suppress(OSError):  # no picture
            sizes[clip, frame] = texts[clip, frame] + 4 * picture_path(run, clip, frame).stat().st_size // 3
    return sizes


def _fitting(sizes: Mapping[_Frame, int], budget: int) -> dict[_Frame, None]:
    frames, step = list(sizes), 1
    while sum(sizes[frame] for frame in frames[::step]) > budget and step < len(frames):
        step += 1
    return dict.fromkeys(frames[::step])


def _data_uri(path: Path) -> str:
    return f"data:image/webp;base64,{base64.b64encode(path.read_bytes()).decode()}"


def _decode(line: bytes, path: Path) -> Thumbnail:
    import msgspec

    try:
        return msgspec.json.decode(line, type=Thumbnail)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise VfoaError(f"{path}: not the thumbnails of a run: {error}") from None
