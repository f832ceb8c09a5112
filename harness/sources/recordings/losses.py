"""Number of lost images of a recording, as far as it is known."""

from __future__ import annotations

from harness.sources.recordings.index import Index
from harness.sources.recordings.streams import Streams


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
