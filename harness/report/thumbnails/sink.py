"""Opens the thumbnails of each configuration of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from harness.run.frame_sink import SinkContext

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
