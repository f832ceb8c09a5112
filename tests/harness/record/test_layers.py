"""Data that several configurations share is written once, and the layers hold the same as one recording of each."""

from __future__ import annotations

import shutil
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from harness.labels.labels import Label, LabelRange, Labels
from harness.record import entities, verdict_layer
from harness.record.layers import ClipFiles, LayerNames, layer_names
from harness.record.reading import RecordingFile, reading
from harness.record.recorder import Recorder, SharedRecorder, noted_colours
from harness.record.verdict_layer import write_verdict_layers
from harness.run.directory import RunDirectory, new_run_id
from harness.run.grid import OF_LAYERS
from harness.run.table_records import TableReader, read_records
from tests.harness.record.conftest import ANN, LABEL, LABELS, LAYERS, four_frames, show, under, write_run
from tests.harness.record.conftest import shared as seen_by
from tests.record_tables import write_tables
from tests.records import write_manifest
from vfoa.errors import VfoaError


def test_an_error_of_the_reader_without_a_text_is_named_by_its_kind():
    with pytest.raises(VfoaError, match="recording: RuntimeError"), reading(Path("clip.rrd")):
        raise RuntimeError


def test_a_layer_is_named_after_the_first_configuration_that_has_it():
    bm, sgbm = ({"stereo": {"matcher": name}, "segmentation": "truth"} for name in ("bm", "sgbm"))
    names = layer_names({"a": {**bm, "attention": 1}, "b": {**bm, "attention": 2}, "c": {**sgbm, "attention": 1}})
    assert names == {
        "a": LayerNames(configuration="a", masks="a", reconstruction="a"),
        "b": LayerNames(configuration="b", masks="a", reconstruction="a"),
        "c": LayerNames(configuration="c", masks="a", reconstruction="c"),
    }


