from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from harness.clips.naming import NameRule, SubjectNames, name_frame
from tests.scenes import make_measured_person
from vfoa.tracking import Tracked
from vfoa.types import Head, HeadView, Instance, Person, Scene, Target

PERSON = NameRule(category="person")
Place = tuple[float, float]
Frame = tuple[Scene, Tracked]


def _box(place: Place, size: float = 20.0) -> np.ndarray:
    u, v = place
    return np.array([u - size / 2, v - size / 2, u + size / 2, v + size / 2])


def frame(things: Sequence[tuple[int, str, Place]], people: Sequence[tuple[int, int | None, Place]] = ()) -> Frame:
    """A frame with things (instance id, label, place) and tracked people (track id, instance id, place), px."""
    targets = tuple(
        Target(
            instance=Instance(id=number, label=label, category_id=1, is_thing=True, score=1.0),
            box_px=_box(place),
            points_left=np.zeros((0, 3), np.float32),
            box=None,
        )
        for number, label, place in things
    )
    persons = tuple(
        Person(view=HeadView(head=Head(box_px=_box(place), score=1.0), head_pose=None, gaze=None),
               instance_id=instance, eye_origin_left=None)
        for _, instance, place in people
    )  # fmt: skip
    return Scene(index=0, time_ns=0, targets=targets, people=persons), tracks(*(track for track, *_ in people))


def tracks(*ids: int) -> Tracked:
    return Tracked(ids=ids, open=frozenset(ids))


def people(*places: tuple[int, float]) -> Frame:
    """People only: (track id, u); the instance id is the track's plus 10."""
    return frame(
        [(track + 10, "person", (u, 50)) for track, u in places], [(track, track + 10, (u, 50)) for track, u in places]
    )


def names_of_tracks(rules: dict[str, NameRule], *frames: Frame) -> list[dict[int, str]]:
    memory, found = SubjectNames(), []
    for each in frames:
        names, memory = name_frame(*each, rules, {}, memory)
        found.append(dict(names.subjects))
    return found


LEFT_RIGHT = {
    "anna": NameRule(category="person", from_left=1),
    "ben": NameRule(category="person", from_left=2),
}


def test_people_are_named_from_the_left_when_they_appear_and_keep_their_names() -> None:
    crossed = people((1, 90), (2, 10))
    assert names_of_tracks(LEFT_RIGHT, people((1, 10), (2, 90)), crossed) == [{1: "anna", 2: "ben"}] * 2


@pytest.mark.parametrize("order", [(1, 2), (2, 1)])
def test_names_do_not_depend_on_the_order_of_tracks(order: tuple[int, int]) -> None:
    at = {1: 10.0, 2: 90.0}
    found = names_of_tracks(LEFT_RIGHT, people(*((track, at[track]) for track in order)))
    assert found == [{1: "anna", 2: "ben"}]


def test_a_lost_name_goes_to_the_nearest_new_track() -> None:
    # They have crossed: by the places from the left, the new track 7 on the right would be ben.
    found = names_of_tracks(LEFT_RIGHT, people((1, 10), (2, 90)), people((1, 90), (2, 10)), people((2, 10), (7, 88)))
    assert found[-1] == {2: "ben", 7: "anna"}


def test_both_lost_names_find_their_own_people() -> None:
    found = names_of_tracks(LEFT_RIGHT, people((1, 10), (2, 90)), people(), people((8, 80), (9, 20)))
    assert found == [{1: "anna", 2: "ben"}, {}, {8: "ben", 9: "anna"}]


def test_one_name_is_borne_by_one_person_at_a_time() -> None:
    assert names_of_tracks({"girl": PERSON}, people((1, 10)), people((1, 10), (2, 50)), people((2, 50))) == [
        {1: "girl"},
        {1: "girl"},
        {2: "girl"},
    ]


def test_a_track_that_comes_back_after_its_name_was_taken_has_none() -> None:
    assert names_of_tracks({"girl": PERSON}, people((1, 10)), people((2, 50)), people((1, 10), (2, 50)))[-1] == {
        2: "girl"
    }


def test_a_head_without_a_person_gets_its_name_when_the_person_is_seen() -> None:
    unknown = frame([(3, "bird", (50, 50))], [(1, None, (50, 50))])
    a_bird = frame([(3, "bird", (50, 50))], [(1, 3, (50, 50))])
    assert names_of_tracks({"girl": PERSON}, unknown, a_bird, people((1, 50))) == [{}, {}, {1: "girl"}]


