"""Frames that wait for later ones come back in order and revised; each person's state goes with the track."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.scenes import make_box, make_person, make_subject, make_target
from vfoa.bayes import BayesSettings, smooth
from vfoa.cones import ConesSettings
from vfoa.gaze_filter import GazeFilterSettings
from vfoa.logit import LogitSettings, weigh_again
from vfoa.methods import MethodSettings, answer_of, look_ahead_s, open_method
from vfoa.nearest import NearestSettings
from vfoa.pipeline import MOST_REMEMBERED, Attending, AttendSettings
from vfoa.tracking import Tracked, Tracker, TrackingSettings
from vfoa.types import Attention, FrameResult, Scene, Subject

TARGETS = (make_target(1, make_box((-0.3, 0, 2))), make_target(2, make_box((0.3, 0, 2))))


def bayes(smoothing: str, **more: object) -> BayesSettings:
    told = {"method": "bayes", "smoothing": smoothing, "look_ahead_s": 0.12, "error": "told"}
    return BayesSettings.model_validate({**told, **more})


def logit(smoothing: str) -> LogitSettings:
    return LogitSettings.model_validate({"method": "logit", "smoothing": smoothing, "look_ahead_s": 0.12})


def scenes(gazes: Sequence[float], times_ns: Sequence[int] | None = None) -> list[Scene]:
    """One person, who looks at x = 2 ``gaze`` at the targets' depth."""
    people = [make_person(gaze=(x, 0, 1)) for x in gazes]
    times = times_ns or [0] * len(gazes)
    return [
        Scene(index=index, time_ns=time_ns, targets=TARGETS, people=(person,))
        for index, (person, time_ns) in enumerate(zip(people, times, strict=True))
    ]


def blocks(settings: MethodSettings, frames: Sequence[Scene]) -> list[list[FrameResult]]:
    """What each step gives, and the end."""
    attending, tracker = Attending(AttendSettings(attention=settings)), Tracker(TrackingSettings())
    return [*(attending.step(scene, tracker.step(scene.people)) for scene in frames), attending.finish()]


def focuses(results: Sequence[FrameResult]) -> list[int | None]:
    return [result.attentions[0].focus for result in results]


def content(results: Sequence[FrameResult]) -> list[object]:
    """Everything that is recorded of results, comparable."""
    return [
        (result.scene.index, each.subject.track_id, each.missing, each.focus, each.tied, repr(each.values))
        for result in results
        for each in result.attentions
    ]


@pytest.mark.parametrize(
    "method",
    [
        ConesSettings(cones_deg=(10,)),
        NearestSettings(method="nearest"),
        bayes("off"),
        bayes("forward"),
        logit("forward"),
    ],
)
def test_nothing_waits_that_does_not_look_ahead(method: MethodSettings) -> None:
    *steps, rest = blocks(method, scenes([0.15] * 5))
    assert [len(step) for step in steps] == [1] * 5
    assert focuses(steps[-1]) == [2]
    assert rest == []


@pytest.mark.parametrize(
    "method",
    [
        ConesSettings(cones_deg=(10,)),
        NearestSettings(method="nearest"),
        *map(bayes, ("off", "forward", "both")),
        *map(logit, ("forward", "both")),
    ],
)
@pytest.mark.parametrize(("gaze", "head"), [((0.3, 0, 2), (0.3, 0, 2)), ((0.3, 0, 2), None), (None, (0.3, 0, 2))])
def test_nothing_is_looked_at_in_frames_that_have_no_target(
    method: MethodSettings, gaze: tuple[float, ...] | None, head: tuple[float, ...] | None
) -> None:
    """Nothing was segmented in them, or no instance has a box; frames before, between and after them are as always."""
    person = make_person(gaze=gaze, head=head)
    without_box = (replace(TARGETS[0], box=None),)
    seen = ((), TARGETS, (), without_box, TARGETS, without_box)
    frames = [
        Scene(index=index, time_ns=index * 40_000_000, targets=targets, people=(person,))
        for index, targets in enumerate(seen)
    ]
    results = [result for block in blocks(method, frames) for result in block]
    assert [bool(result.attentions[0].values) for result in results] == [targets is TARGETS for targets in seen]
    assert all(focus is None for focus, targets in zip(focuses(results), seen, strict=True) if targets is not TARGETS)


def test_a_first_frame_is_corrected_by_those_after_it() -> None:
    frames = scenes([-0.1, *[0.15] * 7])
    forward = [result for block in blocks(bayes("forward"), frames) for result in block]
    revised = blocks(bayes("both"), frames)
    assert focuses(forward)[0] == 1
    assert [focuses(block) for block in revised if block] == [[2] * 4, [2] * 4]
    assert [len(block) for block in revised] == [0, 0, 0, 0, 0, 0, 4, 0, 4]  # seven have come: three ahead of each


