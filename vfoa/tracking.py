"""Tracking: who is who from one frame to the next, by the overlap of head boxes alone.

The IOU tracker (Bochinski, Eiselein and Sikora, AVSS 2017) with its parameters: detections below ``sigma_l`` are
left out; each track, oldest first, takes the free detection that overlaps its last box most, if by ``sigma_iou`` or
more, and otherwise ends; what is left starts tracks. ``ttl`` lets a track outlive a gap, as the authors' V-IOU does,
but without its visual tracker: the last box waits where it was.

The published rule also looks back: a track counts only if it came to a good head and a least length (sigma_h and
t_min) in the end. Attention is needed in every frame, so here a track is reported from its first frame on, and none
is taken back.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from pydantic import Field, NonNegativeInt

from vfoa.geometry import box_iou
from vfoa.settings import Settings
from vfoa.types import Float, Person


class TrackingSettings(Settings):
    """Settings of :func:`track_people`, named as published.

    ``sigma_l`` is the least score of a head that is followed, ``sigma_iou`` the least overlap from frame to frame.
    ``ttl`` is the longest gap in frames; 0 is the published rule.
    """

    sigma_l: float = Field(default=0.0, ge=0)
    sigma_iou: float = Field(default=0.5, gt=0, le=1)
    ttl: NonNegativeInt = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Track:
    """One person followed so far: the last head box (4,), and the frames missed since."""

    id: int
    box_px: Float
    missed: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackerState:
    """The tracks that are still open, oldest first, and the id of the next one. Ids start at 1 and are not reused."""

    tracks: tuple[Track, ...] = ()
    next_id: int = 1


def track_people(
    people: tuple[Person, ...], state: TrackerState, settings: TrackingSettings
) -> tuple[tuple[tuple[int, Person], ...], TrackerState]:
    """Give each person of one frame the id of a track; people come back in the order of their ids.

    Left out are those with a head below ``sigma_l``.
    """
    free = [person for person in people if person.view.head.score >= settings.sigma_l]
    tracked, tracks = [], []

    for track in state.tracks:
        overlaps = [box_iou(track.box_px, person.view.head.box_px) for person in free]
        if max(overlaps, default=0.0) >= settings.sigma_iou:
            person = free.pop(overlaps.index(max(overlaps)))
            tracked.append((track.id, person))
            tracks.append(Track(id=track.id, box_px=person.view.head.box_px))
        elif track.missed < settings.ttl:
            tracks.append(replace(track, missed=track.missed + 1))

    for new_id, person in enumerate(free, start=state.next_id):
        tracked.append((new_id, person))
        tracks.append(Track(id=new_id, box_px=person.view.head.box_px))

    return tuple(tracked), TrackerState(tracks=tuple(tracks), next_id=state.next_id + len(free))
