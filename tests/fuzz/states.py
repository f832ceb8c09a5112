"""Parsers that need more than one file: what reads a damaged file beside whole ones, in the same folder each time."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.annotate.actions import look
from harness.annotate.label_store import LabelStore
from harness.labels.formats.exchange import Exchange
from harness.labels.formats.idiap_vfoa import IdiapGroundTruth
from harness.labels.formats.pupil_cloud import PupilCloud
from harness.labels.labels import Timeline, timeline_of
from harness.pipeline.cache import StageIdentity, StoredOutputs, difference
from harness.pipeline.cache_store import Store, encode
from harness.pipeline.stage_files.coco_panoptic import CocoPanoptic, CocoPanopticSettings
from harness.pipeline.stage_files.directions import FileGaze, FileGazeSettings
from harness.pipeline.stage_files.heads import read_heads
from harness.report.thumbnails import lines_path, read_thumbnails
from harness.report.thumbnails.writer import PictureWriter, ThumbnailWriter
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.run.table_columns import ColumnReader
from harness.run.table_records import read_records
from harness.score.finished_run import FinishedRun
from harness.score.labelled_run import read_labelled
from harness.score.reference import Reference
from harness.score.score import score as score_columns
from harness.sources.calibration_files.read import read_cameras
from harness.sources.recordings import messages, orbbec
from harness.sources.recordings.clip import RecordingClip
from harness.sources.recordings.messages import BY_NAME, MessageType
from harness.sources.recordings.pixels import read_depth, read_image
from harness.sources.recordings.settings import RecordingSettings
from harness.studio.store import load_geometry, load_pair, save_geometry, save_pair
from scripts.measure.stage_outputs import write_coco_panoptic
from tests.disk import labels_text, write_text
from tests.exchanges import PlainClip, exchange
from tests.fuzz import whole
from tests.harness.record.conftest import ANN, shared, show
from tests.measured import idiap_file, measured_tables, open_measured, openface_file, pose
from tests.records import labels, score
from vfoa.errors import VfoaError
from vfoa.types import Disparity, Head, Instance, Instances

Read = Callable[[Path], Any]


def once(path: Path, make: Callable[[Path], Any]) -> Path:
    """The folder ``whole`` beside a case, with what ``make`` has written there the first time."""
    folder = path.parent / "whole"
    if not folder.is_dir():
        folder.mkdir()
        make(folder)
    return folder


def naming(path: Path, read: Callable[[], Any]) -> Any:
    """What ``read`` returns; its errors name the file of the case, of which they name another part."""
    try:
        return read()
    except VfoaError as error:
        raise VfoaError(f"{path}: {error}") from None


def cameras_beside(name: str, write: whole.Write) -> Read:
    """Reads a pair of which the other file is whole: the right camera's, or the extrinsics."""
    return lambda path: read_cameras([path, once(path, lambda folder: write(folder / name)) / name], lambda: whole.SIZE)


# Labels


def idiap_labels(path: Path) -> Any:
    clip = open_measured("idiap_vfoa", once(path, idiap_file), file="tracker.csv")
    return IdiapGroundTruth().read(
        path, Exchange(timeline=timeline_of(clip), rate_hz=clip.rate_hz, subjects=("1", "2"), targets=("robot",))
    )


def pupil_cloud(path: Path) -> Any:
    """Reads the tables of an export, of which the other one is whole."""
    for name, text in (("aoi_fixations.csv", whole.AOI_FIXATIONS), ("fixations.csv", whole.FIXATIONS)):
        if path.name != name:
            path.with_name(name).write_text(text)
    return naming(path, lambda: PupilCloud().read(path.with_name("aoi_fixations.csv"), exchange()))


def _store(folder: Path, journal: Path) -> LabelStore:
    timeline = Timeline(frames=range(1, 9), times_ns=())
    return LabelStore(folder / "mine.csv", journal, timeline=timeline, subjects=("ann", "ben"), targets=("cup",))


def write_journal(path: Path) -> None:
    store = _store(path.parent, path)
    for at, target in ((0, "cup"), (3, "none"), (5, "ben")):
        store.put("ann", look(store.track("ann"), at, target), seen=at)
    store.step_back("undo")
    store.see("ann", 6)
    store.close()


def open_labels(path: Path) -> Any:
    """Beside the CSV that belongs to the whole journal."""
    folder = once(path, lambda folder: write_journal(folder / path.name))
    shutil.copyfile(folder / "mine.csv", path.parent / "mine.csv")
    store = _store(path.parent, path)
    try:
        return store.state()
    finally:
        store.close()


# Runs


