"""Every parser of files that a user or another program has written: whole files to begin with, and what reads them.

A new parser is one line here; the suite and `make fuzz` try all of them.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.clips.manifest import load_manifest
from harness.labels.drawn_shapes import read_drawn
from harness.labels.files import read_annotations
from harness.labels.formats import FORMATS
from harness.pipeline.stage_files.answer_tables import read_answers
from harness.pipeline.stage_files.coco_instances import CocoInstances, CocoInstancesSettings
from harness.pipeline.stage_files.heads import read_heads, read_table
from harness.pipeline.stage_files.id_maps import IdMaps, IdMapsSettings
from harness.run.experiment import load_experiment
from harness.run.fitted import read_fitted
from harness.sources.calibration_files.one_camera import read_one_camera
from harness.sources.calibration_files.read import Options, read_cameras
from harness.sources.depth_layouts import read_stamped_list
from harness.sources.foreign import refuse_foreign
from harness.sources.media.images import read_raw, read_rgb
from harness.sources.media.maps import read_depth_file, read_disparity, read_ids
from harness.sources.media.video import Video
from harness.sources.recordings import orbbec, zed
from harness.sources.sintel import read_camera, read_segments
from tests import calibrations
from tests.disk import moving_picture, picture, sintel_camera, sintel_disparity, write_video
from tests.exchanges import PlainClip, exchange
from tests.fuzz import states, whole
from tests.fuzz.states import Read
from tests.measured import idiap_file, motive_file, qualisys_file, ros_file, vicon_file

KINDS = {
    "boris": "json",
    "conf": "text",
    "eaf": "xml",
    "npz": "zip",
    "txt": "text",
    "yml": "yaml",
    **dict(zip(*2 * [("csv", "json", "jsonl", "toml", "xml", "yaml")], strict=True)),
}
"""The kind of a file by its suffix; others are binary."""


@dataclass(frozen=True)
class Parser:
    """A parser by name.

    ``whole`` are texts, and functions that write a whole file at a path. ``read`` raises nothing but a VfoaError.
    ``names_file`` says that its message names the file.
    """

    name: str
    file_name: str
    whole: str | whole.Write | tuple[str | whole.Write, ...]
    read: Read
    names_file: bool = True

    @property
    def kind(self) -> str:
        return KINDS.get(self.file_name.rpartition(".")[2], "binary")

    @property
    def folder(self) -> str:
        """Its name as that of a folder."""
        return "".join(sign if sign.isalnum() else "-" for sign in self.name.lower())

    def corpus(self, place: Path) -> list[bytes]:
        """Whole files of this parser, made in a folder of their own."""
        found = []
        for number, each in enumerate(self.whole if isinstance(self.whole, tuple) else (self.whole,)):
            path = place / str(number) / self.file_name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(each) if isinstance(each, str) else each(path)
            found.append(path.read_bytes())
        return found


def _cameras(path: Path) -> Any:
    return read_cameras([path], lambda: whole.SIZE)


def _vins(path: Path) -> Any:
    """A configuration beside the files of both cameras."""
    calibrations.write_camodocal(path.parent, whole.RIG)
    return _cameras(path)


def _camodocal(path: Path) -> Any:
    """A camera's file in the place of the left one."""
    damaged = path.read_bytes()
    configuration = calibrations.write_vins(path.parent / "vins.yaml", whole.RIG)
    path.write_bytes(damaged)
    return _cameras(configuration)


def _camera(path: Path) -> Any:
    return read_one_camera(path, whole.SIZE)


def _annotations(path: Path) -> Any:
    return read_annotations(path, timeline=None, subjects=["anna"], targets=["mug", "book"])


def _drawn(path: Path) -> Any:
    drawn = read_drawn(path, frames=None, subjects=["anna"], targets=["mug", "book"])
    return [drawn.at(frame) for frame in range(12)]


def _signals(path: Path) -> Any:
    return read_table(path, "gaze", ("x", "y", "z"), range(9)).columns.group(("x", "y", "z"))


def _their_answers(path: Path) -> Any:
    frames = range(1, 4)
    return read_answers(path, frames, [frame * 40_000_000 for frame in frames], ("mug", "anna", "ben"), ("anna", "ben"))


def _video(path: Path) -> Any:
    video = Video(path)
    return [video.read(place) for place in video.frames[:9]]


def _labels(name: str) -> Read:
    return lambda path: FORMATS.load(name)().read(path, exchange())


def _shapes(name: str) -> Read:
    def places(path: Path) -> Any:
        read = FORMATS.load(name)().read(path, exchange())
        return [read.drawn.at(frame) for frame in range(12)]

    return places


