from __future__ import annotations

import ctypes.util
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rerun.chunk import RrdReader

from harness.cli import main
from harness.cli.view import MOST_OPENED
from harness.record import viewer
from harness.record.blueprint import HALF_VIEW, LEAST_M, eye_of_scene, eye_on
from harness.record.composed import Composed, find_clips, find_recordings
from harness.record.excerpt import write_excerpt
from harness.record.layers import ClipFiles
from harness.record.reading import RecordingFile, first_shapes
from harness.record.verdict_layer import write_verdict_layers
from harness.record.viewer import screenshot
from harness.run.directory import RunDirectory
from tests.harness.record.conftest import ANN, CONFIGURATION, LABELS, Columns, verdict, write_run
from tests.records import write_manifest
from vfoa.errors import VfoaError
from vfoa.geometry import box_corners


def test_the_eye_looks_at_the_scene_from_outside(frames):
    position, target = eye_of_scene(frames[0].result.scene)
    boxes = [target.box for target in frames[0].result.scene.targets if target.box is not None]
    corners = box_corners(boxes).reshape(-1, 3)
    assert position[1] < corners[:, 1].min()  # above
    assert position[2] < corners[:, 2].min()  # on the camera's side
    assert ((corners - position) @ (target - position) > 0).all()
    empty = replace(frames[0].result.scene, targets=(), people=())
    assert np.isfinite(eye_of_scene(empty)).all()


PLACES = st.lists(st.tuples(*[st.floats(-20, 20)] * 3), min_size=1, max_size=6)


def in_view(points, position, target):
    """The points to the right, below, and ahead of an eye."""
    ahead = (target - position) / np.linalg.norm(target - position)
    right = np.cross(ahead, [0, -1, 0])
    right /= np.linalg.norm(right)
    return (points - position) @ np.array([right, np.cross(ahead, right), ahead]).T


@given(PLACES)
def test_the_eye_sees_every_point_wherever_the_scene_is(places):
    """A scene without a camera may be anywhere; Rerun shows 55 degrees down, and more across a view that is wider."""
    points = np.array(places)
    seen = in_view(points, *eye_on([points]))
    assert (np.abs(seen[:, :2]) <= np.tan(np.radians(27.5)) * np.array([1.2, 1]) * seen[:, 2:]).all()


@given(PLACES)
def test_the_eye_is_as_near_as_it_can_be(places):
    """The points reach two opposite sides of the view, or the eye is at its least distance; they are in its middle."""
    points = np.array(places)
    seen = in_view(points, *eye_on([points]))
    slopes = seen[:, :2] / seen[:, 2:] / HALF_VIEW
    assert slopes.max(axis=0) == pytest.approx(-slopes.min(axis=0), abs=1e-6)
    assert np.abs(slopes).max() == pytest.approx(1) or seen[:, 2].min() == pytest.approx(LEAST_M)


def test_a_scene_without_clouds_is_seen_by_its_boxes(frames, record_run):
    def without_clouds(shown):
        scene = shown.result.scene
        targets = tuple(replace(target, points_left=target.points_left[:0]) for target in scene.targets)
        return replace(shown, result=replace(shown.result, scene=replace(scene, targets=targets)))

    files = record_run([without_clouds(each) for each in frames[:2]]).files
    boxes = [target.box for target in frames[0].result.scene.targets if target.box is not None]
    found = np.array(first_shapes(files.reconstruction(CONFIGURATION)))
    np.testing.assert_allclose(np.sort(found, axis=1), np.sort(box_corners(boxes), axis=1), atol=1e-6)


def test_a_scene_with_clouds_is_seen_with_its_boxes(frames, record_run):
    boxes = [target.box for target in frames[0].result.scene.targets if target.box is not None]
    found = np.concatenate(first_shapes(record_run(frames[:2]).files.reconstruction(CONFIGURATION)))
    for corner in np.concatenate(box_corners(boxes)):
        assert np.abs(found - corner).max(axis=1).min() < 1e-6
    assert len(found) > 8 * len(boxes)


def test_plots_end_with_their_data_on_the_timelines_of_frames_and_of_times(frames, tmp_path):
    write_run(tmp_path / "run", {CONFIGURATION: frames})
    (composed,) = find_recordings(tmp_path / "run", None, None)
    reader = RrdReader(composed.files_to_open(tmp_path)[0])
    chunks = reader.stream(store=reader.blueprints()[0]).filter(components="TimeAxis:view_range")
    ranges = [chunk.to_record_batch().column("TimeAxis:view_range")[0].as_py() for chunk in chunks]
    assert ranges
    first = frames[0].frame.index
    assert all(room["start"] < first and room["end"] is None for (room,) in ranges)


