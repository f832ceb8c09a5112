"""A clip under several configurations, with and without threads: the same percepts, and the same stages are timed.

Configurations that see the same people share their tracks and names."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import numpy as np
import pytest
from typer.testing import CliRunner

from harness.cli.clips import app
from harness.clips.manifest import load_manifest
from harness.pipeline.perception import FollowedFrame, Perception, pose_frames
from harness.run.experiment import load_experiment
from harness.sources import MeasuredClip
from tests.disk import write_text
from tests.measured import measured_tables


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
