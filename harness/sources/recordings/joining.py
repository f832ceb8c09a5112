"""Join messages of several cameras to frames by their stamps, and count those that belong to no frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from harness.sources.recordings.containers import Index
from harness.sources.recordings.topics import Place, RecordingSettings, Streams, Topic
from vfoa.errors import VfoaError


def join(left: Sequence[Place], right: Sequence[Place], tolerance_ns: int) -> list[tuple[Place, Place]]:
    """Pair places of the two ascending sequences, each used once, at most ``tolerance_ns`` apart.

    A place stays without a pair if its neighbour fits the other side better.
    """
    pairs: list[tuple[Place, Place]] = []
    i = j = 0
    while i < len(left) and j < len(right):
        apart = abs(left[i].stamp_ns - right[j].stamp_ns)
        if j + 1 < len(right) and abs(left[i].stamp_ns - right[j + 1].stamp_ns) < apart:
            j += 1
        elif i + 1 < len(left) and abs(left[i + 1].stamp_ns - right[j].stamp_ns) < apart:
            i += 1
        else:
            if apart <= tolerance_ns:
                pairs.append((left[i], right[j]))
            i, j = i + 1, j + 1
    return pairs


def of_distinct_stamps(pairs: Sequence[tuple[Place, Place]]) -> list[tuple[Place, Place]]:
    """The first pair of each left stamp: a camera takes one image at a time, but a file may contain copies."""
    return [pair for place, pair in enumerate(pairs) if not place or pair[0].stamp_ns != pairs[place - 1][0].stamp_ns]


_TOLD_NS = 1e6
"""Offset of colour and depth above which a note reports it."""


class FramePlaces(NamedTuple):
    """Positions of the messages of one frame."""

    left: Place
    right: Place | None
    depth: Place | None


def join_streams(
    streams: Streams, settings: RecordingSettings, where: str
) -> tuple[tuple[FramePlaces, ...], tuple[str, ...]]:
    """Return the frames in the order of their stamps, and a note per kind of image that belongs to no frame.

    Raises
    ------
    VfoaError
        If no two stamps are near enough; the message says how far apart they are.
    """
    if streams.right is None:
        assert streams.depth is not None
        pairs, lost = _join_two(streams.left, streams.depth, settings.tolerance_ns(of_depth=True), where)
        return tuple(FramePlaces(left, None, depth) for left, depth in pairs), (*lost, *_offset(pairs))
    pairs, lost = _join_two(streams.left, streams.right, settings.tolerance_ns(of_depth=False), where)
    if streams.depth is None:
        return tuple(FramePlaces(left, right, None) for left, right in pairs), tuple(lost)
    tolerance_ns = settings.tolerance_ns(of_depth=True)
    depths = dict(join([left for left, _ in pairs], streams.depth.places, tolerance_ns))
    if without := len(pairs) - len(depths):
        lost.append(f"{streams.depth.name}: {without} of {len(pairs)} frames have no depth within {_ms(tolerance_ns)}")
    return tuple(FramePlaces(left, right, depths.get(left)) for left, right in pairs), tuple(lost)


def _join_two(left: Topic, other: Topic, tolerance_ns: int, where: str) -> tuple[list[tuple[Place, Place]], list[str]]:
    joined = join(left.places, other.places, tolerance_ns)
    if not joined:
        nearest = _nearest(left, other)
        raise VfoaError(f"{where}: no two stamps of {left} and {other} are within {_ms(tolerance_ns)}{nearest}")
    lost = [
        f"{topic.name}: {count} of {len(topic.places)} images have no partner within {_ms(tolerance_ns)}"
        for topic in (left, other)
        if (count := len(topic.places) - len(joined))
    ]
    pairs = of_distinct_stamps(joined)
    if twice := len(joined) - len(pairs):
        why = "left out (a copy, or a clock that stood)"
        lost.append(f"{twice} of {len(joined)} pairs have the stamp of the one before, {why}")
    return pairs, lost


def _offset(pairs: list[tuple[Place, Place]]) -> list[str]:
    offset_ns = float(np.median([abs(colour.stamp_ns - depth.stamp_ns) for colour, depth in pairs]))
    return [f"colour and depth of a frame were taken {_ms(offset_ns)} apart (median)"] if offset_ns >= _TOLD_NS else []


def _nearest(left: Topic, other: Topic) -> str:
    """How far apart the two are, and the setting that allows it, if both have images."""
    if not left.places or not other.places:
        return ""
    stamps = np.array([place.stamp_ns for place in other.places])
    apart_ns = float(np.median([np.abs(stamps - place.stamp_ns).min() for place in left.places[:100]]))
    return f"; the nearest ones are {_ms(apart_ns)} apart (median): tolerance_ms = in [source] allows it"


def _ms(nanoseconds: float) -> str:
    return f"{nanoseconds / 1e6:g} ms"


def lost_by_metadata(index: Index, streams: Streams) -> list[str]:
    """A note for each topic with fewer images than the metadata beside the files says."""
    recorded = index.recorded or {}
    return [
        f"{topic.name}: {recorded[topic.name] - topic.count} of {recorded[topic.name]} images are lost "
        "(by metadata.yaml)"
        for topic in streams.topics
        if recorded.get(topic.name, 0) > topic.count
    ]


def lost_by_cuts(index: Index, rate_hz: float | None) -> list[str]:
    """A note for each truncated file. Its length is unknown; the head of its last chunk says what that chunk held."""
    if index.recorded is not None:
        return []
    return [
        "how many frames were lost is unknown (file truncated)"
        if span is None or rate_hz is None
        else f"the cut chunk alone held about {1 + round((span[1] - span[0]) / 1e9 * rate_hz)} of the lost "
        f"frames ({span[0] / 1e9:.3f} to {span[1] / 1e9:.3f} s); how many followed is unknown (file truncated)"
        for span in index.cut_spans_ns
    ]