@cache
def _run(folder: Path) -> Path:
    """A finished run of measured frames, labelled: no images, so that it takes a second."""
    project = folder / "project"
    measured_tables(project / "data" / "talk")
    clip = write_text(project / "datasets" / "mine.toml", whole.MEASURED.replace("../talk", "../data/talk"))
    write_text(project / "annotations" / "mine.csv", labels_text("1,6,anna,none,", "7,12,anna,robot,"))
    text = f'clips = ["{clip.as_posix()}"]\npreset = "measured"\n[[configuration]]\nname = "one"\n'
    experiment = load_experiment(str(write_text(project / "e.toml", text)))
    run_plan(prepare(experiment), project / "run", workers=1, progress=lambda clip: None)
    return project / "run"


def write_run_manifest(path: Path) -> None:
    path.write_bytes((_run(path.parent) / "manifest.json").read_bytes())


def open_run(path: Path) -> Any:
    """A run with this manifest and whole results."""
    directory = RunDirectory(_run(once(path, _run)))
    shutil.copyfile(path, directory.manifest)
    run = FinishedRun.read(directory)
    columns, reference = list(run.columns()), run.reference()
    read_labelled(directory, None)
    return score_columns(columns, reference)


def _table(run: Path, name: str) -> Path:
    (path,) = run.rglob(name)
    return path


def write_table(path: Path) -> None:
    path.write_bytes(_table(_run(path.parent), path.name).read_bytes())


def read_run(path: Path) -> Any:
    """The records and the columns of a run with this table, of the same name as one of its own."""
    run = _run(once(path, _run))
    shutil.copyfile(path, _table(run, path.name))
    directory = RunDirectory(run)
    reader = ColumnReader(directory, directory.read_manifest())
    columns = [reader.read(pair) for pair in reader.paths]
    return list(read_records(directory)), columns


def write_thumbnails(path: Path) -> None:
    with PictureWriter(path.parent, "clip") as pictures, ThumbnailWriter(path.parent, "clip", "one") as writer:
        for each in _shown():
            pictures.write(shared({"one": each}))
            writer.write(each.finished)
    path.write_bytes(lines_path(path.parent, "clip", "one").read_bytes())


def open_thumbnails(path: Path) -> Any:
    """Lines beside whole pictures, of frames that are wrong."""
    folder = once(path, lambda folder: write_thumbnails(folder / path.name))
    shutil.copyfile(path, lines_path(folder, "clip", "one"))
    return read_thumbnails(folder, _wrong())


@cache
def _shown() -> Any:
    return [show(frame, things=(1, 2, 3, 4), gaze_at=4) for frame in (1, 2, 3)]


@cache
def _wrong() -> Any:
    reference = Reference(labels={"clip": labels("red cup", "red cup", "red cup", subject=ANN)})
    return score((each.record for each in _shown()), reference).wrong_frames


# The cache: nothing in it may stop a run


_IDENTITY = StageIdentity(slot="stereo", parts={"stage": "bm", "clip": "mine", "settings": {}}, digest="abc")


def write_entry(path: Path) -> None:
    cup = Instance(id=3, label="cup", category_id=47, is_thing=True, score=0.1)
    instances = Instances(ids=np.zeros((6, 8), np.uint16), instances=(cup,))
    values = (Disparity(disparity_px=np.ones((6, 8), np.float32)), instances, (Head(box_px=np.arange(4.0), score=0.3),))
    path.write_bytes(encode((f"{_IDENTITY.digest}/{path.name}", 0.5, values)))


def load_entry(path: Path) -> Any:
    """The damaged bytes behind a right checksum, as a stage's stored output."""

    class Here(StoredOutputs):
        def _path(self, inputs: Any) -> Path:
            return path

    data = path.read_bytes()
    path.write_bytes(hashlib.blake2b(data, digest_size=16).digest() + data)
    return Here(Store(path.parent, 10**9), _IDENTITY).load(())


def use_identity(path: Path) -> Any:
    store = Store(path.parent, 10**9)
    place = store.folder("stereo", "abc") / path.name
    place.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, place)
    return store.usage(), difference(_IDENTITY.parts, (parts for _, parts in store.described("stereo")))


def write_rendered(path: Path) -> None:
    save_pair(path, *(np.full((10, 20, 3), value, np.uint8) for value in (1, 2)))
    path.write_bytes(path.read_bytes()[32:])


def load_rendered(path: Path) -> Any:
    """The damaged bytes behind a right checksum."""
    return load_pair(_sealed(path), (10, 20))


def write_geometry(path: Path) -> None:
    save_geometry(path, np.ones((10, 20), np.float32), np.ones((10, 20), np.uint16))
    path.write_bytes(path.read_bytes()[32:])


def load_rendered_geometry(path: Path) -> Any:
    """The damaged bytes behind a right checksum."""
    return load_geometry(_sealed(path), (10, 20))


def _sealed(path: Path) -> Path:
    data = path.read_bytes()
    path.write_bytes(hashlib.sha256(data).digest() + data)
    return path


# Outputs of stages, and measurements


