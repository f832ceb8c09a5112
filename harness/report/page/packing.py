"""Packing of the page's data and script: packs of compact text, and JavaScript modules as one script.

A pack is zlib data in base64. ``store.js`` decodes it when the page shows it. Modules are bundled, because a page that
is opened from disk cannot load any.

The attention of every named subject over the frames is kept small: a byte for each value.
"""

from __future__ import annotations

import base64
import json
import re
import zlib
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.record.appearance import Colours, attention_by_name
from harness.run.records import AttentionRecord, FrameRecord
from harness.score.verdicts import Verdict, find_subject

_IMPORT = re.compile(r'^import (\{[^}]*\}) from "\./(\w+)\.js";$', re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?(?:const|function) (\w+))", re.MULTILINE)


def pack(content: bytes) -> str:
    """Compress bytes to text for a page; the same bytes give the same text.

    The timelines of an hour take 15 times as long at the highest level, and are a tenth smaller.
    """
    return base64.b64encode(zlib.compress(content)).decode()


def pack_json(value: object) -> str:
    """A value of plain types as a pack of its JSON."""
    return pack(json.dumps(value, separators=(",", ":"), ensure_ascii=False).encode())


def runs(values: Iterable[int]) -> list[int]:
    """Run-length code: each value and its number of repetitions, ``[value, count, value, count, ...]``."""
    array = np.fromiter(values, dtype=np.int64)
    begins = np.flatnonzero(np.diff(array, prepend=array[:1] - 1))
    lengths = np.diff(begins, append=len(array))
    return np.stack([array[begins], lengths], axis=1).ravel().tolist()


def steps(numbers: Iterable[int]) -> list[int]:
    """Increasing numbers as the first one and the run-length code of the differences."""
    numbers = list(numbers)
    if not numbers:
        return []
    return [numbers[0], *runs(after - before for before, after in pairwise(numbers))]


def bundle(entry: Path) -> str:
    """Join a module and everything that it imports, each module once and before its importers.

    A module imports names from ``./NAME.js`` and exports constants and functions. Each becomes a function of its own
    that returns its exports, so that two modules may use one name for different things.
    """
    texts: dict[str, str] = {}
    _add(entry.parent, entry.stem, texts, set())
    return '"use strict";\n(() => {\n' + "\n".join(texts.values()) + "})();\n"


def _add(folder: Path, name: str, texts: dict[str, str], begun: set[str]) -> None:
    begun.add(name)
    source = (folder / f"{name}.js").read_text(encoding="utf-8")
    for _, needed in _IMPORT.findall(source):
        if needed not in begun:
            _add(folder, needed, texts, begun)
    exports = ", ".join(found for _, found in _EXPORT.findall(source))
    body = _EXPORT.sub(r"\1", _IMPORT.sub(r"const \1 = module_\2;", source))
    texts[name] = f"const module_{name} = (() => {{\n{body}return {{ {exports} }};\n}})();\n"


Bytes = NDArray[np.uint8]

SCALE = 250
"""Attention is stored in steps of 1 / SCALE; ``frames.csv`` has more digits."""
UNKNOWN = 255
"""Not measured, or no attention in this frame."""
PARTS = ("total", "gaze", "head")
MOST_BYTES = 3_000_000
"""Most bytes of the attention values of all clips in a page. If there are more, only every second or third frame has
values."""

TrackPart = tuple[list[int], dict[str, list[bytes]]]
"""Frames, and by target the bytes of each part."""
Judged = dict[str, list[Verdict]]
"""A subject's verdicts by configuration."""


@dataclass(slots=True)
class AttentionTrack:
    """One subject's attention in one clip under one configuration: a row per frame, a column per target and part."""

    frames: array[int] = field(default_factory=lambda: array("q"))
    columns: dict[str, tuple[bytearray, bytearray, bytearray]] = field(default_factory=dict)

    def append(self, frame: int, values: Mapping[str, AttentionRecord]) -> None:
        """Add a frame."""
        columns = {name: [bytes([_byte(getattr(value, part))]) for part in PARTS] for name, value in values.items()}
        self.extend([frame], columns)

    def extend(self, frames: Sequence[int], columns: Mapping[str, Sequence[bytes]]) -> None:
        """Add frames; ``columns`` are the bytes of each part, by target."""
        for name in [each for each in columns if each not in self.columns]:
            self.columns[name] = tuple(bytearray([UNKNOWN]) * len(self.frames) for _ in PARTS)  # type: ignore[assignment]
        self.frames.extend(frames)
        unknown = (bytes([UNKNOWN]) * len(frames),) * len(PARTS)
        for name, column in self.columns.items():
            for cells, more in zip(column, columns.get(name, unknown), strict=True):
                cells.extend(more)

    def attended(self) -> list[str]:
        """The targets that got any attention, in order of appearance."""
        return [name for name, (total, _, _) in self.columns.items() if any(0 < each < UNKNOWN for each in total)]

    def aligned(self, name: str, frames: Sequence[int]) -> Bytes:
        """A target's values (parts, frames) at these frames; :data:`UNKNOWN` if there are none."""
        place = {frame: i for i, frame in enumerate(self.frames)}
        rows = np.array([place.get(frame, -1) for frame in frames], dtype=np.intp)
        values = np.array([np.frombuffer(cells, dtype=np.uint8) for cells in self.columns[name]])
        return np.where(rows >= 0, values[:, rows], UNKNOWN).astype(np.uint8)