@pytest.mark.parametrize("method", [bayes("forward"), bayes("both"), logit("forward"), logit("both")])
def test_the_answer_is_the_likeliest_target_of_the_likeliest_name(method: MethodSettings) -> None:
    """Three cups may be more likely than the one plate, and none of them as likely as it."""
    cups = [make_target(number, make_box((x, 0, 2), 0.05)) for number, x in ((1, -0.9), (2, -0.6), (3, -0.5))]
    plate = make_target(4, make_box((0.3, 0, 2), 0.05))
    ways = set()
    for gaze in np.linspace(-0.6, 0.2, 17):
        unnamed = Scene(index=0, time_ns=0, targets=(*cups, plate), people=(make_person(gaze=(gaze, 0, 1)),))
        named = replace(unnamed, names={1: "cup", 2: "cup", 3: "cup", 4: "plate"})
        found, alone = (
            next(result.attentions[0] for block in blocks(method, [scene]) for result in block)
            for scene in (named, unnamed)
        )
        total, same = ({value.instance_id: value.total for value in each.values} for each in (found, alone))
        assert total == same
        cup = max((1, 2, 3), key=lambda number: total[number])
        chances = {**total, None: 1 - sum(total.values())}
        of_names = {cup: total[1] + total[2] + total[3], 4: total[4], None: chances[None]}
        assert found.focus == max(of_names, key=lambda focus: of_names[focus])
        assert alone.focus == max(chances, key=lambda focus: chances[focus])
        ways.add((found.focus in (1, 2, 3), alone.focus in (1, 2, 3)))
    assert {(True, False), (False, False)} <= ways


@pytest.mark.parametrize(
    ("totals", "nowhere", "names", "focus", "tied"),
    [
        ({1: 0.3, 2: 0.3, 3: 0.2, 4: 0.3}, 0.1, {}, 1, (2, 4)),
        ({3: 0.2, 2: 0.3, 1: 0.3}, 0.2, {1: "cup", 2: "cup"}, 2, (1,)),
        ({1: 0.3, 2: 0.1, 3: 0.4}, 0.2, {1: "cup", 2: "cup"}, 3, ()),  # as likely as both cups, and than each alone
        ({1: 0.5}, 0.5, {}, None, ()),
        ({1: 0.25, 2: 0.25}, 0.5, {1: "cup", 2: "cup"}, None, ()),
        ({}, 1.0, {}, None, ()),
    ],
)
def test_equally_likely_targets_are_tied_and_none_wins_that_nowhere_equals(
    totals: dict[int, float], nowhere: float, names: dict[int, str], focus: int | None, tied: tuple[int, ...]
) -> None:
    found = answer_of(make_subject(), totals, nowhere, (0.25, 0.75), names)
    assert (found.focus, found.tied) == (focus, tied)
    assert [(each.instance_id, each.gaze, each.head, each.total) for each in found.values] == [
        (number, 0.25 * total, 0.75 * total, total) for number, total in totals.items()
    ]


def revised_by(method: BayesSettings | LogitSettings, window: list[FrameResult]) -> list[FrameResult]:
    """All frames of a window, revised."""
    if isinstance(method, BayesSettings):
        return smooth(window, len(window), method)
    return weigh_again(window, len(window), method)


