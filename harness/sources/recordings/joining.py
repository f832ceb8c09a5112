"""Join messages of several cameras to frames by their stamps, and count those that belong to no frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from harness.sources.media.frame_files import join_times, nearest_apart
from harness.sources.recordings.topics import Place, RecordingSettings, Streams, Topic
from vfoa.errors import VfoaError

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
    depths = dict(_join_places([left for left, _ in pairs], streams.depth.places, tolerance_ns))
    if without := len(pairs) - len(depths):
        lost.append(f"{streams.depth.name}: {without} of {len(pairs)} frames have no depth within {_ms(tolerance_ns)}")
    return tuple(FramePlaces(left, right, depths.get(left)) for left, right in pairs), tuple(lost)


def _join_two(left: Topic, other: Topic, tolerance_ns: int, where: str) -> tuple[list[tuple[Place, Place]], list[str]]:
    joined = _join_places(left.places, other.places, tolerance_ns)
    if not joined:
        apart = ""
        if left.places and other.places:
            apart_ns = nearest_apart(*([place.stamp_ns for place in topic.places] for topic in (left, other)))
            apart = f"; the nearest ones are {_ms(apart_ns)} apart (median): tolerance_ms = in [source] allows it"
        raise VfoaError(f"{where}: no two stamps of {left} and {other} are within {_ms(tolerance_ns)}{apart}")
    lost = [
        f"{topic.name}: {count} of {len(topic.places)} images have no partner within {_ms(tolerance_ns)}"
        for topic in (left, other)
        if (count := len(topic.places) - len(joined))
    ]
    # A camera takes one image at a time, but a file may contain copies
    pairs = [each for at, each in enumerate(joined) if not at or each[0].stamp_ns != joined[at - 1][0].stamp_ns]
    if twice := len(joined) - len(pairs):
        why = "left out (a copy, or a clock that stood)"
        lost.append(f"{twice} of {len(joined)} pairs have the stamp of the one before, {why}")
    return pairs, lost


def _join_places(left: Sequence[Place], right: Sequence[Place], tolerance_ns: int) -> list[tuple[Place, Place]]:
    lefts, rights = ([place.stamp_ns for place in side] for side in (left, right))
    return [(left[one], right[other]) for one, other in join_times(lefts, rights, tolerance_ns)]


def _offset(pairs: list[tuple[Place, Place]]) -> list[str]:
    offset_ns = float(np.median([abs(colour.stamp_ns - depth.stamp_ns) for colour, depth in pairs]))
    return [f"colour and depth of a frame were taken {_ms(offset_ns)} apart (median)"] if offset_ns >= _TOLD_NS else []


def _ms(nanoseconds: float) -> str:
    return f"{nanoseconds / 1e6:g} ms"
