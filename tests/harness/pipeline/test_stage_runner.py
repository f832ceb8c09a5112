"""Every call of a stage goes through one runner, which knows no protocol: shared, cached, checked and timed there."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from harness.clips.manifest import load_manifest
from harness.pipeline.cache import open_cache
from harness.pipeline.cache_store import Store
from harness.pipeline.configuration import STAGES
from harness.pipeline.stage_runner import Memo, StageRunner, Timings, timed
from harness.run.experiment import load_experiment
from tests.calls import calls_to_match
from vfoa.tracking import TrackingSettings


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A clock that stands unless a test moves it."""
    now = SimpleNamespace(s=100.0)
    monkeypatch.setattr("harness.pipeline.stage_runner.time", SimpleNamespace(perf_counter=lambda: now.s))
    return now


def test_a_call_of_the_same_inputs_is_made_once_and_charged_in_full_to_everyone(clock: SimpleNamespace) -> None:
    memo, calls, given = Memo(), [], [1]

    def work(value: object) -> object:
        calls.append(value)
        clock.s += 2.0
        return object()

    first = memo.call("stage", work, given)
    timings, memo.timings = memo.timings, {"decode": 4.0}
    assert memo.call("stage", work, given) is first
    assert (calls, timings, memo.timings) == ([given], {"stage": 2.0}, {"decode": 4.0, "stage": 2.0})


def test_equal_objects_are_different_inputs_but_equal_settings_are_the_same() -> None:
    memo = Memo()

    def work(given: object) -> object:
        return object()

    assert len({id(memo.call("stage", work, [1])) for _ in range(3)}) == 3
    assert len({id(memo.call("stage", work, TrackingSettings())) for _ in range(3)}) == 1


def test_a_block_is_charged_its_seconds_and_a_second_one_added(clock: SimpleNamespace) -> None:
    timings: Timings = {"decode": 3.0}
    for seconds in (2.5, 0.5):
        with timed(timings, "stereo"):
            clock.s += seconds
    assert timings == {"decode": 3.0, "stereo": 3.0}


class Novel:
    """A stage with a method that no protocol has today; a call takes a second."""

    def __init__(self, clock: SimpleNamespace) -> None:
        self.calls, self._clock = 0, clock

    def segment_twice(self, frame: object, often: str) -> tuple[str, int]:
        self.calls += 1
        self._clock.s += 1.0
        return often, self.calls


def test_a_new_method_of_a_protocol_needs_nothing_new(clock: SimpleNamespace) -> None:
    memo, frame = Memo(), object()
    runner = StageRunner(Novel(clock), slot="segmentation", name="novel", memo=memo)
    assert runner.segment_twice(frame, "a") == ("a", 1)
    assert runner.segment_twice(frame, "a") == ("a", 1)
    assert runner.segment_twice(frame, "b") == ("b", 2)
    assert memo.timings == {"segmentation": 3.0}
    assert not hasattr(runner, "match")


def test_few_calls_are_between_the_loop_and_the_matcher() -> None:
    assert len(calls_to_match()) <= 8


@pytest.mark.parametrize("damage", ["another's", "garbage"])
def test_a_stored_output_that_is_another_frames_or_none_is_computed_again(damage: str, tmp_path: Path) -> None:
    clip = load_manifest("studio_table").open_images()
    experiment = load_experiment("demo", clips=("studio_table",))
    store = Store(tmp_path, 10**9)
    first = experiment.configurations[0]
    cache = open_cache(store, "studio_table", clip, [first])
    choice = first.choices["stereo"]
    assert choice is not None
    matcher = STAGES["stereo"].build(choice, clip)
    stored = cache.outputs_of(choice)
    runner = StageRunner(matcher, slot="stereo", name="bm", stored=stored)
    expected = {number: runner.match(clip.frame(number)).disparity_px for number in (1, 2)}
    paths = sorted(tmp_path.rglob("*.bin"))
    assert len(paths) == 2
    if damage == "another's":
        paths[0].write_bytes(paths[1].read_bytes())
    else:
        store.save(paths[0], b"\x93\x01\x02")
    again = StageRunner(matcher, slot="stereo", name="bm", stored=stored)
    np.testing.assert_array_equal(again.match(clip.frame(1)).disparity_px, expected[1])
    assert stored is not None
    tally = stored.take()
    assert (tally.reused, tally.computed) == (set(), {path.name for path in paths})
