"""Which object is which from one frame to the next: instances keep their number while their masks overlap.

A segmenter numbers the objects of a frame by itself, the surest first, so that an object has one number now and another
one in the next frame. What is remembered of an object goes by its number: how long somebody looked at it, its box in
the recording, its automatic name. So numbers are followed over the frames of a sequence, as heads are
(:mod:`vfoa.tracking`), by the overlap of masks (intersection over union).

A network also changes its mind: a cup is a bowl in some frames. An object has the label that it had most in the last
frames, so that its name and its part in the scene do not come and go.

Frames between key frames (:mod:`vfoa.segmentation.key_frames`) repeat what the key frame has found: they neither miss
an object nor vote for its label.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from numpy.typing import NDArray

from vfoa.pixels import relabel
from vfoa.times import NO_GAP, Gap, seconds_between
from vfoa.types import HeadView, Instance, Instances, Percepts

SAME_OBJECT = 0.3
"""Least overlap of an object's masks in two frames."""
SAME_UNDER_ANOTHER_LABEL = 0.6
"""Least overlap of them under two labels: a cup that stands before a bowl covers only part of it."""
VOTE_DECAY = 0.9
"""Factor of an object's votes for a label from one frame to the next."""
MAJORITY = 2
"""Another label replaces the present one when it has this many times its votes: after up to eleven frames."""
PATIENCE = 5
"""Longest gap of an object, in segmented frames: after it, its number is free. At 100 frames per second it is 0.2 s, as
at 25 (:meth:`vfoa.times.Gap.is_within`)."""
LONGER_SIDE = 480
"""Masks are compared at every nth pixel, so that the longer side of the image has about as many."""


def frames_missed(before: Mapping[int, Gap], seen: Iterable[int], dt_s: float) -> dict[int, Gap]:
    """Return how long each object or person was not seen, by number: of those seen now, then of those missed so far.

    ``dt_s`` is the time since the last frame. Who is missed is remembered for ``PATIENCE`` frames
    (:meth:`vfoa.times.Gap.is_within`), and keeps the number.
    """
    now = dict.fromkeys(seen, NO_GAP)
    missed = {number: gap.longer(dt_s) for number, gap in before.items() if number not in now}
    return now | {number: gap for number, gap in missed.items() if gap.is_within(PATIENCE)}


@dataclass(frozen=True, slots=True)
class _Known:
    """An object that is followed: its label and name (None: the source knows none), and the segmented frames missed.

    ``kinds`` are its last instances by label, ``votes`` the scores of all under each label, the older the less.
    """

    label: str
    name: str | None
    kinds: Mapping[str, Instance]
    votes: Mapping[str, float]
    missed: Gap = NO_GAP

    @property
    def kind(self) -> Instance:
        """The last instance under its label."""
        return self.kinds[self.label]


@dataclass(frozen=True, slots=True)
class Numbered:
    """The instances of a frame under their lasting numbers, and these by the ids of the segmenter."""

    instances: Instances
    numbers: Mapping[int, int]

    def renumber(self, percepts: Percepts) -> Percepts:
        """The percepts that these instances belong to, under the same numbers."""
        if percepts.instances is self.instances:
            return percepts
        views = tuple(_renumbered(view, self.numbers) for view in percepts.views)
        return replace(percepts, instances=self.instances, views=views)


