"""Tracking: who is who from one frame to the next, by the overlap of head boxes alone.

The IOU tracker (Bochinski, Eiselein and Sikora, AVSS 2017) with its parameters: detections below ``sigma_l`` are
left out; each track, oldest first, takes the free detection that overlaps its last box most, if by ``sigma_iou`` or
more, and otherwise ends; what is left starts tracks. ``ttl`` lets a track outlive a gap, as the authors' V-IOU does,
but without its visual tracker: the last box waits where it was.

The published rule looks back: a track counts only if it came to ``sigma_h`` and ``t_min``. Attention is needed in
every frame, so here a track is reported from its first frame on, and :attr:`Track.confirmed` says whether it counts
so far. :func:`final_tracks` is the published rule over a whole sequence.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from pydantic import Field, NonNegativeInt, PositiveInt

from vfoa.geometry import box_iou
from vfoa.settings import Settings
from vfoa.types import Float, Head, Person


class TrackingSettings(Settings):
    """Settings of :func:`track_people`, named as published.

    ``sigma_l`` and ``sigma_h`` are scores of heads: the least to be followed, and what one head of a track must come
    to for it to count. ``sigma_iou`` is the least overlap from frame to frame, ``t_min`` the least number of heads of
    a track that counts. ``ttl`` is the longest gap in frames; 0 is the published rule.
    """

    sigma_l: float = Field(default=0.0, ge=0)
    sigma_h: float = Field(default=0.5, ge=0)
    sigma_iou: float = Field(default=0.5, gt=0, le=1)
    t_min: PositiveInt = 2
    ttl: NonNegativeInt = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Track:
    """One person followed so far: the last head box (4,), the best score, the heads seen, the frames missed since."""

    id: int
    box_px: Float
    best_score: float
    length: int = 1
    missed: int = 0

    def confirmed(self, settings: TrackingSettings) -> bool:
        """Whether the track counts by the published rule, from what was seen of it so far."""
        return self.best_score >= settings.sigma_h and self.length >= settings.t_min

    def followed(self, head: Head) -> Track:
        """The track with one more head."""
        score = max(self.best_score, head.score)
        return replace(self, box_px=head.box_px, best_score=score, length=self.length + 1, missed=0)


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
            tracks.append(track.followed(person.view.head))
        elif track.missed < settings.ttl:
            tracks.append(replace(track, missed=track.missed + 1))

    for new_id, person in enumerate(free, start=state.next_id):
        head = person.view.head
        tracked.append((new_id, person))
        tracks.append(Track(id=new_id, box_px=head.box_px, best_score=head.score))

    return tuple(tracked), TrackerState(tracks=tuple(tracks), next_id=state.next_id + len(free))


def final_tracks(
    frames: Iterable[tuple[Person, ...]], settings: TrackingSettings
) -> dict[int, tuple[tuple[int, Person], ...]]:
    """The tracks of a whole sequence that count by the published rule: id -> (position in ``frames``, person)."""
    state = TrackerState()
    members: dict[int, list[tuple[int, Person]]] = {}
    last: dict[int, Track] = {}
    for position, people in enumerate(frames):
        tracked, state = track_people(people, state, settings)
        last.update((track.id, track) for track in state.tracks)
        for track_id, person in tracked:
            members.setdefault(track_id, []).append((position, person))
    return {track_id: tuple(found) for track_id, found in members.items() if last[track_id].confirmed(settings)}
