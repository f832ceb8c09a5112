"""What is written while a clip is perceived: every value, once for all that see the same, and never a half of it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.pipeline.ground_truth import TruthMatcher
from harness.pipeline.perception import FollowedFrame, SharedFrame
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.run.scene_identity import key_of
from harness.run.scenes import SceneWriters
from harness.run.table_columns import ColumnReader
from harness.run.table_files import find_tables, read_table
from harness.run.table_records import read_records
from harness.run.table_scenes import read_scenes
from tests.disk import write_text
from tests.experiments import TRUTH, experiment_of
from tests.records import write_manifest
from vfoa.bayes import RAYS
from vfoa.types import Disparity, HeadView, StereoFrame
from vfoa.visible import spaced

CONFIGURATIONS: dict[str, dict[str, object]] = {
    "raw": {},
    "filtered": {"gaze_filter.cues": "both"},
    "other-gaze": {"gaze.seed": 7},
    "posterior": {"attention.method": "bayes"},
    "other-depth": {"stereo.matcher": "truth"},
}
STAGES = {**TRUTH, "stereo.matcher": "bm", "stereo.min_depth_m": 0.8, "reconstruction.boxes": "oriented"}


def _run(folder: Path, progress: Callable[[str], None] = lambda clip: None, frames: int = 3) -> RunDirectory:
    path = write_text(folder / "four.toml", experiment_of(["studio_talk"], CONFIGURATIONS, STAGES))
    return run_plan(prepare(load_experiment(str(path)), limit=frames), folder / "out", workers=1, progress=progress)


def _folders(directory: RunDirectory, place: str) -> list[Path]:
    return sorted(path for path in (directory.path / place).glob("*/*") if path.is_dir())


@pytest.fixture(scope="module")
def followed(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunDirectory, list[SharedFrame]]:
    """A run, and what it has perceived. The true disparities, which one configuration takes, lack frame 2."""
    frames: list[SharedFrame] = []
    write, match = SceneWriters.write, TruthMatcher.match

    def blinking(self: TruthMatcher, frame: StereoFrame) -> Disparity:
        found = match(self, frame)
        return found if frame.index != 2 else Disparity(disparity_px=np.full_like(found.disparity_px, np.nan))

    def noted(self: SceneWriters, shared: SharedFrame) -> None:
        frames.append(shared)
        write(self, shared)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SceneWriters, "write", noted)
        patch.setattr(TruthMatcher, "match", blinking)
        return _run(tmp_path_factory.mktemp("scenes")), frames


def _rows(directory: RunDirectory, table: str, configuration: str) -> list[dict[str, Any]]:
    """The rows of a table that a configuration's answers come from."""
    paths = dict(find_tables(directory))["studio_talk", configuration]
    keys = {"scene": paths["frames"].parts[-3], "directions": paths["directions"].parts[-3]}
    rows = read_table(directory, table).to_pylist()
    return [row for row in rows if all(row.get(name, key) == key for name, key in keys.items())]


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


