"""A clip under several configurations, with and without threads: the same percepts, and the same stages are timed.

Configurations that see the same people share their tracks and names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np
import pytest
from typer.testing import CliRunner

from harness.cli.clips import app
from harness.clips.manifest import load_manifest
from harness.pipeline.ground_truth import TruthSegmenter
from harness.pipeline.perception import FollowedFrame, Perception, number_step, pose_frames
from harness.run.experiment import load_experiment
from harness.sources import Clip, MeasuredClip
from tests.disk import write_text
from tests.measured import measured_tables
from tests.true_stages import renamed
from vfoa.types import Instances, StereoFrame


def test_head_models_beside_the_matcher_give_the_same_and_are_timed_all_the_same() -> None:
    configurations = load_experiment("demo", clips=("studio_table",)).configurations
    found = []
    for parallel in (False, True):
        pipeline = Perception(configurations, load_manifest("studio_table").open(), parallel=parallel)
        found.append(list(pipeline.frames((1, 2))))
    for alone, beside in zip(*found, strict=True):
        for configuration in configurations:
            expected, seen = (each.by_configuration[configuration.name] for each in (alone, beside))
            assert isinstance(expected, FollowedFrame)
            assert isinstance(seen, FollowedFrame)
            assert expected.percepts
            assert seen.percepts
            np.testing.assert_array_equal(
                seen.percepts.disparity.disparity_px, expected.percepts.disparity.disparity_px
            )
            assert [view.gaze.direction.tolist() for view in seen.percepts.views if view.gaze] == [
                view.gaze.direction.tolist() for view in expected.percepts.views if view.gaze
            ]
            stages = {"decode", "stereo", "segmentation", "heads", "head_pose", "gaze", "tracking", "reconstruction"}
            assert set(seen.timings) == set(expected.timings) == stages
            assert all(seconds > 0 for seconds in seen.timings.values())


SHARED = """
clips = ["{clip}"]
{defaults}

[[configuration]]
name = "cones"

[[configuration]]
name = "posterior"
attention.method = "bayes"

[[configuration]]
name = "other_tracks"
tracking.sigma_iou = 0.3
"""
IMAGES = """
defaults.stereo.matcher = "truth"
defaults.segmentation.model = "truth"
defaults.heads.detector = "truth"
defaults.head_pose.model = "truth"
defaults.gaze.model = "truth"
"""
POSES = """
defaults.stereo.matcher = "none"
defaults.segmentation.model = "none"
defaults.heads.detector = "none"
defaults.head_pose.model = "none"
defaults.gaze.model = "none"
"""


def _followed(clip: str, defaults: str, tmp_path: Path) -> list[list[FollowedFrame]]:
    """The first two frames of a clip under each configuration of SHARED."""
    experiment = load_experiment(str(write_text(tmp_path / "shared.toml", SHARED.format(clip=clip, defaults=defaults))))
    configurations, manifest = experiment.configurations, load_manifest(clip)
    opened = manifest.open()
    if isinstance(opened, MeasuredClip):
        frames = pose_frames(configurations, opened, (1, 2), manifest)
    else:
        frames = Perception(configurations, opened, manifest=manifest).frames((1, 2))
    return [[cast("FollowedFrame", each.by_configuration[it.name]) for it in configurations] for each in frames]


@pytest.mark.parametrize(("clip", "defaults"), [("studio_talk", IMAGES), ("talk", POSES)])
def test_people_are_followed_and_named_once_for_all_who_see_the_same(
    clip: str, defaults: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    CliRunner().invoke(app, ["add", str(measured_tables(tmp_path / "talk"))], catch_exceptions=False)
    frames = _followed(clip, defaults, tmp_path)
    for cones, posterior, other in frames:
        assert cones.tracked is posterior.tracked
        assert cones.names is posterior.names
        assert other.tracked is not cones.tracked
        assert other.names is not cones.names
        assert (other.tracked, other.names) == (cones.tracked, cones.names)
        assert cones.tracked.ids == tuple(range(1, len(cones.scene.people) + 1))
        assert cones.names.targets.keys() == {target.instance.id for target in cones.scene.targets}
        assert all({"tracking", "decode"} <= each.timings.keys() for each in (cones, posterior, other))
    assert sorted(frames[0][0].names.subjects.values()) == sorted(load_manifest(clip).subjects)


class _Times(NamedTuple):
    """The numbers, times and rate of a clip."""

    numbers_ms: Mapping[int, int]
    rate_hz: float | None

    @property
    def frames(self) -> tuple[int, ...]:
        return tuple(self.numbers_ms)

    def time_ns(self, number: int) -> int:
        return self.numbers_ms[number] * 1_000_000


@pytest.mark.parametrize(
    ("numbers_ms", "rate_hz", "step"),
    [
        ({number: 40 * number for number in (1, 2, 3, 6, 7, 8)}, 25.0, 1),  # frames 4 and 5 are missing
        ({10 * place: 10**9 + 40 * place for place in range(9)}, 25.0, 10),  # numbered in tens, with times
        ({10 * place: 400 * place for place in range(9)}, 25.0, 1),  # every tenth frame
        ({place: 40 * place + 60_000 * (place > 5) for place in range(9)}, 25.0, 1),  # a pause of a minute
        (dict.fromkeys(range(3), 1000), 25.0, 1),  # times that stand still
        ({10 * place: 10_000 * place for place in range(9)}, None, 10),
        ({7: 0}, 25.0, 1),
    ],
)
def test_the_step_of_the_numbers_is_that_of_frames_at_the_rate(
    numbers_ms: Mapping[int, int], rate_hz: float | None, step: int
) -> None:
    assert number_step(cast("Clip", _Times(numbers_ms, rate_hz))) == step


def test_a_segmenter_that_numbers_anew_in_each_frame_changes_no_object(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither its number, its automatic name and its person's instance, nor its box."""
    configurations = load_experiment("demo", clips=("studio_talk",)).configurations[:2]

    def objects() -> list[dict[str, dict[int, list[float]]]]:
        found = []
        for each in Perception(configurations, load_manifest("studio_talk").open()).frames(range(1, 5)):
            for seen in each.by_configuration.values():
                assert isinstance(seen, FollowedFrame)
                of_people = {person.instance_id: [*map(float, person.eye_origin_left)] for person in seen.scene.people}
                boxes = {
                    target.instance.id: [*map(float, target.box.center_m)]
                    for target in seen.scene.targets
                    if target.box
                }
                found.append({"people": of_people, "boxes": boxes, "names": dict(seen.names.targets)})
        return found

    expected = objects()
    known = TruthSegmenter.segment

    def segment(stage: TruthSegmenter, frame: StereoFrame) -> Instances:
        """The true instances, numbered by their places in an order that is another one in each frame."""
        true = known(stage, frame)
        ids = [instance.id for instance in true.instances]
        by = frame.index - 1
        anew = renamed(true, dict(zip(ids, ids[by:] + ids[:by], strict=True)))
        return replace(anew, instances=tuple(replace(each, keeps_id=False) for each in anew.instances))

    monkeypatch.setattr(TruthSegmenter, "segment", segment)
    assert objects() == expected
