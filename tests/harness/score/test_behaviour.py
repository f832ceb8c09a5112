"""Behaviour from the labels of the rendered clips equals the scripts that made them; intervals are the textbook's."""

from __future__ import annotations

from itertools import groupby, pairwise
from statistics import mean

import numpy as np
import pytest
from scipy.stats import t

from harness.clips.manifest import load_manifest
from harness.labels.timeline import timeline_of
from harness.run.records import FrameRecord
from harness.score.behaviour import BehaviourRow, measure_behaviour, pooled_ratios
from harness.score.intervals import Units, rate_interval
from harness.score.reference import Reference
from harness.score.sequences import TRUTH
from harness.studio.choreography import SACCADE_FRAMES, Choreography
from harness.studio.scenario import SCENARIOS, ScenarioName
from tests.records import answers, collect_outcomes, labels

NAMES: tuple[ScenarioName, ...] = ("table", "talk", "split", "crowd")
FRAMES, SEED = 60, 7


def _script(name: ScenarioName) -> dict[str, list[tuple[str, int, int]]]:
    """The looks of each actor as the script has them: the target, the first frame and the frame after the last."""
    fixations = Choreography(SCENARIOS[name], FRAMES, SEED, {})._fixations
    return {
        actor: [
            (
                each.look.at if isinstance(each.look.at, str) else "none",
                each.first + (SACCADE_FRAMES if place else 0),
                found[place + 1].first if place + 1 < len(found) else FRAMES,
            )
            for place, each in enumerate(found)
            if each.first + (SACCADE_FRAMES if place else 0) < FRAMES
        ]
        for actor, found in fixations.items()
    }


def _frames(script: list[tuple[str, int, int]]) -> dict[int, str]:
    return {frame: target for target, first, end in script for frame in range(first, end)}


@pytest.fixture(params=NAMES)
def told(request: pytest.FixtureRequest) -> tuple[ScenarioName, list[BehaviourRow]]:
    """The behaviour that the labels of a studio clip tell; its one configuration predicts nothing."""
    manifest = load_manifest(f"studio_{request.param}")
    clip = manifest.open()
    found = manifest.labels(timeline_of(clip), None)
    assert found is not None
    records = [
        FrameRecord(
            clip=manifest.name, configuration="one", frame=each, time_ns=clip.time_ns(each), targets=(), subjects=()
        )
        for each in clip.frames
    ]
    outcomes = collect_outcomes(records, Reference(labels={manifest.name: found}))
    return request.param, [row for row in measure_behaviour(outcomes) if row.source == TRUTH]


def _values(rows: list[BehaviourRow], measure: str, subject: str, partner: str | None = None) -> dict[object, float]:
    chosen = [row for row in rows if (row.measure, row.subject, row.partner) == (measure, subject, partner)]
    return {(row.before, row.target) if row.before else row.target: row.value for row in chosen}


def test_each_subjects_looks_are_those_of_the_script(told: tuple[ScenarioName, list[BehaviourRow]]) -> None:
    name, rows = told
    rate = SCENARIOS[name].rate_hz
    for subject, script in _script(name).items():
        frames = list(_frames(script).values())
        minutes = len(frames) / rate / 60
        lengths = {target: [(end - first) / rate for at, first, end in script if at == target] for target, *_ in script}
        moves = [(before[0], after[0]) for before, after in pairwise(script)]
        expected: dict[str, dict[object, float]] = {
            "time_share": {target: frames.count(target) / len(frames) for target in lengths},
            "looks": {target: len(found) for target, found in lengths.items()},
            "looks_per_min": {target: len(found) / minutes for target, found in lengths.items()},
            "look_length_s": {
                **{target: mean(found) for target, found in lengths.items()},
                None: mean(each for found in lengths.values() for each in found),
            },
            "transitions": {move: moves.count(move) for move in moves},
            "transitions_per_min": {None: len(moves) / minutes},
        }
        for measure, values in expected.items():
            assert _values(rows, measure, subject) == pytest.approx(values), (subject, measure)


def test_what_two_do_together_is_that_of_the_scripts(told: tuple[ScenarioName, list[BehaviourRow]]) -> None:
    name, rows = told
    rate, scripts = SCENARIOS[name].rate_hz, _script(name)
    pairs = [(one, other) for one in scripts for other in scripts if one < other]
    assert {(row.subject, row.partner) for row in rows if row.measure == "mutual_gazes"} == set(pairs)
    for one, other in pairs:
        ours, theirs = _frames(scripts[one]), _frames(scripts[other])
        both = sorted(ours.keys() & theirs.keys())
        mutual = ["mutual" if (ours[f], theirs[f]) == (other, one) else "" for f in both]
        joint = [ours[f] if ours[f] == theirs[f] != "none" else "" for f in both]
        for state, share, count, length in (
            (mutual, "mutual_gaze_share", "mutual_gazes", "mutual_gaze_length_s"),
            (joint, "joint_attention_share", "joint_attentions", "joint_attention_length_s"),
        ):
            episodes = [len(list(found)) / rate for target, found in groupby(state) if target]
            told_length = _values(rows, length, one, other)[None]
            assert _values(rows, share, one, other)[None] == pytest.approx(sum(map(bool, state)) / len(both))
            assert _values(rows, count, one, other)[None] == len(episodes)
            assert told_length == pytest.approx(mean(episodes) if episodes else np.nan, nan_ok=True)


