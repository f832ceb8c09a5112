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
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.record.appearance import Colours, attention_by_name
from harness.run.directory import Pair
from harness.run.records import FrameRecord
from harness.score.statistics import Codes
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
    exports = ", ".join(name for _, name in _EXPORT.findall(source))
    body = _EXPORT.sub(r"\1", _IMPORT.sub(r"const \1 = module_\2;", source))
    texts[name] = f"const module_{name} = (() => {{\n{body}return {{ {exports} }};\n}})();\n"


Bytes = NDArray[np.uint8]

SCALE = 250
"""Attention is stored in steps of 1 / SCALE; the run's tables have all digits."""
UNKNOWN = 255
"""Not measured, or no attention in this frame."""
PARTS = ("total", "gaze", "head")
MOST_BYTES = 3_000_000
"""Most bytes of the attention values of all clips in a page. If there are more, only every second or third frame has
values."""

Judged = dict[str, Sequence[Verdict]]
"""A subject's verdicts by configuration."""
Track = dict[str, dict[str, bytearray]]
"""A subject's attention by target, in the order of appearance: ``frames`` (int64), and a byte of each part for each."""


@dataclass(slots=True)
class AttentionPart:
    """The attention of each subject of one clip under one configuration, and all targets in order of appearance."""

    tracks: dict[str, Track] = field(default_factory=dict)
    targets: dict[str, None] = field(default_factory=dict)

    def take(self, record: FrameRecord) -> None:
        """Add the attention of each named subject of a record."""
        self.targets |= dict.fromkeys(target.name for target in record.targets)
        for person in dict.fromkeys(subject.name for subject in record.subjects if subject.name is not None):
            if (subject := find_subject(record, person)) is not None and subject.attention:
                track = self.tracks.setdefault(person, {})
                for target, value in attention_by_name(record, subject).items():
                    columns = track.setdefault(target, {name: bytearray() for name in ("frames", *PARTS)})
                    columns["frames"].extend(record.frame.to_bytes(8, "little"))
                    for name in PARTS:
                        columns[name].append(_byte(getattr(value, name)))


Attention = Mapping[Pair, AttentionPart]
"""The attention of a run by clip and configuration."""


def attended(attention: Attention, pair: Pair, subject: str) -> Track:
    """A subject's attention to the targets that got any; empty if there is none."""
    return {
        name: columns
        for name, columns in attention.get(pair, AttentionPart()).tracks.get(subject, {}).items()
        if any(0 < value < UNKNOWN for value in columns["total"])
    }


def target_colours(attention: Attention, clip: str) -> Colours:
    """The colours of a clip's targets, in order of appearance."""
    return Colours(name for (of, _), part in attention.items() if of == clip for name in part.targets)


def frames_of(judged: Judged) -> list[int]:
    """The numbers of all frames with a verdict, in order."""
    return sorted({verdict.frame for verdicts in judged.values() for verdict in verdicts})


def aligned(columns: Mapping[str, bytearray], frames: Codes) -> Bytes:
    """A target's values (:data:`PARTS`, frames) at these frames; :data:`UNKNOWN` if there are none."""
    own = np.frombuffer(columns["frames"], dtype="<i8")
    _, here, there = np.intersect1d(own, frames, assume_unique=True, return_indices=True)
    values = np.full((len(PARTS), len(frames)), UNKNOWN, dtype=np.uint8)
    values[:, there] = np.array([np.frombuffer(columns[name], dtype=np.uint8) for name in PARTS])[:, here]
    return values


def _byte(value: float | None) -> int:
    return UNKNOWN if value is None else min(max(round(SCALE * value), 0), SCALE)


def pack_attention(
    clips: Sequence[str], by_clip: Mapping[str, Mapping[str, Judged]], attention: Attention
) -> tuple[int, dict[str, str]]:
    """Pack the attention of every frame or, if that is too much, of every second, third ...: stride, packs by clip."""

    def packed(stride: int) -> dict[str, str]:
        values = {clip: _values(clip, by_clip.get(clip, {}), attention, stride) for clip in clips}
        return {clip: pack(content) if content else "" for clip, content in values.items()}

    whole = packed(1)
    stride = -(-sum(map(len, whole.values())) // MOST_BYTES)
    return (stride, packed(stride)) if stride > 1 else (1, whole)


def _values(clip: str, subjects: Mapping[str, Judged], attention: Attention, stride: int) -> bytes:
    """Totals, then gaze and head, of all timelines of a clip in the order of the page's data."""
    totals, cues = [], []
    for subject, judged in subjects.items():
        frames = np.array(frames_of(judged)[::stride])
        for configuration in judged:
            for columns in attended(attention, (clip, configuration), subject).values():
                total, gaze, head = aligned(columns, frames)
                totals.append(total.tobytes())
                cues += [gaze.tobytes(), head.tobytes()]
    return b"".join(totals + cues)
