"""The sinks that receive a run's frames, beside its results: recordings and thumbnails.

Importing this does not import Rerun.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.files.ascending import numbers_per_second
from harness.files.digests import own_code_digest
from harness.pipeline.configuration import Configuration
from harness.record.layers import ClipFiles, LayerNames, layer_names, recording_ids
from harness.run.directory import Pair, RunDirectory
from harness.run.frame_sink import ClipContext, SinkContext, SinkFactory
from vfoa.errors import VfoaError

if TYPE_CHECKING:
    from harness.record.recorder import Recorder, SharedRecorder
    from harness.report.thumbnails.writer import PictureWriter, ThumbnailWriter


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

    def open_scenes(self, context: ClipContext) -> SharedRecorder:
        """Open the recordings that the configurations of a clip share."""
        from harness.record.recorder import SharedRecorder

        return SharedRecorder(
            _files(context),
            {name: self.layers[name] for name in context.configurations},
            rate_hz=context.rate_hz,
            names=_names(context),
            jpeg=self.jpeg,
        )

    def is_whole(self, context: ClipContext) -> bool:
        """Whether the files are there, and were made together."""
        from harness.record.recorder import noted_colours

        files, layers = _files(context), [self.layers[name] for name in context.configurations]
        shared = {files.images, *(files.reconstruction(each.reconstruction) for each in layers)}
        return all(map(Path.is_file, shared)) and noted_colours(files, context.configurations) is not None

    def open(self, context: SinkContext) -> Recorder:
        """Open the recording of one configuration on one clip."""
        from harness.record.recorder import Recorder, noted_colours

        files = _files(context)
        colours = noted_colours(files, [context.configuration])
        if colours is None:
            raise VfoaError(f"{files.noted}: expected what {files.images.name} was made with; run again")
        return Recorder(
            files,
            self.layers[context.configuration],
            colours,
            per_second=numbers_per_second(context.frames, context.rate_hz),
            names=_names(context),
            probabilistic=context.probabilistic,
        )

    def files(self, directory: RunDirectory, pair: Pair) -> tuple[Path, ...]:
        """The layers that show one configuration of a clip when it is finished."""
        clip, configuration = pair
        files, layers = ClipFiles(run=directory.path, clip=clip), self.layers[configuration]
        return files.images, files.reconstruction(layers.reconstruction), files.attention(configuration)


def _files(context: ClipContext) -> ClipFiles:
    clip = context.manifest.name
    return ClipFiles(run=context.directory.path, clip=clip, ids=recording_ids(context.run_id, clip))


def _names(context: ClipContext) -> tuple[str, ...]:
    return (*context.manifest.targets, *context.manifest.subjects)


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

    def open_scenes(self, context: ClipContext) -> PictureWriter:
        """Open the pictures of one clip."""
        from harness.report.thumbnails.writer import PictureWriter

        return PictureWriter(context.directory.path, context.manifest.name)

    def is_whole(self, context: ClipContext) -> bool:
        """Whether every picture is there."""
        from harness.report.thumbnails import picture_path

        run, clip = context.directory.path, context.manifest.name
        return all(picture_path(run, clip, frame).is_file() for frame in context.image_frames)

    def folder(self, context: ClipContext) -> Path:
        """The folder of the pictures."""
        from harness.report.thumbnails import picture_path

        return picture_path(context.directory.path, context.manifest.name, 0).parent

    def code(self) -> str:
        """The digest of the code that writes pictures."""
        return own_code_digest(("harness.report.thumbnails.writer",))

    def open(self, context: SinkContext) -> ThumbnailWriter:
        """Open what is drawn over them of one configuration on one clip."""
        from harness.report.thumbnails.writer import ThumbnailWriter

        return ThumbnailWriter(context.directory.path, context.manifest.name, context.configuration)


def composed_sinks(
    configurations: Iterable[Configuration], *, recorded: bool = True, jpeg: bool = False
) -> tuple[SinkFactory, ...]:
    """Thumbnails and, if they are wanted, recordings of an experiment with these configurations."""
    return (ThumbnailSinks(), *((recordings(configurations, jpeg=jpeg),) if recorded else ()))
