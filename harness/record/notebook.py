"""A recording in the Rerun viewer of a notebook."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import rerun as rr

from harness.record.composed import Composed
from harness.record.reading import reading
from vfoa.errors import VfoaError

if TYPE_CHECKING:
    from rerun.notebook import Viewer

HEIGHT_PX = 640


def show_recording(recording: Composed, frame: int | None = None) -> Viewer:
    """Return a viewer that shows a recording, as the last value of a cell; with ``frame``, it opens there.

    Raises
    ------
    VfoaError
        If the notebook part of Rerun is not installed, or the recording cannot be read.
    """
    from rerun.notebook import HAS_NOTEBOOK, Viewer

    if not HAS_NOTEBOOK:
        raise VfoaError('the notebook viewer is not installed; install it: pip install "vfoa[notebook]"')
    stream = rr.RecordingStream(recording.application_id)
    viewer = Viewer(width="auto", height=HEIGHT_PX, recording=stream)
    with tempfile.TemporaryDirectory() as scratch:
        for file in recording.files_to_open(Path(scratch)):
            with reading(file):
                stream.log_file_from_path(file)
        stream.flush()
    if frame is not None:
        viewer.set_time_ctrl(timeline="frame", sequence=frame)
    return viewer
