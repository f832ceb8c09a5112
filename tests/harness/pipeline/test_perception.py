"""A clip under several configurations, with and without threads: the same percepts, and the same stages are timed."""

from __future__ import annotations

import numpy as np

from harness.clips.manifest import load_manifest
from harness.pipeline.perception import Perception
from harness.run.experiment import load_experiment


def test_head_models_beside_the_matcher_give_the_same_and_are_timed_all_the_same() -> None:
    configurations = load_experiment("demo", clips=("studio_table",)).configurations
    found = []
    for parallel in (False, True):
        pipeline = Perception(configurations, load_manifest("studio_table").open(), parallel=parallel)
        found.append(list(pipeline.frames((1, 2))))
    for alone, beside in zip(*found, strict=True):
        for configuration in configurations:
            expected, seen = (each.by_configuration[configuration.name] for each in (alone, beside))
            assert isinstance(expected, tuple)
            assert isinstance(seen, tuple)
            np.testing.assert_array_equal(seen[0].disparity.disparity_px, expected[0].disparity.disparity_px)
            assert [view.gaze.direction.tolist() for view in seen[0].views if view.gaze] == [
                view.gaze.direction.tolist() for view in expected[0].views if view.gaze
            ]
            stages = {"decode", "stereo", "segmentation", "heads", "head_pose", "gaze", "reconstruction"}
            assert set(seen[2]) == set(expected[2]) == stages
            assert all(seconds > 0 for seconds in seen[2].values())
