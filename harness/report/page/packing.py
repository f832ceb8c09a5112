"""Packing of the page's data: packs of compact text, zlib data in base64. ``store.js`` decodes one when it is shown.

The attention of every named subject over the frames is kept small: a byte for each value.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from harness.labels.labels import NOWHERE
from harness.record.appearance import Colours
from harness.run.columns import UNKNOWN, PairColumns
from harness.run.directory import Pair
from harness.score.verdict_columns import SubjectVerdicts
from vfoa.types import CUES, Codes, Float


def pack(content: bytes) -> str:
    """Compress bytes to text for a page; the same bytes give the same text.

    The timelines of an hour take 15 times as long at the highest level, and are a tenth smaller.
    """
    return base64.b64encode(zlib.compress(content)).decode()


def pack_json(value: object) -> str:
    """A value of plain types as a pack of its JSON."""
    return pack(json.dumps(value, separators=(",", ":"), ensure_ascii=False).encode())


def runs(values: NDArray[np.integer]) -> list[int]:
    """Run-length code: each value and its number of repetitions, ``[value, count, value, count, ...]``."""
    begins = np.flatnonzero(np.diff(values, prepend=values[:1] - 1))
    lengths = np.diff(begins, append=len(values))
    return [*map(int, np.stack([values[begins], lengths], axis=1).ravel())]


def steps(numbers: NDArray[np.integer]) -> list[int | str]:
    """Increasing numbers as the first one and the run-length code of the differences.

    The first one is a text, since numbers may be time stamps of 63 bits, and JavaScript keeps 53.
    """
    return [str(numbers[0]), *runs(np.diff(numbers))] if len(numbers) else []


Bytes = NDArray[np.uint8]

SCALE = 250
"""Attention is stored in steps of 1 / SCALE; the run's tables have all digits."""
NO_VALUE = 255
"""Not measured, or no attention in this frame."""
PARTS = ("total", *CUES)
MOST_BYTES = 3_000_000
"""Most bytes of the attention values of all clips in a page. If there are more, only every second or third frame has
values."""

BySubject = dict[str, SubjectVerdicts]
"""A subject's verdicts by configuration."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TargetValues:
    """A subject's attention to the targets of one name over n frames: their numbers, and ``values`` (PARTS, n)."""

    frames: NDArray[np.int64]
    values: Bytes


AttentionByTarget = dict[str, TargetValues]
"""A subject's attention by target, in the order of appearance."""


@dataclass(frozen=True, slots=True)
class AttentionPart:
    """The attention of each subject of one clip under one configuration, and all targets in order of appearance."""

    by_subject: dict[str, AttentionByTarget] = field(default_factory=dict)
    targets: tuple[str, ...] = ()

    @classmethod
    def of(cls, columns: PairColumns, *, probabilistic: bool) -> AttentionPart:
        """The attention of each named subject; of instances that share a name, the greatest, of probabilities the sum.

        If tracks share the name of a subject, the first one is the subject's. Of probabilities, looking at nothing has
        the rest up to 1.
        """
        scene, words = columns.scene, columns.words
        named = np.flatnonzero(scene.person_names != UNKNOWN)
        _, first = np.unique(scene.person_at[named] * len(words) + scene.person_names[named], return_index=True)
        is_subject = np.zeros(len(scene.person_at), dtype=np.bool_)
        is_subject[named[first]] = True
        entries = np.flatnonzero(is_subject[columns.attending])
        people, targets = columns.attending[entries], scene.names[columns.attended[entries]]
        tracks: dict[str, AttentionByTarget] = {}
        pairs = scene.person_names[people] * len(words) + targets
        _, begins, groups = np.unique(pairs, return_index=True, return_inverse=True)
        for group in np.argsort(begins).tolist():
            within = np.flatnonzero(groups == group)
            parts = [each[entries[within]] for each in (columns.total, columns.gaze, columns.head)]
            if probabilistic:
                chosen = np.flatnonzero(np.diff(people[within], prepend=-1))
                parts = [np.add.reduceat(part, chosen) for part in parts]
            else:
                chosen = _greatest(people[within], parts[0])
                parts = [part[chosen] for part in parts]
            within = within[chosen]
            subject, target = (str(words.word(code)) for code in divmod(int(pairs[begins[group]]), len(words)))
            tracks.setdefault(subject, {})[target] = TargetValues(
                frames=scene.frames[scene.person_at[people[within]]], values=np.stack([*map(_bytes, parts)])
            )
        if probabilistic:
            looking, places = np.unique(people, return_inverse=True)
            nowhere = _bytes(np.maximum(1 - np.bincount(places, columns.total[entries]), 0))
            values = np.stack([nowhere, *(np.full_like(nowhere, NO_VALUE) for _ in CUES)])
            for code in np.unique(scene.person_names[looking]).tolist():
                own = scene.person_names[looking] == code
                frames = scene.frames[scene.person_at[looking[own]]]
                tracks[str(words.word(code))][NOWHERE] = TargetValues(frames=frames, values=values[:, own])
        names, appears = np.unique(scene.names, return_index=True)
        return cls(tracks, tuple(map(str, words.words(names[np.argsort(appears)]))))


