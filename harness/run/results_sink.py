"""The sink of a run's results: one line per frame, in partial files that are marked when the clip is finished.

The lines of a frame go to the operating system when the frame is finished, its timings before its result. A run that
was interrupted begins the clip anew: trackers and filters carry more than the lines hold, and what was perceived is in
the stage cache.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from contextlib import ExitStack
from types import TracebackType
from typing import Any, Self

from harness.files.io import atomic_write, take_lock
from harness.run.directory import Pair, RunDirectory
from harness.run.frame_sink import FinishedFrame, SinkContext
from harness.run.results import to_line
from vfoa.errors import VfoaError

LOCK_SECONDS = 10.0
"""Seconds that the last writer of a file may take to end before it counts as another run."""


class ResultsSink:
    """Results and timings of one (clip, configuration): two partial files, written anew in a ``with`` block.

    :meth:`mark_finished` gives them their names, when all sinks of the clip are closed.
    """

    def __init__(self, directory: RunDirectory, pair: Pair) -> None:
        self._paths = directory.partial(pair, "jsonl.partial"), directory.partial(pair, "csv.partial")
        self._files = ExitStack()

    def __enter__(self) -> Self:
        """Open the files; a :class:`VfoaError` says that another process is writing them."""
        self._paths[0].parent.mkdir(parents=True, exist_ok=True)
        with ExitStack() as files:
            self._results, self._timings = (files.enter_context(open(path, "ab")) for path in self._paths)
            deadline = time.monotonic() + LOCK_SECONDS
            while not take_lock(self._results):
                if time.monotonic() > deadline:
                    raise VfoaError(f"{self._paths[0]}: another process is writing it; expected one run in a directory")
                time.sleep(0.1)
            for file in (self._results, self._timings):  # not before the lock is held
                file.truncate(0)
            self._files = files.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._files.close()

    def mark_finished(self, keys: Mapping[str, str]) -> None:
        """Mark the (clip, configuration) as finished; ``keys`` are those of its scene and directions."""
        atomic_write(self._paths[0].with_suffix("").with_suffix(".json"), json.dumps(keys))
        for draft in reversed(self._paths):  # the results' file is the mark: it is last
            draft.replace(draft.with_suffix(""))

    def write(self, frame: FinishedFrame) -> None:
        """Write one frame: its line of results, and its ms per stage."""
        record = frame.record
        prefix = f"{record.clip},{record.configuration},{record.frame}"
        rows = "".join(f"{prefix},{stage},{1e3 * seconds:.3f}\n" for stage, seconds in frame.timings.items())
        for file, content in ((self._timings, rows), (self._results, to_line(record))):
            file.write(content.encode())
            file.flush()


class ResultsSinks:
    """Opens the results of each configuration: the last sink of every run, so that it knows the times of all others."""

    def described(self) -> Mapping[str, Any]:
        """The manifest needs no entry: every run has results."""
        return {}

    def open(self, context: SinkContext) -> ResultsSink:
        """Open the results of one configuration on one clip."""
        return ResultsSink(context.directory, (context.manifest.name, context.configuration))
