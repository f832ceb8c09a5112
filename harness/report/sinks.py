"""The sinks that receive a run's frames, beside its results."""

from __future__ import annotations

from collections.abc import Iterable

from harness.record import Size
from harness.record.sink import recordings
from harness.report.thumbnails.sink import ThumbnailSinks
from harness.run.frame_sink import SinkFactory
from harness.stages.configuration import Configuration


def composed_sinks(
    configurations: Iterable[Configuration],
    recording: Size | None,
    *,
    watched_at: str | None = None,
    around: int | None = None,
) -> tuple[SinkFactory, ...]:
    """Thumbnails, and recordings of this size (None: none), which a viewer at ``watched_at`` shows as they grow.

    ``configurations`` are all those of the experiment. ``around``: frames before and after each wrong one that the
    recordings have whole; None: all.
    """
    return ThumbnailSinks(), *recordings(configurations, recording, watched_at, around)
