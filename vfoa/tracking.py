"""Tracking: who is who from one frame to the next, by the overlap of head boxes.

People who were measured without an image have no head box: the source identifies them by the instance id.

The IOU tracker (Bochinski, Eiselein and Sikora, AVSS 2017) with its parameters: detections below ``sigma_l`` are left
out. Each track takes the free detection that overlaps its last box most, if the overlap is at least ``sigma_iou``;
otherwise it ends. The remaining detections start tracks. ``ttl`` lets a track outlive a gap, as the authors' V-IOU
does, but without its visual tracker: the last box stays in place.

The authors let the oldest track choose first. Here tracks without a gap come first, and among them the greatest
overlap: the track of a head that is hidden would otherwise take the head that hides it.

The authors drop short and doubtful tracks (``sigma_h``, ``t_min``) at the end of a sequence. Attention is needed in
every frame, so here a track is reported from its first frame on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from pydantic import Field, NonNegativeInt

from vfoa.geometry import box_iou
from vfoa.settings import Settings
from vfoa.types import Float, Person


class TrackingSettings(Settings):
    """Settings of :class:`Tracker`, named as published."""

    sigma_l: float = Field(default=0.0, ge=0)
    """Least score of a head that is followed."""
    sigma_iou: float = Field(default=0.5, gt=0, le=1)
    """Least overlap (intersection over union) of a track's boxes from frame to frame."""
    ttl: NonNegativeInt = 5
    """Longest gap of a track in frames; 0 is the published rule."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Track:
    """One person followed so far, and the frames missed since.

    ``box_px`` (4,) is the last head box; None for a person without one, who is known by ``instance_id`` instead.
    """

    id: int
    box_px: Float | None
    instance_id: int | None
    missed: int = 0

    def followed(self, person: Person) -> Track:
        """Return the track with one more head."""
        return replace(self, box_px=_box_px(person), missed=0)

    def overlap(self, person: Person) -> float:
        """Overlap of a person's head box with the last one, in [0, 1]; without head boxes, 1 for the same person."""
        head = person.head
        if head is None or self.box_px is None:
            return float(head is None and self.box_px is None and person.instance_id == self.instance_id)
        return box_iou(self.box_px, head.box_px)


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracked:
    """The tracks of one frame: of each person, in their order (None: not followed), and all that are still open."""

    ids: tuple[int | None, ...]
    open: frozenset[int]

    def people(self, people: tuple[Person, ...]) -> tuple[tuple[int, Person], ...]:
        """Return those people of the frame who are followed, each with the track, in the order of the tracks' ids.

        ``people`` may have other directions than the people who were followed; the heads must be the same.
        """
        followed = [(track, person) for track, person in zip(self.ids, people, strict=True) if track is not None]
        return tuple(sorted(followed, key=lambda pair: pair[0]))


class Tracker:
    """Follows the people of one sequence, frame by frame. Ids of tracks start at 1 and are not reused."""

    def __init__(self, settings: TrackingSettings) -> None:
        self._settings = settings
        self._open: tuple[Track, ...] = ()  # oldest first
        self._begun = 0  # tracks so far

    def step(self, people: tuple[Person, ...]) -> Tracked:
        """Follow the people of the next frame. People with a head below ``sigma_l`` are left out."""
        free = {place: person for place, person in enumerate(people) if _score(person) >= self._settings.sigma_l}
        overlaps = sorted(
            (track.missed, -overlap, track.id, place)
            for track in self._open
            for place, person in free.items()
            if (overlap := track.overlap(person)) >= self._settings.sigma_iou
        )
        places = dict[int, int]()  # by track
        for *_, track_id, place in overlaps:
            if track_id not in places and place in free:
                places[track_id] = place
                del free[place]

        tracks = [
            track.followed(people[places[track.id]]) if track.id in places else replace(track, missed=track.missed + 1)
            for track in self._open
            if track.id in places or track.missed < self._settings.ttl
        ]
        ids = {place: track_id for track_id, place in places.items()}
        for new_id, (place, person) in enumerate(free.items(), start=self._begun + 1):
            ids[place] = new_id
            tracks.append(Track(id=new_id, box_px=_box_px(person), instance_id=person.instance_id))

        self._open, self._begun = tuple(tracks), self._begun + len(free)
        return Tracked(
            ids=tuple(ids.get(place) for place in range(len(people))),
            open=frozenset(track.id for track in tracks),
        )


def _box_px(person: Person) -> Float | None:
    return None if person.head is None else person.head.box_px


def _score(person: Person) -> float:
    """Score of a head; a measured person without an image has score 1."""
    return 1.0 if person.head is None else person.head.score
