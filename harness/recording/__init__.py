"""Recordings: every stage of every frame, written for the Rerun viewer by an observer that changes nothing.

``recorder.py`` is the observer; ``stages.py``, ``scene.py``, ``attention.py`` and ``verdicts.py`` say what is logged of
each subject; ``entities.py`` holds the paths, ``blueprint.py`` the layout, ``viewer.py`` opens the result. This file
does not import Rerun, so that a run without recordings does not pay for it.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Literal, Protocol, Self

from harness.runs.directory import pair_of
from vfoa.errors import VfoaError, did_you_mean
from vfoa.types import FrameResult, Percepts, StereoFrame

if TYPE_CHECKING:
    from harness.runs.results import FrameRecord
    from harness.scores.verdicts import Verdict

Size = Literal["light", "full"]
"""How much a recording holds: ``light`` is enough to understand a failure, ``full`` is everything at full size."""


VERSUS = "__vs__"
"""Between two configurations in the name of a recording that shows both, made of a run's own and none of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownFrame:
    """One finished frame: its images, what was found in it, the result, its record with names, and the verdicts."""

    frame: StereoFrame
    percepts: Percepts
    result: FrameResult
    record: FrameRecord
    verdicts: tuple[Verdict, ...]


class FrameObserver(Protocol):
    """What the run loop shows each finished frame to. Frames come in order; nothing shown may be changed."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def log(self, shown: ShownFrame) -> None:
        """Show one frame."""
        ...


class Observers:
    """Any number of observers as one: each is shown every frame, in order. None of them: a run that nobody watches."""

    def __init__(self, *observers: FrameObserver) -> None:
        self._observers = observers
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            for observer in self._observers:
                stack.enter_context(observer)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    def log(self, shown: ShownFrame) -> None:
        """Show the frame to each."""
        for observer in self._observers:
            observer.log(shown)


def find_recordings(run: Path, clip: str | None, configuration: str | None) -> list[Path]:
    """The recordings of a run's directory in the order of their names, or ``run`` itself where it is a recording.

    Those that show two configurations side by side are left out.

    Raises
    ------
    VfoaError
        If there is none, or none of that clip and configuration.
    """
    if run.is_file() and run.suffix == ".rrd":
        return [run]
    recordings = sorted(path for path in run.glob("*__*.rrd") if VERSUS not in path.stem)
    if not recordings:
        if run.is_dir():
            raise VfoaError(
                f"{run}: expected a run's directory with recordings (*.rrd), found none (run with --recording none?)"
            )
        raise VfoaError(f"{run}: expected a run's directory or a recording (.rrd), found nothing there")
    if clip is not None:
        known = {pair_of(path.stem)[0] for path in recordings}
        recordings = [path for path in recordings if pair_of(path.stem)[0] == clip]
        if not recordings:
            raise VfoaError(f"{run}: found no recording of clip {clip!r}; {did_you_mean(clip, known)}")
    if configuration is not None:
        known = {pair_of(path.stem)[1] for path in recordings}
        recordings = [path for path in recordings if pair_of(path.stem)[1] == configuration]
        if not recordings:
            raise VfoaError(f"{run}: found no recording under {configuration!r}; {did_you_mean(configuration, known)}")
    return recordings
