"""The frames before and after: what a temporal gaze model sees of each person.

A frame's gaze is known only when later frames were read. So a window is fed every frame in order, and asked about a
frame when ``look_ahead`` more have been fed, or the clip has ended.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from vfoa.gaze import REACH, TemporalGazeModel
from vfoa.tracking import TrackerState, TrackingSettings, track_people
from vfoa.types import Gaze, HeadView, Image, Percepts, Person, StereoRig


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowStart:
    """Where a window can begin in the middle of a clip: at this frame, with the tracks as they were before it."""

    frame: int
    tracker: TrackerState


@dataclass(frozen=True, slots=True, kw_only=True)
class _Seen:
    """The heads of one frame, and the track of each (None: it is not followed); the tracks before it."""

    before: TrackerState
    rig: StereoRig
    views: tuple[HeadView, ...]
    tracks: tuple[int | None, ...]


class HeadWindow:
    """The last heads of one clip, by frame and track: as many frames as a gaze needs, no more.

    Heads are followed by the rule of the pipeline (:mod:`vfoa.tracking`), so that those that have no gaze here,
    being below ``sigma_l``, are no subjects there either.

    Parameters
    ----------
    model
        Whose crops the views hold, and which is asked.
    rate_hz
        Of the clip, None if not known.
    tracking
        How heads are followed.
    start
        The frame to begin at; those before it are left out. None: the first.

    Raises
    ------
    VfoaError
        If the model cannot say its stride at this rate.
    """

    def __init__(
        self,
        model: TemporalGazeModel,
        rate_hz: float | None,
        tracking: TrackingSettings,
        start: WindowStart | None = None,
    ) -> None:
        self._model, self._tracking, self._start = model, tracking, start
        self._stride = model.stride(rate_hz)
        self._tracker = start.tracker if start else TrackerState()
        self._seen: dict[int, _Seen] = {}

    @property
    def look_ahead(self) -> int:
        """How far beyond a frame's number the frames must have been read before its gazes can be known."""
        return REACH * self._stride

    def begin_by(self, start: WindowStart | None) -> None:
        """Begin early enough for another user as well, before the first frame is added; None: with the clip."""
        if self._start and (start is None or start.frame < self._start.frame):
            self._start, self._tracker = start, start.tracker if start else TrackerState()

    def add(self, percepts: Percepts) -> None:
        """Take in the next frame; its views hold the model's crops."""
        if self._start and percepts.index < self._start.frame:
            return
        before = self._tracker
        people = tuple(Person(view=view, instance_id=None, eye_origin_left=None) for view in percepts.views)
        tracked, self._tracker = track_people(people, self._tracker, self._tracking)
        track_of = {id(person): track for track, person in tracked}
        tracks = tuple(track_of.get(id(person)) for person in people)
        self._seen[percepts.index] = _Seen(before=before, rig=percepts.rig, views=percepts.views, tracks=tracks)

    def gazes(self, index: int) -> tuple[Gaze | None, ...]:
        """The gazes in a frame, in the order of its views; None for a head that is not followed.

        Frames must be asked about in order: those before its earliest neighbour are forgotten.
        """
        seen = self._seen[index]
        self._seen = {number: kept for number, kept in self._seen.items() if number >= index - self.look_ahead}
        return tuple(
            None if track is None else self._gaze(index, view, track, seen.rig)
            for view, track in zip(seen.views, seen.tracks, strict=True)
        )

    def start(self) -> WindowStart:
        """Where a window must begin to have the gazes of the frame that was asked about last, and of all after it."""
        first = min(self._seen)
        return WindowStart(frame=first, tracker=self._seen[first].before)

    def _gaze(self, index: int, view: HeadView, track: int, rig: StereoRig) -> Gaze:
        numbers = range(index - self.look_ahead, index + self.look_ahead + 1, self._stride)
        crops = [self._crop(number, track) for number in numbers]
        middle = crops[REACH]
        assert middle is not None, "a view without the crop that its model asks for"
        return self._model.estimate_sequence([middle if each is None else each for each in crops], view.head, rig)

    def _crop(self, number: int, track: int) -> Image | None:
        """What the track looks like in a frame; None where it was not seen, or there is no such frame."""
        seen = self._seen.get(number)
        return seen.views[seen.tracks.index(track)].crop if seen and track in seen.tracks else None


def with_gazes(percepts: Percepts, gazes: tuple[Gaze | None, ...]) -> Percepts:
    """The percepts with a gaze for each view, in their order."""
    views = tuple(replace(view, gaze=gaze) for view, gaze in zip(percepts.views, gazes, strict=True))
    return replace(percepts, views=views)