@settings(deadline=None)
@given(
    gazes=st.lists(st.floats(-0.5, 0.5), min_size=1, max_size=24),
    rate_hz=st.sampled_from([None, 20, 25, 50]),
    method=st.sampled_from([bayes("both", gaze_error_deg=25), logit("both")]),
)
def test_every_frame_is_revised_by_the_block_that_waits_with_it(
    gazes: list[float], rate_hz: int | None, method: BayesSettings | LogitSettings
) -> None:
    """More than twice the time ahead waits: all but that time is revised with all that waits, and comes back.

    The expected frames are the first ones of windows that are revised as a whole.
    """
    frames = scenes(gazes, [0] * len(gazes) if rate_hz is None else [i * 10**9 // rate_hz for i in range(len(gazes))])
    forward = method.model_copy(update={"smoothing": "forward"})
    waiting: list[FrameResult] = []
    expected = []
    for (result,), scene in zip(blocks(forward, frames)[:-1], frames, strict=True):
        waiting.append(result)
        timed = scene.time_ns > waiting[0].scene.time_ns
        ahead = sum(scene.time_ns - each.scene.time_ns < 0.12e9 for each in waiting) if timed else 3
        count = len(waiting) - ahead if len(waiting) > 2 * ahead else 0
        expected.append(revised_by(method, waiting)[:count])
        waiting = waiting[count:]
    expected.append(revised_by(method, waiting))
    found = blocks(method, frames)
    assert [content(block) for block in found] == [content(block) for block in expected]
    assert [result.scene.index for block in found for result in block] == list(range(len(gazes)))


def test_a_gap_in_the_times_leaves_no_frame_with_less_time_ahead() -> None:
    """Frames of 25 per second with gaps of ten seconds, and a method that needs 0.12 s of later frames."""
    times_ns = [round(4e7 * (number + 250 * ((number + 6) // 7))) for number in range(42)]
    frames = scenes([0.15] * len(times_ns), times_ns)
    for scene, block in zip([*frames, frames[-1]], blocks(bayes("both"), frames), strict=True):
        last_ns = scene.time_ns
        for result in block:
            ahead = [time_ns for time_ns in times_ns if 0 < time_ns - result.scene.time_ns < 0.12e9]
            assert all(time_ns <= last_ns for time_ns in ahead)


class Counting:
    """The state of a person is the number of frames before; the focus says it."""

    Settings = MethodSettings
    probabilistic = False
    says_nowhere = False
    last: tuple[int, ...] = ()

    def start(self) -> int:
        return 0

    def attend(
        self, subjects: tuple[Subject, ...], scene: Scene, states: tuple[int, ...]
    ) -> tuple[tuple[Attention, ...], tuple[int, ...]]:
        after = tuple(state + 1 for state in states)
        return tuple(Attention(subject=each, focus=n) for each, n in zip(subjects, after, strict=True)), after


def counting(monkeypatch: pytest.MonkeyPatch, method: object) -> Attending:
    monkeypatch.setattr("vfoa.pipeline.open_method", lambda settings: method)
    return Attending(AttendSettings())


def test_a_state_goes_with_its_track_also_over_frames_without_the_person(monkeypatch: pytest.MonkeyPatch) -> None:
    left, right = make_person((0, 0, 50, 50)), make_person((200, 0, 250, 50))
    frames = [(left,), (left, right), (), (right,), (left, right)]
    attending, tracker = counting(monkeypatch, Counting()), Tracker(TrackingSettings())
    found = [
        {each.subject.track_id: each.focus for each in result.attentions}
        for index, people in enumerate(frames)
        for result in attending.step(Scene(index=index, time_ns=0, targets=(), people=people), tracker.step(people))
    ]
    assert found == [{1: 1}, {1: 2, 2: 1}, {}, {2: 2}, {1: 3, 2: 3}]


def test_the_states_do_not_grow_with_the_people_who_have_left(monkeypatch: pytest.MonkeyPatch) -> None:
    attending, tracker = counting(monkeypatch, Counting()), Tracker(TrackingSettings())
    for index in range(30):
        person = make_person((100 * index, 0, 100 * index + 50, 50))
        scene = Scene(index=index, time_ns=0, targets=(), people=(person,))
        (result,) = attending.step(scene, tracker.step(scene.people))
        assert result.attentions[0].focus == 1
        assert result.attentions[0].subject.track_id in attending._states
    assert len(attending._states) == TrackingSettings().ttl + 1


@given(st.lists(st.lists(st.floats(-0.6, 0.6), max_size=3), min_size=1, max_size=12), st.data())
def test_frames_attended_to_at_once_get_the_same_answers(gazes: list[list[float]], data: st.DataObject) -> None:
    chosen = AttendSettings(gaze_filter=GazeFilterSettings(cues="both"), attention=ConesSettings())
    tracker, frames = Tracker(TrackingSettings()), []
    for index, of_people in enumerate(gazes):
        people = tuple(make_person((90 * k, 0, 90 * k + 50, 50), gaze=(x, 0, 1)) for k, x in enumerate(of_people))
        scene = Scene(index=index, time_ns=0, targets=TARGETS, people=people)
        frames.append((scene, tracker.step(people), {1: "ann"}))
    one_by_one, at_once = Attending(chosen), Attending(chosen)
    expected = [result for frame in frames for result in one_by_one.step(*frame)]
    cut = data.draw(st.integers(0, len(frames)))
    found = at_once.steps(frames[:cut]) + at_once.steps(frames[cut:])
    assert at_once.takes_many
    assert content(found) == content(expected)
    assert [result.scene for result in found] == [scene for scene, *_ in frames]


def test_a_method_that_takes_one_frame_at_a_time_gets_them_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    attending, tracker = counting(monkeypatch, Counting()), Tracker(TrackingSettings())
    people = (make_person((0, 0, 50, 50)),)
    frames = [(Scene(index=k, time_ns=0, targets=(), people=people), tracker.step(people), None) for k in range(3)]
    assert focuses(attending.steps(frames)) == [1, 2, 3]
    assert not attending.takes_many


def test_a_method_that_leaves_out_a_person_or_changes_the_order_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    class Wrong(Counting):
        def attend(self, subjects, scene, states):
            attentions, after = super().attend(subjects, scene, states)
            return attentions[::-1], after

    scene = Scene(index=0, time_ns=0, targets=(), people=(make_person((0, 0, 9, 9)), make_person((50, 0, 60, 9))))
    with pytest.raises(ValueError, match="in their order"):
        counting(monkeypatch, Wrong()).step(scene, Tracked(ids=(1, 2), open=frozenset({1, 2})))
    alone = replace(scene, people=scene.people[:1])
    assert counting(monkeypatch, Wrong()).step(alone, Tracked(ids=(1,), open=frozenset({1})))

    class WrongAtOnce(Counting):
        def attend_frames(self, frames):
            return [tuple(Attention(subject=each) for each in subjects[::-1]) for subjects, _ in frames]

    with pytest.raises(ValueError, match="in their order"):
        counting(monkeypatch, WrongAtOnce()).steps([(scene, Tracked(ids=(1, 2), open=frozenset({1, 2})), None)])


def test_a_method_that_answers_fewer_frames_than_asked_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    class Short(Counting):
        def attend_frames(self, frames):
            return [() for _ in frames][1:]

    frames = [(scene, Tracked(ids=(1,), open=frozenset({1})), None) for scene in scenes([0, 0])]
    with pytest.raises(ValueError, match="answers to 1 frames; expected 2"):
        counting(monkeypatch, Short()).steps(frames)


def test_a_method_that_revises_away_a_frame_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    class Forgetful(Counting):
        look_ahead_s = 0.04

        def revise(self, window, count):
            return window[1:count]

    attending = counting(monkeypatch, Forgetful())
    for scene in scenes([0, 0]):
        assert attending.step(scene, Tracked(ids=(1,), open=frozenset({1}))) == []
    with pytest.raises(ValueError, match="revised frames"):
        attending.finish()


@pytest.mark.parametrize(
    ("method", "promised"),
    [
        (ConesSettings(), (False, False, 0)),
        (NearestSettings(method="nearest"), (False, False, 0)),
        (NearestSettings(method="nearest", limit_deg=10), (False, True, 0)),
        (bayes("forward"), (True, True, 0)),
        (bayes("both"), (True, True, 0.12)),
        (logit("forward"), (True, True, 0)),
        (logit("both"), (True, True, 0.12)),
    ],
)
def test_each_method_says_what_its_answers_are(method: MethodSettings, promised: tuple[bool, bool, float]) -> None:
    opened = open_method(method)
    assert (opened.probabilistic, opened.says_nowhere, look_ahead_s(opened)) == promised
    assert np.isscalar(look_ahead_s(opened))


def test_the_memory_of_people_who_are_gone_has_an_end() -> None:
    """After so many others that each is forgotten, the first one is met as somebody new."""
    frames = scenes([0.15] * (MOST_REMEMBERED + 3), [40_000_000 * i for i in range(MOST_REMEMBERED + 3)])

    def last(others: int) -> list[float]:
        """The attention of anna, who comes back after the others have been there, a frame each."""
        attending = Attending(AttendSettings(attention=bayes("forward")))
        names = ["anna", *map(str, range(others)), "anna"]
        times = zip(names, [*frames[: others + 1], frames[-1]], strict=True)
        for track, (name, scene) in enumerate(times):
            (result,) = attending.step(scene, Tracked(ids=(track,), open=frozenset({track})), {track: name})
        return [value.total for value in result.attentions[0].values]

    assert last(MOST_REMEMBERED) == last(0)
    assert last(MOST_REMEMBERED + 1) != last(0)


@pytest.mark.parametrize("method", [bayes("forward"), bayes("both"), logit("forward"), logit("both")])
def test_a_named_person_is_remembered_when_the_track_is_another_one(method: MethodSettings) -> None:
    """A face that turns away is lost, and comes back as another track; the manifest's rules give it its name."""
    gazes = [0.15] * 6
    frames = scenes(gazes, [40_000_000 * i for i in range(6)])

    def values(ids: Sequence[int], names: Sequence[str | None]) -> list[object]:
        attending = Attending(AttendSettings(attention=method))
        results: list[FrameResult] = []
        for scene, track, name in zip(frames, ids, names, strict=True):
            tracked = Tracked(ids=(track,), open=frozenset({track}))
            results += attending.step(scene, tracked, {track: name} if name else None)
        results += attending.finish()
        return [[(value.instance_id, value.total) for value in each.attentions[0].values] for each in results]

    followed = values([1] * 6, ["anna"] * 6)
    assert values([1, 1, 1, 2, 2, 2], ["anna"] * 6) == followed
    assert values([1] * 6, [None, "anna", *["anna"] * 4])[-1] == followed[-1]
    assert values([1, 1, 1, 2, 2, 2], [None] * 6)[-1] != followed[-1]
    assert values([1, 1, 1, 2, 2, 2], [*["anna"] * 3, *["ben"] * 3])[-1] != followed[-1]
