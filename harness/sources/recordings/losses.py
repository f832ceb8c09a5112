"""How many images of a recording are lost, as far as that can be known."""

from __future__ import annotations

from harness.sources.recordings.index import Index
from harness.sources.recordings.streams import Streams


def lost_by_metadata(index: Index, streams: Streams) -> list[str]:
    """One sentence per topic of which fewer images are there than were noted beside the files."""
    recorded = index.recorded or {}
    return [
        f"{topic.name}: {recorded[topic.name] - topic.count} of {recorded[topic.name]} images are lost "
        "(by metadata.yaml)"
        for topic in streams.topics
        if recorded.get(topic.name, 0) > topic.count
    ]


def lost_by_cuts(index: Index, rate_hz: float | None) -> list[str]:
    """One sentence per cut file, which does not say how long it was; its last chunk's head says what that one held."""
    if index.recorded is not None:
        return []
    return [
        "how many frames were lost is unknown (file truncated)"
        if span is None or rate_hz is None
        else f"the cut chunk alone held about {1 + round((span[1] - span[0]) / 1e9 * rate_hz)} of the lost "
        f"frames ({span[0] / 1e9:.3f} to {span[1] / 1e9:.3f} s); how many followed is unknown (file truncated)"
        for span in index.cut_spans_ns
    ]
