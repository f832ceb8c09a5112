"""Sinks that receive a run's finished frames, and the factories that open them.

A run writes its results itself. The caller adds other sinks: a recording, thumbnails, a count of right answers. A job
travels to its worker by pickle, so it carries factories, not open files.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, Self, runtime_checkable

from harness.clips.manifest import ClipManifest
from harness.run.directory import Pair, RunDirectory
from harness.run.records import FrameRecord
from vfoa.types import FrameResult, Percepts, StereoFrame

if TYPE_CHECKING:
    from harness.pipeline.stage_runner import Timings


@dataclass(frozen=True, slots=True, kw_only=True)
class FinishedFrame:
    """One frame under one configuration: images, percepts, result, the record with names, and seconds by stage.

    A clip of recorded 3D poses has no images and no percepts.
    """

    frame: StereoFrame | None
    percepts: Percepts | None
    result: FrameResult
    record: FrameRecord
    timings: Timings


class FrameSink(Protocol):
    """Takes the finished frames of one clip under one configuration, in order, and does not change them.

    It is a context manager. An exception at the end means that frames are missing: the files must then not look
    complete.
    """

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def write(self, frame: FinishedFrame) -> None:
        """Take one frame."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class SinkContext:
    """Context of a sink: one configuration on one clip. ``run_id`` is the run's, also on another computer."""

    manifest: ClipManifest
    configuration: str
    rate_hz: float | None
    directory: RunDirectory
    run_id: str


class SinkFactory(Protocol):
    """Opens a sink. It is pickled with the job."""

    def described(self) -> Mapping[str, Any]:
        """Entries of the sink in the run's manifest: a run with other sinks is another run."""
        ...

    def open(self, context: SinkContext) -> FrameSink | None:
        """Open the sink of one configuration on one clip; None if it takes none of these frames."""
        ...


@runtime_checkable
class SharedFiles(SinkFactory, Protocol):
    """Opens sinks whose files the configurations of a clip share: one process opens all sinks of a clip.

    A (clip, configuration) without one of its files is not finished. Then all configurations of the clip run again: a
    shared file has the frames of all of them.
    """

    def files(self, directory: RunDirectory, pair: Pair) -> Iterable[Path]:
        """The files that show a (clip, configuration) when it is finished."""
        ...


def lacks_files(sinks: Iterable[SinkFactory], directory: RunDirectory, pair: Pair) -> bool:
    """Whether a file of a (clip, configuration) that these sinks write is missing."""
    return any(
        not path.is_file()
        for factory in sinks
        if isinstance(factory, SharedFiles)
        for path in factory.files(directory, pair)
    )