def _coco_masks(path: Path) -> object:
    clip = PlainClip()
    masks = CocoInstances(CocoInstancesSettings(root=str(path.parent), annotations=path.name, partial=True), clip)
    return [masks.segment(clip.frame(number)).ids for number in (1, 2)]


def _ids(path: Path) -> object:
    return IdMaps(IdMapsSettings(root=str(path.parent), objects=path.name, partial=True), PlainClip())


_IMAGE = whole.array(picture(1, 20, 10))
_ONES, _PNG_16 = whole.array(np.ones((4, 5))), whole.array(np.full((4, 5), 700, np.uint16))
_IDENTITY = json.dumps({"stage": "bm", "clip": "mine", "settings": {"a": 1}, "code": "x", "versions": {"n": "2"}})
_OPENCV = (whole.opencv(), whole.opencv(rectified=True))

PARSERS: Sequence[Parser] = (
    Parser("manifest", "mine.toml", (whole.MANIFEST, whole.MEASURED, whole.RECORDED), load_manifest),
    Parser("experiment", "e.toml", whole.EXPERIMENTS, lambda path: load_experiment(str(path))),
    Parser("fitted settings", "fitted.toml", whole.FITTED, read_fitted),
    # Labels
    Parser("labels", "mine.csv", whole.LABELS, _annotations),
    Parser("drawn", "mine.drawn.csv", whole.DRAWN, _drawn),
    *(
        Parser(f"{name} labels", file_name, whole.exported(name), _labels(name))
        for name, file_name in (("csv", "theirs.csv"), ("elan", "theirs.eaf"))
    ),
    Parser("labels of a table", "theirs.csv", whole.LOOKS, _labels("table")),
    Parser("elan text", "theirs.txt", whole.ELAN_TEXT, _labels("elan")),
    Parser("TextGrid", "theirs.TextGrid", whole.TEXT_GRID, _labels("praat")),
    Parser("VIA", "theirs.csv", whole.VIA, _labels("via")),
    Parser("Pupil Cloud's areas", "aoi_fixations.csv", whole.AOI_FIXATIONS, states.pupil_cloud),
    Parser("Pupil Cloud's fixations", "fixations.csv", whole.FIXATIONS, states.pupil_cloud),
    Parser("Label Studio", "theirs.json", whole.LABEL_STUDIO, _labels("label_studio")),
    Parser("Datavyu", "theirs.csv", whole.DATAVYU, _labels("datavyu")),
    Parser("Datavyu spreadsheet", "theirs.opf", whole.datavyu_packed, _labels("datavyu")),
    Parser("CVAT", "theirs.xml", whole.CVAT, _shapes("cvat")),
    Parser("COCO's masks", "theirs.json", whole.COCO_MASKS, _coco_masks),
    Parser("COCO's boxes", "theirs.json", whole.COCO, _shapes("coco")),
    Parser("Observer log", "theirs.txt", whole.OBSERVER, _labels("observer")),
    Parser("BORIS project", "theirs.boris", whole.BORIS_PROJECT, _labels("boris")),
    Parser("BORIS export", "theirs.tsv", whole.BORIS_EXPORTS, _labels("boris")),
    Parser("BORIS project, packed", "theirs.boris.gz", whole.boris_packed, _labels("boris")),
    Parser("Idiap labels, arrays", "a_gt.npz", whole.idiap_arrays, states.idiap_labels),
    Parser("journal of labels", "journal.jsonl", states.write_journal, states.open_labels),
    # Runs and the cache
    # its scene may be one of which there are no tables
    Parser("answers", "mine.parquet", states.write_table, states.read_run, names_file=False),
    Parser("instances", "instances.parquet", states.write_table, states.read_run),
    Parser("run manifest", "manifest.json", states.write_run_manifest, states.open_run, names_file=False),
    Parser("thumbnails", "clip__one.jsonl", states.write_thumbnails, states.open_thumbnails),
    Parser("cache entry", "entry.bin", states.write_entry, states.load_entry, names_file=False),
    Parser("cache identity", "identity.json", _IDENTITY, states.use_identity, names_file=False),
    Parser(
        "rendered pair",
        "pair.bin",
        states.write_rendered,
        states.load_rendered,
        names_file=False,
    ),
    Parser("rendered geometry", "truth.bin", states.write_geometry, states.load_rendered_geometry, names_file=False),
    # Tables
    Parser("signal table", "gaze.csv", whole.SIGNALS, _signals),
    Parser("heads table", "heads.csv", whole.HEADS, lambda path: read_heads(path, PlainClip())),
    Parser("answers of another system", "answers.csv", whole.THEIR_ANSWERS, _their_answers),
    Parser("COCO panoptic", "panoptic.json", states.write_coco, states.read_coco),
    Parser("ids of masks", "ids.csv", "id,category,name\n7,person,\n9,robot,pepper\n70000,,\n", _ids),
    Parser(
        "measured people",
        "people.csv",
        (whole.measured, whole.measured_by_a_spreadsheet),
        states.open_tables,
        names_file=False,
    ),
    Parser(
        "measured objects",
        "objects.csv",
        (whole.measured, whole.measured_by_a_spreadsheet),
        states.open_tables,
        names_file=False,
    ),
    Parser("Idiap tracker", "tracker.csv", lambda path: idiap_file(path.parent, 4), states.open_idiap),
    Parser(
        "Motive take",
        "take.csv",
        lambda path: motive_file(path, states.bodies()),
        states.open_motion_capture("motive"),
    ),
    Parser(
        "Qualisys bodies",
        "take.tsv",
        lambda path: qualisys_file(path, states.bodies()),
        states.open_motion_capture("qualisys"),
    ),
    Parser(
        "Vicon objects",
        "take.csv",
        lambda path: vicon_file(path, states.bodies()),
        states.open_motion_capture("vicon"),
    ),
    Parser(
        "ROS poses",
        "take.bag",
        lambda path: ros_file(path, states.bodies()),
        states.open_motion_capture("ros_poses"),
    ),
    Parser("OpenFace table", "faces.csv", states.write_openface, states.open_openface),
    Parser("OpenFace heads", "faces.csv", states.write_openface, states.read_faces),
    Parser("gaze3d table", "gazes.csv", whole.GAZE3D, states.read_faces),
    Parser("list of stamps", "rgb.txt", whole.STAMPS, read_stamped_list),
    # Calibrations
    Parser("OpenCV calibration", "stereo.yml", _OPENCV, _cameras),
    Parser("OpenCV XML calibration", "stereo.xml", _OPENCV, _cameras),
    Parser("OpenCV JSON calibration", "stereo.json", _OPENCV, _cameras),
    Parser("calibration of yaml.dump", "stereo.yaml", whole.python_calibration, _cameras),
    Parser("NumPy calibration", "stereo.npz", whole.numpy_calibration, _cameras),
    Parser(
        "OpenCV intrinsics",
        "intrinsics.yml",
        whole.opencv("K1", "D1", "K2", "D2"),
        states.cameras_beside("extrinsics.yml", whole.opencv("R", "T")),
    ),
    Parser("ROS calibration", "left.yaml", whole.ros(0), states.cameras_beside("right.yaml", whole.ros(1))),
    Parser("ROS message", "left.yaml", whole.ros_echo(0), states.cameras_beside("right.yaml", whole.ros_echo(1))),
    Parser("EuRoC calibration", "cam0.yaml", whole.euroc(0), states.cameras_beside("cam1.yaml", whole.euroc(1))),
    Parser("Kalibr calibration", "camchain.yaml", lambda path: calibrations.write_kalibr(path, whole.RIG), _cameras),
    Parser("ORB-SLAM2 calibration", "mine.yaml", lambda path: calibrations.write_orb_slam_2(path, whole.RIG), _cameras),
    Parser("ORB-SLAM3 calibration", "mine.yaml", lambda path: calibrations.write_orb_slam_3(path, whole.RIG), _cameras),
    Parser("stella_vslam calibration", "mine.yaml", whole.STELLA, _cameras),
    Parser("VINS-Fusion calibration", "vins.yaml", lambda path: calibrations.write_vins(path, whole.RIG), _vins),
    Parser(
        "camera of camodocal",
        "lens0.yaml",
        lambda path: calibrations.write_camodocal(path.parent, whole.RIG)[0],
        _camodocal,
        names_file=False,  # with what is wrong of the pair, it names the configuration
    ),
    Parser("iCub calibration", "eyes.ini", lambda path: calibrations.write_icub(path, whole.RIG), _cameras),
    Parser("ROS's ost.txt", "ost.txt", lambda path: calibrations.write_ros_text(path, whole.RIG), _cameras),
    Parser("MATLAB calibration", "mine.json", lambda path: calibrations.write_matlab(path, whole.RIG), _cameras),
    Parser("file of MATLAB", "mine.mat", lambda path: calibrations.write_toolbox(path, whole.RIG), _cameras),
    Parser("Basalt calibration", "mine.json", lambda path: calibrations.write_basalt(path, whole.RIG), _cameras),
    Parser("OAK calibration", "oak.json", lambda path: calibrations.write_depthai(path, whole.RIG), _cameras),
    Parser("ZED calibration", "SN1.conf", lambda path: calibrations.write_zed(path, whole.RIG), _cameras),
    Parser("KITTI calibration", "calib.txt", whole.KITTI, _cameras),
    Parser("Middlebury calibration", "calib.txt", whole.MIDDLEBURY, _cameras),
    Parser(
        "matrix calibration",
        "K.txt",
        (whole.MATRIX, whole.FOUNDATION, whole.NAMED),
        lambda path: read_cameras([path], lambda: whole.SIZE, Options(baseline_m=0.1)),
    ),
    Parser("one camera, ROS", "camera.yaml", whole.ros(0), _camera),
    Parser("one camera, JSON", "camera.json", (whole.OPEN3D, whole.REALSENSE), _camera),
    Parser("one camera, numbers", "camera.txt", (whole.MATRIX, whole.NAMED), _camera),
    Parser("Sintel camera", "frame.cam", lambda path: path.write_bytes(sintel_camera(100.0)), read_camera),
    Parser("JSON that is no source", "layout.json", '[{"timestamp": {"sec": 1}, "frame": "left"}]', refuse_foreign),
    # Images and maps
    Parser("Sintel disparity", "frame.png", whole.array(sintel_disparity(np.full((4, 5), 7.0))), read_disparity),
    Parser("Sintel segments", "frame.png", whole.array(picture(3, 5, 4)), read_segments),
    Parser("map of ids, palette", "frame.png", whole.palette, read_ids),
    Parser("map of ids, numbers", "frame.npy", whole.array(np.full((4, 5), 7)), read_ids),
    Parser("KITTI disparity", "frame.png", _PNG_16, read_disparity),
    *(Parser(f"{each} disparity", f"frame.{each}", _ONES, read_disparity) for each in ("npy", "pfm")),
    *(
        Parser(f"{each} depth", f"frame.{each}", write, lambda path: read_depth_file(path, None))
        for each, write in (("npy", _ONES), ("npz", _ONES), ("exr", _ONES), ("pfm", _ONES), ("tif", _PNG_16))
    ),
    Parser("PNG image", "frame.png", _IMAGE, read_rgb),
    Parser("JPEG image", "frame.jpg", (_IMAGE, whole.turned_jpeg), read_rgb),
    Parser("TIFF image", "frame.tif", _IMAGE, read_raw),
    Parser("WebP image", "frame.webp", _IMAGE, read_rgb),
    Parser(
        "video",
        "both.mkv",
        lambda path: write_video(path, [moving_picture(k, *whole.SMALL) for k in range(1, 5)]),
        _video,
    ),
    # Recordings and messages
    Parser("MCAP, ros2", "take.mcap", whole.mcap("ros2"), states.read_recording),
    Parser("MCAP, protobuf", "take.mcap", whole.mcap("protobuf"), states.read_recording),
    Parser("MCAP of a depth camera", "take.mcap", whole.depth_bag("mcap"), states.read_recording),
    Parser("MCAP of a video", "take.mcap", whole.video_mcap, states.read_recording),
    Parser(
        "message: strips of the ZED", "message.bin", whole.zed_message, states.read_sdk_image(zed.ENCODING, zed.IMAGES)
    ),
    Parser(
        "message: image of Orbbec's SDK",
        "message.bin",
        (whole.orbbec_image("content"), whole.orbbec_image("metadata first")),
        states.read_sdk_image(orbbec.ENCODING, orbbec.IMAGE),
    ),
    Parser("message: calibration of Orbbec's SDK", "message.bin", whole.orbbec_profile, states.read_orbbec_profile),
    Parser("ROS 1 bag", "take.bag", tuple(map(whole.depth_bag, ("bag", "bag bz2", "bag lz4"))), states.read_recording),
    Parser("ROS 2 bag", "take.db3", whole.depth_bag("db3"), states.read_recording),
    Parser("ROS 2 bag's metadata", "metadata.yaml", states.write_metadata, states.read_with_metadata),
    *(
        Parser(f"message: {name}", "message.bin", write, states.read_message(kind))
        for name, kind, write in (
            ("depth in PNG", "CompressedImage", whole.compressed("png")),
            ("depth in RVL", "CompressedImage", whole.compressed("rvl")),
            ("inverse depth in PNG", "CompressedImage", whole.compressed("32FC1 png")),
            ("raw depth", "Image", whole.ros_message("Image", height=24, width=32, **whole.RAW_DEPTH)),
            ("camera info", "CameraInfo", whole.ros_message("CameraInfo", height=24, width=32, **whole.CAMERA_INFO)),
        )
    ),
)
"""All parsers, each under its own name."""