def test_the_source_s_own_id_names_a_person_whatever_the_track() -> None:
    rules = {"anna": NameRule(category="person", instance=12)}
    assert names_of_tracks(rules, people((1, 10), (2, 90)), people(), people((1, 91)), people((2, 5))) == [
        {2: "anna"},
        {},
        {},
        {2: "anna"},
    ]


CUPS = [(1, "cup", (10.0, 50.0)), (2, "cup", (50.0, 50.0)), (3, "cup", (90.0, 50.0)), (4, "book", (30.0, 80.0))]


def names_of_targets(targets: dict[str, NameRule], things: list[tuple[int, str, Place]] = CUPS) -> dict[int, str]:
    names, _ = name_frame(*frame(things), {}, targets, SubjectNames())
    return dict(names.targets)


@pytest.mark.parametrize(
    ("choice", "instance"),
    [
        ({"instance": 2}, 2),
        ({"from_left": 3}, 3),
        ({"at_px": (60, 55)}, 2),
        ({"at_px": (1000, 1000)}, 3),
        ({"box_px": (0, 40, 22, 60)}, 1),
        ({"box_px": (200, 200, 210, 210)}, None),
        ({"from_left": 4}, None),
        ({"instance": 4}, None),
    ],
)
def test_a_rule_finds_its_instance(choice: dict[str, object], instance: int | None) -> None:
    rule = NameRule.model_validate({"category": "cup", **choice})
    expected = {number: f"{label}#{number}" for number, label, _ in CUPS}
    if instance is not None:
        expected[instance] = "mine"
    assert names_of_targets({"mine": rule}) == expected


def test_a_point_is_of_the_thing_it_lies_in_though_the_middle_of_another_one_is_nearer() -> None:
    wide, narrow = frame(CUPS[:2])[0].targets
    wide = replace(wide, box_px=np.array([0.0, 0, 100, 40]))
    narrow = replace(narrow, box_px=np.array([92.0, 10, 110, 30]))
    scene = Scene(index=0, time_ns=0, targets=(wide, narrow), people=())
    names, _ = name_frame(scene, tracks(), {}, {"mine": NameRule(category="cup", at_px=(90, 20))}, SubjectNames())
    assert names.targets == {1: "mine", 2: "cup#2"}


def test_a_name_by_category_is_shared_by_those_that_have_no_name_of_their_own() -> None:
    rules = {"cups": NameRule(category="cup"), "middle": NameRule(category="cup", from_left=2)}
    assert names_of_targets(rules) == {1: "cups", 2: "middle", 3: "cups", 4: "book#4"}


def test_two_points_near_one_thing_go_to_two_things() -> None:
    rules = {
        "far": NameRule(category="cup", at_px=(25, 50)),
        "near": NameRule(category="cup", at_px=(11, 50)),
    }
    assert names_of_targets(rules) == {1: "near", 2: "far", 3: "cup#3", 4: "book#4"}


def test_a_subject_is_a_target_by_its_own_name() -> None:
    both = people((1, 10), (2, 90))
    names, memory = name_frame(*both, LEFT_RIGHT, {"people": PERSON}, SubjectNames())
    assert names.targets == {11: "anna", 12: "ben"}
    ben_turned_away = frame([(11, "person", (10, 50)), (5, "person", (88, 50))], [(1, 11, (10, 50))])
    names, _ = name_frame(*ben_turned_away, LEFT_RIGHT, {}, memory)
    assert names.subjects == {1: "anna"}
    assert names.targets == {11: "anna", 5: "ben"}


def test_a_subject_never_tracked_is_a_target_by_its_rule() -> None:
    names, _ = name_frame(*frame([(5, "person", (50, 50))]), {"girl": PERSON}, {}, SubjectNames())
    assert names.targets == {5: "girl"}


@given(st.permutations(CUPS))
def test_names_do_not_depend_on_the_order_of_instances(things: list[tuple[int, str, Place]]) -> None:
    rules = {"left": NameRule(category="cup", from_left=1), "point": NameRule(category="cup", at_px=(30, 50))}
    assert names_of_targets(rules, things) == {1: "left", 2: "point", 3: "cup#3", 4: "book#4"}