@pytest.mark.parametrize("probabilistic", [True, False])
def test_plots_of_probabilities_reach_from_0_to_1(frames, tmp_path, probabilistic):
    recorded = write_run(tmp_path / "run", {CONFIGURATION: frames}, probabilistic=probabilistic)
    (composed,) = find_recordings(tmp_path / "run", None, None)
    for file in (composed.files_to_open(tmp_path)[0], recorded.files.attention(CONFIGURATION)):
        reader = RrdReader(file)
        chunks = reader.stream(store=reader.blueprints()[0]).filter(components="ScalarAxis:range")
        ranges = [chunk.to_record_batch().column("ScalarAxis:range")[0].as_py() for chunk in chunks]
        assert all(limits == [[0, 1]] for limits in ranges)
        assert bool(ranges) == probabilistic


@pytest.mark.parametrize(("begins_ns", "has_room"), [(0, True), (10**18, False)])
def test_a_plot_does_not_begin_in_1970_where_times_are_those_of_a_clock(frames, tmp_path, begins_ns, has_room):
    def later(shown):
        time_ns = begins_ns + 40_000_000 * shown.frame.index
        scene = replace(shown.result.scene, time_ns=time_ns)
        frame, record = replace(shown.frame, time_ns=time_ns), replace(shown.record, time_ns=time_ns)
        return replace(shown, frame=frame, record=record, result=replace(shown.result, scene=scene))

    write_run(tmp_path / "run", {CONFIGURATION: [later(each) for each in frames]})
    (composed,) = find_recordings(tmp_path / "run", None, None)
    reader = RrdReader(composed.files_to_open(tmp_path)[0])
    chunks = reader.stream(store=reader.blueprints()[0]).filter(components="TimeAxis:view_range")
    assert any(True for _ in chunks) == has_room


@pytest.mark.parametrize(
    ("rate_hz", "step", "per_second"), [(25, 1, 25), (25, 8, 200), (25, 40_000_000, 1e9), (None, 1, 25), (None, 8, 25)]
)
def test_the_viewer_plays_in_real_time_whatever_frames_are_numbered_by(frames, tmp_path, rate_hz, step, per_second):
    """They are counted, or every eighth is there of counted ones, or they are nanoseconds; no times: 25 numbers a s."""
    write_run(tmp_path / "run", {CONFIGURATION: frames})
    (clip,) = find_clips(tmp_path / "run", None, None)
    composed = replace(clip, rate_hz=rate_hz, frames=tuple(7 + step * each for each in range(4))).compose()
    reader = RrdReader(composed.files_to_open(tmp_path)[0])
    chunks = reader.stream(store=reader.blueprints()[0]).filter(components="TimePanelBlueprint:fps")
    assert [chunk.to_record_batch().column("TimePanelBlueprint:fps")[0].as_py() for chunk in chunks] == [[per_second]]


@pytest.mark.parametrize(("frames_of", "half"), [(range(4), None), (range(0, 10**9, 40_000_000), 960_000_000)])
@pytest.mark.parametrize("first", [7, 10**18])
def test_verdicts_of_frames_that_are_time_stamps_are_seen_for_seconds(frames, tmp_path, first, frames_of, half):
    write_run(tmp_path / "run", {CONFIGURATION: frames})
    (clip,) = find_clips(tmp_path / "run", None, None)
    composed = replace(clip, frames=tuple(first + each for each in frames_of)).compose()
    reader = RrdReader(composed.files_to_open(tmp_path)[0])
    chunks = reader.stream(store=reader.blueprints()[0]).filter(components="TimeAxis:view_range")
    ranges = [chunk.to_record_batch().column("TimeAxis:view_range")[0].as_py() for chunk in chunks]
    windows = {(room["start"], room["end"]) for (room,) in ranges if room["end"] is not None}
    assert windows == ({(-half, half)} if half else set())