def _greatest(people: Codes, totals: Float) -> Codes:
    """The places of the greatest total of each person, the first of equal ones; ``people`` ascend."""
    if (np.diff(people) > 0).all():
        return np.arange(len(people))
    order = np.lexsort((-totals, people))  # it is stable
    return order[np.diff(people[order], prepend=-1) > 0]


RunAttention = Mapping[Pair, AttentionPart]
"""The attention of a run by clip and configuration."""


def attended(attention: RunAttention, pair: Pair, subject: str) -> AttentionByTarget:
    """A subject's attention to the targets that got any; empty if there is none."""
    of_subject = attention.get(pair, AttentionPart()).by_subject.get(subject, {})
    totals = PARTS.index("total")
    return {
        name: found
        for name, found in of_subject.items()
        if ((found.values[totals] > 0) & (found.values[totals] < NO_VALUE)).any()
    }


def target_colours(attention: RunAttention, clip: str, names: Iterable[str]) -> Colours:
    """The colours of a clip's targets, as in its recordings: ``names`` of the manifest, then in order of appearance."""
    appearing = (target for (name, _), part in attention.items() if name == clip for target in part.targets)
    return Colours((*names, *appearing))


def frames_of(judged: BySubject) -> NDArray[np.int64]:
    """The numbers of all frames with a verdict, in order."""
    return np.unique(np.concatenate([each.frames for each in judged.values()]))


def aligned(found: TargetValues, frames: NDArray[np.int64]) -> Bytes:
    """A target's values (:data:`PARTS`, frames) at these frames; :data:`NO_VALUE` if there are none."""
    _, here, there = np.intersect1d(found.frames, frames, assume_unique=True, return_indices=True)
    values = np.full((len(PARTS), len(frames)), NO_VALUE, dtype=np.uint8)
    values[:, there] = found.values[:, here]
    return values


def _bytes(values: Float) -> Bytes:
    """A byte for each value; :data:`NO_VALUE` for NaN."""
    known = np.rint(SCALE * np.nan_to_num(values)).clip(0, SCALE)
    return np.where(np.isnan(values), NO_VALUE, known).astype(np.uint8)


def pack_attention(
    clips: Sequence[str], by_clip: Mapping[str, Mapping[str, BySubject]], attention: RunAttention
) -> tuple[int, dict[str, str]]:
    """Pack the attention of every frame or, if that is too much, of every second, third ...: stride, packs by clip."""

    def packed(stride: int) -> dict[str, str]:
        values = {clip: _values(clip, by_clip.get(clip, {}), attention, stride) for clip in clips}
        return {clip: pack(content) if content else "" for clip, content in values.items()}

    whole = packed(1)
    stride = -(-sum(map(len, whole.values())) // MOST_BYTES)
    return (stride, packed(stride)) if stride > 1 else (1, whole)


def _values(clip: str, subjects: Mapping[str, BySubject], attention: RunAttention, stride: int) -> bytes:
    """Totals, then gaze and head, of all timelines of a clip in the order of the page's data."""
    totals, cues = [], []
    for subject, judged in subjects.items():
        frames = frames_of(judged)[::stride]
        for configuration in judged:
            for columns in attended(attention, (clip, configuration), subject).values():
                total, gaze, head = aligned(columns, frames)
                totals.append(total.tobytes())
                cues += [gaze.tobytes(), head.tobytes()]
    return b"".join(totals + cues)