def test_the_names_that_an_experiment_refuses_are_those_of_other_files_of_a_recording():
    files = ClipFiles(run=Path("run"), clip="clip")
    others = {files.reconstruction("a"), files.verdicts("a")}
    assert others == {files.attention(f"a.{end}") for end in OF_LAYERS}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Three configurations, of which the last two share a reconstruction and the last has not seen the last frame."""
    frames = four_frames()
    run = tmp_path_factory.mktemp("written") / "run"
    return write_run(run, {"one": frames, "two": frames, "three": frames[:3]})


@pytest.fixture
def shared(written, tmp_path):
    """A copy of that run, which the test may change."""
    return replace(written, run=shutil.copytree(written.run, tmp_path / "run"))


def test_what_is_shared_is_written_once(shared, frames, read_back):
    names = {path.name for path in shared.run.glob("*.rrd")}
    assert names == {
        "clip.rrd",
        *(f"clip__{name}.scene.rrd" for name in ("one", "two")),
        *(f"clip__{name}{suffix}.rrd" for name in ("one", "two", "three") for suffix in ("", ".verdicts")),
    }
    images = RrdReader(shared.files.images).stream().filter(content=entities.IMAGE, has_timeline="frame")
    assert sum(chunk.to_record_batch().num_rows for chunk in images) == len(frames)


def test_each_configuration_alone_holds_what_it_holds_among_others(shared, frames, read_back, tmp_path):
    """Every entity with every value of every frame: those of one recording of one configuration."""
    together = read_back(shared)
    for name, seen in (("one", frames), ("two", frames), ("three", frames[:3])):
        alone = read_back(write_run(tmp_path / f"alone {name}", {name: seen}))
        scene = "two" if name == "three" else name
        shared_name = {entities.masks(name): entities.masks("one")} | {
            path: path.replace(f"/{name}", f"/{scene}", 1)
            for path in alone.paths
            if path.startswith((entities.RECONSTRUCTION, entities.STEREO))
        }
        kept = {each.record.frame for each in seen}
        compared = 0
        for path in alone.paths:
            expected = alone.everything(path)
            for component, values in expected.items():
                found = together.at(shared_name.get(path, path), component)
                assert {frame: value for frame, value in found.items() if frame in kept} == values, (path, component)
                compared += 1
        assert compared > 40


def test_a_configuration_that_fails_leaves_the_others_whole(frames, tmp_path, read_back):
    files = ClipFiles(run=tmp_path, clip="clip")
    names = layer_names({"one": {"attention": 1}, "two": {"attention": 2}})
    with SharedRecorder(files, names, rate_hz=25) as recorder:
        broken, whole = (Recorder(files, names[name], recorder.colours, per_second=25) for name in ("one", "two"))
        with whole, suppress(VfoaError), broken:
            for frame in frames:
                recorder.write(seen_by({"one": frame, "two": frame}))
                whole.write(under(frame, "two").finished)
            broken.write(under(frames[0], "one").finished)
            raise VfoaError("broken")
    assert not files.attention("one").exists()
    assert files.attention("two").is_file()
    boxes = read_back(files.reconstruction("one")).at(entities.box("one", 4), "Boxes3D:centers")
    # in the last frame the box has another number
    assert [frame for frame, centres in boxes.items() if centres] == [10, 11, 13]
    assert len(read_back(files.images).at(entities.IMAGE, "VideoStream:sample")) == len(frames)


def test_a_configuration_that_is_not_perceived_to_the_end_has_no_reconstruction(frames, tmp_path, read_back):
    files = ClipFiles(run=tmp_path, clip="clip")
    names = layer_names({"one": {"stereo": 1, "segmentation": 1}, "two": {"stereo": 2, "segmentation": 1}})
    with SharedRecorder(files, names, rate_hz=25) as recorder:
        recorder.write(seen_by({"one": frames[0], "two": frames[0]}))
        for frame in frames[1:]:
            perceived = seen_by({"two": frame})
            both = {"one": VfoaError("lost"), **perceived.by_configuration}
            recorder.write(replace(perceived, by_configuration=both))
    assert sorted(path.name for path in tmp_path.glob("*.rrd")) == ["clip.rrd", "clip__two.scene.rrd"]
    masks = read_back(files.images).at(entities.masks("one"), "EncodedImage:blob")
    assert list(masks) == [10, 11, 13, 14]


def test_a_clip_that_cannot_be_read_to_the_end_has_no_recordings(frames, tmp_path):
    files = ClipFiles(run=tmp_path, clip="clip")
    with suppress(VfoaError), SharedRecorder(files, {"one": LAYERS}, rate_hz=25) as recorder:
        recorder.write(seen_by({"one": frames[0]}))
        raise VfoaError("unreadable")
    assert list(tmp_path.glob("*.rrd")) == []


def test_colours_are_noted_for_the_configurations_that_were_recorded_together(shared):
    names = list(shared.configurations)
    colours = noted_colours(shared.files, names)
    assert list(colours.known) == ["red cup", ANN, "book#4"]
    assert noted_colours(shared.files, names[:1]).known == colours.known
    assert noted_colours(shared.files, [*names, "four"]) is None
    shared.files.noted.unlink()
    assert noted_colours(shared.files, names) is None


def test_verdicts_follow_an_edited_label(shared, read_back):
    lane = (entities.verdict("one", ANN, "truth"), "StateChange:state")
    assert set(map(tuple, read_back(shared).at(*lane).values())) == {("red cup",)}
    edited = Labels([LabelRange(first_frame=0, last_frame=1000, subject=ANN, label=Label(target="book#4"))])
    before = shared.files.attention("one").read_bytes()
    write_verdict_layers(RunDirectory(shared.run), {"clip": edited})
    columns = read_back(shared)
    assert set(map(tuple, columns.at(*lane).values())) == {("book#4",)}
    outcomes = columns.at(entities.verdict("one", ANN, "verdict"), "StateChange:state")
    assert outcomes[14] == ["correct"]
    assert shared.files.attention("one").read_bytes() == before


def test_the_progress_of_verdicts_is_that_of_recordings(shared):
    seen = []

    @contextmanager
    def bar(total, what):
        seen.append((total, what))
        yield seen.append

    write_verdict_layers(RunDirectory(shared.run), {"clip": LABELS}, bar=bar)
    assert seen == [(len(shared.configurations), shared.run.name), *["clip"] * len(shared.configurations)]


def test_only_layers_that_change_are_written(shared):
    labels, files = {"clip": LABELS}, [shared.files.verdicts(name) for name in shared.configurations]

    def written(labels, spoil=None):
        before = {file: file.stat().st_mtime_ns for file in files}
        if spoil is not None:
            spoil()
        write_verdict_layers(RunDirectory(shared.run), labels)
        return [file for file in files if file.stat().st_mtime_ns != before[file]]

    assert written(labels) == []
    noted = LabelRange(first_frame=0, last_frame=1000, subject=ANN, label=replace(LABEL, note="checked twice"))
    assert written({"clip": Labels([noted])}) == []
    assert written(labels, lambda: files[1].write_bytes(b"no recording")) == [files[1]]
    assert written({}) == files
    assert written(labels) == files


def test_only_the_frames_with_an_edited_label_are_written_anew_and_the_rest_stays(shared, read_back, monkeypatch):
    monkeypatch.setattr("harness.run.table_files.GROUP_FRAMES", 2)  # blocks of frames 10 and 11, 13 and 14
    directory, read, real = RunDirectory(shared.run), [], TableReader.read
    records = list(read_records(directory))
    by_pair = {
        ("clip", name): [each for each in records if each.configuration == name] for name in shared.configurations
    }
    write_tables(directory, by_pair)
    late = [
        LabelRange(first_frame=0, last_frame=13, subject=ANN, label=LABEL),
        LabelRange(first_frame=14, last_frame=1000, subject=ANN, label=Label(target="book#4")),
    ]
    early = [
        LabelRange(first_frame=0, last_frame=10, subject=ANN, label=LABEL),
        LabelRange(first_frame=11, last_frame=1000, subject=ANN, label=Label(target="book#4")),
    ]

    def written(ranges):
        read.clear()
        write_verdict_layers(directory, {"clip": Labels(ranges)})
        return {block.frames for block in read}

    def content():
        columns = [read_back(shared.files.verdicts(name)) for name in shared.configurations]
        palette = entities.verdict("one", ANN, "truth"), "StateConfiguration:values"
        return [{path: column.everything(path) for path in column.paths} for column in columns], columns[0].static(
            *palette
        )

    monkeypatch.setattr(
        verdict_layer.TableReader, "read", lambda reader, block: (read.append(block), real(reader, block))[1]
    )
    assert written([LABELS.ranges[0]]) == {(10, 11), (13, 14), (13,)}
    assert written(late) == {(13, 14)}  # the third configuration has not seen frame 14
    edited = content()
    assert written(early) == {(10, 11), (13, 14), (13,)}
    assert written(late) == {(10, 11), (13, 14), (13,)}
    for name in shared.configurations:
        shared.files.verdicts(name).unlink()
    written(late)
    assert content() == edited


def test_a_layer_that_is_written_later_joins_the_recording_of_an_earlier_version(shared):
    """Its ids were made in another way than those of the manifest's run would be now."""
    manifest = RunDirectory(shared.run).read_manifest().plain()
    write_manifest(RunDirectory(shared.run), {**manifest, "run_id": new_run_id()})
    before = RecordingFile(shared.files.attention("one")).ids
    write_verdict_layers(RunDirectory(shared.run), {})
    assert {RecordingFile(path).ids for path in shared.run.glob("*.rrd")} == {before}
    shared.files.attention("one").write_bytes(b"no recording")
    write_verdict_layers(RunDirectory(shared.run), {"clip": LABELS})  # scores are whole without it