def test_there_is_a_plot_for_each_cue_that_was_measured(frames, tmp_path):
    def plots(run, chosen):
        write_run(run, {CONFIGURATION: chosen})
        (composed,) = find_recordings(run, None, None)
        reader = RrdReader(composed.files_to_open(tmp_path)[0])
        chunks = reader.stream(store=reader.blueprints()[0]).filter(components="ViewBlueprint:space_origin")
        found = [chunk.to_record_batch().column("ViewBlueprint:space_origin")[0].as_py() for chunk in chunks]
        return {origin.rsplit("/", 1)[-1] for (origin,) in found if origin.startswith("/attention/")}

    assert plots(tmp_path / "both", frames) == {"total", "gaze", "head"}
    assert frames[1].record.subjects[0].gaze is None
    assert plots(tmp_path / "head", frames[1:3]) == {"total", "head"}


def test_the_plot_of_all_people_has_totals_alone(frames, tmp_path):
    """The parts of the cues have the same names and colours."""
    write_run(tmp_path / "run", {CONFIGURATION: frames})
    (clip,) = find_clips(tmp_path / "run", None, None)
    composed = replace(clip, subjects=()).compose().files_to_open(tmp_path)[0]
    curves = {path for path in Columns(clip.files.attention(CONFIGURATION)).paths if path.startswith("/attention/")}
    parts = {path for path in curves if "/gaze" in path or "/head" in path}
    assert (len(curves), len(parts)) == (6, 4)  # each of the names of the manifest, and of another name
    for layout in (composed, clip.files.attention(CONFIGURATION)):
        reader = RrdReader(layout)
        chunks = reader.stream(store=reader.blueprints()[0]).filter(components="ViewContents:query")
        queries = [chunk.to_record_batch().column("ViewContents:query")[0].as_py() for chunk in chunks]
        (hidden,) = [query[1:] for query in queries if query[0] == "$origin/**" and query[1:]]
        assert {*hidden} == {f"- {path}" for path in parts}


needs_vulkan = pytest.mark.skipif(
    ctypes.util.find_library("vulkan") is None or not any(Path("/usr/share/vulkan/icd.d").glob("*.json")),
    reason="needs a Vulkan driver (Debian: mesa-vulkan-drivers libvulkan1)",
)


LEFT_VIEW_PX = (252, 168)
"""The size of the left image in a window of 800 x 500 pixels."""


@needs_vulkan
def test_the_real_viewer_draws_the_frame_it_is_asked_for_and_leaves_no_files(frames, record_run, tmp_path, monkeypatch):
    """The left image, which is noise, is somewhere in the picture, and no other frame's is."""
    composed = find_clips(record_run(frames).run, None, None)[0].compose()
    (temporary := tmp_path / "temporary").mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    monkeypatch.setattr(tempfile, "tempdir", None)
    screenshot(composed, 13, tmp_path / "13.png", size=(800, 500))
    assert list(temporary.iterdir()) == []
    picture = cv2.imread(str(tmp_path / "13.png"))
    assert picture.shape == (500, 800, 3)
    for frame in (each.frame for each in frames):
        left = cv2.resize(frame.left[..., ::-1], LEFT_VIEW_PX, interpolation=cv2.INTER_NEAREST)
        likeness = cv2.matchTemplate(picture, left, cv2.TM_CCOEFF_NORMED).max()
        assert (likeness > 0.2) if frame.index == 13 else (likeness < 0.1), (frame.index, likeness)


class SlowClient:
    """A client of a viewer that does not draw in time at first, then draws these pictures."""

    def __init__(self, *pictures: bytes | None) -> None:
        self.pictures = list(pictures)

    def take_screenshot(self) -> bytes:
        picture = self.pictures.pop(0)
        if picture is None:
            raise TimeoutError("Deadline expired")
        return picture


@needs_vulkan
def test_a_viewer_that_ended_is_said_although_it_has_answered():
    """One without a display answers for a moment before it ends."""

    def use() -> None:
        with viewer._viewer(["--headless"]) as (process, client):
            process.kill()
            process.wait()
            client.set_time("frame", sequence=1)

    with pytest.raises(VfoaError, match="ended with status -9"):
        use()


@needs_vulkan
@pytest.mark.parametrize("letter", ["杯", "ם", "😀"])
def test_a_letter_that_the_viewers_font_lacks_is_named(letter, frames, tmp_path):
    write_run(tmp_path / "run", {CONFIGURATION: frames[:1]}, names=["red cup", f"cup {letter}"])
    (recording,) = find_recordings(tmp_path / "run", None, None)
    with pytest.raises(VfoaError, match=rf"found {letter} \(U\+{ord(letter):04X}\).*--web"):
        screenshot(recording, None, tmp_path / "shot.png")
    assert not (tmp_path / "shot.png").exists()


