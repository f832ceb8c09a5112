"""The observer of a run: writes each frame into one Rerun recording, and changes nothing."""

from __future__ import annotations

import datetime
import uuid
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import rerun as rr

from harness.recording import ShownFrame, Size, entities
from harness.recording.attention import log_attention
from harness.recording.blueprint import blueprint, guide
from harness.recording.frame_log import FrameLog
from harness.recording.labels import Colours
from harness.recording.scene import log_targets
from harness.recording.stages import log_disparity, log_heads, log_images, log_masks
from harness.recording.verdicts import log_verdicts
from vfoa.types import Scene

APPLICATION = "vfoa"

_FLUSHED_EVERY = 50
"""Frames: what waits in memory to be written does not grow with the clip, and a kill loses no more."""


class Recorder:
    """One recording of one clip under one configuration, as a context manager.

    Frames are written to ``<name>.rrd.partial``, which becomes ``path`` at the end of the ``with`` block. After an
    error or a kill only the partial file is left; Rerun can still read its frames.

    Parameters
    ----------
    path
        The recording, ``<clip>__<configuration>.rrd`` in a run's directory. An older one is replaced at the end.
    rate_hz
        Frames per second at which the viewer plays, None where the source does not know it.
    size
        ``light``: every second disparity, at most 15,000 points a frame, a small right view. ``full``: everything.
    subjects, targets
        The names the manifest knows, in its order: they fix the colours and give each subject its own plot. Names
        that turn up later are added as they come.
    properties
        Plain values stored with the recording under ``eval``, beside clip, configuration and the count of verdicts.
    watched_at
        The address of a viewer that is shown every frame as it is logged; None for none.
    """

    def __init__(
        self,
        path: Path,
        *,
        clip: str,
        configuration: str,
        rate_hz: float | None,
        size: Size = "light",
        subjects: Sequence[str] = (),
        targets: Sequence[str] = (),
        properties: Mapping[str, Any] | None = None,
        watched_at: str | None = None,
    ) -> None:
        self._path, self._watched_at = path, watched_at
        self._partial = path.with_name(path.name + ".partial")
        self._clip, self._configuration = clip, configuration
        self._rate_hz, self._size, self._subjects = rate_hz, size, tuple(subjects)
        self._properties = dict(properties or {})
        self._colours = Colours((*targets, *subjects))
        self._outcomes: Counter[str] = Counter()
        self._stream = rr.RecordingStream(
            APPLICATION,
            recording_id=recording_id(path, clip, configuration),
            # the default, 0.2 s, would cut a slow pipeline's recording into a chunk per frame and entity
            batcher_config=rr.ChunkBatcherConfig(flush_tick=datetime.timedelta(seconds=0.05 if watched_at else 60)),
        )
        # frames are found by the source's number and time; when they were computed is nothing to scrub through
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        self._log = FrameLog(self._stream)
        self._opened = False
        self._logged = 0

    def __enter__(self) -> Self:
        # without it, Rerun drops bad data with a warning
        rr.set_strict_mode(True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            if not self._opened:
                self._open(None)
            self._send_properties()
        if self._opened:
            self._log.close()
            self._stream.flush()
        self._stream.disconnect()
        if error is None:
            self._partial.replace(self._path)

    def log(self, shown: ShownFrame) -> None:
        """Write one frame."""
        if not self._opened:
            self._open(shown.result.scene)
        log, frame, percepts, result, record = self._log, shown.frame, shown.percepts, shown.result, shown.record
        log.begin(frame.index, frame.time_ns)
        log_images(log, frame, self._size)
        log_disparity(log, percepts, self._size)
        log_masks(log, percepts, record, self._colours)
        log_heads(log, record)
        log_targets(log, result.scene, record, self._colours, self._size)
        log_attention(log, result, record, self._colours)
        log_verdicts(log, record, shown.verdicts, self._colours)
        log.end()
        self._logged += 1
        if self._logged % _FLUSHED_EVERY == 0:
            self._stream.flush()
        if self._watched_at:
            log.close()  # whoever looks on wants the curves now
        self._outcomes.update(verdict.outcome for verdict in shown.verdicts)

    def _open(self, first: Scene | None) -> None:
        """Open the file; the layout in its head looks at the first frame's scene."""
        self._opened = True
        self._path.parent.mkdir(parents=True, exist_ok=True)
        layout = blueprint(first, self._subjects, self._rate_hz, self._size, follow=self._watched_at is not None)
        if self._watched_at is None:
            self._stream.save(self._partial, default_blueprint=layout)
        else:
            sinks = rr.FileSink(self._partial), rr.GrpcSink(self._watched_at)
            self._stream.set_sinks(*sinks, default_blueprint=layout)
        self._stream.send_recording_name(f"{self._clip}, {self._configuration}")
        self._stream.log(entities.WORLD, rr.ViewCoordinates.RDF, static=True)
        self._stream.log(entities.GUIDE, guide(), static=True)

    def _send_properties(self) -> None:
        counts = {outcome: self._outcomes[outcome] for outcome in ("correct", "wrong", "unscored")}
        values = {"clip": self._clip, "configuration": self._configuration, **counts, **self._properties}
        scored = counts["correct"] + counts["wrong"]
        if scored:
            values.setdefault("frr", counts["correct"] / scored)
        self._stream.send_property("eval", rr.AnyValues(**values))


def recording_id(path: Path, clip: str, configuration: str) -> str:
    """The same for the same run, clip and configuration, and another for every other run that may be open beside it."""
    return str(uuid.uuid5(uuid.NAMESPACE_URL, f"vfoa:{path.parent.name}/{clip}/{configuration}"))
