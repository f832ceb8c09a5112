"""Who looks at what from measured eyes, directions and boxes."""

from __future__ import annotations

import doctest
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

import vfoa
import vfoa.scoring
from tests.measured import measured_tables, open_measured
from vfoa.config import dotted_tables, read_steps
from vfoa.errors import VfoaError
from vfoa.estimator import DEFAULTS
from vfoa.measured import Observed, box_of
from vfoa.pipeline import Attending
from vfoa.tracking import Tracker
from vfoa.types import Float, NoAttention, Person

EYES = (0.0, -0.4, 2.0)
CUP, BOOK = (0.5, 0.0, 1.0), (-0.5, 0.0, 1.0)


def _at(point: ArrayLike) -> list[float]:
    return (np.array(point) - EYES).tolist()


def test_a_person_looks_at_what_the_gaze_points_to() -> None:
    follower = vfoa.MeasuredFollower()
    for target, point in {"cup": CUP, "book": BOOK}.items():
        (look,) = follower.step({"anna": Observed(eyes_m=EYES, gaze=_at(point))}, {"cup": CUP, "book": BOOK})
        assert (look.subject, look.target, look.track_id) == ("anna", target, 1)
        assert look.distance_m == pytest.approx(math.dist(EYES, point))
        assert set(look.values) == {"cup", "book"}
        assert str(look).startswith(f"anna looks at {target} (attention ")


@pytest.mark.parametrize("settings", [{}, {"attention.method": "bayes"}, {"gaze_filter.cues": "both"}])
@pytest.mark.parametrize("axis", [*np.eye(3), *-np.eye(3)])
def test_a_person_may_look_exactly_along_an_axis(settings: dict[str, str], axis: Float) -> None:
    follower, eyes = vfoa.MeasuredFollower(settings), np.array([2.0, 2.0, 4.0])
    for _ in range(3):
        seen = {"anna": Observed(eyes_m=eyes, gaze=axis, head=axis)}
        (look,) = follower.step(seen, {"cup": eyes + axis, "book": eyes - axis, "pen": eyes + np.roll(axis, 1)})
    assert look.target == "cup"
    assert sum(look.values.values()) <= 1 + 1e-9


def test_people_look_at_each_other_in_the_order_given() -> None:
    ben = np.add(EYES, (1.0, 0.0, 0.0))
    looks = vfoa.MeasuredFollower().step(
        {"ben": Observed(eyes_m=ben, head=_at(ben - 2 * (ben - EYES))), "anna": Observed(eyes_m=EYES, gaze=_at(CUP))},
        {"cup": CUP},
    )
    assert [(look.subject, look.target) for look in looks] == [("ben", "anna"), ("anna", "cup")]
    assert "ben" not in looks[0].values


def test_a_person_may_have_a_box_and_leave() -> None:
    follower = vfoa.MeasuredFollower({"attention.method": "cones"})
    anna = Observed(eyes_m=EYES, gaze=(1.0, 1.0, 0.0))
    body = box_of((1.0, 0.6, 2.0), (0.4, 1.6, 0.3))
    (seen, _) = follower.step({"anna": anna, "ben": Observed(eyes_m=(1.0, -0.4, 2.0))}, {"ben": body})
    assert seen.target == "ben"
    (alone,) = follower.step({"anna": anna}, {})
    assert (alone.target, dict(alone.values)) == (None, {})


@given(st.floats(0.01, 1000), st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda given: math.hypot(*given) > 0.01))
def test_only_the_direction_counts(length: float, direction: tuple[float, float, float]) -> None:
    objects = {"cup": CUP, "book": np.array([BOOK, (0.2, 0.2, 0.2)])}
    one, other = (
        vfoa.MeasuredFollower().step({"anna": Observed(eyes_m=EYES, gaze=np.array(direction) * by)}, objects)[0]
        for by in (1.0, length)
    )
    assert one.target == other.target
    assert one.values == pytest.approx(dict(other.values))


def test_what_was_not_measured_is_unknown() -> None:
    follower = vfoa.MeasuredFollower()
    people = {"anna": Observed(eyes_m=None, gaze=(0, 0, 1)), "ben": Observed(eyes_m=EYES)}
    assert [look.missing for look in follower.step(people, {"cup": CUP})] == [
        NoAttention.NO_EYES_3D,
        NoAttention.NO_DIRECTION,
    ]


