"""Left and right messages joined by time stamp."""

from __future__ import annotations

from collections.abc import Sequence

from harness.sources.recordings.topics import Place


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