class AttentionLog:
    """Collects every named subject's attention from passing records: see :meth:`watch`."""

    def __init__(self) -> None:
        self._tracks: dict[tuple[str, str, str], AttentionTrack] = {}
        self._colours: dict[str, Colours] = {}

    def watch(self, records: Iterable[FrameRecord]) -> Iterator[FrameRecord]:
        """Yield the records unchanged and keep the attention of each named subject, by the target's name."""
        for record in records:
            colours = self._colours.setdefault(record.clip, Colours(()))
            for target in record.targets:
                colours.class_of(target.name)
            for name in dict.fromkeys(subject.name for subject in record.subjects if subject.name is not None):
                if (found := find_subject(record, name)) is not None and found.attention:
                    key = record.clip, record.configuration, name
                    self._tracks.setdefault(key, AttentionTrack()).append(
                        record.frame, attention_by_name(record, found)
                    )
            yield record

    def part(self) -> tuple[dict[str, TrackPart], list[str]]:
        """Each subject's attention so far, and the targets in the order of their colours, for another log."""
        tracks = {
            subject: (track.frames.tolist(), {name: list(map(bytes, cells)) for name, cells in track.columns.items()})
            for (_, _, subject), track in self._tracks.items()
        }
        return tracks, [name for colours in self._colours.values() for name in colours.known]

    def add(self, clip: str, configuration: str, tracks: Mapping[str, TrackPart], known: Iterable[str]) -> None:
        """Add another log's attention of one configuration on one clip."""
        colours = self._colours.setdefault(clip, Colours(()))
        for target in known:
            colours.class_of(target)
        for subject, (frames, columns) in tracks.items():
            self._tracks.setdefault((clip, configuration, subject), AttentionTrack()).extend(frames, columns)

    def track(self, clip: str, configuration: str, subject: str) -> AttentionTrack:
        """A subject's attention; without columns if there is none."""
        return self._tracks.get((clip, configuration, subject), AttentionTrack())

    def colours(self, clip: str) -> Colours:
        """The colours of a clip's targets, in order of appearance."""
        return self._colours.setdefault(clip, Colours(()))


def _byte(value: float | None) -> int:
    return UNKNOWN if value is None else min(max(round(SCALE * value), 0), SCALE)


@dataclass(frozen=True, slots=True)
class PackedAttention:
    """Packs of attention by clip, with the values of every ``stride`` frames."""

    stride: int
    has_cues: bool
    packs: Mapping[str, str]


def pack_attention(
    clips: Sequence[str], by_clip: Mapping[str, Mapping[str, Judged]], attention: AttentionLog
) -> PackedAttention:
    """Pack as much of the attention as fits: totals of every frame or every second, third ..., then gaze and head."""
    parts = {clip: _values(clip, by_clip.get(clip, {}), attention, 1) for clip in clips}
    whole = {clip: pack(totals + cues) for clip, (totals, cues) in parts.items()}
    if sum(map(len, whole.values())) <= MOST_BYTES:
        return PackedAttention(1, True, {clip: text if parts[clip][0] else "" for clip, text in whole.items()})
    totals = {clip: pack(each) if each else "" for clip, (each, _) in parts.items()}
    stride = -(-sum(map(len, totals.values())) // MOST_BYTES)
    if stride > 1:
        thinned = {clip: _values(clip, by_clip.get(clip, {}), attention, stride)[0] for clip in clips}
        totals = {clip: pack(each) if each else "" for clip, each in thinned.items()}
    return PackedAttention(stride, False, totals)


def _values(clip: str, subjects: Mapping[str, Judged], attention: AttentionLog, stride: int) -> tuple[bytes, bytes]:
    """Totals, and gaze and head, of all timelines of a clip in the order of the page's data."""
    totals, cues = [], []
    for subject, judged in subjects.items():
        frames = sorted({verdict.frame for each in judged.values() for verdict in each})[::stride]
        for configuration in judged:
            track = attention.track(clip, configuration, subject)
            for name in track.attended():
                total, *others = track.aligned(name, frames)
                totals.append(total.tobytes())
                cues += [each.tobytes() for each in others]
    return b"".join(totals), b"".join(cues)