def test_a_rule_says_one_thing_beside_the_category() -> None:
    with pytest.raises(ValidationError, match="found from_left and at_px"):
        NameRule(category="cup", from_left=1, at_px=(1, 2))


# Without images


def measured(things: Sequence[tuple[int, str]], tracked: Sequence[tuple[int, int]]) -> Frame:
    """A frame of a clip without images: things (instance id, label), and tracks (track id, instance id)."""
    seen, _ = frame([(number, label, (0, 0)) for number, label in things])
    people = tuple(make_measured_person(number) for _, number in tracked)
    targets = tuple(replace(target, box_px=None) for target in seen.targets)
    return replace(seen, targets=targets, people=people), tracks(*(track for track, _ in tracked))


def test_without_an_image_the_source_s_ids_and_categories_name() -> None:
    subjects = {"anna": NameRule(category="person", instance=1), "ben": NameRule(category="person", instance=2)}
    targets = {"robot": NameRule(category="robot"), "left": NameRule(category="cup", from_left=1)}
    found = measured([(1, "person"), (2, "person"), (3, "robot"), (4, "cup")], [(7, 2), (8, 1)])
    names, memory = name_frame(*found, subjects, targets, SubjectNames())
    assert names.subjects == {7: "ben", 8: "anna"}
    assert names.targets == {1: "anna", 2: "ben", 3: "robot", 4: "cup#4"}, "no place from the left without an image"
    later, _ = name_frame(*measured([(1, "person"), (2, "person")], [(9, 1)]), subjects, targets, memory)
    assert later.subjects == {9: "anna"}, "a name comes back with the source's id"


def test_a_name_that_the_source_gives_stands_over_the_rules() -> None:
    """A drawn instance is known by its name, wherever it is and whatever else has its category."""
    rules = {"anna": NameRule(category="person", from_left=1), "ben": NameRule(category="person", from_left=2)}
    targets = {"mug": NameRule(category="cup", from_left=1), "glass": NameRule(category="cup", from_left=2)}
    things = [(1, "person", (10, 10)), (2, "person", (90, 10)), (3, "cup", (30, 50)), (4, "cup", (70, 50))]
    scene, tracked = frame(things, [(1, 1, (10, 10)), (2, 2, (90, 10))])
    own = {1: "ben", 3: "glass"}
    drawn = tuple(
        replace(target, instance=replace(target.instance, name=own.get(target.instance.id))) for target in scene.targets
    )
    names, memory = name_frame(replace(scene, targets=drawn), tracked, rules, targets, SubjectNames())
    assert names.subjects == {1: "ben"}
    assert {names.targets[key] for key in (1, 3)} == {"ben", "glass"}
    assert "mug" not in (names.targets[3], names.targets[1])
    assert memory.by_track == {1: "ben"}


def _called(found: Frame, **names: str) -> Frame:
    """The frame with names of the source, by the instance's id after a letter."""
    scene, tracked = found
    own = {int(key[1:]): name for key, name in names.items()}
    named = tuple(
        replace(target, instance=replace(target.instance, name=own.get(target.instance.id))) for target in scene.targets
    )
    return replace(scene, targets=named), tracked


def test_a_name_that_the_source_gives_goes_to_nobody_whom_it_calls_otherwise() -> None:
    """Anna is no subject: Ben's name is not hers while he is away, whether her track is new, old, or was his."""
    ben = {"ben": PERSON}
    both = _called(people((1, 20), (2, 60)), i11="ben", i12="anna")
    for track in (1, 2, 3):
        alone = _called(people((track, 30)), **{f"i{track + 10}": "anna"})
        assert names_of_tracks(ben, both, alone, both) == [{1: "ben"}, {}, {1: "ben"}]
    _, memory = name_frame(*both, ben, {}, SubjectNames())
    scene, _ = _called(people((3, 30)), i13="anna")
    assert name_frame(replace(scene, people=()), tracks(), ben, {}, memory)[0].targets == {13: "person#13"}


def test_a_name_that_the_source_gives_now_and_then_follows_its_person() -> None:
    """Of masks without names in between, the lost track's name goes to the nearest new one, as anybody's does."""
    named = _called(people((1, 20), (2, 60)), i11="ben", i12="anna")
    between = people((3, 22), (4, 60))
    assert names_of_tracks({"ben": PERSON}, named, people((1, 21)), between) == [{1: "ben"}, {1: "ben"}, {3: "ben"}]
