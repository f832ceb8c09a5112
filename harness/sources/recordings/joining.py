"""Which messages make a frame: images are joined by their stamps, and notes say what is left out or may be wrong."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from harness.sources.media.frame_times import join_nearest, join_times, nearest_apart
from harness.sources.recordings.settings import RecordingSettings
from harness.sources.recordings.streams import Sides, Streams
from harness.sources.recordings.topics import Place, Topic
from vfoa.errors import VfoaError, counted

_NOTED_NS = 1e6
"""Offset of colour and depth above which a note reports it."""

_APART_S = 10.0
"""Longest time between two parts of one recording."""

FEW_REORDERED = 3
"""Most messages in a row that a recorder's threads write behind a later one."""

FramePlaces = Sides[Place]
"""Positions of the messages of one frame."""


def join_streams(
    streams: Streams, settings: RecordingSettings, where: str
) -> tuple[tuple[FramePlaces, ...], tuple[str, ...]]:
    """Return the frames in the order of their stamps, and a note per kind of image that belongs to no frame.

    Raises
    ------
    VfoaError
        If no two stamps are near enough; the message says how far apart they are.
    """
    if streams.is_packed:
        places, repeated = _once_per_stamp(streams.left.places, "images", settings)
        return tuple(Sides(place, place, None) for place in places), tuple(repeated)
    partner = streams.right or streams.depth
    assert partner is not None
    tolerance_ns = settings.tolerance_ns(of_depth=partner is streams.depth)
    joined, notes = _join_partners(streams.left, partner, tolerance_ns, where)
    kept, repeated = _once_per_stamp(list(joined), "pairs", settings)
    joined = {place: joined[place] for place in kept}
    notes += repeated
    rights, depths = ({}, joined) if streams.right is None else (joined, {})
    if streams.right is None:
        offset_ns = float(np.median([abs(colour.stamp_ns - depth.stamp_ns) for colour, depth in joined.items()]))
        if offset_ns >= _NOTED_NS:
            notes.append(f"colour and depth of a frame were taken {_ms(offset_ns)} apart (median)")
    elif streams.depth is not None:
        tolerance_ns = settings.tolerance_ns(of_depth=True)
        depths = _join(list(joined), streams.depth.places, tolerance_ns)
        if lost := len(joined) - len(depths):
            notes.append(
                f"{streams.depth.name}: {lost} of {len(joined)} frames have no depth within {_ms(tolerance_ns)}"
            )
    return tuple(Sides(left, rights.get(left), depths.get(left)) for left in joined), tuple(notes)


def notes_on_unstamped(streams: Streams, where: str) -> list[str]:
    """A note for each topic some of whose images have no time stamp.

    Raises
    ------
    VfoaError
        If none of them has one.
    """
    unstamped = {topic.name: topic for topic in streams if topic is not None and topic.unstamped}.values()
    for topic in unstamped:
        if not topic.places:
            raise VfoaError(
                f"{where}: {topic.name}: {counted(len(topic.unstamped), 'image')} without time stamp; expected one in "
                'each, images are joined by it (stamps = "log" in [source] joins them by the time of recording)'
            )
    return [
        f"{topic.name}: {len(topic.unstamped)} of {len(topic.unstamped) + len(topic.places)} images have no time stamp "
        "and are left out"
        for topic in unstamped
    ]


def notes_on_files(places: Sequence[Place], files: Sequence[Path]) -> list[str]:
    """Notes on files that do not follow each other, as the parts of a recording that was split do."""
    spans: dict[int, tuple[int, int]] = {}
    for place in places:
        begin, end = spans.get(place.file, (place.stamp_ns, place.stamp_ns))
        spans[place.file] = min(begin, place.stamp_ns), max(end, place.stamp_ns)
    notes = []
    for (one, (_, end)), (other, (begin, _)) in pairwise(sorted(spans.items(), key=lambda span: span[1])):
        if not 0 <= (apart_s := (begin - end) / 1e9) <= _APART_S:
            what = f"{apart_s:.0f} s lie between them" if apart_s > 0 else "both are of the same time"
            notes.append(
                f"{files[one].name}, {files[other].name}: {what}; if these are separate recordings, add each "
                "file as a clip"
            )
    return notes