class InstanceTracker:
    """Follows the instances of one sequence, frame by frame.

    In each frame, an instance is the object of its label whose last mask it overlaps most, the greatest overlap first,
    but objects that were missed come last: something else may be in their place.
    One of a name of its own, such as a drawn shape, is the object of that name. What is left is the object whose mask
    it is, under whatever label, and gets the label that the object had most; one that is alone with its label, now and
    before, is the same wherever it is. A new one keeps the segmenter's id if that is free, and takes the smallest
    free number otherwise. Where the source keeps the ids (:attr:`vfoa.types.Instance.keeps_id`), so do the instances.
    """

    def __init__(self) -> None:
        self._known: dict[int, _Known] = {}
        self._last: NDArray[np.uint16] = np.zeros((0, 0), np.uint16)  # the number at each pixel, 0: none
        self._missed: dict[int, NDArray[np.intp]] = {}  # the pixels of the last mask of an object that is missed
        self._segmented_ns: int | None = None

    def step(self, instances: Instances, time_ns: int | None = None) -> Numbered:
        """Number the instances of the next frame; ``time_ns`` is its time, nanoseconds (None: unknown)."""
        step = max(1, max(instances.ids.shape) // LONGER_SIDE)
        ids = instances.ids[::step, ::step]
        if ids.shape != self._last.shape:
            self._known, self._last, self._missed = {}, np.zeros(ids.shape, np.uint16), {}
        numbers = {each.id: each.id for each in instances.instances if each.keeps_id}
        followed = {each.id: each for each in instances.instances if not each.keeps_id}
        if not followed and not self._known:
            return Numbered(instances, numbers)
        known = {number: each for number, each in self._known.items() if number not in numbers.values()}
        free = set(known)
        overlaps = _overlaps(self._last, ids) | _overlaps_of_missed(self._missed, ids)
        for *_, number, id_ in sorted(_pairs(known, followed, overlaps)):
            if id_ not in numbers and number in free:
                numbers[id_] = number
                free.remove(number)
        numbers |= _new_numbers(followed.keys() - numbers.keys(), {*known, *numbers.values()})
        seen = {numbers[id_]: each for id_, each in followed.items()}
        passed_s = None
        if instances.carried_from is None:
            passed_s, self._segmented_ns = seconds_between(self._segmented_ns, time_ns), time_ns
        self._remember(known, seen, relabel(ids, numbers), passed_s)
        return Numbered(_instances(instances, numbers, {number: self._known[number].kind for number in seen}), numbers)

    def _remember(
        self,
        known: Mapping[int, _Known],
        seen: Mapping[int, Instance],
        numbers: NDArray[np.uint16],
        passed_s: float | None,
    ) -> None:
        """``passed_s`` is the time since the last segmented frame, seconds; None in a frame that is not segmented."""
        missed = {number: each for number, each in known.items() if number not in seen}
        if passed_s is not None:
            missed = {number: replace(each, missed=each.missed.longer(passed_s)) for number, each in missed.items()}
        gone = {number: each for number, each in missed.items() if each.missed.is_within(PATIENCE)}
        self._known = gone | {
            number: _seen_again(known.get(number), each, is_segmented=passed_s is not None)
            for number, each in seen.items()
        }
        self._missed = {
            number: self._missed[number] if number in self._missed else np.flatnonzero(self._last == number)
            for number in gone
        }
        self._last = numbers


def _seen_again(before: _Known | None, now: Instance, *, is_segmented: bool) -> _Known:
    """The object with one more instance. A name of its own says what it is: its label is the last one."""
    if before is None or now.name or before.name:
        return _Known(now.label, now.name, {now.label: now}, {now.label: now.score})
    if not is_segmented:
        return replace(before, missed=NO_GAP)
    votes = {label: VOTE_DECAY * vote for label, vote in before.votes.items()}
    votes[now.label] = votes.get(now.label, 0.0) + now.score
    wins = votes[now.label] > MAJORITY * votes[before.label]
    return _Known(now.label if wins else before.label, None, {**before.kinds, now.label: now}, votes)


def _pairs(
    known: Mapping[int, _Known],
    found: Mapping[int, Instance],
    overlaps: Mapping[tuple[int, int], float],
) -> Iterator[tuple[int, int, float, int, int]]:
    """The objects that instances may be, the likeliest first when sorted: (kind, missed, less overlap, number, id)."""
    labels_known = Counter(each.label for each in known.values())
    labels_found = Counter(each.label for each in found.values())
    for number, before in known.items():
        for id_, now in found.items():
            if before.name and now.name and before.name != now.name:
                continue
            overlap = overlaps.get((number, id_), 0.0)
            if before.label != now.label:
                if overlap >= SAME_UNDER_ANOTHER_LABEL and not (before.name or now.name):
                    yield 2, before.missed.frames, -overlap, number, id_
                continue
            if before.name and before.name == now.name:
                yield 0, before.missed.frames, -overlap, number, id_
            elif overlap >= SAME_OBJECT:
                yield 1, before.missed.frames, -overlap, number, id_
            elif labels_known[now.label] == labels_found[now.label] == 1:
                yield 3, before.missed.frames, -overlap, number, id_


def _overlaps(last: NDArray[np.uint16], ids: NDArray[np.uint16]) -> dict[tuple[int, int], float]:
    """Intersection over union of each number's last mask and each instance's mask that have a pixel in common."""
    rows, columns = int(last.max(initial=0)) + 1, int(ids.max(initial=0)) + 1
    both = (last.astype(np.int64) * columns + ids).ravel()
    starts = np.flatnonzero(np.diff(both, prepend=-1))  # of runs of the same pair, far fewer than pixels
    pairs, run_pairs = np.unique(both[starts], return_inverse=True)
    pixels = np.bincount(run_pairs, np.diff(starts, append=both.size))
    number, id_ = np.divmod(pairs, columns)
    areas = np.bincount(number, pixels, rows), np.bincount(id_, pixels, columns)
    shares = pixels / (areas[0][number] + areas[1][id_] - pixels)
    found = zip(number.tolist(), id_.tolist(), shares.tolist(), strict=True)
    return {(before, now): share for before, now, share in found if before and now}


def _overlaps_of_missed(
    missed: Mapping[int, NDArray[np.intp]], ids: NDArray[np.uint16]
) -> dict[tuple[int, int], float]:
    """The same of masks that are given by their pixels, places in the map: something else may have been there since."""
    areas = np.bincount(ids.ravel()) if missed else np.zeros(0, np.intp)
    found = {}
    for number, places in missed.items():
        pixels = np.bincount(ids.take(places))
        for id_ in np.flatnonzero(pixels).tolist():
            found[number, id_] = float(pixels[id_] / (len(places) + areas[id_] - pixels[id_]))
    return {pair: share for pair, share in found.items() if pair[1]}


def _new_numbers(ids: Iterable[int], taken: set[int]) -> dict[int, int]:
    """A free number for each id: the id itself, or the smallest."""
    own = {id_: id_ for id_ in ids if id_ not in taken}
    free = (number for number in count(1) if number not in taken and number not in own)
    return own | {id_: next(free) for id_ in sorted(set(ids) - own.keys())}


def _instances(instances: Instances, numbers: Mapping[int, int], kinds: Mapping[int, Instance]) -> Instances:
    """The instances under their numbers, as what these objects are; the same object if they are so already."""
    named = tuple(_of_kind(each, numbers[each.id], kinds.get(numbers[each.id], each)) for each in instances.instances)
    if named == instances.instances:
        return instances
    ids = instances.ids if all(id_ == number for id_, number in numbers.items()) else relabel(instances.ids, numbers)
    return replace(instances, ids=ids, instances=named)


def _of_kind(each: Instance, number: int, kind: Instance) -> Instance:
    """An instance under a number, with the label of another instance of the same object."""
    return replace(each, id=number, label=kind.label, category_id=kind.category_id, is_thing=kind.is_thing)


def _renumbered(view: HeadView, numbers: Mapping[int, int]) -> HeadView:
    head = view.head
    if head.instance_id is None:
        return view
    return replace(view, head=replace(head, instance_id=numbers.get(head.instance_id, head.instance_id)))
