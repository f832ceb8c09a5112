"""Sources that deliver frames at their own pace: cameras, and a clip played in real time.

A recording that is being written is in ``recordings/mcap_tail.py``. :mod:`harness.run.live` processes the newest frame.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Event
from typing import Any, Protocol

import cv2
import numpy as np

from harness.sources import Clip
from harness.sources.calibration_files.read import Options, read_cameras
from harness.sources.media.video import opencv_name
from harness.sources.rectification import Rectifier
from vfoa.errors import VfoaError
from vfoa.types import Image, StereoFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrival:
    """A frame that has arrived and is not decoded: its number, its time, and its arrival (:func:`time.monotonic`).

    ``read`` decodes it, in any thread; it raises :class:`vfoa.errors.VfoaError` for a damaged one.
    """

    number: int
    time_ns: int
    arrived_s: float
    read: Callable[[], StereoFrame]


class LiveSource(Protocol):
    """A source that delivers frames whether or not anybody is ready for them."""

    @property
    def rate_hz(self) -> float | None:
        """Frames per second; None if not known."""
        ...

    def arrivals(self, stopped: Event) -> Iterator[Arrival]:
        """Yield frames as they arrive, with ascending numbers; ends with the source, or soon after ``stopped`` is set.

        The first one is for rehearsal: a source that can wait gives it at once, and again after :meth:`begin`.

        Raises
        ------
        VfoaError
            If there is nothing to read, or no more.
        """
        ...

    def begin(self) -> None:
        """Tell the source that everything is ready: frames from now on count."""
        ...


_POLL_S = 0.05


class PlayedClip:
    """A clip whose frames arrive at the times at which they were taken, counted from the first one."""

    def __init__(self, clip: Clip, where: str) -> None:
        self._clip, self._begun = clip, Event()
        self._due = [(number, clip.time_ns(number)) for number in clip.frames]
        if len(self._due) > 1 and self._due[0][1] == self._due[-1][1]:
            raise VfoaError(f"{where}: all frames have the same time; expected a clip with times, to play it")

    @property
    def rate_hz(self) -> float | None:
        """The clip's frame rate."""
        return self._clip.rate_hz

    def arrivals(self, stopped: Event) -> Iterator[Arrival]:
        """As in :class:`harness.sources.live.LiveSource`; frames have the clip's numbers."""
        yield self._arrival(0, time.monotonic())
        while not self._begun.wait(_POLL_S):
            if stopped.is_set():
                return
        started_s = time.monotonic()
        for place, (_, time_ns) in enumerate(self._due):
            due_s = started_s + (time_ns - self._due[0][1]) / 1e9
            if stopped.wait(max(due_s - time.monotonic(), 0)):
                return
            yield self._arrival(place, due_s)

    def begin(self) -> None:
        """Start to play."""
        self._begun.set()

    def _arrival(self, place: int, arrived_s: float) -> Arrival:
        number, time_ns = self._due[place]
        return Arrival(number=number, time_ns=time_ns, arrived_s=arrived_s, read=partial(self._clip.frame, number))


def open_capture(name: str) -> Any:
    """Open a camera by its number, or anything else that OpenCV opens (a stream's address).

    Raises
    ------
    VfoaError
        If it cannot be opened.
    """
    capture = cv2.VideoCapture(int(name) if name.isdecimal() else opencv_name(name))
    if not capture.isOpened():
        raise VfoaError(f"camera {name}: cannot be opened; expected the number of a camera, or a stream's address")
    return capture


class CameraPair:
    """Two cameras that are grabbed one right after the other; a frame's time is that of the left one's grab.

    Numbers begin at 1. Nothing synchronises the two: a fast object is seen at two places, unless the cameras trigger
    each other.

    Parameters
    ----------
    left, right
        Open captures, as of ``cv2.VideoCapture``.
    calibration
        Any calibration file that a stereo folder may have.
    rectified
        The images are rectified already.
    """

    rate_hz = None

    def __init__(self, left: Any, right: Any, calibration: Path, *, rectified: bool = False) -> None:
        self._captures = left, right
        self._calibration, self._rectified = calibration, rectified
        self._rectifier: Rectifier | None = None

    def arrivals(self, stopped: Event) -> Iterator[Arrival]:
        """As in :class:`harness.sources.live.LiveSource`; ends when a camera delivers no more frames."""
        number, started_s = 0, time.monotonic()
        while not stopped.is_set():
            arrived_s = time.monotonic()
            grabbed = [capture.grab() for capture in self._captures]  # grab from both, even if the first one fails
            if not all(grabbed):
                return
            images = [capture.retrieve() for capture in self._captures]
            if not all(found for found, _ in images):
                continue
            number += 1
            (_, left), (_, right) = images
            yield self._arrival(number, arrived_s, round((arrived_s - started_s) * 1e9), left, right)

    def begin(self) -> None:
        """Do nothing: cameras do not wait."""

    def _arrival(self, number: int, arrived_s: float, time_ns: int, left: Any, right: Any) -> Arrival:
        def read() -> StereoFrame:
            return self._frame(number, time_ns, _rgb(left), _rgb(right))

        return Arrival(number=number, time_ns=time_ns, arrived_s=arrived_s, read=read)

    def _frame(self, number: int, time_ns: int, left: Image, right: Image) -> StereoFrame:
        if self._rectifier is None:
            size = (left.shape[1], left.shape[0])
            self._rectifier = Rectifier(
                read_cameras([self._calibration], lambda: size, Options(rectified=self._rectified))
            )
        left, right = self._rectifier.rectify(left, right)
        rig = self._rectifier.calibration.rig(left.shape[1], left.shape[0])
        return StereoFrame(index=number, time_ns=time_ns, left=left, right=right, rig=rig)


def _rgb(image: Any) -> Image:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)
