"""The answers of a configuration on a clip: written as they are made, with the time that they took.

The answers are a table (:mod:`harness.run.tables`), the times a CSV file. Both have draft names in ``partial/`` until
the configuration is finished. A run that was interrupted attends to the clip anew: methods and filters carry more than
the answers hold.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import fields
from operator import attrgetter
from typing import Any, Self

from harness.files.io import take_lock
from harness.run.directory import Pair, RunDirectory
from harness.run.frame_sink import FinishedFrame
from harness.run.records import FrameRecord
from harness.run.table_files import Row, TableWriter
from harness.run.timings import time_rows
from vfoa.errors import VfoaError
from vfoa.types import CUES, Cue, DirectionFit

LOCK_SECONDS = 10.0
"""Seconds that the last writer of a file may take to end before it counts as another run."""


def filtered_cues(settings: Mapping[str, Any]) -> tuple[Cue, ...]:
    """The cues that a configuration filters, by its settings in the run's manifest."""
    cues = settings.get("gaze_filter", {}).get("cues", "off")
    return tuple(cue for cue in CUES if cues in ("both", cue))


class AnswerWriter:
    """Writes the answers and times of one (clip, configuration) anew, in a ``with`` block.

    It is the last sink of every configuration, so that it knows the times of all others. :meth:`finish` gives the files
    their names, when all of these sinks are closed.

    Parameters
    ----------
    keys
        ``scene`` and ``directions`` that the answers come from.
    filtered
        The cues that are filtered.
    """

    def __init__(
        self, directory: RunDirectory, pair: Pair, keys: Mapping[str, str], filtered: tuple[Cue, ...] = ()
    ) -> None:
        self._answers, self._times = directory.answers(pair), directory.partial(pair, "csv")
        self._drafts = directory.partial(pair, "answers.partial"), directory.partial(pair, "csv.partial")
        self._keys = {"clip": pair[0], **keys, "configuration": pair[1]}
        self._filtered = filtered
        self._files = ExitStack()

    def __enter__(self) -> Self:
        """Open the files; a :class:`VfoaError` says that another process is writing them."""
        answers, times = self._drafts
        times.parent.mkdir(parents=True, exist_ok=True)
        with ExitStack() as files:
            self._rows = files.enter_context(open(times, "ab"))
            deadline = time.monotonic() + LOCK_SECONDS
            while not take_lock(self._rows):
                if time.monotonic() > deadline:
                    raise VfoaError(f"{times}: another process is writing it; expected one run in a directory")
                time.sleep(0.1)
            self._rows.truncate(0)  # not before the lock is held
            self._table = files.enter_context(TableWriter({"answers": answers}, self._keys))
            self._files = files.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        self._files.__exit__(*error)

    def write(self, frame: FinishedFrame) -> None:
        """Write one frame: the rows of its answers, and its ms per stage."""
        record = frame.record
        self._rows.write(time_rows((record.clip, record.configuration), record.frame, frame.timings))
        self._rows.flush()
        self._table.add({"answers": answer_rows(record, self._filtered)})

    def finish(self) -> None:
        """Mark the (clip, configuration) as finished."""
        answers, times = self._drafts
        self._answers.parent.mkdir(parents=True, exist_ok=True)
        answers.replace(self._answers)
        times.replace(self._times)  # it is the mark: it is last


_OF_FIT = tuple(each.name for each in fields(DirectionFit))
_FIT = attrgetter(*_OF_FIT)


def answer_rows(record: FrameRecord, filtered: tuple[Cue, ...]) -> Iterator[Row]:
    """The rows of a frame's answers."""
    for subject in record.subjects:
        attention = subject.attention
        yield (
            *(record.frame, subject.track_id, subject.missing, subject.focus, subject.tied),
            [value.instance_id for value in attention],
            [value.gaze for value in attention],
            [value.head for value in attention],
            [value.total for value in attention],
            dict(zip(_OF_FIT, _FIT(subject.fit), strict=True)) if subject.fit else None,
            *((getattr(subject, cue) if cue in filtered else None) for cue in CUES),
        )