@pytest.mark.parametrize(
    ("printed", "reason"),
    [
        ("thread 'main' panicked at 'no \"such\" thing'\nepaint/fonts.rs:806\n\nReport bugs: URL", 'no "such" thing'),
        (
            "thread 'main' panicked at src/main.rs:4:5:\nno such thing\nnote: run with `RUST_BACKTRACE=1`",
            "no such thing",
        ),
        ("opening\nno such thing", "no such thing"),
        ("", "it printed no reason"),
    ],
)
def test_a_viewer_that_ended_says_why_it_panicked(printed, reason, tmp_path):
    stderr = tmp_path / "stderr"
    stderr.write_text(printed)
    process = subprocess.Popen([sys.executable, "-c", "raise SystemExit(102)"])
    with stderr.open("rb") as file:
        error = viewer._ended(process, file, viewer.INSTEAD, 30.0)
    assert str(error) == f"the Rerun viewer ended with status 102: {reason}"


def test_a_picture_that_is_late_is_awaited(monkeypatch):
    monkeypatch.setattr(viewer, "_POLL_S", 0.0)
    client = SlowClient(None, b"first", None, b"last", b"last")
    assert viewer._settled_picture(client) == b"last"
    assert client.pictures == []
    monkeypatch.setattr(viewer, "_DRAWN_S", 0.0)
    with pytest.raises(VfoaError, match="settled picture"):
        viewer._settled_picture(client)


@needs_vulkan
def test_the_real_viewer_goes_from_clip_to_clip_and_shows_the_tabs_it_is_told(frames, tmp_path, monkeypatch):
    recorded = write_run(tmp_path / "run", {"one": frames, "two": frames}, names=["red cup", ANN, "Ben"])
    clip = replace(find_clips(recorded.run, None, None)[0], subjects=(ANN, "Ben"))
    one, excerpt = clip.compose(), tmp_path / "excerpt.rrd"
    write_excerpt(clip, None, 13, 1, excerpt)
    other = Composed(name="excerpt", files=(excerpt,))
    clients, connect = [], viewer._connect

    def overheard(*what):
        clients.append(connect(*what))
        return clients[-1]

    monkeypatch.setattr(viewer, "_connect", overheard)
    in_front = []
    with viewer.opened(["--headless", "--window-size", "640x480"]) as go_to:
        for recording, frame, tabs in ((one, 14, ("one", "Ben")), (other, 13, ()), (one, 10, ("two", ANN))):
            go_to(recording, frame, tabs)
            state = clients[0].get_state()
            shown = {each.store_id: each for each in state.recordings}[state.active_recording]
            assert (shown.current_timeline, shown.current_time) == ("frame", frame)
            in_front.append(state.active_recording)
            if tabs:
                assert {*tabs} <= _active_tabs(clients[0])
        with pytest.raises(VfoaError, match=r"gone\.rrd"):
            go_to(Composed(name="gone", files=(tmp_path / "gone.rrd",)), 10, ())
    assert in_front[0] == in_front[2] != in_front[1]


@needs_vulkan
def test_the_real_viewer_opens_an_excerpt_at_its_frame(frames, record_run, tmp_path):
    excerpt = tmp_path / "excerpt.rrd"
    write_excerpt(find_clips(record_run(frames).run, None, None)[0], None, 13, 2, excerpt)
    with viewer._viewer(["--headless"]) as (_, client):
        client.open(str(excerpt))
        viewer._settled_picture(client)
        (shown,) = client.get_state().recordings
        assert (shown.current_timeline, shown.current_time) == ("frame", 13)


@needs_vulkan
def test_two_runs_of_one_clip_in_one_viewer_have_panes_of_their_own(frames, tmp_path, monkeypatch):
    clients, connect = [], viewer._connect
    monkeypatch.setattr(viewer, "_connect", lambda *what: clients.append(connect(*what)) or clients[-1])
    runs = [write_run(tmp_path / name, {name: frames, f"{name} wide": frames}) for name in ("first", "second")]
    recordings = [find_clips(each.run, None, None)[0].compose() for each in runs]
    with viewer.opened(["--headless", "--window-size", "640x480"]) as go_to:
        for turn in (0, 1, 0):
            go_to(recordings[turn], 14, ())
            names = {name for name in _names(clients[0]) if name.startswith(("first", "second"))}
            own = runs[turn].configurations
            assert names == {*own}, (turn, names)


