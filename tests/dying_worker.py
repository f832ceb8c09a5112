"""A sink that kills its process at one frame of one clip, but only the first time."""

from __future__ import annotations

import os
import signal
from collections.abc import Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

from harness.remote import Remote
from harness.run.checkpoint import SinkState
from harness.run.frame_sink import FinishedFrame, SinkContext

DIED, CONTINUED = "died", "continued"
"""The files at the address with the process that died, and the first frame of the process that came after it."""


@dataclass(frozen=True)
class DyingWorkers:
    """Opens the sinks; ``address`` is where the deed is noted before it is done."""

    address: str
    clip: str
    frame: int

    def described(self) -> Mapping[str, Any]:
        return {}

    def open(self, context: SinkContext) -> _Dying | None:
        return _Dying(self) if context.manifest.name == self.clip else None


class _Dying:
    def __init__(self, how: DyingWorkers) -> None:
        self._how = how
        self._is_first = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def state(self) -> SinkState:
        return SinkState(files={})

    def write(self, frame: FinishedFrame) -> None:
        remote = Remote(self._how.address)
        if self._is_first and remote.has(DIED):
            remote.write(CONTINUED, str(frame.record.frame).encode())
        self._is_first = False
        if frame.record.frame == self._how.frame and not remote.has(DIED):
            remote.write(DIED, str(os.getpid()).encode())
            os.kill(os.getpid(), signal.SIGKILL)
