"""The sinks that receive a run's frames, beside its results."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from harness.record import Size
from harness.record.sink import recordings
from harness.run.frame_sink import SinkContext, SinkFactory
from harness.stages.configuration import Configuration

if TYPE_CHECKING:
    from harness.report.thumbnails.writer import ThumbnailWriter


@dataclass(frozen=True, slots=True)
class ThumbnailSinks:
    """Thumbnails in the run's directory: the report needs them, and neither clip nor models."""

    def described(self) -> Mapping[str, Any]:
        """They are no setting of a run."""
        return {}

    def open(self, context: SinkContext) -> ThumbnailWriter:
        """The thumbnails of one configuration on one clip."""
        from harness.report.thumbnails.writer import ThumbnailWriter

        return ThumbnailWriter(context.directory.path, *context.pair, resumed=context.resumed)


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