@pytest.mark.parametrize("method", ["bayes", "logit", "nearest", "cones"])
def test_answers_are_scored_also_those_of_nothing(method: str) -> None:
    limit = {"attention.limit_deg": 20} if method == "nearest" else {}
    follower = vfoa.MeasuredFollower({"attention.method": method, **limit})
    away = [np.negative(_at(CUP))] * 30
    looks = [follower.step({"anna": Observed(eyes_m=EYES, gaze=gaze)}, {"cup": CUP})[0] for gaze in [*away, None]]
    scored = vfoa.score(["none"] * 31, [look.answer for look in looks])
    assert (looks[-1].target, looks[-1].answer) == (None, None)
    assert (scored.correct, scored.coverage) == (30, pytest.approx(30 / 31))
    (look,) = follower.step({"anna": Observed(eyes_m=EYES, gaze=_at(CUP))}, {"cup": CUP})
    assert look.answer == look.target


@pytest.mark.parametrize("name", ["none", "ignore"])
def test_no_target_is_called_as_the_label_of_none(name: str) -> None:
    with pytest.raises(VfoaError, match=f"objects: '{name}'"):
        vfoa.MeasuredFollower().step({"anna": Observed(eyes_m=EYES, gaze=_at(CUP))}, {name: CUP})


@pytest.mark.parametrize("method", ["bayes", "logit", "nearest", "cones"])
def test_every_method_answers_with_its_memory(method: str) -> None:
    follower = vfoa.MeasuredFollower({"attention.method": method})
    for frame in range(30):
        anna = Observed(eyes_m=EYES, gaze=_at(CUP), head=_at(CUP), gaze_error_rad=0.1, head_error_rad=0.1)
        (look,) = follower.step({"anna": anna}, {"cup": CUP, "book": BOOK}, time_ns=frame * 40_000_000)
    assert look.target == "cup"


@pytest.mark.parametrize("method", ["bayes", "logit", "nearest", "cones"])
@given(seed=st.integers(0, 2**32 - 1), turn_deg=st.floats(-180, 180))
def test_a_turn_of_the_room_the_order_of_the_names_and_the_start_of_the_clock_change_nothing(
    method: str, seed: int, turn_deg: float
) -> None:
    """The room and all that is in it, about the camera's vertical axis."""

    def answers(turn: Float, names: list[str], start_ns: int) -> list[tuple[str | None, dict[str, float]]]:
        rng, follower, found = np.random.default_rng(seed), vfoa.MeasuredFollower({"attention.method": method}), []
        boxes = {name: (rng.uniform((-2, -1, 0.5), (2, 1, 4)), rng.uniform(0.05, 0.3, 3)) for name in sorted(names)}
        for frame in range(8):
            looked_at = boxes["book" if frame < 5 else "cup"][0] - EYES
            gaze, head = looked_at + rng.normal(0, 0.2, 3), looked_at + rng.normal(0, 0.4, 3)
            anna = Observed(eyes_m=turn @ EYES, gaze=turn @ gaze if frame != 2 else None, head=turn @ head)
            seen = {name: box_of(turn @ middle_m, size_m, turn) for name, (middle_m, size_m) in boxes.items()}
            in_order = {name: seen[name] for name in names}
            (look,) = follower.step({"anna": anna}, in_order, time_ns=start_ns + frame * 40_000_000)
            found.append((look.target, dict(look.values)))
        return found

    turn = Rotation.from_euler("y", turn_deg, degrees=True).as_matrix()
    expected = answers(np.eye(3), ["cup", "book", "lamp"], 0)
    for (target, values), (of_room, in_room) in zip(
        answers(turn, ["lamp", "book", "cup"], 10**15), expected, strict=True
    ):
        assert values == pytest.approx(in_room, abs=1e-6)
        if sorted(in_room.values())[-1] - sorted(in_room.values())[-2] > 1e-6:
            assert target == of_room


def test_a_time_before_that_of_the_last_frame_is_refused_and_changes_nothing() -> None:
    follower = vfoa.MeasuredFollower({"attention.method": "bayes"})
    other = vfoa.MeasuredFollower({"attention.method": "bayes"})
    for frame in range(3):
        people = {"anna": Observed(eyes_m=EYES, gaze=_at(BOOK if frame else CUP))}
        objects = {"cup": CUP, "book": BOOK}
        looks = follower.step(people, objects, time_ns=frame * 40_000_000)
        assert looks == other.step(people, objects)
        with pytest.raises(VfoaError, match=f"time_ns: .*{frame * 40_000_000}"):
            follower.step(people, objects, time_ns=frame * 40_000_000)


def test_the_default_is_the_method_of_a_clip() -> None:
    def values(settings: dict[str, object]) -> list[dict[str, float]]:
        follower = vfoa.MeasuredFollower(settings)
        seen = {"anna": Observed(eyes_m=EYES, gaze=_at(CUP), head=_at(BOOK))}
        return [dict(look.values) for _ in range(3) for look in follower.step(seen, {"cup": CUP, "book": BOOK})]

    assert values({}) == values({"attention.method": DEFAULTS["attention.method"]})