def test_a_clip_without_labels_has_predictions_alone(shared, read_back):
    write_verdict_layers(RunDirectory(shared.run), {})
    columns = read_back(shared)
    assert set(map(tuple, columns.at(entities.verdict("one", ANN, "verdict"), "StateChange:state").values())) == {
        ("unscored",)
    }
    assert entities.answer_3d("one", ANN, "truth", "box") not in columns.paths


def test_the_marked_boxes_are_those_of_truth_and_answer(shared, frames, read_back):
    columns = read_back(shared)
    wrong = frames[3]
    (truth,) = columns.at(entities.answer_3d("one", ANN, "truth", "box"), "Boxes3D:centers")[14]
    (predicted,) = columns.at(entities.answer_3d("one", ANN, "predicted", "box"), "Boxes3D:centers")[14]
    centres = {target.name: target.box.center_m for target in wrong.record.targets if target.box is not None}
    assert truth == pytest.approx(centres["red cup"], abs=1e-6)
    assert predicted == pytest.approx(centres["book#4"], abs=1e-6)


def test_of_two_targets_of_a_name_the_one_at_the_labels_point_is_the_truth(shared, frames, read_back):
    """Also while somebody looks at the other one."""
    label = Label(target="red cup", point_px=(30, 30))
    labels = Labels([LabelRange(first_frame=0, last_frame=1000, subject=ANN, label=label)])
    write_verdict_layers(RunDirectory(shared.run), {"clip": labels}, {"clip": {"book#4": "red cup"}})
    columns = read_back(shared)
    assert columns.at(entities.verdict("one", ANN, "verdict"), "StateChange:state")[14] == ["wrong"]
    centres = {target.name: target.box.center_m for target in frames[3].record.targets if target.box is not None}
    for what, name in (("truth", "red cup"), ("predicted", "book#4")):
        (centre,) = columns.at(entities.answer_3d("one", ANN, what, "box"), "Boxes3D:centers")[14]
        assert centre == pytest.approx(centres[name], abs=1e-6)


