from __future__ import annotations

import io
import math
import os
import pickle
import subprocess
from collections.abc import Iterable
from dataclasses import replace

import av
import cv2
import numpy as np
import pytest
import rerun as rr
from PIL import Image
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation

from harness.record import entities, layer_file, reading
from harness.record.appearance import attention_by_name
from harness.record.frame_log import FrameLog
from harness.record.images import VideoEncoder
from harness.record.layers import ClipFiles, recording_ids
from harness.record.recorder import Recorder, SharedRecorder
from harness.record.viewer import viewer_binary
from harness.run.directory import new_run_id
from tests.harness.record.conftest import CONFIGURATION, LAYERS, NAMES, shared, verdict
from vfoa.errors import VfoaError
from vfoa.scoring import NO_HIT, NO_PREDICTION

ANN = "Ann Müller/left"


def test_the_real_tool_verifies_all_layers(frames, record_run):
    paths = record_run(frames).paths
    assert len(paths) == 4
    done = subprocess.run([viewer_binary(), "rrd", "verify", *paths], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert len({RrdReader(path).recordings()[0].recording_id for path in paths}) == 1


def test_the_recorder_changes_nothing_it_is_shown(frames, record_run):
    def content():  # not the frames themselves: their class is in a conftest, one of several modules of that name
        return pickle.dumps([(each.frame, each.percepts, each.result, each.record) for each in frames])

    before = content()
    record_run(frames)
    assert content() == before


def test_curves_equal_the_record(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    for what in ("gaze", "head", "total"):
        curve = columns.at(entities.curves(CONFIGURATION, ANN, what, "book#4"), "Scalars:scalars")
        expected = {
            shown.record.frame: [getattr(value, what)]
            for shown in frames
            for subject in shown.record.subjects
            for value in subject.attention
            if shown.record.target(value.instance_id).name == "book#4" and getattr(value, what) is not None
        }
        assert {frame: value for frame, value in curve.items() if value} == expected
        assert len(expected) == {"gaze": 2, "head": 3, "total": 3}[what]


def test_the_curves_of_a_manifests_names_are_one_entity(frames, record_run, read_back):
    columns = read_back(record_run(frames, names=["red cup", "book#4", ANN]))
    for what in ("gaze", "head", "total"):
        path = entities.curves(CONFIGURATION, ANN, what)
        assert columns.static(path, "SeriesLines:names") == ["red cup", "book#4"]
        found = columns.at(path, "Scalars:scalars")
        for shown in frames:
            values = {
                name: getattr(value, what)
                for subject in shown.record.subjects
                for name, value in attention_by_name(shown.record, subject, probabilistic=False).items()
            }
            numbers = [values.get("red cup"), values.get("book#4")]
            if any(number is not None for number in numbers):
                expected = [math.nan if number is None else number for number in numbers]
                np.testing.assert_equal(found[shown.record.frame], expected)
            else:
                assert not found.get(shown.record.frame)


def test_of_probabilities_the_highest_curve_is_the_answer(frames, record_run, read_back):
    """That of looking at nothing has a curve, too: it is the answer where it is more probable than every target."""
    unsure = []
    for shown, most in zip(frames, (0.2, 0.3, 0.0, 0.7), strict=True):
        subjects = []
        for subject in shown.record.subjects:
            totals = {subject.attention[0].instance_id: most}
            values = tuple(replace(value, total=totals.get(value.instance_id, 0.0)) for value in subject.attention)
            subjects.append(replace(subject, attention=values))
        unsure.append(replace(shown, record=replace(shown.record, subjects=tuple(subjects))))
    columns = read_back(record_run(unsure, names=["red cup", "book#4", ANN], probabilistic=True))
    path = entities.curves(CONFIGURATION, ANN, "total")
    names = columns.static(path, "SeriesLines:names")
    curves = {
        frame: dict(zip(names, found, strict=True))
        for frame, found in columns.at(path, "Scalars:scalars").items()
        if found
    }
    assert {frame: found["none"] for frame, found in curves.items()} == pytest.approx({10: 0.8, 11: 0.7, 14: 0.3})
    highest = {frame: max(found, key=lambda name: np.nan_to_num(found[name])) for frame, found in curves.items()}
    assert highest == {10: "none", 11: "none", 14: "red cup"}
    gaze = columns.static(entities.curves(CONFIGURATION, ANN, "gaze"), "SeriesLines:names")
    assert "none" not in gaze


def test_a_cue_that_was_not_measured_leaves_a_gap(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    path = entities.curves(CONFIGURATION, ANN, "gaze", "book#4")
    assert [frame for frame, value in columns.at(path, "Scalars:scalars").items() if not value] == [11]


def test_boxes_equal_the_scene(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    for shown in frames:
        for target in shown.result.scene.targets:
            path = entities.box(CONFIGURATION, target.instance.id)
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
    gone_at_11 = {
        entities.box(CONFIGURATION, 2): "Boxes3D:half_sizes",
        entities.points(CONFIGURATION, 3): "Points3D:positions",
        entities.subject_3d(CONFIGURATION, ANN, "gaze", "rays"): "LineStrips3D:strips",
        entities.subject_3d(CONFIGURATION, ANN, "gaze", "cones"): "LineStrips3D:strips",
    }
    gone_at_13 = {
        entities.box(CONFIGURATION, 1): "Boxes3D:half_sizes",
        entities.subject_3d(CONFIGURATION, ANN, "origin"): "Points3D:positions",
        entities.head_box(CONFIGURATION, ANN): "Boxes2D:half_sizes",
    }
    for frame, components in ((11, gone_at_11), (13, gone_at_13)):
        for path, component in components.items():
            assert [at for at, value in columns.at(path, component).items() if not value] == [frame], path


def test_hits_lie_where_rays_enter_boxes(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    shown = frames[0]
    rays = shown.result.attentions[0].rays
    cones = shown.result.attentions[0].cones
    expected = sum(np.isfinite(rays.entry_m[[cones[c].cue == cue for c in rays.cone_index]]).sum() for cue in ("gaze",))
    hits = np.array(columns.at(entities.subject_3d(CONFIGURATION, ANN, "gaze", "hits"), "Points3D:positions")[10])
    assert len(hits) == expected > 0
    box = shown.result.scene.targets[1].box
    local = np.abs((hits - box.center_m) @ box.left_from_box) / box.half_size_m
    np.testing.assert_allclose(local.max(axis=1), 1, atol=1e-5)


def test_rays_end_where_they_enter_the_first_box_and_missed_ones_with_their_cone(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    attention = frames[0].result.attentions[0]
    for cue in ("gaze", "head"):
        ours = np.array([cone.cue == cue for cone in attention.cones])[attention.rays.cone_index]
        directions, entry = attention.rays.directions[ours], attention.rays.entry_m[ours]
        hit = np.isfinite(entry).any(axis=1)
        rays, missed = (
            np.array(columns.at(entities.subject_3d(CONFIGURATION, ANN, cue, part), "LineStrips3D:strips")[10])
            for part in ("rays", "missed_rays")
        )
        assert np.ptp([*rays[:, 0], *missed[:, 0]], axis=0) == pytest.approx(0)
        ways = [lines[:, 1] - attention.rays.origin_left for lines in (rays, missed)]
        np.testing.assert_allclose(ways[0], directions[hit] * np.nanmin(entry[hit], axis=1)[:, None], atol=1e-5)
        lengths = np.linalg.norm(ways[1], axis=1)
        assert np.ptp(lengths) < 1e-5
        np.testing.assert_allclose(ways[1] / lengths[:, None], directions[~hit][::2], atol=1e-5)


def test_eyes_directions_and_cones_equal_the_attention(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    for shown in (frames[0], frames[1], frames[3]):
        frame, (attention,) = shown.frame.index, shown.result.attentions
        eyes = attention.subject.person.eye_origin_left
        (origin,) = columns.at(entities.subject_3d(CONFIGURATION, ANN, "origin"), "Points3D:positions")[frame]
        assert origin == pytest.approx(eyes)
        boxes = [target.box for target in shown.result.scene.targets[1:] if target.box is not None]
        reach_m = np.median([np.linalg.norm(box.center_m - eyes) for box in boxes])
        for cue in ("gaze", "head"):
            path = entities.subject_3d(CONFIGURATION, ANN, cue)
            cones = [cone for cone in attention.cones if cone.cue == cue]
            strips = columns.at(f"{path}/cones", "LineStrips3D:strips")[frame]
            for strip, cone in zip(strips, cones, strict=True):
                rim = np.array(strip)[8:] - eyes  # after four ribs of two points
                np.testing.assert_allclose(np.linalg.norm(rim, axis=1), reach_m, rtol=1e-5)
                np.testing.assert_allclose(rim @ cone.axis, reach_m * np.cos(cone.fov_rad / 2), rtol=1e-5)
            arrows = [columns.at(f"{path}/direction", f"Arrows3D:{end}")[frame] for end in ("origins", "vectors")]
            if (direction := attention.subject.direction(cue)) is None:
                assert arrows == [[], []]
            else:
                assert arrows == [[pytest.approx(eyes)], [pytest.approx(0.25 * direction)]]


def test_clouds_are_evenly_chosen_points_of_their_targets_and_small_ones_whole(frames, record_run, read_back):
    shown = frames[0]
    targets = tuple(
        replace(target, points_left=target.points_left[:count])
        for target, count in zip(shown.result.scene.targets, (400, 100, 2, 0), strict=True)
    )
    scene = replace(shown.result.scene, targets=targets)
    columns = read_back(record_run([replace(shown, result=replace(shown.result, scene=scene))]))
    for target in targets:
        found = columns.at(entities.points(CONFIGURATION, target.instance.id), "Points3D:positions")
        if not len(target.points_left):
            assert not found
            continue
        (chosen,) = found.values()
        rows = [target.points_left.tolist().index(point) for point in chosen]
        assert (rows[0], rows[-1], len(rows)) == (0, len(target.points_left) - 1, min(len(target.points_left), 100))
        assert set(np.diff(rows)) <= ({4, 5} if len(target.points_left) > 100 else {1})


def test_the_image_has_the_box_of_each_target_with_its_name_attention_and_colour(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    shown = frames[0]
    record, marks = shown.record, entities.image_marks(CONFIGURATION, "targets")
    centers, half_sizes = (
        np.array(columns.at(f"{marks}/box2d", f"Boxes2D:{name}")[10]) for name in ("centers", "half_sizes")
    )
    corners = np.hstack([centers - half_sizes, centers + half_sizes])
    np.testing.assert_allclose(corners, [target.box_px for target in record.targets])
    assert columns.at(f"{marks}/caption", "Points2D:positions")[10] == centers.tolist()
    totals = {value.instance_id: value.total for value in record.subjects[0].attention}
    assert totals[2] > 0
    assert totals[4] > 0
    captions = [ANN, f"red cup (2) {totals[2]:.2f}", "red cup (3)", f"book#4 {totals[4]:.2f}"]
    assert columns.at(f"{marks}/caption", "Points2D:labels")[10] == captions
    assert columns.at(f"{marks}/caption", "Points2D:labels")[13] == ["book#4"]
    by_name = {info["label"]: info["color"] for info in _infos(columns)}
    for what in ("box2d:Boxes2D", "caption:Points2D"):
        entity, archetype = what.split(":")
        found = columns.at(f"{marks}/{entity}", f"{archetype}:colors")[10]
        assert found == [by_name[target.name] for target in record.targets]


def test_a_head_has_its_box_in_the_image_and_an_answer_its_words_above_it(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    head = entities.head_box(CONFIGURATION, ANN)
    assert columns.at(head, "Boxes2D:centers")[10] == [[10, 27]]
    assert columns.at(head, "Boxes2D:half_sizes")[10] == [[8, 7]]
    label = entities.answer_3d(CONFIGURATION, ANN, "truth", "label")
    ((u, height, depth),) = columns.at(label, "Points3D:positions")[10]
    box = frames[0].record.target(2).box
    assert (u, depth) == pytest.approx((box.center_m[0], box.center_m[2]))
    assert height < box.center_m[1] - box.half_size_m[1]
    assert columns.at(label, "Points3D:labels")[10] == ["truth: red cup"]


def test_verdicts_are_lanes_and_warnings(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    lane = columns.at(entities.verdict(CONFIGURATION, ANN, "verdict"), "StateChange:state")
    assert lane == {shown.frame.index: [verdict(shown).outcome] for shown in frames}
    assert {"correct", "wrong"} <= {state for (state,) in lane.values()}
    wrong = {shown.frame.index for shown in frames if verdict(shown).outcome == "wrong"}
    warnings = columns.at(entities.log(CONFIGURATION), "TextLog:level")
    assert {frame for frame, level in warnings.items() if level == ["WARN"]} == wrong
    assert {11, 13} <= wrong
    types = columns.at(entities.verdict(CONFIGURATION, ANN, "error_type"), "TextDocument:text")
    assert {frame: found for frame, found in types.items() if found} == {
        shown.frame.index: [verdict(shown).error_type] for shown in frames if shown.frame.index in wrong
    }


def test_states_that_are_no_target_are_grey(frames, record_run, read_back):
    """Without a colour of its own, the viewer gives a state one that may be a target's."""
    *others, last = frames
    (ann,) = last.record.subjects
    missed = tuple(replace(value, gaze=0, head=0, total=0) for value in ann.attention)
    record = replace(last.record, subjects=(replace(ann, attention=missed, focus=None, tied=()),))
    columns = read_back(record_run([*others, replace(last, record=record)]))
    path = entities.verdict(CONFIGURATION, ANN, "predicted")
    names = columns.static(path, "StateConfiguration:values")
    colours = dict(zip(names, columns.static(path, "StateConfiguration:colors"), strict=True))
    states = {state for (state,) in columns.at(path, "StateChange:state").values()}
    assert {NO_HIT, NO_PREDICTION} <= states <= set(names)
    assert len({colours[name] for name in states - set(NAMES.values())}) == 1


def test_a_name_keeps_its_class_when_instances_are_numbered_anew(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    first = columns.at(entities.points(CONFIGURATION, 2), "Points3D:class_ids")[10]
    again = columns.at(entities.points(CONFIGURATION, 302), "Points3D:class_ids")[14]
    assert first == again
    assert columns.at(entities.box(CONFIGURATION, 2), "Boxes3D:class_ids")[10] == first
    assert columns.at(entities.box(CONFIGURATION, 2), "Boxes3D:labels")[10] == ["red cup (2)"]
    assert {info["id"]: info["label"] for info in _infos(columns)}[first[0]] == "red cup"


def _infos(columns):
    """Id, name and colour of each class."""
    classes = columns.static(entities.scene(CONFIGURATION), "AnnotationContext:context")[0]
    return [each["class_description"]["info"] for each in classes]


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


def _png(blob) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(bytes(blob), np.uint8), cv2.IMREAD_UNCHANGED)


def test_a_recording_keeps_disparities_in_pixels_and_unknown_ones_unknown(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    path = entities.disparity(CONFIGURATION)
    (steps_per_px,) = columns.at(path, "EncodedDepthImage:meter")[10]
    disparity = _png(columns.at(path, "EncodedDepthImage:blob")[10][0]) / steps_per_px
    assert disparity.shape == (32, 48)
    assert set(disparity[:3].ravel()) == {0}
    assert set(disparity[3:].ravel()) == {8.0}


def test_the_images_of_a_recording_are_a_video_of_the_same_frames(frames, record_run, read_back):
    smooth = np.linspace(0, 255, 96 * 64 * 3).reshape(64, 96, 3).astype(np.uint8)
    frames = [
        replace(each, frame=replace(each.frame, left=np.roll(smooth, 7 * k, axis=1))) for k, each in enumerate(frames)
    ]
    columns = read_back(record_run(frames))
    packets = columns.at(entities.IMAGE, "VideoStream:sample")
    assert list(packets) == [10, 11, 13, 14]
    decoded = _decoded(bytes(packet[0]) for packet in packets.values())
    assert len(decoded) == 4
    for shown, frame in zip(decoded, frames, strict=True):
        assert np.abs(shown - frame.frame.left).mean() < 6


def _decoded(packets: Iterable[bytes]) -> list[np.ndarray]:
    decoder = av.CodecContext.create("libdav1d", "r")
    pictures = [picture for data in packets for picture in decoder.decode(av.Packet(data))]
    return [picture.to_ndarray(format="rgb24").astype(int) for picture in (*pictures, *decoder.decode(None))]


def test_masks_have_one_colour_per_name_and_none_where_there_is_none(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    blobs = columns.at(entities.masks(CONFIGURATION), "EncodedImage:blob")
    first, again = (_png(blobs[number][0]) for number in (10, 14))
    assert first.shape[:2] == (64, 96)
    np.testing.assert_array_equal(first, again)  # the instances were numbered anew
    rgba = np.asarray(Image.open(io.BytesIO(bytes(blobs[10][0]))).convert("RGBA"))
    assert set(rgba[:18, :, 3].ravel()) == {0}
    assert set(rgba[20:38, :78, 3].ravel()) == {255}
    assert tuple(rgba[30, 30, :3]) == tuple(rgba[30, 50, :3]) != tuple(rgba[30, 70, :3])  # two cups, and the book


def test_verdict_counts_are_listed_by_configuration(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    outcomes = [verdict(shown).outcome for shown in frames]
    found = {name: columns.static(f"/__properties/{_ESCAPED}", name) for name in ("clip", "correct", "wrong", "frr")}
    correct, wrong = outcomes.count("correct"), outcomes.count("wrong")
    assert found == {"clip": ["clip"], "correct": [correct], "wrong": [wrong], "frr": [correct / (correct + wrong)]}


_ESCAPED = CONFIGURATION.replace(" ", "\\ ")


def test_a_recording_with_jpeg_pictures_has_each_image_on_its_own(frames, record_run, read_back):
    columns = read_back(record_run(frames, jpeg=True))
    blobs = columns.at(entities.IMAGE, "EncodedImage:blob")
    assert list(blobs) == [shown.frame.index for shown in frames]
    for shown in frames:
        (blob,) = blobs[shown.frame.index]
        with Image.open(io.BytesIO(bytes(blob))) as picture:
            assert picture.format == "JPEG"
            found = np.asarray(picture.convert("L"), dtype=float)
        expected = np.asarray(Image.fromarray(shown.frame.left).convert("L"), dtype=float)
        assert np.abs(found - expected).mean() < 5  # another frame's noise is 40 off
    assert not any("VideoStream" in component for component in columns.everything(entities.IMAGE))


def test_an_error_leaves_no_recording_that_looks_finished(frames, tmp_path):
    files = ClipFiles(run=tmp_path, clip="clip")
    with pytest.raises(RuntimeError, match="the run broke"):
        _break(files, frames)
    assert {left.suffix for left in tmp_path.iterdir()} == {".partial"}


def _break(files, frames):
    with (
        SharedRecorder(files, {CONFIGURATION: LAYERS}, rate_hz=None) as recorder,
        Recorder(files, LAYERS, recorder.colours, per_second=25) as of_one,
    ):
        recorder.write(shared({CONFIGURATION: frames[0]}))
        of_one.write(frames[0].finished)
        raise RuntimeError("the run broke")


def test_a_clip_without_frames_or_names_is_a_recording_too(tmp_path, frames):
    for clip, written in (("empty", []), ("nameless", frames[2:3])):
        files = ClipFiles(run=tmp_path, clip=clip)
        with (
            SharedRecorder(files, {CONFIGURATION: LAYERS}, rate_hz=None) as recorder,
            Recorder(files, LAYERS, recorder.colours, per_second=25) as of_one,
        ):
            for frame in written:
                recorder.write(shared({CONFIGURATION: frame}))
                of_one.write(frame.finished)
        assert files.images.is_file()
        assert files.attention(CONFIGURATION).is_file()


def test_recordings_of_different_runs_and_clips_can_be_open_together():
    one, other = new_run_id(), new_run_id()
    assert recording_ids(one, "clip") == recording_ids(one, "clip")
    made = [recording_ids(one, "clip"), recording_ids(other, "clip"), recording_ids(one, "clop")]
    assert len({ids.recording for ids in made}) == len({ids.application for ids in made}) == 3


@pytest.mark.parametrize("clip", ["room_B.203", "café", "x" * 250])
def test_rerun_keeps_the_application_of_any_clip(clip, tmp_path):
    ids, file = recording_ids(new_run_id(), clip), tmp_path / "clip.rrd"
    with rr.RecordingStream(ids.application, recording_id=ids.recording) as stream:
        stream.save(str(file))
        stream.log("/a", rr.TextLog("a"))
    assert reading.RecordingFile(file).ids == ids


@pytest.mark.parametrize("every", [1, 2, 3])
def test_rows_are_sent_together_and_none_is_lost(every, frames, record_run, read_back, monkeypatch):
    """Columns of one to three frames, and the last ones at the end, hold the same as one column of all frames."""
    whole = read_back(record_run(frames))
    monkeypatch.setattr(layer_file, "SENT_EVERY", every)
    cut = read_back(record_run(frames))
    assert cut.paths == whole.paths
    for path in whole.paths:
        assert cut.everything(path) == whole.everything(path), path
    assert len(whole.at(entities.curves(CONFIGURATION, ANN, "total", "book#4"), "Scalars:scalars")) == 4


def test_what_never_changes_is_logged_once_and_not_by_time(frames, record_run, read_back):
    columns = read_back(record_run(frames))
    for path, component in (
        (entities.box(CONFIGURATION, 4), "Boxes3D:radii"),
        (entities.points(CONFIGURATION, 4), "Points3D:radii"),
        (entities.subject_3d(CONFIGURATION, ANN, "head", "cones"), "LineStrips3D:colors"),
        (entities.head_box(CONFIGURATION, ANN), "Boxes2D:labels"),
    ):
        assert columns.static(path, component)
        assert columns.at(path, component) == {}


@pytest.mark.skipif(not hasattr(os, "sched_getscheduler"), reason="this system tells no scheduling of threads")
def test_the_encoder_makes_no_thread_a_real_time_one() -> None:
    usual = os.sched_getscheduler(0)
    encoder = VideoEncoder(128, 96, 5)
    packets = list(encoder.encode(np.zeros((96, 128, 3), np.uint8))) + list(encoder.finish())
    assert len(packets) == 1
    assert {os.sched_getscheduler(int(thread)) for thread in os.listdir("/proc/self/task")} == {usual}


@pytest.mark.parametrize("key_every", [5, 7, 25])
def test_the_encoder_delays_packets_but_keeps_their_order_and_the_key_frames(key_every):
    smooth = np.linspace(0, 255, 96 * 64 * 3).reshape(64, 96, 3).astype(np.uint8)
    encoder = VideoEncoder(96, 64, key_every)
    packets = [packet for k in range(32) for packet in encoder.encode(np.roll(smooth, 7 * k, axis=1))]
    packets += encoder.finish()
    assert [position for position, _ in packets] == list(range(32))
    for first in range(0, 32, key_every):  # decoding can begin at each key frame
        group = packets[first : first + key_every]
        decoded = _decoded(data for _, data in group)
        assert len(decoded) == len(group)
        for (position, _), shown in zip(group, decoded, strict=True):
            assert np.abs(shown - np.roll(smooth, 7 * position, axis=1)).mean() < 6


@pytest.mark.parametrize(("height", "rows"), [(64, 64), (109, 112), (110, 112), (370, 372)])
def test_a_video_has_a_height_of_which_the_viewer_draws_all_colours_in_their_rows(height: int, rows: int) -> None:
    """Rerun's native viewer takes the second plane of colour to begin in a whole row of the first one's brightness."""
    image = np.full((height, 97, 3), 50, np.uint8)
    image[-1], image[:, -1] = 200, 200
    encoder = VideoEncoder(97, height, 5)
    (shown,) = _decoded(data for _, data in [*encoder.encode(image), *encoder.finish()])
    assert shown.shape == (rows, 98, 3)
    continued = np.pad(image, ((0, rows - height), (0, 1), (0, 0)), mode="edge")
    assert np.abs(shown - continued).mean() < 6


def test_a_video_states_how_its_colours_are_coded():
    """Of a video that states nothing, Rerun's viewer takes BT.709, and FFmpeg BT.601."""
    encoder = VideoEncoder(96, 64, 5)
    packets = [*encoder.encode(np.full((64, 96, 3), (0, 255, 0), np.uint8)), *encoder.finish()]
    decoder = av.CodecContext.create("libdav1d", "r")
    picture = [*decoder.decode(av.Packet(packets[0][1])), *decoder.decode(None)][0]
    assert picture.colorspace == 6  # BT.601 (ITU-T H.273, table 4)
    luma = np.frombuffer(bytes(picture.planes[0]), np.uint8).reshape(64, -1)[:, :96]
    assert luma.mean() == pytest.approx(16 + 219 * 0.587, abs=2)


def test_rows_of_an_entity_may_have_different_fields_and_numbers_of_instances(tmp_path, read_back):
    stream = rr.RecordingStream("test", recording_id="test")
    stream.save(tmp_path / "test.rrd")
    log = FrameLog(stream)
    clouds = [np.ones((1, 3)), np.zeros((0, 3)), np.full((3, 3), 2.0), np.ones((2, 3))]
    for frame, positions in enumerate(clouds):
        log.begin(frame, 0)
        log.row("/cloud", rr.Points3D, positions=positions, **({"class_ids": [4]} if frame == 2 else {}))
        log.end()
    log.begin(4, 0)
    log.row("/cloud", rr.Boxes3D, half_sizes=np.ones((1, 3)))
    log.end()
    log.send()
    stream.disconnect()
    columns = read_back(tmp_path / "test.rrd")
    shown = {frame: cloud.tolist() for frame, cloud in enumerate(clouds)}
    # what a frame does not log is cleared, or the viewer would show that of an earlier one
    assert columns.at("/cloud", "Points3D:positions") == {**shown, 4: []}
    assert columns.at("/cloud", "Points3D:class_ids") == {2: [4], 3: []}
    assert columns.at("/cloud", "Boxes3D:half_sizes") == {4: [[1, 1, 1]]}


def test_an_entity_may_have_values_of_its_own(tmp_path, read_back):
    stream = rr.RecordingStream("test", recording_id="test")
    stream.save(tmp_path / "test.rrd")
    log = FrameLog(stream)
    log.begin(1, 0)
    log.row("/heart", rr.AnyValues, rate_hz=[1.5])
    log.end()
    log.begin(2, 0)
    log.end()
    log.send()
    stream.disconnect()
    assert read_back(tmp_path / "test.rrd").at("/heart", "rate_hz") == {1: [1.5], 2: []}


def test_whether_a_file_has_video_is_read_once_until_it_is_written_again(frames, record_run, monkeypatch):
    with_video, without = (record_run(frames, jpeg=jpeg).paths[0].read_bytes() for jpeg in (False, True))
    path = record_run(frames, jpeg=True).paths[0]
    opened = []
    read = reading.RrdReader
    monkeypatch.setattr(reading, "RrdReader", lambda file: opened.append(file) or read(file))
    path.write_bytes(with_video)
    assert [reading.has_video(path) for _ in range(3)] == [True] * 3
    assert opened == [path]
    path.write_bytes(without)
    assert [reading.has_video(path) for _ in range(3)] == [False] * 3
    assert opened == [path] * 2
    path.write_bytes(without[: len(without) // 2])
    for _ in range(2):
        with pytest.raises(VfoaError, match=path.name):
            reading.has_video(path)
