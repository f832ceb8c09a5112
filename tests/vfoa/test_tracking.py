"""The IOU tracker: the published rule written out by hand, and against an implementation of its own kind."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.scenes import make_measured_person, make_person
from vfoa.geometry import box_iou
from vfoa.tracking import Tracked, Tracker, TrackingSettings
from vfoa.types import Person

PUBLISHED = TrackingSettings(ttl=0)


def at(left_px: float, score: float = 1.0) -> Person:
    """A head box of 10 x 10 px. Two of them s px apart overlap by (10 - s) / (10 + s): by a half up to s = 10 / 3."""
    return make_person((left_px, 0, left_px + 10, 10), score=score)


def followed(
    frames: Iterable[tuple[Person, ...]], settings: TrackingSettings
) -> dict[int, tuple[tuple[int, Person], ...]]:
    """The tracks of a whole sequence: id -> (position in ``frames``, person)."""
    tracker, members = Tracker(settings), dict[int, list[tuple[int, Person]]]()
    for position, people in enumerate(frames):
        for track_id, person in tracker.step(people).people(people):
            members.setdefault(track_id, []).append((position, person))
    return {track_id: tuple(found) for track_id, found in members.items()}


def lefts(tracks: dict[int, tuple[tuple[int, Person], ...]]) -> dict[int, list[tuple[int, float]]]:
    """Tracks as (frame, left edge)."""
    return {
        track_id: [(frame, float(person.view.head.box_px[0])) for frame, person in members]
        for track_id, members in tracks.items()
    }


def test_a_split_a_crossing_and_a_gap():
    split = [(at(100),), (at(103), at(98)), (at(106), at(96)), (at(109), at(94))]
    crossing = [(at(0), at(9)), (at(3), at(6)), (at(6), at(3)), (at(9), at(0))]
    gap = [(at(200),), (at(200),), (), (at(200),)]
    frames = [sum(people, ()) for people in zip(split, crossing, gap, strict=True)]

    assert lefts(followed(frames, PUBLISHED)) == {
        # the split: 98 overlaps 100 more than 103 does, which starts a track of its own
        1: [(0, 100), (1, 98), (2, 96), (3, 94)],
        5: [(1, 103), (2, 106), (3, 109)],
        # the crossing: boxes alone cannot tell two heads that pass from two that bounce
        2: [(0, 0), (1, 3), (2, 3), (3, 0)],
        3: [(0, 9), (1, 6), (2, 6), (3, 9)],
        # the gap: the track ends before it, and another one begins after it
        4: [(0, 200), (1, 200)],
        6: [(3, 200)],
    }


@pytest.mark.parametrize(("ttl", "ids"), [(1, {1, 2}), (2, {1})])
def test_a_track_outlives_a_gap_of_up_to_ttl_frames(ttl, ids):
    frames = [(at(0),), (at(1),), (), (), (at(2),), (at(3),)]
    assert set(followed(frames, TrackingSettings(ttl=ttl))) == ids


def test_each_gap_is_measured_anew():
    frames = [(at(0),), (), (at(0),), (), (at(0),)]
    assert lefts(followed(frames, TrackingSettings(ttl=1))) == {1: [(0, 0), (2, 0), (4, 0)]}


@pytest.mark.parametrize("speed", [1, 2])
@pytest.mark.parametrize("hidden_px", [3, 5, 9])
@pytest.mark.parametrize("ttl", [0, 5, 10])
def test_a_head_that_is_hidden_takes_no_other_head(speed: int, hidden_px: int, ttl: int) -> None:
    """One person walks behind another, and is not found while the heads are closer than so many pixels."""
    behind = [speed * frame for frame in range(40 // speed)]
    in_front = [30 - left for left in behind]
    frames = [
        (at(front),) if abs(front - back) < hidden_px else (at(back), at(front))
        for back, front in zip(behind, in_front, strict=True)
    ]
    tracks = lefts(followed(frames, TrackingSettings(ttl=ttl)))
    of_front = next(track_id for track_id, members in tracks.items() if members[0] == (0, 30))
    assert [left for _, left in tracks[of_front]] == in_front
    assert [left for _, left in tracks[3 - of_front]][:3] == behind[:3]


def test_heads_below_sigma_l_are_not_followed():
    tracked = Tracker(TrackingSettings(sigma_l=0.3)).step((at(0, 0.2), at(50, 0.4)))
    assert tracked == Tracked(ids=(None, 1), open=frozenset({1}))


def test_people_come_in_the_order_of_their_ids_whatever_the_order_they_were_found_in():
    tracker, people = Tracker(PUBLISHED), (at(90), at(50), at(1))
    tracker.step((at(0), at(50)))
    tracked = tracker.step(people).people(people)
    assert [(track_id, person.view.head.box_px[0]) for track_id, person in tracked] == [(1, 1), (2, 50), (3, 90)]


def test_an_id_is_not_given_twice():
    tracker = Tracker(PUBLISHED)
    assert [tracker.step(people).ids for people in ((at(0),), (), (at(0),))] == [(1,), (), (2,)]


def test_a_track_is_followed_from_exactly_the_least_score_and_overlap_on():
    """The second head covers the first and as much again: an overlap of exactly a half."""
    wide = make_person((0, 0, 10, 20), score=0.6)
    frames = [(at(0, 0.6),), (wide,)]
    assert set(followed(frames, TrackingSettings(sigma_l=0.6, sigma_iou=0.5, ttl=0))) == {1}
    assert set(followed(frames, TrackingSettings(sigma_iou=0.51, ttl=0))) == {1, 2}


@pytest.mark.parametrize(
    ("name", "good", "wrong"),
    [
        ("sigma_l", (0,), (-0.1,)),
        ("sigma_iou", (0.01, 1), (0, 1.1)),
        ("ttl", (0,), (-1,)),
    ],
)
def test_a_setting_outside_of_its_range_is_refused(name, good, wrong):
    for value in good:
        assert getattr(TrackingSettings(**{name: value}), name) == value
    for value in wrong:
        with pytest.raises(ValidationError, match=name):
            TrackingSettings(**{name: value})


boxes = st.builds(
    lambda u, v, score: make_person((u, v, u + 20, v + 20), score=score),
    st.sampled_from([*range(6), *range(30, 36), *range(60, 66)]),
    st.integers(0, 5),
    st.sampled_from([0.1, 0.3, 0.6, 0.9]),
)


def is_disputed(frames: list[tuple[Person, ...]], sigma_iou: float) -> bool:
    """Whether a head overlaps two heads of a neighbouring frame enough: then the oldest track need not have it."""
    return any(
        sum(box_iou(head.view.head.box_px, other.view.head.box_px) >= sigma_iou for other in others) > 1
        for before, after in pairwise(frames)
        for people, others in ((before, after), (after, before))
        for head in people
    )


@given(st.lists(st.lists(boxes, max_size=4).map(tuple), max_size=8))
def test_without_gaps_and_disputes_it_is_the_published_algorithm(frames):
    assume(not is_disputed(frames, sigma_iou=0.4))
    settings = TrackingSettings(sigma_l=0.2, sigma_iou=0.4, ttl=0)
    found = [[person for _, person in members] for members in followed(frames, settings).values()]
    expected = published(frames, sigma_l=0.2, sigma_iou=0.4)
    assert sorted(map(ids, found)) == sorted(map(ids, expected))


def ids(people: list[Person]) -> list[int]:
    return [id(person) for person in people]


def published(frames, *, sigma_l, sigma_iou):
    """Algorithm 1 of the paper without its last step: active and finished tracks, each a list of detections."""
    active: list[list[Person]] = []
    finished: list[list[Person]] = []
    for detections in frames:
        candidates = [person for person in detections if person.view.head.score >= sigma_l]
        still_active = []
        for track in active:
            best = None
            for candidate in candidates:
                overlap = box_iou(track[-1].view.head.box_px, candidate.view.head.box_px)
                if best is None or overlap > best[0]:
                    best = (overlap, candidate)
            if best is not None and best[0] >= sigma_iou:
                still_active.append([*track, best[1]])
                candidates = [candidate for candidate in candidates if candidate is not best[1]]
            else:
                finished.append(track)
        active = still_active + [[candidate] for candidate in candidates]
    return finished + active


# Without images


def test_a_measured_person_is_known_by_its_instance_in_any_order() -> None:
    anna, ben = make_measured_person(4, eyes=(0, 0, 1)), make_measured_person(9, eyes=(5, 0, 1))
    moved = make_measured_person(4, eyes=(5, 0, 1))  # to where the other one was
    tracker = Tracker(TrackingSettings())
    assert [tracker.step(people).ids for people in ((anna, ben), (ben, moved))] == [(1, 2), (2, 1)]


def test_a_measured_person_and_one_in_an_image_are_never_the_same() -> None:
    measured, seen = make_measured_person(4), make_person(instance_id=4)
    for people in ((measured, seen), (seen, measured)):
        tracker = Tracker(TrackingSettings())
        assert [tracker.step((person,)).ids for person in people] == [(1,), (2,)]


def test_a_tracker_says_the_track_of_each_person_where_the_person_stands_and_what_is_open() -> None:
    tracker = Tracker(TrackingSettings(sigma_l=0.3, ttl=1))
    first, second, faint = at(0), at(50), at(100, score=0.2)
    assert tracker.step((first, faint, second)) == Tracked(ids=(1, None, 2), open=frozenset({1, 2}))
    assert tracker.step((second, first)) == Tracked(ids=(2, 1), open=frozenset({1, 2}))
    assert tracker.step((at(200), second)) == Tracked(ids=(3, 2), open=frozenset({1, 2, 3}))
    assert tracker.step(()) == Tracked(ids=(), open=frozenset({2, 3}))


def test_the_people_of_tracks_come_in_the_order_of_the_ids_and_may_look_elsewhere() -> None:
    one, other, faint = (make_person((u, 0, u + 10, 10), gaze=(0, 0, 1)) for u in (0, 50, 100))
    assert Tracked(ids=(2, 1, None), open=frozenset({1, 2})).people((one, other, faint)) == ((1, other), (2, one))
