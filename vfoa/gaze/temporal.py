"""A window of frames around each frame: the input of a temporal gaze model for each person.

A frame's gaze is known only after later frames are read. A window therefore gets every frame in order, and is asked for
the gazes of a frame when ``look_ahead`` more have been added, or the clip has ended.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from vfoa.gaze import REACH, TemporalGazeModel
from vfoa.types import Gaze, HeadView, Image, Percepts, StereoRig


@dataclass(frozen=True, slots=True, kw_only=True)
class _FrameHeads:
    """The heads of one frame with the track of each (None: not followed)."""

    rig: StereoRig
    views: tuple[HeadView, ...]
    tracks: Sequence[int | None]


class HeadWindow:
    """The recent heads of one clip by frame and track: as many frames as a gaze needs.

    Heads are followed by the rule of the pipeline (:mod:`vfoa.tracking`). A head that is not followed has no gaze.

    Parameters
    ----------
    model
        The temporal gaze model; the views hold its crops.
    rate_hz
        Frame rate of the clip; None if not known.
    step
        Usual difference of the numbers of two frames that follow each other at this rate. Numbers that are times
        differ by a little more or less.

    Raises
    ------
    VfoaError
        If the model cannot derive its stride from this rate.
    """

    def __init__(self, model: TemporalGazeModel, rate_hz: float | None, step: int = 1) -> None:
        self._model = model
        self._stride, self._jitter = model.stride(rate_hz) * step, step // 2
        self._seen: dict[int, _FrameHeads] = {}

    @property
    def look_ahead(self) -> int:
        """By how much the number of a read frame is larger than a frame's before its gazes are known."""
        return REACH * self._stride + self._jitter

    def add(self, percepts: Percepts, tracks: Sequence[int | None]) -> None:
        """Add the next frame; its views hold the model's crops, and ``tracks`` the track of each (None: none)."""
        self._seen[percepts.index] = _FrameHeads(rig=percepts.rig, views=percepts.views, tracks=tracks)

    def gazes(self, index: int) -> tuple[Gaze | None, ...]:
        """Return the gazes in a frame, in the order of its views; None for a head that is not followed.

        Ask for frames in increasing order: frames before a frame's earliest neighbour are forgotten.
        """
        seen = self._seen[index]
        self._seen = {number: kept for number, kept in self._seen.items() if number >= index - self.look_ahead}
        return tuple(
            None if track is None else self._gaze(index, view, track, seen.rig)
            for view, track in zip(seen.views, seen.tracks, strict=True)
        )

    def _gaze(self, index: int, view: HeadView, track: int, rig: StereoRig) -> Gaze:
        crops = [self._crop(index + place * self._stride, track) for place in range(-REACH, REACH + 1)]
        middle = crops[REACH]
        assert middle is not None, "a view without the crop that its model asks for"
        return self._model.estimate_sequence([middle if crop is None else crop for crop in crops], view.head, rig)

    def _crop(self, number: int, track: int) -> Image | None:
        """Return the track's crop in the frame of about this number; None if it was not seen, or there is none."""
        nearest = min(self._seen, key=lambda known: abs(known - number))
        seen = self._seen[nearest] if abs(nearest - number) <= self._jitter else None
        return seen.views[seen.tracks.index(track)].crop if seen and track in seen.tracks else None


def with_gazes(percepts: Percepts, gazes: tuple[Gaze | None, ...]) -> Percepts:
    """Return the percepts with a gaze for each view, in the order of the views."""
    views = tuple(replace(view, gaze=gaze) for view, gaze in zip(percepts.views, gazes, strict=True))
    return replace(percepts, views=views)