def _names(client) -> set[str]:
    """The names of all containers and views."""
    entries = [each for layout in client.get_blueprint().blueprint.values() for each in layout.values()]
    return {str(each["display_name"]) for each in entries if isinstance(each, dict) and each.get("display_name")}


def _active_tabs(client) -> set[str]:
    """The names of all containers that are the active tab of another."""
    layout = client.get_blueprint().blueprint
    key = "ContainerBlueprint"
    containers = {path.lstrip("/"): each[key] for path, each in layout.items() if key in each}
    active = {container.get("active_tab") for container in containers.values()}
    return {containers[path].get("display_name") for path in active & containers.keys()}


def test_recordings_are_found_by_clip_and_configuration(frames, tmp_path):
    run = write_run(tmp_path / "run", {"one": frames, "two": frames}).run
    (clip,) = find_clips(run, None, None)
    assert [layer.configuration for layer in clip.layers] == ["one", "two"]
    (alone,) = find_clips(run, "clip", "two")
    assert [path.name for path in alone.compose().files] == [
        "clip.rrd",
        "clip__two.scene.rrd",
        "clip__two.rrd",
        "clip__two.verdicts.rrd",
    ]
    assert len(clip.compare("one", "two").files) == 7
    file = run / "clip__one.rrd"
    assert find_recordings(file, None, None) == [Composed(name="clip__one", files=(file,))]
    for clip_name, configuration, said in (
        ("c", None, r"clip 'c'.*clip"),
        (None, "three", r"'three'.*expected one of: one, two"),
    ):
        with pytest.raises(VfoaError, match=said):
            find_clips(run, clip_name, configuration)
    with pytest.raises(VfoaError, match="found nothing there"):
        find_recordings(tmp_path / "nowhere", None, None)
    for path in run.glob("*.rrd"):
        path.unlink()
    with pytest.raises(VfoaError, match="found none; was it run with --recording none"):
        find_recordings(run, None, None)
    directory = RunDirectory(run)
    directory.write_manifest(directory.read_manifest().model_copy(update={"finished": None}))
    with pytest.raises(VfoaError, match="found none; the run is not finished"):
        find_recordings(run, None, None)


def test_the_name_of_a_row_of_several_seeds_is_that_of_all_its_recordings(frames, tmp_path, monkeypatch, capsys):
    """Tables have one row, `one`, for all seeds."""
    run = write_run(tmp_path / "run", {"one.seed1": frames, "one.seed2": frames, "two.seed1": frames}).run
    for asked, found in (("one", ["one.seed1", "one.seed2"]), ("one.seed2", ["one.seed2"])):
        (clip,) = find_clips(run, "clip", asked)
        assert [layer.configuration for layer in clip.layers] == found
    view = ["view", str(run), "--clip", "clip", "--compare"]
    for arguments, said in (
        (["export-failure", str(run), "--config", "one", "--frame", "11"], "(clip, one.seed1), (clip, one.seed2)"),
        ([*view, "one", "two"], "'one' is of 2 seeds; expected one of one.seed1, one.seed2"),
        ([*view, "one.seed1", "owt"], "expected one of: one, two"),
    ):
        assert _vfoa(monkeypatch, *arguments) == 2
        assert said in capsys.readouterr().err
    shown = []
    monkeypatch.setattr(viewer, "show", lambda recordings, frame: shown.append(recordings[0].name))
    assert _vfoa(monkeypatch, *view, "one.seed2", "two") == 0
    assert shown == ["clip__one.seed2__vs__two.seed1"]


def test_the_layout_is_that_of_the_application_of_the_files(frames, tmp_path):
    clip = find_clips(write_run(tmp_path / "run", {"one": frames, "two": frames}).run, None, None)[0]
    for recording in (clip.compose(), clip.under("two").compose(), clip.compare("one", "two")):
        layout, *files = recording.files_to_open(tmp_path)
        (stored,) = {entry.application_id for entry in RrdReader(layout).blueprints()}
        assert {stored} == {RecordingFile(file).ids.application for file in files}
    excerpt = tmp_path / "excerpt.rrd"
    write_excerpt(clip, None, 13, 1, excerpt)
    assert RecordingFile(excerpt).ids.application == stored
    assert RecordingFile(excerpt).ids.recording != RecordingFile(clip.files.images).ids.recording


