"""Whole runs with a temporal gaze model: a frame waits for those after it, and nothing else changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.clips.manifest import load_manifest
from harness.pipeline.configuration import Configuration
from harness.pipeline.ground_truth import OracleSettings, TruthSegmenter
from harness.pipeline.perception import Perception
from harness.run.experiment import Experiment, load_experiment
from harness.run.records import FrameRecord
from harness.run.runner import prepare, run_plan
from harness.run.table_records import read_records
from harness.sources import Clip
from tests import graphs
from tests.disk import write_text
from tests.experiments import TRUTH, experiment_of
from vfoa.gaze.gaze360 import Gaze360
from vfoa.gaze.temporal import HeadWindow
from vfoa.types import Gaze, Head, Instances, Percepts, StereoFrame

CLIPS = ("studio_table", "studio_talk")
LAST = 7
CONFIGURATIONS: dict[str, dict[str, object]] = {
    "truth": {},
    "bm": {"stereo.matcher": "bm", "stereo.wls": False},
    "every": {"gaze.stride": 1},
    "static": {"gaze.model": "truth"},
}


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    folder = tmp_path_factory.mktemp("temporal")
    weights = Path(graphs.seven_levels(folder / "levels.onnx")).as_posix()
    window = {"gaze.model": "gaze360", "gaze.weights": weights, "gaze.stride": 2}
    stages = {**TRUTH, "stereo.min_depth_m": 0.8, "head_pose.model": "none", **window}
    text = experiment_of(CLIPS, CONFIGURATIONS, stages)
    return load_experiment(str(write_text(folder / "temporal.toml", text)))


def run(experiment: Experiment, out: Path, *, only: str | None = None) -> list[FrameRecord]:
    chosen = tuple(configuration for configuration in experiment.configurations if only in (None, configuration.name))
    plan = prepare(Experiment(name="temporal", clips=experiment.clips, configurations=chosen), limit=LAST)
    return list(read_records(run_plan(plan, out, workers=1, progress=lambda clip: None)))


@pytest.fixture(scope="module")
def records(experiment: Experiment, tmp_path_factory: pytest.TempPathFactory) -> list[FrameRecord]:
    return run(experiment, tmp_path_factory.mktemp("runs") / "all")


@pytest.mark.parametrize(("configuration", "stride"), [("truth", 2), ("bm", 2), ("every", 1)])
def test_each_frames_gaze_is_that_of_its_seven_frames(
    experiment: Experiment, records: list[FrameRecord], configuration: str, stride: int
) -> None:
    """Estimated once more from the clip itself: one person, whose head is known in every frame."""
    settings = next(each.choices["gaze"] for each in experiment.configurations if each.name == configuration).settings
    model = Gaze360(settings)
    clip = load_manifest("studio_table").open()
    frames = {number: clip.frame(number) for number in range(1, LAST + 1)}
    heads = {number: Head(box_px=clip.truth(number).people[0].head_box_px, score=1.0) for number in frames}
    found = [each for each in records if (each.clip, each.configuration) == ("studio_table", configuration)]
    assert [each.frame for each in found] == list(frames)
    for record in found:
        wanted = (record.frame + place * stride for place in (-3, -2, -1, 0, 1, 2, 3))
        numbers = [number if number in frames else record.frame for number in wanted]
        crops = [model.crop(frames[number], heads[number]) for number in numbers]
        expected = model.estimate_sequence(crops, heads[record.frame], frames[record.frame].rig)
        (subject,) = record.subjects
        np.testing.assert_allclose(subject.gaze, expected.direction, atol=1e-9)
        assert subject.gaze_sigma_rad == pytest.approx(expected.sigma_rad)
    assert len({record.subjects[0].gaze for record in found}) == LAST, "the frames' crops must differ to tell anything"


def test_a_configuration_among_others_gives_what_it_gives_alone(
    experiment: Experiment, records: list[FrameRecord], tmp_path: Path
) -> None:
    found = run(experiment, tmp_path / "static", only="static")
    assert found == [record for record in records if record.configuration == "static"]


class WatchedClip:
    """A clip that keeps the numbers of the frames that were read."""

    def __init__(self, clip: Clip) -> None:
        self._clip, self.read = clip, []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._clip, name)

    def frame(self, number: int) -> StereoFrame:
        self.read.append(number)
        return self._clip.frame(number)


def only(experiment: Experiment, *names: str) -> list[Configuration]:
    return [configuration for configuration in experiment.configurations if configuration.name in names]


@pytest.fixture
def estimated(monkeypatch: pytest.MonkeyPatch) -> list[Head]:
    """The heads that the network was asked of."""
    asked: list[Head] = []
    estimate = Gaze360.estimate_sequence

    def counted(self: Gaze360, crops: Sequence[Any], head: Head, rig: Any) -> Gaze:
        asked.append(head)
        return estimate(self, crops, head, rig)

    monkeypatch.setattr(Gaze360, "estimate_sequence", counted)
    return asked


class OtherSettings(OracleSettings):
    """Of a stage that is not the same, whatever it answers."""

    mark: int = 1


@pytest.mark.parametrize("slot", ["segmentation", "heads", "tracking"])
def test_the_network_runs_anew_where_heads_may_be_others(
    experiment: Experiment, estimated: list[Head], slot: str
) -> None:
    (base,) = only(experiment, "truth")
    if slot == "tracking":
        tracking = base.attend.tracking.model_copy(update={"sigma_iou": 0.3})
        other = replace(base, name="other", attend=base.attend.model_copy(update={"tracking": tracking}))
    else:
        choice = replace(base.choices[slot], settings=OtherSettings())
        other = replace(base, name="other", choices={**base.choices, slot: choice})
    pipeline = Perception([base, other], load_manifest("studio_table").open())
    assert len(list(pipeline.frames(range(1, 4)))) == 3
    assert len(estimated) == 2 * 3


def test_the_network_runs_once_for_configurations_that_differ_in_stereo_alone(
    experiment: Experiment, estimated: list[Head], monkeypatch: pytest.MonkeyPatch
) -> None:
    """And follows heads once: a second time in a frame, a head that is gone would be missed twice."""
    followed: list[int] = []
    add = HeadWindow.add

    def counted(self: HeadWindow, percepts: Percepts, tracks: Sequence[int | None]) -> None:
        followed.append(percepts.index)
        add(self, percepts, tracks)

    monkeypatch.setattr(HeadWindow, "add", counted)
    segmented: list[int] = []
    segment = TruthSegmenter.segment

    def counted_too(self: TruthSegmenter, frame: StereoFrame) -> Instances:
        segmented.append(frame.index)
        return segment(self, frame)

    monkeypatch.setattr(TruthSegmenter, "segment", counted_too)
    pipeline = Perception(only(experiment, "truth", "bm"), load_manifest("studio_table").open())
    frames = list(pipeline.frames(range(1, LAST + 1)))
    assert len(estimated) == LAST
    assert followed == segmented == list(range(1, LAST + 1))
    for shared in frames:
        bills = [followed.timings for followed in shared.by_configuration.values()]
        assert all({"decode", "stereo", "gaze", "reconstruction"} <= bill.keys() for bill in bills)
        assert bills[0]["decode"] == bills[1]["decode"]
        assert bills[0]["stereo"] != bills[1]["stereo"]


@pytest.mark.parametrize(("names", "ahead"), [(("static",), 0), (("every",), 3), (("every", "truth", "static"), 6)])
def test_a_frame_leaves_when_those_its_gaze_needs_were_read(
    experiment: Experiment, names: tuple[str, ...], ahead: int
) -> None:
    clip = WatchedClip(load_manifest("studio_table").open())
    pipeline = Perception(only(experiment, *names), clip)
    left = [(shared.frame.index, clip.read[-1]) for shared in pipeline.frames(range(1, LAST + 1))]
    assert left == [(number, min(number + ahead, LAST)) for number in range(1, LAST + 1)]
    assert clip.read == list(range(1, LAST + 1))