def test_who_follows_whom_is_that_of_the_scripts(told: tuple[ScenarioName, list[BehaviourRow]]) -> None:
    name, rows = told
    rate, scripts = SCENARIOS[name].rate_hz, _script(name)
    for follower in scripts:
        for leader in scripts.keys() - {follower}:
            after_s: list[float] = []
            for target, begins, _ in scripts[leader][1:]:
                theirs = [look for look in scripts[follower] if look[0] == target]
                if target in ("none", leader, follower) or any(first <= begins < end for _, first, end in theirs):
                    continue
                within = [(first - begins) / rate for _, first, _ in theirs if 0 < first - begins <= 2 * rate]
                after_s.append(min(within, default=np.nan))
            followed = [each for each in after_s if each == each]
            share = len(followed) / len(after_s) if after_s else np.nan
            assert _values(rows, "followed_share", follower, leader)[None] == pytest.approx(share, nan_ok=True)
            latency = mean(followed) if followed else np.nan
            assert _values(rows, "following_latency_s", follower, leader)[None] == pytest.approx(latency, nan_ok=True)


def test_a_configuration_stands_beside_the_labels_with_the_same_rows() -> None:
    truth = ["cup"] * 50 + ["ignore"] * 5 + ["book"] * 50 + ["none"] * 20
    # it does not see the book, loses the person for longer than a blink, and hits nothing at the end
    said = ["cup"] * 40 + [None] * 5 + ["cup"] * 30 + [None] * 20 + ["cup"] * 10 + ["none"] * 20
    outcomes = collect_outcomes(answers(said), Reference(labels={"clip": labels(*truth)}))
    rows = {(row.source, row.measure, row.before, row.target): row for row in measure_behaviour(outcomes)}
    assert rows[TRUTH, "time_share", None, "cup"].value == 50 / 120
    assert rows["one", "time_share", None, "cup"].value == pytest.approx(75 / 95)  # without the ignored frames
    assert rows["one", "time_share", None, "book"].value == 0
    assert rows[TRUTH, "transitions", "cup", "book"].value == 1
    assert rows["one", "transitions", "cup", "book"].value == 0
    assert rows["one", "transitions", "cup", "none"].value == 1
    assert rows["one", "looks", None, "cup"].value == 2  # the shorter gap ends no look
    assert rows["one", "look_length_s", None, "cup"].value == pytest.approx((75 + 10) / 2 / 25)


def test_a_run_without_labels_has_behaviour_too() -> None:
    outcomes = collect_outcomes(answers(["cup"] * 10 + ["book"] * 30), Reference(labels={}))
    rows = measure_behaviour(outcomes)
    assert {row.source for row in rows} == {"one"}
    assert _values(rows, "time_share", "girl") == {"cup": 0.25, "book": 0.75}


def test_clips_are_pooled() -> None:
    records = [
        record
        for place in range(6)
        for record in answers(["cup"] * (5 + place) + ["book"] * (15 - place), clip=f"clip {place}")
    ]
    pooled = [row for row in measure_behaviour(collect_outcomes(records, Reference(labels={}))) if row.clip is None]
    cup = next(row for row in pooled if (row.measure, row.target) == ("time_share", "cup"))
    assert (cup.value, cup.n) == (45 / 120, 120)
    assert cup.interval is not None
    assert cup.interval.unit == "clip"
    assert cup.interval.low < cup.value < cup.interval.high


def test_a_few_looks_have_the_interval_of_a_rate() -> None:
    units = Units(
        clips=np.array([0, 0, 0, 1, 1]), frames=np.array([40.0, 60, 50, 70, 45]), values=np.array([10.0, 60, 20, 5, 45])
    )
    expected = rate_interval(units)
    found = pooled_ratios(units.clips, units.frames[:, None], units.values[:, None], shares=True)
    assert (found.low[0], found.high[0], found.unit) == pytest.approx((expected.low, expected.high, "look"))


@pytest.mark.parametrize("clips", [np.zeros(9, dtype=np.intp), np.repeat(np.arange(9), 2)])
def test_equal_units_have_students_interval(clips: np.ndarray) -> None:
    values = np.random.default_rng(3).uniform(1, 3, len(clips))
    found = pooled_ratios(clips, np.ones((len(clips), 1)), values[:, None], shares=False)
    units = values if clips.max() == 0 else values.reshape(9, 2).mean(axis=1)
    low, high = t.interval(0.95, len(units) - 1, units.mean(), units.std(ddof=1) / np.sqrt(len(units)))
    assert (found.low[0], found.high[0]) == pytest.approx((low, high))
