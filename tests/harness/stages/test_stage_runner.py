"""A stage is called through one runner, which knows no protocol."""

from __future__ import annotations

import sys
from pathlib import Path
from types import FrameType

import numpy as np
import pytest

from harness.clips.manifest import load_manifest
from harness.run.experiment import load_experiment
from harness.stages.cache.stage import open_cache
from harness.stages.cache.store import Store
from harness.stages.sharing import SharedPipeline
from harness.stages.slots import SLOTS
from harness.stages.stage_runner import StageMemo, StageRunner, build_stage
from vfoa.pipeline import perceive
from vfoa.stereo.block_matching import BlockMatcher

MOST_BETWEEN = 3
"""Frames of the harness between ``perceive`` and the matcher."""


class Novel:
    """A stage with a method that no protocol has today."""

    def __init__(self) -> None:
        self.calls = 0

    def segment_twice(self, frame: object, often: str) -> tuple[str, int]:
        self.calls += 1
        return often, self.calls


def test_a_new_method_of_a_protocol_needs_nothing_new() -> None:
    stage, memo, frame = Novel(), StageMemo(), object()
    memo.timings = {}
    runner = StageRunner(stage, slot="segmentation", name="novel", memo=memo)
    assert runner.segment_twice(frame, "a") == ("a", 1)
    assert runner.segment_twice(frame, "a") == ("a", 1)
    assert runner.segment_twice(frame, "b") == ("b", 2)
    assert list(memo.timings) == ["segmentation"]
    assert not hasattr(runner, "match")


@pytest.mark.parametrize("cached", [False, True])
def test_few_frames_stand_between_the_pipeline_and_a_matcher(
    cached: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = load_experiment("demo", clips=("studio_table",))
    configurations = [each for each in experiment.configurations if each.name == "bm-one"]
    clip = load_manifest("studio_table").open()
    cache = open_cache(Store(tmp_path, 10**9), "studio_table", clip, configurations) if cached else None
    between: list[int] = []
    match = BlockMatcher.match

    def counted(self: BlockMatcher, frame: object) -> object:
        count, at = 0, sys._getframe(1)
        while isinstance(at, FrameType) and at.f_code is not perceive.__code__:
            count, at = count + ("/harness/" in at.f_code.co_filename), at.f_back  # type: ignore[assignment]
        between.append(count)
        return match(self, frame)  # type: ignore[arg-type]

    monkeypatch.setattr(BlockMatcher, "match", counted)
    list(SharedPipeline(configurations, clip, cache).frames([1]))
    assert between
    assert max(between) <= MOST_BETWEEN


@pytest.mark.parametrize("damage", ["another's", "garbage"])
def test_a_stored_output_that_is_another_frames_or_none_is_computed_again(damage: str, tmp_path: Path) -> None:
    clip = load_manifest("studio_table").open()
    choice = SLOTS["stereo"].parse({"matcher": "bm", "min_depth_m": 0.5}, "test")
    assert choice is not None
    experiment = load_experiment("demo", clips=("studio_table",))
    store = Store(tmp_path, 10**9)
    first = experiment.configurations[0]
    cache = open_cache(store, "studio_table", clip, [first])
    choice = first.choices["stereo"]
    assert choice is not None
    tallies: dict[str, object] = {}
    runner = build_stage(choice, clip, StageMemo(), cache.outputs_of(choice, tallies))  # type: ignore[arg-type]
    expected = {number: runner.match(clip.frame(number)).disparity_px for number in (1, 2)}
    paths = sorted(tmp_path.rglob("*.bin"))
    assert len(paths) == 2
    if damage == "another's":
        paths[0].write_bytes(paths[1].read_bytes())
    else:
        store.save(paths[0], b"\x93\x01\x02")
    again = build_stage(choice, clip, StageMemo(), cache.outputs_of(choice, tallies))  # type: ignore[arg-type]
    np.testing.assert_array_equal(again.match(clip.frame(1)).disparity_px, expected[1])
    (tally,) = tallies.values()
    assert tally.damaged == {paths[0].name}  # type: ignore[attr-defined]