@pytest.mark.parametrize("configuration", ["raw", "filtered", "other-gaze", "other-depth"])
def test_every_column_has_what_was_perceived(
    followed: tuple[RunDirectory, list[SharedFrame]], configuration: str
) -> None:
    directory, frames = followed
    perceived = [shared.by_configuration[configuration] for shared in frames]
    assert len(perceived) == 3
    scenes = [each for each in perceived if isinstance(each, FollowedFrame) and each.percepts]
    rigs = [each.percepts.rig for each in scenes if each.percepts]
    rows = _rows(directory, "frames", configuration)
    assert [(row["frame"], row["time_ns"], row["masks_from"]) for row in rows] == [
        (each.scene.index, each.scene.time_ns, None) for each in scenes
    ]
    for name in ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px", "baseline_m", "cx_right_px"):
        assert [row[name] for row in rows] == [getattr(rig, name) for rig in rigs]
    assert [(row["has_truth"], row["has_right"], row["has_depth"]) for row in rows] == [(True, True, False)] * 3

    targets = [(each, target) for each in scenes for target in each.scene.targets]
    rows = _rows(directory, "instances", configuration)
    assert len(rows) == len(targets) > 10
    for row, (each, target) in zip(rows, targets, strict=True):
        instance, box = target.instance, target.box
        assert box
        expected = {
            "frame": each.scene.index,
            "instance_id": instance.id,
            "name": each.names.targets[instance.id],
            "label": instance.label,
            "own_name": instance.name,
            "category_id": instance.category_id,
            "is_thing": instance.is_thing,
            "score": instance.score,
            "box_px": _plain(target.box_px),
            "points": len(target.points_left),
            "center_m": _plain(box.center_m),
            "half_size_m": _plain(box.half_size_m),
            "depth_from": 1 if (configuration, each.scene.index) == ("other-depth", 2) else None,
            "axes": [*box.left_from_box[:, 0], *box.left_from_box[:, 1], *box.left_from_box[:, 2]],
        }
        assert {name: row[name] for name in expected} == expected

    people = [(each, *tracked) for each in scenes for tracked in each.tracked.people(each.scene.people)]
    found = zip(*(_rows(directory, table, configuration) for table in ("people", "directions")), strict=True)
    for (person_row, look_row), (each, track, person) in zip(found, people, strict=True):
        view = person.view
        assert isinstance(view, HeadView)
        assert view.gaze
        assert view.head_pose
        expected = {
            "frame": each.scene.index,
            "track_id": track,
            "name": each.names.subjects.get(track),
            "instance_id": person.instance_id,
            "head_box_px": _plain(view.head.box_px),
            "head_score": view.head.score,
        }
        assert {name: person_row[name] for name in expected} == expected
        expected = {
            "frame": each.scene.index,
            "track_id": track,
            "eye_origin_m": _plain(person.eye_origin_left),
            "gaze": _plain(view.gaze.direction),
            "gaze_sigma_rad": view.gaze.sigma_rad,
            "no_gaze": None,
            "head": _plain(view.head_pose.direction),
            "head_sigma_rad": view.head_pose.sigma_rad,
            "depth_from": 1 if (configuration, each.scene.index) == ("other-depth", 2) else None,
        }
        assert {name: look_row[name] for name in expected} == expected
    assert len(people) == 6


def test_scenes_say_which_depths_are_of_an_earlier_frame(followed: tuple[RunDirectory, list[SharedFrame]]) -> None:
    directory, _ = followed
    for configuration, of_second in (("other-depth", 1), ("raw", None)):
        scenes = [each.scene for each in read_scenes(dict(find_tables(directory))["studio_talk", configuration])]
        for part in ("targets", "people"):
            found = [{each.depth_from for each in getattr(scene, part)} for scene in scenes]
            assert found == [{None}, {of_second}, {None}]


def test_columns_have_the_size_of_heads_and_the_step_of_depth(
    followed: tuple[RunDirectory, list[SharedFrame]],
) -> None:
    directory, frames = followed
    reader = ColumnReader(directory, directory.read_manifest())
    scene = reader.read(("studio_talk", "raw")).scene
    seen = [shared.by_configuration["raw"] for shared in frames]
    rigs = [each.percepts.rig for each in seen if isinstance(each, FollowedFrame) and each.percepts]
    assert scene.pixel_metres.tolist() == [rig.fx_px * rig.baseline_m for rig in rigs]
    heads = [row["head_box_px"] for row in _rows(directory, "people", "raw")]
    assert scene.head_heights_px.tolist() == [bottom - top for _, top, _, bottom in heads]


def test_what_is_the_same_is_written_once(followed: tuple[RunDirectory, list[SharedFrame]]) -> None:
    directory, _ = followed
    assert [len(_folders(directory, place)) for place in ("scenes", "directions")] == [2, 3]
    paths = {name: of_pair for (_, name), of_pair in find_tables(directory)}
    assert paths["raw"]["directions"] == paths["filtered"]["directions"] != paths["other-gaze"]["directions"]
    assert paths["raw"]["frames"] == paths["other-gaze"]["frames"] != paths["other-depth"]["frames"]