def test_of_two_targets_of_a_name_that_no_answer_tells_apart_both_are_the_truth(tmp_path, read_back):
    """One of them alone, in green, would say which one somebody looks at."""
    shown = show(10, things=(1, 2, 4), gaze_at=2)
    first, cup, book = shown.record.targets
    other = replace(book, name="red cup")
    (ann,) = shown.record.subjects
    records = [
        replace(shown.record, targets=(first, cup, other), subjects=(replace(ann, focus=focus),)) for focus in (None, 4)
    ]
    frames = [replace(shown, record=replace(each, frame=number)) for number, each in enumerate(records)]
    columns = read_back(write_run(tmp_path / "run", {"one": frames}))
    boxes = columns.at(entities.answer_3d("one", ANN, "truth", "box"), "Boxes3D:centers")
    assert boxes[0] == pytest.approx(np.array([cup.box.center_m, other.box.center_m]), abs=1e-6)
    assert boxes[1] == pytest.approx(np.array([other.box.center_m]), abs=1e-6)
    (line, _) = columns.at(entities.answer_3d("one", ANN, "truth", "line"), "LineStrips3D:strips")[0]
    assert line == pytest.approx(np.array([ann.eye_origin_m, cup.box.center_m]), abs=1e-6)


def test_a_frame_without_a_right_image_has_no_disparity(frames, tmp_path, read_back):
    depth = [replace(frame, frame=replace(frame.frame, right=None, depth_m=_flat(frame))) for frame in frames]
    columns = read_back(write_run(tmp_path / "run", {"one": depth}))
    assert entities.MEASURED_DEPTH in columns.paths
    assert not {entities.RIGHT, entities.disparity("one")} & columns.paths


def _flat(frame):
    import numpy as np

    return np.full(frame.frame.left.shape[:2], 1.5, np.float32)
