"""Give the names of a manifest to instances and tracks.

A rule identifies one object or person by what the pipeline knows: its category and, if several share it, its own id in
the source, its place from the left, or a place in the image.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from harness.files.safe_names import composed
from vfoa.geometry import box_iou
from vfoa.settings import Settings
from vfoa.tracking import Tracked
from vfoa.types import Float, Instance, Scene

PointPx = tuple[float, float]

HUES = ("blue", "orange", "green", "pink", "violet", "brown", "cyan", "yellow", "magenta", "olive")
PATTERNS = ("plain", "diagonal", "vertical", "horizontal")
_WHICH = ("instance", "from_left", "at_px", "box_px")
_COLOUR = rf"^({'|'.join(HUES)}) ({'|'.join(PATTERNS)})$"


class NameRule(Settings):
    """The rule of a name: an instance of ``category`` (the segmenter's word), and which one if there are several.

    At most one of: ``instance``, the id it has in the source; ``from_left``, 1 for the leftmost of its category;
    ``at_px`` (u, v), the nearest to this point; ``box_px`` (u0, v0, u1, v1), the one that overlaps this box most. With
    none of them, a target's name is shared by all of the category, a subject's goes to one person at a time.

    ``key`` and ``colour`` are the name's own on the labelling page, which assigns them (:mod:`harness.clips.naming`).
    ``formerly`` are earlier names of a renamed target: results of runs have them
    (:meth:`harness.clips.manifest.ClipManifest.names_now`).
    """

    category: str
    instance: int | None = Field(default=None, gt=0)
    from_left: int | None = Field(default=None, gt=0)
    at_px: tuple[float, float] | None = None
    box_px: tuple[float, float, float, float] | None = None
    key: str | None = Field(default=None, pattern=r"^(shift\+)?[0-9]$")
    colour: str | None = Field(default=None, pattern=_COLOUR)
    formerly: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _one_choice(self) -> Self:
        given = [key for key in _WHICH if getattr(self, key) is not None]
        if len(given) > 1:
            raise ValueError(f"found {' and '.join(given)}; expected at most one of them beside category")
        return self

    @property
    def is_shared(self) -> bool:
        """Whether the rule has only a category."""
        return all(getattr(self, key) is None for key in _WHICH)


@dataclass(frozen=True, slots=True, kw_only=True)
class SubjectNames:
    """State carried from frame to frame: the name of each track, and the last position of each name (a head, px).

    ``of_source`` are the names that the source gave: whomever it calls otherwise has none of them.
    """

    by_track: Mapping[int, str] = field(default_factory=dict)
    of_source: frozenset[str] = frozenset()
    last_seen_px: Mapping[str, PointPx] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameNames:
    """The names in one frame: of the named tracks by track id, and of every target by instance id."""

    subjects: Mapping[int, str]
    targets: Mapping[int, str]


Rules = Mapping[str, NameRule]

_AUTOMATIC = re.compile(r".+#\d+")


def is_automatic(name: str) -> bool:
    """Whether a name is one of an object that the manifest does not name: ``label#id``."""
    return _AUTOMATIC.fullmatch(name) is not None


class Namer:
    """Names the people and the targets of one clip, frame by frame; it holds the memory of :func:`name_frame`."""

    def __init__(self, subjects: Rules, targets: Rules) -> None:
        self._subjects, self._targets, self._memory = subjects, targets, SubjectNames()

    def step(self, scene: Scene, tracked: Tracked) -> FrameNames:
        """Name the next frame."""
        names, self._memory = name_frame(scene, tracked, self._subjects, self._targets, self._memory)
        return names


def name_frame(
    scene: Scene, tracked: Tracked, subjects: Rules, targets: Rules, memory: SubjectNames
) -> tuple[FrameNames, SubjectNames]:
    """Name the people and the targets of one frame."""
    memory = name_subjects(scene, tracked, subjects, memory)
    present = {track: person.instance_id for track, person in tracked.people(scene.people)}
    named = {track: memory.by_track[track] for track in present if track in memory.by_track}
    of_people = {present[track]: name for track, name in named.items()}
    seen = [(target.instance, target.box_px) for target in scene.targets]
    return FrameNames(subjects=named, targets=name_instances(seen, of_people, subjects, targets, memory)), memory


def name_subjects(scene: Scene, tracked: Tracked, rules: Rules, memory: SubjectNames) -> SubjectNames:
    """Name the tracks of one frame that have no name yet; a track keeps its name, unless its source knows it.

    The name of an ended track goes to the unnamed person nearest to its last position; a name that was never given goes
    by its rule. People whose instance is not known (or not of the category) get none.
    """
    people = _people(scene, tracked)
    by_source = {person.own_name: person.key for person in people if person.own_name and person.own_name in rules}
    of_source, called = memory.of_source | by_source.keys(), {person.key: person.own_name for person in people}
    by_track = {
        track: name
        for track, name in memory.by_track.items()
        if name not in by_source and not _is_another(called.get(track), name, of_source)
    }
    by_track |= {track: name for name, track in by_source.items()}
    present = {person.key: by_track[person.key] for person in people if person.key in by_track}
    named = _named(present, _in_turn(rules, memory), people, of_source)
    by_track = {track: name for track, name in by_track.items() if name not in named.values()} | named
    seen = {
        by_track[candidate.key]: place
        for candidate in people
        if candidate.key in by_track and (place := candidate.center_px)
    }
    return SubjectNames(by_track=by_track, of_source=of_source, last_seen_px={**memory.last_seen_px, **seen})


def name_instances(
    seen: Sequence[tuple[Instance, Float | None]],
    of_people: Mapping[int | None, str],
    subjects: Rules,
    targets: Rules,
    memory: SubjectNames,
) -> dict[int, str]:
    """Name every instance of a frame: by the subject it belongs to, its own name, the rules, or as ``label#id``.

    ``seen`` has the instances with their boxes (4,), ``of_people`` the names of subjects by the ids of their instances.
    """
    things = [
        _Candidate(
            key=instance.id,
            instance_id=instance.id,
            label=instance.label,
            box_px=box_px,
            own_name=composed(instance.name) if instance.name else None,
        )
        for instance, box_px in seen
    ]
    names = {instance_id: name for instance_id, name in of_people.items() if instance_id is not None}
    known = {**subjects, **targets}
    for instance, _ in seen:
        own_name = composed(instance.name or "")
        if own_name in known and own_name not in names.values():
            names.setdefault(instance.id, own_name)
    exact = {name: rule for name, rule in targets.items() if not rule.is_shared}
    names = _named(names, (*_in_turn(subjects, memory), exact), things, memory.of_source)
    shared = {rule.category: name for name, rule in targets.items() if rule.is_shared}
    names |= {thing.key: shared[thing.label] for thing in things if thing.key not in names and thing.label in shared}
    return {instance.id: names.get(instance.id, instance.automatic_name) for instance, _ in seen}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Candidate:
    """A person or object that may get a name: ``key`` is its track or instance id, ``label`` None if not known.

    ``box_px`` is None without an image: then only the category and the source's own id can distinguish candidates.
    ``own_name`` is the name of its instance, if the source gave one.
    """

    key: int
    instance_id: int | None
    label: str | None
    box_px: Float | None
    own_name: str | None = None

    @property
    def center_px(self) -> PointPx | None:
        if self.box_px is None:
            return None
        u0, v0, u1, v1 = self.box_px.tolist()
        return (u0 + u1) / 2, (v0 + v1) / 2


def _people(scene: Scene, tracked: Tracked) -> list[_Candidate]:
    instances = {target.instance.id: target.instance for target in scene.targets}
    people = []
    for track, person in tracked.people(scene.people):
        instance_id, head = person.instance_id, person.head
        instance = None if instance_id is None else instances.get(instance_id)
        people.append(
            _Candidate(
                key=track,
                instance_id=instance_id,
                label=None if instance is None else instance.label,
                box_px=None if head is None else head.box_px,
                own_name=composed(instance.name) if instance and instance.name else None,
            )
        )
    return people


def _in_turn(rules: Rules, memory: SubjectNames) -> tuple[Rules, Rules]:
    """Rules that find names seen before, by the source's own id, else by the last position; then those of new names."""
    returning = {
        name: rule if rule.instance is not None else NameRule(category=rule.category, at_px=memory.last_seen_px[name])
        for name, rule in rules.items()
        if name in memory.last_seen_px
    }
    return returning, {name: rule for name, rule in rules.items() if name not in returning}


def _is_another(own_name: str | None, name: str, of_source: Collection[str]) -> bool:
    """Whether the source calls somebody otherwise than by this name, which it gave: then it is not lost, but absent."""
    return own_name is not None and own_name != name and name in of_source


def _named(
    names: Mapping[int, str], rounds: Iterable[Rules], everyone: Sequence[_Candidate], of_source: Collection[str]
) -> dict[int, str]:
    """The names by candidates' keys: those given, then those that the rules find, round by round."""
    named = dict(names)
    for rules in rounds:
        free = {name: rule for name, rule in rules.items() if name not in named.values()}
        unnamed = [candidate for candidate in everyone if candidate.key not in named]
        named |= _assign(free, unnamed, everyone, of_source)
    return named


def _assign(
    rules: Rules, candidates: Iterable[_Candidate], everyone: Iterable[_Candidate], of_source: Collection[str]
) -> dict[int, str]:
    """Assign names to candidates' keys, each name and each candidate at most once, the best match first.

    Places from the left are counted among ``everyone``.
    """
    places = _places_from_left(everyone)
    matches = sorted(
        (match, places[candidate.key], order, candidate.key, name)
        for order, (name, rule) in enumerate(rules.items())
        for candidate in candidates
        if not _is_another(candidate.own_name, name, of_source)
        and (match := _match(rule, candidate, places[candidate.key])) is not None
    )
    assigned: dict[int, str] = {}
    for *_, key, name in matches:
        if key not in assigned and name not in assigned.values():
            assigned[key] = name
    return assigned


def _places_from_left(candidates: Iterable[_Candidate]) -> dict[int, int]:
    """The place of each candidate among those of its category, 1 = leftmost, by the middle of its box."""
    places: dict[int, int] = {}
    count: dict[str | None, int] = {}
    for candidate in sorted(candidates, key=lambda candidate: (candidate.center_px or (0.0, 0.0), candidate.key)):
        count[candidate.label] = places[candidate.key] = count.get(candidate.label, 0) + 1
    return places


def _match(rule: NameRule, candidate: _Candidate, place: int) -> tuple[float, ...] | None:
    """How well a candidate fits a rule (smaller is better, certain rules before loose ones); None: not at all."""
    if candidate.label != rule.category:
        return None
    if rule.instance is not None:
        return (0,) if candidate.instance_id == rule.instance else None
    if candidate.box_px is None:
        return (3,) if rule.is_shared else None
    if rule.from_left is not None:
        return (1,) if place == rule.from_left else None
    if rule.at_px is not None:
        return (2, *_distances_px(candidate.box_px, rule.at_px))
    if rule.box_px is not None:
        overlap = box_iou(candidate.box_px, np.array(rule.box_px))
        return (2, 1 - overlap) if overlap > 0 else None
    return (3,)


def _distances_px(box_px: Float, point_px: PointPx) -> tuple[float, float]:
    """Distance of a point to a box (0 inside) and to its middle."""
    point, low, high = np.array(point_px), box_px[:2], box_px[2:]
    to_box = np.maximum(np.maximum(low - point, point - high), 0)
    return float(np.linalg.norm(to_box)), float(np.linalg.norm(point - (low + high) / 2))


DIGITS = "1234567890"
KEYS = (*DIGITS, *(f"shift+{digit}" for digit in DIGITS))
COLOURS = tuple(
    f"{HUES[place % len(HUES)]} {PATTERNS[(place + place // 20) % len(PATTERNS)]}"
    for place in range(len(HUES) * len(PATTERNS))
)
"""Twenty names in a row differ by colour and by pattern."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KeyAndColour:
    """A key of :data:`KEYS`, None if all are taken, and a colour of :data:`COLOURS`."""

    key: str | None
    colour: str


def keys_and_colours(rules: Mapping[str, NameRule]) -> dict[str, KeyAndColour]:
    """Return the key and colour of every name.

    Names without a key or colour in the manifest get those of their place, or the next free ones.

    Parameters
    ----------
    rules
        The manifest's targets, then its subjects, which are targets as well.
    """
    keys = _fill([rule.key for rule in rules.values()], KEYS)
    colours = _fill([rule.colour for rule in rules.values()], COLOURS)
    return {
        name: KeyAndColour(key=keys[place], colour=colours[place] or COLOURS[place % len(COLOURS)])
        for place, name in enumerate(rules)
    }


def _fill(given: Sequence[str | None], choices: Sequence[str]) -> list[str | None]:
    """The given value, else the choice at its own place, else the first free choice; None if nothing is free."""
    filled = [value or (own if own not in given else None) for value, own in zip_longest(given, choices[: len(given)])]
    free = iter([choice for choice in choices if choice not in filled])
    return [value or next(free, None) for value in filled]