def test_filtered_directions_are_in_the_answers(followed: tuple[RunDirectory, list[SharedFrame]]) -> None:
    directory, _ = followed
    for row in _rows(directory, "answers", "raw"):
        if row["configuration"] != "filtered":
            assert (row["gaze_filtered"], row["head_filtered"]) == (None, None)
    answers = [row for row in _rows(directory, "answers", "filtered") if row["configuration"] == "filtered"]
    looks = _rows(directory, "directions", "filtered")
    assert [row["gaze_filtered"] == look["gaze"] for row, look in zip(answers, looks, strict=True)] == (
        [True] * 2 + [False] * 4
    )
    records = {
        name: [each for each in read_records(directory) if each.configuration == name] for name in ("raw", "filtered")
    }
    subjects = {name: [subject for each in found for subject in each.subjects] for name, found in records.items()}
    for cue in ("gaze", "head"):
        assert [list(getattr(each, cue)) for each in subjects["filtered"]] == [
            row[f"{cue}_filtered"] for row in answers
        ]
        assert [list(getattr(each, cue)) for each in subjects["raw"]] == [look[cue] for look in looks]


def test_clouds_have_the_points_that_a_method_chooses(followed: tuple[RunDirectory, list[SharedFrame]]) -> None:
    directory, frames = followed
    scenes = [each.scene for shared in frames if isinstance(each := shared.by_configuration["raw"], FollowedFrame)]
    targets = [(scene.index, target) for scene in scenes for target in scene.targets]
    rows = _rows(directory, "clouds", "raw")
    assert [(row["frame"], row["instance_id"], row["points"]) for row in rows] == [
        (frame, target.instance.id, RAYS) for frame, target in targets
    ]
    for row, (_, target) in zip(rows, targets, strict=True):
        chosen = spaced(target.points_left, RAYS)
        assert len(target.points_left) > RAYS
        assert np.array(row["points_m"]).reshape(-1, 3).tolist() == chosen.tolist()
        assert spaced(chosen, RAYS).tolist() == chosen.tolist()


def test_a_run_without_such_a_method_has_no_clouds(tmp_path: Path) -> None:
    cones = experiment_of(["studio_talk"], CONFIGURATIONS | {"posterior": {}}, STAGES)
    path = write_text(tmp_path / "cones.toml", cones)
    directory = run_plan(
        prepare(load_experiment(str(path)), limit=1), tmp_path / "out", workers=1, progress=lambda clip: None
    )
    assert read_table(directory, "clouds").num_rows == 0
    assert read_table(directory, "instances").num_rows > 0


def test_a_folder_says_what_it_is_a_digest_of(followed: tuple[RunDirectory, list[SharedFrame]]) -> None:
    directory, _ = followed
    folders = _folders(directory, "scenes") + _folders(directory, "directions")
    identities = {folder.parent.name: json.loads((folder / "identity.json").read_text()) for folder in folders}
    assert all(key_of(identity) == key for key, identity in identities.items())
    scenes = [folder.parent.name for folder in _folders(directory, "scenes")]
    first, second = (identities[key] for key in scenes)
    assert {name for name in first if first[name] != second[name]} == {"stereo"}
    assert {identities[folder.parent.name]["scene"] for folder in _folders(directory, "directions")} == set(scenes)


def test_a_run_that_is_interrupted_has_no_half_of_a_scene(tmp_path: Path) -> None:
    done: list[str] = []

    def interrupted(clip: str) -> None:
        done.append(clip)
        if len(done) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        _run(tmp_path, interrupted)
    directory = RunDirectory(tmp_path / "out")
    assert _folders(directory, "scenes") == _folders(directory, "directions") == []
    assert list(directory.path.rglob("*.parquet")) == []


def test_what_a_killed_run_has_left_is_removed(
    tmp_path: Path, followed: tuple[RunDirectory, list[SharedFrame]]
) -> None:
    directory = RunDirectory(tmp_path / "out")
    for left in ("partial/studio_talk__0.tables", "scenes/0/studio_talk", "directions/0/studio_talk"):
        write_text(directory.path / left / "frames.parquet", "half")
    write_manifest(
        directory,
        {key: value for key, value in followed[0].read_manifest().plain().items() if key not in ("finished", "failed")},
    )
    _run(tmp_path)
    assert {path.relative_to(tmp_path / "out") for path in directory.path.rglob("*.parquet")} == {
        path.relative_to(followed[0].path) for path in followed[0].path.rglob("*.parquet")
    }
    assert not (directory.path / "partial").exists()