def notes_on_clock(name: str, stamps: Iterable[tuple[int, int]], most_in_a_row: int = FEW_REORDERED) -> list[str]:
    """A note if the clock was set back while a file was written: messages of two times are then mixed.

    Parameters
    ----------
    stamps
        Of each message of a topic, in the order of writing: the file's index and the stamp, ns.
    most_in_a_row
        Most messages in a row that may be written behind a later one.
    """
    latest_ns: dict[int, int] = {}
    late = in_a_row = most_found = back_ns = 0
    for file, stamp_ns in stamps:
        before_ns = latest_ns.get(file, stamp_ns)
        latest_ns[file] = max(before_ns, stamp_ns)
        is_late = stamp_ns < before_ns
        late, back_ns = late + is_late, max(back_ns, before_ns - stamp_ns)
        in_a_row = in_a_row + 1 if is_late else 0
        most_found = max(most_found, in_a_row)
    if most_found <= most_in_a_row:
        return []
    return [
        f"{name}: {late} messages were recorded after ones with later stamps, by up to {back_ns / 1e9:g} s: was the "
        'clock set back? Frames are in the order of stamps; stamps = "log" in [source] takes that of recording'
    ]


def _join_partners(left: Topic, other: Topic, tolerance_ns: int, where: str) -> tuple[dict[Place, Place], list[str]]:
    """The images of two topics that belong together, and notes on those that are left out."""
    joined = _join(left.places, other.places, tolerance_ns)
    if not joined:
        raise VfoaError(f"{where}: {_too_far(left, other, tolerance_ns)}")
    notes = [
        f"{side.name}: {lost} of {len(side.places)} images have no partner within {_ms(tolerance_ns)}"
        for side in (left, other)
        if (lost := len(side.places) - len(joined))
    ]
    near = join_nearest(_stamps_ns(left.places), _stamps_ns(other.places)) if notes else []
    if more := max(len(near) - len(joined), 0):
        apart_ns = max(abs(left.places[i].stamp_ns - other.places[j].stamp_ns) for i, j in near)
        pairs = "1 more pair is" if more == 1 else f"{more} more pairs are up to"
        notes.append(f"{pairs} {_ms(apart_ns)} apart, which tolerance_ms = in [source] would allow")
    return joined, notes


def _once_per_stamp(places: Sequence[Place], what: str, settings: RecordingSettings) -> tuple[list[Place], list[str]]:
    """The first place of each stamp, and a note on the others.

    A camera takes one image at a time, but a file may contain copies, and a script may write stamps in whole seconds.
    """
    first_of_stamp = {place.stamp_ns: place for place in reversed(places)}
    kept = list(reversed(first_of_stamp.values()))
    if not (twice := len(places) - len(kept)):
        return kept, []
    why = "left out (a copy, or a clock that stopped)"
    note = f"{twice} of {len(places)} {what} have the stamp of the one before, {why}"
    if settings.stamps == "header" and twice > len(kept):
        note += '; stamps = "log" in [source] keeps all that were recorded at other times'
    return kept, [note]


def _join(left: Sequence[Place], other: Sequence[Place], tolerance_ns: int) -> dict[Place, Place]:
    return {left[i]: other[j] for i, j in join_times(_stamps_ns(left), _stamps_ns(other), tolerance_ns)}


def _stamps_ns(places: Sequence[Place]) -> list[int]:
    return [place.stamp_ns for place in places]


def _too_far(left: Topic, other: Topic, tolerance_ns: int) -> str:
    apart = ""
    if left.places and other.places:
        apart_ns = nearest_apart(_stamps_ns(left.places), _stamps_ns(other.places))
        apart = f"; the nearest ones are {_ms(apart_ns)} apart (median): tolerance_ms = in [source] allows it"
    return f"no two stamps of {left} and {other} are within {_ms(tolerance_ns)}{apart}"


def _ms(nanoseconds: float) -> str:
    return f"{nanoseconds / 1e6:g} ms"