def test_a_frame_that_the_clip_does_not_have_is_refused(frames, tmp_path):
    (recording,) = find_recordings(write_run(tmp_path / "run", {"one": frames}).run, None, None)
    recording.expect_frame(13)
    with pytest.raises(VfoaError, match=r"clip\.rrd: found no frame 12.*10 to 14, such as 11 or 13"):
        recording.expect_frame(12)
    (alone,) = find_recordings(recording.files[-1], None, None)
    alone.expect_frame(13)
    with pytest.raises(VfoaError, match=r"clip__one.verdicts\.rrd: found no frame 12.*10 to 14, such as 11 or 13"):
        alone.expect_frame(12)


@pytest.mark.parametrize("options", [["--clip", "clip"], ["--config", "one"], ["--subject", ANN]])
def test_no_part_of_a_file_is_shown(frames, tmp_path, monkeypatch, capsys, options):
    file = write_run(tmp_path / "run", {"one": frames}).files.attention("one")
    monkeypatch.setattr(viewer, "show", lambda recordings, frame: pytest.fail("shown"))
    assert _vfoa(monkeypatch, "view", str(file), *options) == 2
    assert f"{file}: " in capsys.readouterr().err


def test_a_layer_that_is_opened_alone_is_said_to_be_one(frames, tmp_path, monkeypatch, capsys):
    """It has no images or no cones, and a viewer shows errors in their place."""
    recorded = write_run(tmp_path / "run", {"one": frames, "two": frames})
    monkeypatch.setattr(viewer, "show", lambda recordings, frame: None)
    alone = tmp_path / "alone.rrd"
    write_excerpt(find_clips(recorded.run, None, "two")[0], None, 13, 1, alone)
    for file, said in (
        (recorded.files.attention("two"), f"view {recorded.run} --clip clip --config two"),
        (recorded.files.images, f"view {recorded.run} --clip clip --config one"),
        (alone, ""),
    ):
        assert _vfoa(monkeypatch, "view", str(file)) == 0
        error = capsys.readouterr().err
        assert said in error
        assert bool(error) == bool(said)


def test_a_frame_opens_with_the_tab_of_the_person_who_is_wrong_there(frames, tmp_path, monkeypatch):
    run = write_run(tmp_path / "run", {"one": frames, "two": frames}).run
    directory = RunDirectory(run)
    manifest = directory.read_manifest()
    people = {
        "subjects": {"aron": {}, ANN: {}},
        "targets": {"red cup": {}},
    }  # the first tab is that of aron, who has no labels
    clip = manifest.plain()["clips"][0] | {"names": people}
    write_manifest(directory, manifest.plain() | {"clips": [clip]})
    write_verdict_layers(directory, {"clip": LABELS})
    shown = []
    monkeypatch.setattr(viewer, "show", lambda recordings, frame: shown.append(recordings[0].subject))
    for frame in frames:
        wrong = ANN if verdict(frame).outcome == "wrong" else None
        for more in ([], ["--config", "two"], ["--compare", "one", "two"]):
            assert _vfoa(monkeypatch, "view", str(run), "--frame", str(frame.record.frame), *more) == 0
            assert shown.pop() == wrong
    assert {verdict(frame).outcome for frame in frames} >= {"correct", "wrong"}
    assert _vfoa(monkeypatch, "view", str(run), "--frame", "14", "--subject", "aron") == 0
    assert shown.pop() == "aron"
    cut = tmp_path / "cut.rrd"
    monkeypatch.setattr(
        "harness.record.excerpt.write_excerpt", lambda *given: (shown.append(given[1]), given[-1].touch())
    )
    assert _vfoa(monkeypatch, "export-failure", str(run), "--config", "two", "--frame", "14", "--out", str(cut)) == 0
    assert shown == [ANN]


