"""The sink that records one configuration on one clip, and the layers that it shares with the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from types import TracebackType
from typing import ClassVar, Self

from harness.record import entities
from harness.record.appearance import Colours
from harness.record.blueprint import Shown, eye_controls, file_layout, guide
from harness.record.entities import load_entities
from harness.record.frame_content import log_attention, log_disparity, log_targets
from harness.record.images import ImageLog, log_masks
from harness.record.layer_file import LayerFile
from harness.record.layers import ClipFiles, LayerNames
from harness.run.frame_sink import FinishedFrame


class SharedLayers:
    """The layers of a clip that several configurations share, while a run writes them.

    The first configuration that reaches a frame logs it. A file is complete if at least one of its configurations was.
    """

    _open: ClassVar[dict[ClipFiles, SharedLayers]] = {}

    def __init__(self, files: ClipFiles, rate_hz: float | None, names: Sequence[str], *, jpeg: bool) -> None:
        self.files = files
        self.colours = Colours(names)
        self.further = load_entities()
        self._images = LayerFile(files.images, files)
        self._image_log = ImageLog(self._images.part("images"), rate_hz, jpeg=jpeg)
        self._reconstructions: dict[str, LayerFile] = {}
        self._users = 0
        self._complete: set[str] = set()

    @classmethod
    def join(cls, files: ClipFiles, rate_hz: float | None, names: Sequence[str], *, jpeg: bool) -> SharedLayers:
        """Return the layers of a clip that this process writes; each caller leaves them by :meth:`leave`."""
        if files not in cls._open:
            cls._open[files] = cls(files, rate_hz, names, jpeg=jpeg)
        shared = cls._open[files]
        shared._users += 1
        return shared

    def leave(self, layers: LayerNames, *, complete: bool) -> None:
        """End one configuration's use of the layers; the last one closes the files."""
        self._users -= 1
        if complete:
            self._complete.add(layers.reconstruction)
        if self._users == 0:
            del self._open[self.files]
            if self._complete:
                self._image_log.close()
            self._images.close(complete=bool(self._complete))
            for name, layer in self._reconstructions.items():
                layer.close(complete=name in self._complete)

    def write(self, frame: FinishedFrame, layers: LayerNames) -> None:
        """Log a frame's data in the shared layers of a configuration, unless it is logged already."""
        self._images.open()
        index, time_ns = frame.record.frame, frame.record.time_ns
        if frame.frame is not None and self._image_log.add(frame.frame):
            self._images.end_frame()
        masks = self._images.part(layers.masks)
        if frame.percepts is not None and masks.begin(index, time_ns):
            log_masks(masks, layers.masks, frame.percepts, frame.record, self.colours)
            masks.end()
        name = layers.reconstruction
        layer = self._layer_of(name)
        layer.open()
        log = layer.part(name)
        if log.begin(index, time_ns):
            if frame.frame is not None and frame.frame.right is not None and frame.percepts is not None:
                log_disparity(log, name, frame.percepts.disparity)
            log_targets(log, name, frame.result.scene, frame.record, self.colours)
            log.end()
            layer.end_frame()

    def _layer_of(self, name: str) -> LayerFile:
        if name not in self._reconstructions:
            layer = LayerFile(self.files.reconstruction(name), self.files)
            self._reconstructions[name] = layer
        return self._reconstructions[name]


@dataclass
class Recorder:
    """Records one clip under one configuration, as a context manager (:mod:`harness.record.layers` lists the files).

    Parameters
    ----------
    files, layers
        The files of the clip, and the layers of the configuration.
    rate_hz
        Frames per second at which the viewer plays; None if the source does not know it.
    subjects, targets
        The names of the manifest, in its order: they fix the colours and give each subject a view of its own.
    jpeg
        Whether images are JPEG pictures, not AV1 video.
    """

    files: ClipFiles
    layers: LayerNames
    _: KW_ONLY
    rate_hz: float | None
    subjects: Sequence[str] = ()
    targets: Sequence[str] = ()
    jpeg: bool = False

    def __enter__(self) -> Self:
        self._names = (*self.targets, *self.subjects)
        self._shared = SharedLayers.join(self.files, self.rate_hz, self._names, jpeg=self.jpeg)
        self._layer = LayerFile(self.files.attention(self.layers.configuration), self.files)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        complete = False
        try:
            self._layer.close(complete=error is None)
            complete = error is None
        finally:
            self._shared.leave(self.layers, complete=complete)

    def write(self, frame: FinishedFrame) -> None:
        """Record one frame."""
        self._open(frame)
        self._shared.write(frame, self.layers)
        record, colours = frame.record, self._shared.colours
        log = self._layer.part("attention")
        log.begin(record.frame, record.time_ns)
        log_attention(log, self.layers.configuration, frame.result, record, colours, self._names)
        for log_further in self._shared.further:
            log_further(log, frame)
        log.end()
        self._layer.end_frame()

    def _open(self, first: FinishedFrame) -> None:
        """Begin the file with a layout for the scene of the first frame and the views that it has."""
        if self._layer.is_open:
            return
        frame = first.frame
        shown = Shown(
            has_images=frame is not None,
            has_right=frame is not None and frame.right is not None,
            has_measured_depth=frame is not None and frame.depth_m is not None,
            eye=eye_controls(first.result.scene),
            rate_hz=self.rate_hz,
        )
        self._layer.open(file_layout(self.layers, shown))
        self._layer.stream.log(entities.GUIDE, guide(), static=True)
