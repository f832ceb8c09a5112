"""The sinks that receive a run's frames, beside its results: recordings and thumbnails.

Importing this does not import Rerun.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.pipeline.configuration import Configuration
from harness.record.layers import ClipFiles, LayerNames, layer_names, recording_ids
from harness.run.directory import Pair, RunDirectory
from harness.run.frame_sink import SinkContext, SinkFactory

if TYPE_CHECKING:
    from harness.record.recorder import Recorder
    from harness.report.thumbnails.writer import ThumbnailWriter


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingSinks:
    """Recordings, next to the results.

    ``layers`` are those of every configuration of the experiment, by its name. ``jpeg``: images are JPEG pictures, not
    AV1 video.
    """

    layers: Mapping[str, LayerNames]
    jpeg: bool = False

    def described(self) -> Mapping[str, Any]:
        """The kind of its recordings is written into a run's manifest."""
        return {"recording": "jpeg" if self.jpeg else "light"}

    def open(self, context: SinkContext) -> Recorder:
        """Open the recording of one configuration on one clip."""
        from harness.record.recorder import Recorder

        manifest = context.manifest
        return Recorder(
            ClipFiles(run=context.directory.path, clip=manifest.name, ids=recording_ids(context.run_id, manifest.name)),
            self.layers[context.configuration],
            rate_hz=context.rate_hz,
            subjects=tuple(manifest.subjects),
            targets=tuple(manifest.targets),
            jpeg=self.jpeg,
        )

    def files(self, directory: RunDirectory, pair: Pair) -> tuple[Path, ...]:
        """The layers that show one configuration of a clip when it is finished."""
        clip, configuration = pair
        files, layers = ClipFiles(run=directory.path, clip=clip), self.layers[configuration]
        return files.images, files.reconstruction(layers.reconstruction), files.attention(configuration)


def recordings(configurations: Iterable[Configuration], *, jpeg: bool = False) -> RecordingSinks:
    """Return the recordings of an experiment with these configurations."""
    plain = {configuration.name: configuration.plain() for configuration in configurations}
    return RecordingSinks(layers=layer_names(plain), jpeg=jpeg)


@dataclass(frozen=True, slots=True)
class ThumbnailSinks:
    """Opens thumbnails in the run's directory, so that the report needs neither clip nor models."""

    def described(self) -> Mapping[str, Any]:
        """They are no setting of a run."""
        return {}

    def open(self, context: SinkContext) -> ThumbnailWriter:
        """Open the thumbnails of one configuration on one clip."""
        from harness.report.thumbnails.writer import ThumbnailWriter

        return ThumbnailWriter(context.directory.path, context.manifest.name, context.configuration)


def composed_sinks(
    configurations: Iterable[Configuration], *, recorded: bool = True, jpeg: bool = False
) -> tuple[SinkFactory, ...]:
    """Thumbnails and, if they are wanted, recordings of an experiment with these configurations."""
    return (ThumbnailSinks(), *((recordings(configurations, jpeg=jpeg),) if recorded else ()))