def test_of_many_clips_the_first_ones_are_opened(frames, tmp_path, monkeypatch, capsys):
    run = write_run(tmp_path / "run", {"one": frames}).run
    manifest = RunDirectory(run).read_manifest()
    names = [f"clip {k}" for k in range(MOST_OPENED + 3)]
    clips = [manifest.clips[0].model_copy(update={"name": name}) for name in names]
    RunDirectory(run).write_manifest(manifest.model_copy(update={"clips": clips}))
    for name in names:
        ClipFiles(run=run, clip=name).attention("one").touch()
    shown = []
    monkeypatch.setattr(viewer, "show", lambda recordings, frame: shown.append([each.clip for each in recordings]))
    assert _vfoa(monkeypatch, "view", str(run)) == 0
    assert shown.pop() == names[:MOST_OPENED]
    assert capsys.readouterr().err == "vfoa: the first 20 of 23 clips; --clip opens another one\n"
    assert _vfoa(monkeypatch, "view", str(run), "--clip", names[-1]) == 0
    assert (shown.pop(), capsys.readouterr().err) == ([names[-1]], "")


def test_two_configurations_are_compared_side_by_side_by_one_command(frames, tmp_path, monkeypatch, capsys):
    run = write_run(tmp_path / "run", {"one": frames, "two": frames}).run
    before = sorted(run.iterdir())
    shown = []
    monkeypatch.setattr(viewer, "show", lambda recordings, frame: shown.append((recordings[0].name, frame)))
    view = ["view", str(run), "--clip", "clip"]
    for words in (view, ["view", str(run)]):  # the run has one clip
        assert _vfoa(monkeypatch, *words, "--compare", "one", "two", "--frame", "11") == 0
        assert shown.pop() == ("clip__one__vs__two", 11)
    assert sorted(run.iterdir()) == before  # nothing is copied
    manifest = RunDirectory(run).read_manifest()
    another = manifest.clips[0].model_copy(update={"name": "another"})
    RunDirectory(run).write_manifest(manifest.model_copy(update={"clips": [*manifest.clips, another]}))
    for path in run.glob("clip*.rrd"):
        shutil.copyfile(path, path.with_name(path.name.replace("clip", "another", 1)))
    for arguments, said in (
        (["view", str(run), "--compare", "one", "two"], "choose one with --clip: clip, another"),
        ([*view, "--compare", "two", "two"], "two configurations"),
        ([*view, "--compare", "one", "tow"], "did you mean 'two'?"),
    ):
        assert _vfoa(monkeypatch, *arguments) == 2
        error = capsys.readouterr().err
        assert said in error
        assert error.count("\n") == 1


def _vfoa(monkeypatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["vfoa", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def test_a_screenshot_is_a_png(tmp_path, monkeypatch, capsys):
    assert _vfoa(monkeypatch, "view", str(tmp_path / "a.rrd"), "--screenshot", str(tmp_path / "a.txt")) == 2
    assert "a.txt: found the suffix '.txt'; expected .png" in capsys.readouterr().err


def test_a_screenshot_replaces_no_file_unasked(tmp_path, monkeypatch, capsys):
    (tmp_path / "a.png").write_text("mine")
    assert _vfoa(monkeypatch, "view", str(tmp_path / "a.rrd"), "--screenshot", str(tmp_path / "a.png")) == 2
    assert "a.png: exists already; expected --replace, or another --screenshot" in capsys.readouterr().err
    assert (tmp_path / "a.png").read_text() == "mine"


@pytest.mark.parametrize(("options", "code"), [([], 0), (["--screenshot", "a.png"], 130)])
def test_a_viewer_does_not_outlive_the_command_that_opened_it(tmp_path, options, code):
    recording = tmp_path / "a__one.rrd"
    recording.touch()
    binary = tmp_path / "rerun"
    binary.write_text(f"#!/bin/sh\necho $$ > {tmp_path}/started\nmv {tmp_path}/started {tmp_path}/pid\nexec sleep 60\n")
    binary.chmod(0o755)
    fake = f"from harness.record import viewer; viewer.viewer_binary = lambda: {str(binary)!r}"
    command = [sys.executable, "-c", f"{fake}; from harness.cli import main; main()", "view", str(recording), *options]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    with subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE) as process:
        try:
            deadline = time.monotonic() + 30
            while not (tmp_path / "pid").exists() and time.monotonic() < deadline:
                time.sleep(0.05)
            time.sleep(0.5)  # the viewer tells its number before whoever started it knows it
            process.send_signal(signal.SIGTERM)
            process.communicate(timeout=30)
        finally:
            process.kill()
    assert process.returncode == code
    assert not psutil.pid_exists(int((tmp_path / "pid").read_text()))
