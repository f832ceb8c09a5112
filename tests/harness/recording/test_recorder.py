from __future__ import annotations

import pickle
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from harness.recording import Observers, entities, frame_log
from harness.recording.recorder import Recorder, recording_id
from harness.recording.viewer import viewer_binary

ANN = "Ann Müller/left"


def test_the_real_tool_verifies_both_sizes(frames, record_run):
    for size in ("light", "full"):
        path = record_run(frames, size=size)
        done = subprocess.run([viewer_binary(), "rrd", "verify", path], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


def test_the_recorder_changes_nothing_it_is_shown(frames, record_run):
    before = pickle.dumps(frames)
    record_run(frames, size="full")
    assert pickle.dumps(frames) == before


def test_curves_equal_the_record(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    for what in ("gaze", "head", "total"):
        curve = columns.at(entities.curve(ANN, what, "book#4"), "Scalars:scalars")
        expected = {
            shown.record.frame: [getattr(value, what)]
            for shown in frames
            for subject in shown.record.subjects
            for value in subject.attention
            if shown.record.target(value.instance_id).name == "book#4" and getattr(value, what) is not None
        }
        assert curve == expected
        assert len(curve) == {"gaze": 2, "head": 3, "total": 3}[what]


def test_a_cue_that_was_not_measured_leaves_a_gap(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    path = entities.curve(ANN, "gaze", "book#4")
    assert columns.at(path, "Clear:is_recursive") == {11: [True]}


def test_boxes_equal_the_scene(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    for shown in frames:
        for target in shown.result.scene.targets:
            path = entities.box(target.instance.id)
            if target.box is None:
                assert shown.frame.index not in columns.at(path, "Boxes3D:centers")
                continue
            (centre,) = columns.at(path, "Boxes3D:centers")[shown.frame.index]
            (half_size,) = columns.at(path, "Boxes3D:half_sizes")[shown.frame.index]
            (quaternion,) = columns.at(path, "Boxes3D:quaternions")[shown.frame.index]
            assert centre == pytest.approx(target.box.center_m.tolist(), abs=1e-6)
            assert half_size == pytest.approx(target.box.half_size_m.tolist(), abs=1e-6)
            rotation = Rotation.from_quat(quaternion).as_matrix()
            np.testing.assert_allclose(rotation, target.box.left_from_box, atol=1e-6)


def test_what_vanishes_is_cleared_in_that_frame(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    gone_at_11 = [
        entities.box(2),
        entities.points(3),
        entities.cue_3d(ANN, "gaze", "rays"),
        entities.cue_3d(ANN, "gaze", "cones"),
    ]
    gone_at_13 = [entities.box(1), entities.subject_3d(ANN, "origin"), entities.head_box(ANN)]
    for frame, paths in ((11, gone_at_11), (13, gone_at_13)):
        for path in paths:
            assert columns.at(path, "Clear:is_recursive") == {frame: [True]}, path


def test_hits_lie_where_rays_enter_boxes(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    shown = frames[0]
    rays = shown.result.attentions[0].rays
    cones = shown.result.attentions[0].cones
    expected = sum(np.isfinite(rays.entry_m[[cones[c].cue == cue for c in rays.cone_index]]).sum() for cue in ("gaze",))
    hits = np.array(columns.at(entities.cue_3d(ANN, "gaze", "hits"), "Points3D:positions")[10])
    assert len(hits) == expected > 0
    box = shown.result.scene.targets[1].box
    local = np.abs((hits - box.center_m) @ box.left_from_box) / box.half_size_m
    np.testing.assert_allclose(local.max(axis=1), 1, atol=1e-5)


def test_verdicts_are_lanes_and_warnings(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    lane = columns.at(entities.verdict(ANN), "StateChange:state")
    assert lane == {shown.frame.index: [shown.verdicts[0].outcome] for shown in frames}
    assert {"correct", "wrong"} <= {state for (state,) in lane.values()}
    wrong = {shown.frame.index for shown in frames if shown.verdicts[0].outcome == "wrong"}
    warnings = columns.at(entities.LOG, "TextLog:level")
    assert {frame for frame, level in warnings.items() if level == ["WARN"]} == wrong
    assert {11, 13} <= wrong


def test_a_name_keeps_its_class_when_instances_are_numbered_anew(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    first = columns.at(entities.points(2), "Points3D:class_ids")[10]
    again = columns.at(entities.points(302), "Points3D:class_ids")[14]
    assert first == again
    classes = {c["class_description"]["info"]["id"]: c["class_description"]["info"]["label"] for c in _classes(columns)}
    assert classes[first[0]] == "red cup"


def _classes(columns):
    return columns.static(entities.WORLD, "AnnotationContext:context")[0]


def test_frames_and_times_are_the_sources_own(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    assert columns.timelines(entities.IMAGE) == {"frame", "time"}
    seconds = {frame: time.total_seconds() for frame, time in columns.at(entities.IMAGE, "time").items()}
    assert seconds == pytest.approx({shown.frame.index: shown.frame.time_ns / 1e9 for shown in frames})


def test_the_camera_is_logged_once_and_again_when_it_changes(frames, record_run, read_back):
    zoomed = replace(frames[3].frame, rig=replace(frames[3].frame.rig, fx_px=100.0))
    frames[3] = replace(frames[3], frame=zoomed)
    columns = read_back(record_run(frames))
    assert list(columns.at(entities.CAMERA, "Pinhole:image_from_camera")) == [10, 14]


def test_a_full_recording_holds_every_map(frames, record_run, read_back):
    columns = read_back(record_run(frames, size="full"))
    assert {entities.DISPARITY, entities.DEPTH, entities.CONFIDENCE, entities.RIGHT} <= columns.paths
    depth = np.frombuffer(bytes(columns.at(entities.DEPTH, "DepthImage:buffer")[10][0]), dtype=np.uint16)
    # z = fx B / d = 80 * 0.1 / 8 = 1 m; 0 where the disparity is not known
    assert set(depth.reshape(64, 96)[:5].ravel()) == {0}
    assert set(depth.reshape(64, 96)[5:].ravel()) == {1000}


def test_a_light_recording_keeps_disparities_in_pixels_and_unknown_ones_unknown(frames, record_run, read_back):
    columns = read_back(record_run(frames, size="light"))
    assert not {entities.DEPTH, entities.CONFIDENCE} & columns.paths
    buffer = columns.at(entities.DISPARITY, "DepthImage:buffer")[10][0]
    disparity = np.frombuffer(bytes(buffer), dtype=np.float16).reshape(32, 48)
    assert np.isnan(disparity[:3]).all()
    assert set(disparity[3:].ravel()) == {8.0}


def test_verdict_counts_and_given_properties_are_stored(frames, record_run, read_back):
    columns = read_back(record_run(frames, properties={"weights": "abc"}))
    found = {
        name: columns.static("/__properties/eval", name)
        for name in ("clip", "configuration", "weights", "correct", "wrong")
    }
    outcomes = [shown.verdicts[0].outcome for shown in frames]
    assert found == {
        "clip": ["clip"],
        "configuration": ["two"],
        "weights": ["abc"],
        "correct": [outcomes.count("correct")],
        "wrong": [outcomes.count("wrong")],
    }


def test_an_error_leaves_no_recording_that_looks_finished(frames, tmp_path):
    path = tmp_path / "clip__two.rrd"
    with pytest.raises(RuntimeError, match="the run broke"):
        _break(path, frames)
    assert not path.exists()
    assert [left.name for left in tmp_path.iterdir()] == ["clip__two.rrd.partial"]


def _break(path, frames):
    with Recorder(path, clip="clip", configuration="two", rate_hz=None) as recorder:
        recorder.log(frames[0])
        raise RuntimeError("the run broke")


def test_a_run_without_frames_or_names_is_a_recording_too(record_run, tmp_path, frames):
    record_run([])
    with Recorder(tmp_path / "a.rrd", clip="a", configuration="b", rate_hz=None) as recorder:
        recorder.log(replace(frames[2], verdicts=()))
    assert (tmp_path / "a.rrd").exists()


def test_recordings_of_different_runs_can_be_open_together(tmp_path):
    same = recording_id(tmp_path / "run" / "a.rrd", "clip", "one")
    assert same == recording_id(tmp_path / "run" / "a.rrd", "clip", "one")
    others = [
        recording_id(tmp_path / "other" / "a.rrd", "clip", "one"),
        recording_id(tmp_path / "run" / "a.rrd", "clip", "two"),
        recording_id(tmp_path / "run" / "a.rrd", "clop", "one"),
    ]
    assert len({same, *others}) == 4


class Witness:
    """An observer that writes down what happens to it."""

    def __init__(self, said, name):
        self.said, self.name = said, name

    def __enter__(self):
        self.said.append((self.name, "enter"))
        return self

    def __exit__(self, kind, error, trace):
        self.said.append((self.name, kind))

    def log(self, shown):
        self.said.append((self.name, shown.frame.index))


def test_every_observer_of_several_sees_every_frame_and_how_the_run_ended(frames):
    said = []
    both = Observers(Witness(said, "a"), Witness(said, "b"))
    both.__enter__()
    both.log(frames[0])
    both.__exit__(KeyError, KeyError(), None)
    number = frames[0].frame.index
    assert said == [
        ("a", "enter"),
        ("b", "enter"),
        ("a", number),
        ("b", number),
        ("b", KeyError),
        ("a", KeyError),
    ]


def test_no_observer_is_fine(frames):
    with Observers() as nobody:
        nobody.log(frames[0])


def test_curves_are_sent_together_and_none_is_lost(frames, record_run, read_back, monkeypatch):
    """A column after every second frame, and the last one at the end, hold the same curve as one column does."""
    path = entities.curve(ANN, "total", "book#4")
    whole = read_back(record_run(frames)).at(path, "Scalars:scalars")
    monkeypatch.setattr(frame_log, "COLUMN_FRAMES", 2)
    cut = read_back(record_run(frames)).at(path, "Scalars:scalars")
    assert cut == whole
    assert len(whole) == 3


def test_what_never_changes_is_logged_once_and_not_by_time(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    for path, component in (
        (entities.box(4), "Boxes3D:radii"),
        (entities.points(4), "Points3D:radii"),
        (entities.cue_3d(ANN, "head", "cones"), "LineStrips3D:colors"),
        (entities.head_box(ANN), "Boxes2D:labels"),
    ):
        assert columns.static(path, component)
        assert columns.at(path, component) == {}