def write_coco(path: Path) -> None:
    ids = np.zeros((48, 64), np.uint16)
    ids[:20] = 3
    person = Instance(id=3, label="person", category_id=1, is_thing=True, score=0.5)
    write_coco_panoptic(path.parent, [(frame, Instances(ids=ids, instances=(person,))) for frame in (1, 2)])


def read_coco(path: Path) -> Any:
    folder, clip = once(path, lambda folder: write_coco(folder / path.name)), PlainClip()
    shutil.copyfile(path, folder / path.name)
    segmenter = CocoPanoptic(CocoPanopticSettings(root=str(folder), partial=True, stuff="all"), clip)
    return naming(path, lambda: [segmenter.segment(clip.frame(number)) for number in (1, 2)])


def open_tables(path: Path) -> Any:
    """Both tables; the one that is not damaged is whole."""
    folder = once(path, lambda folder: measured_tables(folder, range(1, 5)))
    files = {"people_file": "people.csv", "objects_file": "objects.csv", f"{path.stem}_file": "damaged" + path.suffix}
    shutil.copyfile(path, folder / files[f"{path.stem}_file"])
    clip = open_measured("measured", folder, **files)
    return [clip.scene(number) for number in clip.frames]


def write_openface(path: Path) -> None:
    """Two people in four frames."""
    gaze = {f"gaze_{eye}_{axis}": value for eye in "01" for axis, value in (("x", 0.6), ("z", -0.8))}
    rows = [
        {
            "frame": frame,
            "timestamp": frame / 25,
            "pose_Tx": x,
            "pose_Tz": 900,
            "box_px": (20 + x, 20, 60 + x, 70),
            **gaze,
        }
        for frame in (1, 2, 3, 4)
        for x in (-10, 10)
    ]
    openface_file(path, rows)


def open_openface(path: Path) -> Any:
    clip = open_measured("openface", path.parent, file=path.name)
    return [clip.scene(number) for number in clip.frames]


def bodies() -> dict[str, NDArray[Any]]:
    """Poses of two rigid bodies in four frames; one is lost in the last."""
    poses = pose([0.4, 1.6, 2.0], frames=4)
    lost = poses.copy()
    lost[3] = np.nan
    return {"anna": poses, "cup": lost}


def open_motion_capture(adapter: str) -> Callable[[Path], Any]:
    """Reads all frames of a file in which Anna wears a body."""

    def opened(path: Path) -> Any:
        clip = open_measured(adapter, path.parent, file=path.name, heads={"anna": {}})
        return [clip.scene(number) for number in clip.frames]

    return opened


def read_faces(path: Path) -> Any:
    """The heads and gazes of another program's table."""
    clip: Any = PlainClip()
    heads = read_heads(path, clip)
    FileGaze(FileGazeSettings(root=str(path.parent), file=path.name, heads=path.name), clip)
    return [heads.of(number) for number in clip.frames]


def open_idiap(path: Path) -> Any:
    clip = open_measured("idiap_vfoa", path.parent, file=path.name)
    return [clip.scene(number) for number in clip.frames]


# Recordings and messages


def read_recording(path: Path) -> Any:
    clip = RecordingClip(RecordingSettings.model_validate({"recording": path.name}), path.parent)
    return [clip.frame(number) for number in list(clip.frames)[:4]]


def write_metadata(path: Path) -> None:
    whole.depth_bag("db3")(path.parent / "unused.db3")
    (made,) = (path.parent / "made").rglob("metadata.yaml")
    path.write_bytes(made.read_bytes())


def read_with_metadata(path: Path) -> Any:
    """A folder with this metadata.yaml and a whole database."""
    folder = once(path, lambda folder: write_metadata(folder / path.name)) / "made" / "take_db3"
    shutil.copyfile(path, folder / path.name)
    return naming(path, lambda: read_recording(folder))


def read_message(kind: str) -> Read:
    """Reads a message of ``sensor_msgs`` from a file, whose name stands for the topic's."""
    name = f"sensor_msgs/msg/{kind}"
    type_ = MessageType(message_encoding="cdr", schema_encoding=BY_NAME, name=name, schema=b"")

    def read(path: Path) -> Any:
        data, where = path.read_bytes(), str(path)
        if kind == "CameraInfo":
            return messages.camera(type_, data, where)
        return messages.stamp_ns(type_, data, where), read_depth(type_, data, None, where)

    return read


def read_sdk_image(encoding: str, name: str) -> Read:
    """Reads an image of a camera's SDK."""
    type_ = messages.message_type(encoding, encoding, name, b"")
    return lambda path: read_image(type_, path.read_bytes(), str(path))


def read_orbbec_profile(path: Path) -> Any:
    """Reads the calibration and the pose of depth."""
    type_ = messages.message_type(orbbec.ENCODING, "", orbbec.PROFILE, b"")
    data, where = path.read_bytes(), str(path)
    with messages.reading(type_, where):
        return messages.camera(type_, data, where), orbbec.colour_from_depth(data, where)
