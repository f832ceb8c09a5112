"""Answers from a run's scenes are those of its loop over frames, to the last bit."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import harness
from harness.clips.add import add_clip
from harness.clips.manifest import ClipManifest
from harness.run.attend import attend_scenes
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.plan import Plan
from harness.run.records import TargetRecord
from harness.run.runner import prepare, run_plan
from harness.run.table_files import find_tables, read_table
from harness.run.table_records import read_records
from harness.run.table_scenes import read_scenes
from harness.score.labelled_run import LabelledPair, PairCase, read_features
from harness.sources import Clip
from tests import graphs
from tests.attended import assert_scenes_give_the_same, values_of
from tests.disk import write_text
from tests.experiments import BLOCKS, experiment_of
from tests.measured import START_NS, STEP_NS, measured_tables
from vfoa.errors import VfoaError
from vfoa.logit import LogitSettings
from vfoa.pipeline import AttendSettings

CONFIGURATIONS: dict[str, dict[str, object]] = {
    "cones": {},
    "wide": {"attention.cones_cm": [10, 25]},
    "filtered": {"gaze_filter.cues": "both"},
    "oriented": {"reconstruction.boxes": "oriented", "gaze_filter.cues": "both"},
    "keys": {"gaze_filter.cues": "gaze", "segmentation.every": 3},
    "nearest": {"attention.method": "nearest"},
    "off": {"attention.method": "bayes", "attention.smoothing": "off", "attention.error": "told"},
    "forward": {"attention.method": "bayes"},
    "both": {"attention.method": "bayes", "attention.smoothing": "both", "attention.look_ahead_s": 0.2},
    "logit": {"attention.method": "logit", "attention.smoothing": "both", "attention.look_ahead_s": 0.1},
    "logit-forward": {"attention.method": "logit"},
}
POSES = experiment_of(
    ["talk"],
    {
        "cones": {"gaze_filter.cues": "both"},
        "bayes": {"attention.method": "bayes"},
        "logit": {"attention.method": "logit"},
    },
    preset="measured",
)
SHARING = ("off", "both")
FRAMES = 7


@dataclass(frozen=True)
class Finished:
    """A run with its plan."""

    directory: RunDirectory
    plan: Plan

    @property
    def run(self) -> harness.RunResults:
        """The run as scripts have it."""
        return harness.load_run(self.directory.path)


def _run(file: Path, limit: int | None = None) -> Finished:
    plan = prepare(load_experiment(str(file)), limit=limit)
    return Finished(run_plan(plan, file.parent / "run", workers=1, progress=lambda clip: None), plan)


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    """A run on a clip with images."""
    folder = tmp_path_factory.mktemp("images")
    weights = Path(graphs.seven_levels(folder / "levels.onnx")).as_posix()
    window = {"gaze.model": "gaze360", "gaze.weights": weights, "gaze.stride": 1, "head_pose.model": "none"}
    configurations = CONFIGURATIONS | {"window": window | {"attention.method": "bayes"}}
    return _run(write_text(folder / "all.toml", experiment_of(["studio_talk"], configurations, BLOCKS)), FRAMES)


@pytest.fixture(scope="module")
def poses(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Finished]:
    """A run on a clip of recorded poses, in the working directory."""
    folder = tmp_path_factory.mktemp("poses")
    measured_tables(folder / "data" / "talk")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        add_clip(folder / "data" / "talk")
        yield _run(write_text(folder / "poses.toml", POSES))


def test_answers_from_scenes_are_those_of_the_loop(images: Finished) -> None:
    assert_scenes_give_the_same(images.directory, *images.plan.clips, images.plan.experiment.configurations)


def test_answers_from_scenes_of_poses_are_those_of_the_loop(poses: Finished) -> None:
    assert_scenes_give_the_same(poses.directory, *poses.plan.clips, poses.plan.experiment.configurations)


def test_methods_that_share_a_scene_give_what_each_gives_alone(images: Finished) -> None:
    paths = dict(find_tables(images.directory))["studio_talk", "off"]
    settings = {each.name: each.attend for each in images.plan.experiment.configurations if each.name in SHARING}
    together = defaultdict[str, list[Any]](list)
    for name, frame, result in attend_scenes(paths, settings):
        assert frame.scene is result.scene
        together[name].append(values_of(result))
    alone = {name: [values_of(each) for _, _, each in attend_scenes(paths, {name: settings[name]})] for name in SHARING}
    assert together == alone
    assert alone["off"] != alone["both"]


COLUMNS = ["frame", "track_id", "focus", "targets", "total"]


def _of(answers: pd.DataFrame, *configurations: str) -> pd.DataFrame:
    """The answers of these configurations as text, which can be compared."""
    return answers[answers["configuration"].isin(configurations)].reset_index(drop=True).astype(str)


def test_a_script_gets_answers_under_other_settings(images: Finished, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ClipManifest, "open", _opens_no_clip)
    answers = images.run.answers
    same = images.run.attend({})
    assert same.columns.tolist() == answers.columns.tolist()
    assert same.astype(str).equals(answers.astype(str))
    wide = images.run.attend({"attention.cones_cm": [10.0, 25.0]}, ["cones"]).astype(str)
    assert wide[COLUMNS].equals(_of(answers, "wide")[COLUMNS])
    assert not wide["total"].equals(_of(answers, "cones")["total"])
    nearest = images.run.attend({"attention.method": "nearest"}, ["cones", "wide"]).astype(str)
    for name in ("cones", "wide"):
        assert _of(nearest, name)[COLUMNS].equals(_of(answers, "nearest")[COLUMNS])
    unfiltered = images.run.attend({"gaze_filter.cues": "off"}, "filtered")
    assert unfiltered[["gaze_filtered", "head_filtered"]].isna().all(axis=None)
    assert _of(unfiltered, "filtered")[COLUMNS].equals(_of(answers, "cones")[COLUMNS])


def _opens_no_clip(*_: object) -> Clip:
    raise AssertionError("a clip is opened")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"stereo.matcher": "bm"}, "attend: stereo.matcher: expected settings of attention and gaze_filter, which"),
        ({"attention.cones": [1]}, "attend: cones: unknown key 'attention.cones'; did you mean 'cones_cm'?"),
        ({"attention.method": "answers"}, 'attend: cones: attention.method = "answers" needs the clip; run the'),
    ],
)
def test_what_scenes_do_not_have_is_one_line(images: Finished, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(VfoaError) as caught:
        images.run.attend(changes, ["cones"])
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_unknown_configuration_is_one_line(images: Finished) -> None:
    with pytest.raises(VfoaError, match=r"no configuration 'cone'.*'cones'"):
        images.run.attend({}, ["cone"])


def test_scenes_are_read_with_and_without_their_clouds(images: Finished) -> None:
    paths = dict(find_tables(images.directory))["studio_talk", "forward"]
    with_clouds, without = (list(read_scenes(paths, count)) for count in (128, 0))
    assert {len(target.points_left) for frame in with_clouds for target in frame.scene.targets} == {128}
    assert {len(target.points_left) for frame in without for target in frame.scene.targets} == {0}
    assert set(read_table(images.directory, "clouds")["points"].to_pylist()) == {128}
    with pytest.raises(VfoaError, match=r"clouds\.parquet: .*17 points"):
        list(read_scenes(paths, 17))
    assert [frame.scene.index for frame in with_clouds] == list(range(1, FRAMES + 1))


def test_a_fit_to_a_run_without_the_clouds_that_it_looks_at_says_which_run_to_make(
    images: Finished, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vfoa.bayes.RAYS", 17)
    settings = AttendSettings(attention=LogitSettings(method="logit"))
    paths = dict(find_tables(images.directory))["studio_talk", "forward"]
    pair = LabelledPair(clip="studio_talk", configuration="forward", tables=paths, settings=settings, truths={})
    with pytest.raises(VfoaError, match=r'studio_talk: forward .*method = "logit"'):
        read_features(PairCase(pair, None), lambda word: None)


def test_the_records_of_targets_are_those_that_are_read_with_the_answers(images: Finished, poses: Finished) -> None:
    for run, pair in ((images, ("studio_talk", "forward")), (poses, ("talk", "bayes"))):
        frames = list(read_scenes(dict(find_tables(run.directory))[pair], 0))
        read = [each.targets for each in read_records(run.directory) if each.configuration == pair[1]]
        assert [frame.targets for frame in frames] == read
        assert [[each.instance_id for each in frame.targets] for frame in frames] == [
            [target.instance.id for target in frame.scene.targets] for frame in frames
        ]


def test_a_target_that_is_at_rest_is_one_object_in_all_frames(poses: Finished) -> None:
    frames = list(read_scenes(dict(find_tables(poses.directory))["talk", "bayes"]))
    by_row: dict[TargetRecord, set[int]] = defaultdict(set)
    for frame in frames:
        for record, target in zip(frame.targets, frame.scene.targets, strict=True):
            by_row[record].add(id(target))
    assert {len(objects) for objects in by_row.values()} == {1}
    assert len(by_row) < sum(len(frame.targets) for frame in frames)


def test_a_person_is_remembered_over_a_gap_and_until_the_last_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    people = measured_tables(tmp_path / "data" / "talk") / "people.csv"
    without = tuple(f"{frame},{START_NS + frame * STEP_NS},ben," for frame in (5, 6, 10, 11, 12))
    rows = people.read_text().splitlines(keepends=True)
    people.write_text("".join(row for row in rows if not row.startswith(without)))
    add_clip(tmp_path / "data" / "talk")
    found = _run(write_text(tmp_path / "poses.toml", POSES))
    tracked = [frame.tracked for frame in read_scenes(dict(find_tables(found.directory))["talk", "bayes"])]
    assert [len(each.ids) for each in tracked] == [2] * 4 + [1] * 2 + [2] * 3 + [1] * 3
    assert [len(each.open) for each in tracked] == [2] * 9 + [1] * 3
    assert_scenes_give_the_same(found.directory, *found.plan.clips, found.plan.experiment.configurations)