@pytest.mark.parametrize("method", ["bayes", "cones"])
def test_the_answers_are_those_of_a_clip_of_the_same_measurements(method: str, tmp_path: Path) -> None:
    clip = open_measured("measured", measured_tables(tmp_path / "talk"))
    settings = {"attention.method": method, "gaze_filter.cues": "both"}
    follower = vfoa.MeasuredFollower(settings)
    _, attend = read_steps(dotted_tables(settings.items(), ("attention", "gaze_filter"), ""), None, "")
    tracker, attending = Tracker(attend.tracking), Attending(attend)
    found: set[str | None] = set()
    names = {number: name for name, number in {**clip.people, **clip.objects}.items()}
    for number in clip.frames:
        scene = clip.scene(number)
        (result,) = attending.step(scene, tracker.step(scene.people))
        looks = follower.step(
            {names[person.instance_id]: _observed(person) for person in scene.people if person.instance_id},
            {
                names[target.instance.id]: target.box
                for target in scene.targets
                if target.box and names[target.instance.id] not in clip.people
            },
            time_ns=scene.time_ns,
        )
        for attention, look in zip(result.attentions, looks, strict=True):
            assert look.subject == names[attention.subject.track_id]
            assert look.values == {names[value.instance_id]: value.total for value in attention.values}
            assert look.target == (None if attention.focus is None else names[attention.focus])
            found.add(look.target)
    assert len(found) > 1


def _observed(person: Person) -> Observed:
    gaze, head = person.view.gaze, person.view.head_pose
    return Observed(
        eyes_m=person.eye_origin_left,
        gaze=None if gaze is None else gaze.direction,
        head=None if head is None else head.direction,
        gaze_error_rad=None if gaze is None else gaze.sigma_rad,
        head_error_rad=None if head is None else head.sigma_rad,
    )


@pytest.mark.parametrize(
    ("people", "objects", "message"),
    [
        ({"anna": Observed(eyes_m=(0, 0), gaze=(0, 0, 1))}, {}, r"anna: .*\(2,\)"),
        ({"anna": Observed(eyes_m=(0, 0, math.nan), gaze=(0, 0, 1))}, {}, "anna: .*nan"),
        ({"anna": Observed(eyes_m=EYES, gaze=(0, 0, 0))}, {}, "anna: .*direction"),
        ({"anna": Observed(eyes_m=EYES, gaze=(0, 0, 1), gaze_error_rad=-1)}, {}, "anna: .*-1"),
        ({"anna": Observed(eyes_m=EYES, gaze=(0, 0, 1), gaze_error_rad=8)}, {}, r"anna: gaze_error_rad: .*8"),
        ({"anna": Observed(eyes_m=EYES, head=(0, 0, 1), head_error_rad=5.5)}, {}, r"anna: head_error_rad: .*5\.5"),
        ({}, {"cup": (0, 0)}, r"cup: .*\(2,\)"),
        ({}, {"cup": ((0, 0, 1), (0.1, 0, 0.1))}, "cup: .*positive"),
        ({}, {"cup": (0, 0, math.inf)}, "cup: .*inf"),
        ({}, {"cup": "there"}, "cup: .*there"),
        ({"anna": {"eyes_m": EYES}}, {}, "anna: .*Observed.*dict"),
        ([Observed(eyes_m=EYES)], {}, "people: .*list"),
        ({}, [(0, 0, 1)], "objects: .*list"),
        ({"": Observed(eyes_m=EYES)}, {}, "people: .*''"),
        ({}, {0: CUP}, "objects: .* 0"),
    ],
)
def test_a_wrong_measurement_is_named_and_changes_nothing(
    people: dict[str, Observed], objects: dict[str, ArrayLike], message: str
) -> None:
    follower = vfoa.MeasuredFollower()
    with pytest.raises(VfoaError, match=message):
        follower.step(people, objects)
    (look,) = follower.step({"ben": Observed(eyes_m=EYES, gaze=_at(CUP))}, {"cup": CUP})
    assert (look.track_id, look.target) == (1, "cup")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"attention.cone_deg": 1}, "attention.cone_deg"),
        ({"stereo.matcher": "bm"}, "stereo"),
        ({"attention.method": "bayes", "attention.smoothing": "both"}, "later frames"),
    ],
)
def test_a_wrong_setting_is_one_line(settings: dict[str, object], message: str) -> None:
    with pytest.raises(VfoaError, match=message):
        vfoa.MeasuredFollower(settings)


def test_the_examples_of_docstrings_print_what_they_show() -> None:
    names = {"vfoa": vfoa}
    for documented, name in ((vfoa.MeasuredFollower, "MeasuredFollower"), (vfoa.scoring, "scoring")):
        (example,) = doctest.DocTestFinder(recurse=False).find(documented, name, globs=names)
        assert doctest.DocTestRunner().run(example) == (0, len(example.examples))
        assert example.examples
