"""Sinks that receive a run's frames, and the factories that open them.

A run writes its results itself. The caller adds other sinks: a recording, thumbnails, a count of right answers. There
are two kinds: one sink of a clip gets what is perceived, with images, for all configurations at once; one sink of each
(clip, configuration) gets the answers. A job travels to its worker by pickle, so it carries factories, not open files.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeAlias, TypeVar, runtime_checkable

from harness.clips.manifest import ClipManifest
from harness.run.directory import Pair, RunDirectory
from harness.run.records import FrameRecord
from vfoa.types import FrameResult, StereoFrame, StereoRig

if TYPE_CHECKING:
    from harness.pipeline.perception import SharedFrame
    from harness.pipeline.stage_runner import Timings


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """The camera of a frame, and the images that it has besides the left one."""

    rig: StereoRig
    has_right: bool
    has_depth: bool

    @classmethod
    def of(cls, frame: StereoFrame | None) -> Camera | None:
        """The camera of a frame with images; None without."""
        if frame is None:
            return None
        return cls(rig=frame.rig, has_right=frame.right is not None, has_depth=frame.depth_m is not None)


@dataclass(frozen=True, slots=True, kw_only=True)
class FinishedFrame:
    """One frame under one configuration: the camera, the result, the record with names, and seconds by stage.

    A clip of recorded 3D poses has no camera.
    """

    camera: Camera | None
    result: FrameResult
    record: FrameRecord
    timings: Timings


_Frame = TypeVar("_Frame", contravariant=True)


class Sink(Protocol[_Frame]):
    """Takes the frames of one clip, in order, and does not change them.

    It is a context manager. An exception at the end means that frames are missing: the files must then not look
    complete.
    """

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def write(self, frame: _Frame) -> None:
        """Take one frame."""
        ...


FrameSink: TypeAlias = Sink[FinishedFrame]
"""Takes the finished frames under one configuration."""
SceneSink: TypeAlias = "Sink[SharedFrame]"
"""Takes the frames as all configurations have perceived them.

A configuration that has failed so far has its error in place of what it perceived.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipContext:
    """Context of a scene sink: some configurations on one clip. ``run_id`` is the run's, also on another computer.

    ``image_frames`` are the frames with images: all of them, or none of recorded 3D poses.
    """

    manifest: ClipManifest
    configurations: tuple[str, ...]
    frames: tuple[int, ...]
    image_frames: tuple[int, ...]
    rate_hz: float | None
    directory: RunDirectory
    run_id: str


@dataclass(frozen=True, slots=True, kw_only=True)
class SinkContext(ClipContext):
    """Context of a sink: one of the configurations, and whether its attention is a probability."""

    configuration: str
    probabilistic: bool


class SinkFactory(Protocol):
    """Opens a sink. It is pickled with the job."""

    def described(self) -> Mapping[str, Any]:
        """Entries of the sink in the run's manifest: a run with other sinks is another run."""
        ...

    def open(self, context: SinkContext) -> FrameSink | None:
        """Open the sink of one configuration on one clip; None if it takes none of these frames."""
        ...


@runtime_checkable
class SceneSinkFactory(SinkFactory, Protocol):
    """Opens sinks of both kinds."""

    def open_scenes(self, context: ClipContext) -> SceneSink:
        """Open the sink of what is perceived of one clip. It is closed before the sinks of its configurations open."""
        ...

    def is_whole(self, context: ClipContext) -> bool:
        """Whether all that this sink wrote of the clip is still there, for all of these configurations.

        If it is not, the clip is perceived again for all configurations of the run.
        """
        ...


@runtime_checkable
class PictureSinkFactory(SceneSinkFactory, Protocol):
    """Opens a sink of a clip whose files show the images alone, so that a later run may take a copy of them."""

    def folder(self, context: ClipContext) -> Path:
        """The folder of these files, which has no others."""
        ...

    def code(self) -> str:
        """The digest of the code that writes them."""
        ...


@runtime_checkable
class FinishedFiles(SinkFactory, Protocol):
    """Opens sinks without whose files a (clip, configuration) is not finished."""

    def files(self, directory: RunDirectory, pair: Pair) -> Iterable[Path]:
        """The files that show a (clip, configuration) when it is finished."""
        ...


def lacks_files(sinks: Iterable[SinkFactory], directory: RunDirectory, pair: Pair) -> bool:
    """Whether a file of a (clip, configuration) that these sinks write is missing."""
    return any(
        not path.is_file()
        for factory in sinks
        if isinstance(factory, FinishedFiles)
        for path in factory.files(directory, pair)
    )
