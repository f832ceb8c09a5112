"""The sinks that record a clip: one of what its configurations share, and one of each configuration."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import NamedTuple, Self

from harness.files.folders import read_value, write_value
from harness.pipeline.perception import FollowedFrame, SharedFrame
from harness.record import entities
from harness.record.appearance import Colours
from harness.record.blueprint import ClipContent, eye_of_scene, file_layout, guide
from harness.record.entities import load_entities
from harness.record.frame_content import log_attention, log_disparity, log_targets
from harness.record.images import ImageLog, log_masks
from harness.record.layer_file import LayerFile
from harness.record.layers import ClipFiles, LayerNames
from harness.run.frame_sink import FinishedFrame
from vfoa.errors import VfoaError


class SharedRecorder:
    """Records what the configurations of a clip share: images, masks, depth, clouds and boxes.

    The first configuration that has perceived a frame logs it. A file is complete if at least one of its configurations
    has perceived every frame.

    Parameters
    ----------
    layers
        The layers of each configuration, by its name.
    rate_hz
        Frames per second; None if the source does not know it.
    names
        The names of the manifest, in its order: they have the first colours.
    jpeg
        Whether images are JPEG pictures, not AV1 video.
    """

    def __init__(
        self,
        files: ClipFiles,
        layers: Mapping[str, LayerNames],
        *,
        rate_hz: float | None,
        names: Sequence[str] = (),
        jpeg: bool = False,
    ) -> None:
        self._files, self._layers, self._rate_hz, self._jpeg = files, layers, rate_hz, jpeg
        self.colours = Colours(names)
        self._failed: set[str] = set()

    def __enter__(self) -> Self:
        self._images = LayerFile(self._files.images, self._files)
        self._image_log = ImageLog(self._images.part("images"), self._rate_hz, jpeg=self._jpeg)
        names = dict.fromkeys(each.reconstruction for each in self._layers.values())
        self._reconstructions = {name: LayerFile(self._files.reconstruction(name), self._files) for name in names}
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        whole = [layers for name, layers in self._layers.items() if kind is None and name not in self._failed]
        if whole:
            self._image_log.close()
        self._images.close(complete=bool(whole))
        for name, layer in self._reconstructions.items():
            layer.close(complete=any(layers.reconstruction == name for layers in whole))
        if whole:
            configurations = tuple(each.configuration for each in whole)
            write_value(self._files.noted, _Noted(configurations, tuple(self.colours.known)))

    def write(self, frame: SharedFrame) -> None:
        """Log the data of a frame that is not logged already."""
        self._images.open()
        if frame.frame is not None and self._image_log.add(frame.frame):
            self._images.end_frame()
        for name, layers in self._layers.items():
            followed = frame.by_configuration.get(name)
            if isinstance(followed, VfoaError):
                self._failed.add(name)
            elif followed is not None:
                self._log(frame, followed, layers)

    def _log(self, frame: SharedFrame, followed: FollowedFrame, layers: LayerNames) -> None:
        scene, percepts = followed.scene, followed.percepts
        masks = self._images.part(layers.masks)
        if percepts is not None and masks.begin(scene.index, scene.time_ns):
            log_masks(masks, layers.masks, percepts, scene.names, self.colours)
            masks.end()
        layer = self._reconstructions[layers.reconstruction]
        layer.open()
        log = layer.part(layers.reconstruction)
        if log.begin(scene.index, scene.time_ns):
            if frame.frame is not None and frame.frame.right is not None and percepts is not None:
                log_disparity(log, layers.reconstruction, percepts.disparity)
            log_targets(log, layers.reconstruction, scene, self.colours)
            log.end()
            layer.end_frame()


class _Noted(NamedTuple):
    """What a clip's recordings were made with: configurations, and the names in the order of their colours."""

    configurations: tuple[str, ...]
    names: tuple[str, ...]


def noted_colours(files: ClipFiles, configurations: Iterable[str]) -> Colours | None:
    """The colours of a clip's recordings, if they were made for these configurations; None: make them again."""
    noted = read_value(files.noted, _Noted)
    return Colours(noted.names) if noted and {*configurations} <= {*noted.configurations} else None


@dataclass
class Recorder:
    """Records one clip under one configuration, as a context manager (:mod:`harness.record.layers` lists the files).

    Parameters
    ----------
    files, layers
        The files of the clip, and the layers of the configuration.
    colours
        Those of the clip's other recordings: :func:`noted_colours`.
    per_second
        How many numbers of frames a second has, for the viewer.
    names
        The names of the manifest, in its order: their curves are one entity.
    probabilistic
        Whether attention is a probability: "looks at nothing" then has a curve, too.
    """

    files: ClipFiles
    layers: LayerNames
    colours: Colours
    _: KW_ONLY
    per_second: float
    names: Sequence[str] = ()
    probabilistic: bool = False

    def __enter__(self) -> Self:
        self._further = load_entities()
        self._layer = LayerFile(self.files.attention(self.layers.configuration), self.files)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._layer.is_open:
            curves = {path for path in self._layer.part("attention").kept if path.startswith(f"{entities.ATTENTION}/")}
            self._layer.lay_out(file_layout(self.layers, replace(self._shown, curves=frozenset(curves))))
        self._layer.close(complete=kind is None)

    def write(self, frame: FinishedFrame) -> None:
        """Record one frame."""
        self._open(frame)
        record = frame.record
        log = self._layer.part("attention")
        log.begin(record.frame, record.time_ns)
        log_attention(
            log,
            self.layers.configuration,
            frame.result,
            record,
            self.colours,
            self.names,
            probabilistic=self.probabilistic,
        )
        for log_further in self._further:
            log_further(log, frame)
        log.end()
        self._layer.end_frame()

    def _open(self, first: FinishedFrame) -> None:
        """Begin the file with a layout for the scene of the first frame and the views that it has."""
        if self._layer.is_open:
            return
        camera = first.camera
        self._shown = ClipContent(
            has_images=camera is not None,
            has_right=camera is not None and camera.has_right,
            has_measured_depth=camera is not None and camera.has_depth,
            eye=eye_of_scene(first.result.scene),
            per_second=self.per_second,
            probabilistic=frozenset([self.layers.configuration] if self.probabilistic else []),
        )
        self._layer.open(file_layout(self.layers, self._shown))
        self._layer.stream.log(entities.GUIDE, guide(), static=True)
