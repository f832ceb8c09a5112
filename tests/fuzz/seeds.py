"""Whole files to begin with: each function writes one at a path, by the project's own writers or the tests'."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pandas as pd
from openpyxl import Workbook

from harness.labels.formats import FORMATS
from harness.labels.labels import Labels
from harness.run.results import to_line
from tests import calibrations, depth_recordings
from tests.disk import moving_picture, picture, sintel_camera, sintel_disparity, write_bytes, write_image, write_text
from tests.disk import write_video as write_film
from tests.exchanges import exchange, row, staged
from tests.measured import idiap_file, measured_tables
from tests.recordings import Family, rectified_camera, write_pairs
from tests.records import answers

RIG, SIZE = calibrations.RIG, calibrations.SIZE
SMALL = (32, 24)
"""Width and height of images in recordings."""

MANIFEST = """\
name = "mine"
adapter = "stereo_folder"
root = "../images"
licence = "CC0"

[source]
left = "left"
right = "right"
calibration = "stereo.yml"
rectified = true
rate_hz = 25.0

[subjects.anna]
category = "person"
at_px = [10, 20]

[targets.mug]
category = "cup"
instance = 2

[targets.book]
category = "book"
"""
MEASURED = """\
name = "mine"
adapter = "measured"
root = "../talk"
[source]
people_file = "people.csv"
objects = { robot = { center_m = [0, 0, 0], size_m = [0.3, 0.3, 0.3] } }
[subjects.anna]
category = "person"
[targets.robot]
category = "robot"
"""
RECORDED = """\
name = "mine"
adapter = "rosbag"
root = "../take.bag"
[source]
stamps = "log"
tolerance_ms = 3.5
camera = { fx_px = 50.0, cx_px = 31.5, cy_px = 23.5, baseline_m = 0.1 }
[subjects.anna]
category = "person"
"""
EXPERIMENT = """\
clips = ["studio_table"]
preset = "realtime"

[[configuration]]
name = "one"
stereo = { matcher = "sgbm", min_depth_m = 0.5 }
segmentation = { model = "coco_panoptic", root = "masks", stuff = ["sky"] }
heads = { detector = "person_mask" }
head_pose.model = "none"
gaze = { model = "simulated", error_deg = 5.0 }
attention = { method = "bayes", smoothing = "forward" }

[[configuration]]
name = "two"
stereo.matcher = "bm"
segmentation.model = "truth"
heads.detector = "truth"
head_pose.model = "truth"
gaze.model = "truth"
attention.cones_cm = [10, 25]
"""
FITTED = """\
[fit]
experiment = "mine"
clips = ["talk", "table"]

[[fit.value]]
name = "gaze.sigma_deg"
value = 7.5
n = 120
low = 6.0
high = 9.0

[[fit.held_out]]
clip = "talk"
n = 60
right_before = 0.5
right_after = 0.75
calibration_error_before = 0.2
calibration_error_after = 0.1

[attention]
method = "bayes"
"""
LABELS = (
    "# vfoa annotations 1\nfirst_frame,last_frame,subject,target,note\n"
    '1,3,anna,mug,\n4,4,anna,book,"a, b"\n5,9,anna,none,\n'
)


DRAWN = (
    "# vfoa drawn 1\nframe,name,kind,u0_px,v0_px,u1_px,v1_px,outside\n"
    "1,mug,box,1,2,30.5,40,\n9,mug,box,4,2,33,40,1\n2,book,point,7,8,,,\n1,anna,head,5,6,25,36,\n"
)
CVAT_TRACKS = (
    '<annotations><version>1.1</version><track id="0" label="bird">'
    '<box frame="0" keyframe="1" outside="0" xtl="1" ytl="2" xbr="9" ybr="8"/>'
    '<box frame="5" keyframe="0" outside="1" xtl="3" ytl="2" xbr="11" ybr="8"/></track>'
    '<track id="1" label="cup"><points frame="2" keyframe="1" outside="0" points="7.5,8.5"/></track></annotations>'
)


def drawn(path: Path) -> None:
    write_text(path, DRAWN)


def cvat_tracks(path: Path) -> None:
    write_text(path, CVAT_TRACKS)


def manifest(path: Path) -> None:
    write_text(path, MANIFEST)


def measured_manifest(path: Path) -> None:
    write_text(path, MEASURED)


def recorded(path: Path) -> None:
    write_text(path, RECORDED)


def experiment(path: Path) -> None:
    write_text(path, EXPERIMENT)


def fitted(path: Path) -> None:
    write_text(path, FITTED)


def labels(path: Path) -> None:
    write_text(path, LABELS)


def results(path: Path) -> None:
    write_text(path, "".join(map(to_line, answers(["mug", "none", None, "book"]))))


# Labels of other programs

_ROWS = Labels([row(1, 3, "bird"), row(4, 9, "none"), row(10, 12, "bird", note="a"), row(2, 8, "cup", "boy")])


def exported(name: str) -> Callable[[Path], Any]:
    def write(path: Path) -> None:
        clip, bodies = staged()
        FORMATS.load(name)().write(path, _ROWS, exchange(clip, bodies=bodies))

    return write


def boris_project(path: Path) -> None:
    looks = [[0.08, "girl", "bird", "", "eyes shut", 2], [0.0, "girl", "bird", "", "", 0]]
    events = [*looks, [0.1, "boy", "nod", "", "", 3]]
    behaviours = {"0": {"code": "bird", "type": "State event"}, "1": {"code": "nod", "type": "Point event"}}
    media = {"offset": {"1": 0.0}, "fps": {"a.mp4": 25.0}}
    observations = {"talk": {"type": "MEDIA", "events": events, "media_info": media}}
    content = {"project_format_version": "7.0", "behaviors_conf": behaviours, "observations": observations}
    write_text(path, json.dumps(content))


def boris_packed(path: Path) -> None:
    boris_project(path)
    path.write_bytes(gzip.compress(path.read_bytes(), mtime=0))


def boris_workbook(path: Path) -> None:
    book = Workbook()
    book.active.append(["Time", "Subject", "Behavior", "Behavior type", "Comment"])
    for time, kind in ((0.04, "START"), (0.2, "STOP")):
        book.active.append([time, "girl", "bird", kind, None])
    book.save(path)


def attention_target(path: Path) -> None:
    write_text(path, "00000001.jpg,30,2,40,12,5,5\n00000002.jpg,30,2,40,12,-1,-1\n00000003.jpg,30,2,40,12,-1,7.5\n")


def idiap_arrays(path: Path) -> None:
    np.savez(path, **{"Person 1": [0, 0, 1, 1, 2, 2], "Person 2": [1] * 6})


def idiap_table(path: Path) -> None:
    text = idiap_file(path.parent).read_text()
    stamps = list(dict.fromkeys(line.split(",")[0] for line in text.splitlines()))
    lines = (f"{stamp},1,robot\n{stamp},2,unfocused\n" for stamp in stamps)
    write_text(path, "time_ns,person,looks_at\n" + "".join(lines))


# Tables


def signals(path: Path) -> None:
    write_text(path, "frame,subject,x,y,z\n1,anna,0,0,1\n2,anna,0.5,-0.5,1e0\n2,ben,,,\n")


def heads(path: Path) -> None:
    header = "frame,subject,u0_px,v0_px,u1_px,v1_px,score,instance_id\n"
    write_text(path, f"{header}1,anna,1,2,30.5,40,0.5,1\n2,anna,1,2,3,4,,\n")


def people(path: Path) -> None:
    path.write_bytes((measured_tables(path.parent, range(1, 5)) / "people.csv").read_bytes())


def objects(path: Path) -> None:
    measured_tables(path.parent, range(1, 5))


def people_parquet(path: Path) -> None:
    people(path.with_suffix(".csv"))
    pd.read_csv(path.with_suffix(".csv")).to_parquet(path, compression=None)


def idiap_tracker(path: Path) -> None:
    idiap_file(path.parent, 4)


def stamps(path: Path) -> None:
    write_text(path, "# timestamp filename\n1305031102.175304 rgb/1.png\n1305031102.211214 rgb/2.png\n")


# Calibrations


def opencv(path: Path) -> None:
    calibrations.write_opencv(path, calibrations.opencv_nodes(RIG), SIZE)


def opencv_rectified(path: Path) -> None:
    calibrations.write_opencv(path, calibrations.opencv_nodes(RIG) | calibrations.rectification(RIG), SIZE)


def opencv_inner(path: Path) -> None:
    nodes = calibrations.opencv_nodes(RIG)
    calibrations.write_opencv(path, {name: nodes[name] for name in ("K1", "D1", "K2", "D2")}, SIZE)


def ros(path: Path) -> None:
    path.write_bytes(calibrations.write_ros(path.parent / "ros", RIG)[0].read_bytes())


def euroc(path: Path) -> None:
    _euroc(path, 0)


def _euroc(path: Path, camera: int) -> None:
    pose = np.eye(4)
    pose[0, 3] = 0.12 * camera
    document = {
        "sensor_type": "camera",
        "T_BS": {"cols": 4, "rows": 4, "data": pose.ravel().tolist()},
        "camera_model": "pinhole",
        "intrinsics": RIG.k[camera][[0, 1, 0, 1], [0, 1, 2, 2]].tolist(),
        "distortion_model": "radial-tangential",
        "distortion_coefficients": RIG.d[camera].tolist(),
        "resolution": list(SIZE),
        "rate_hz": 20,
    }
    calibrations.write_yaml(path, document)


def other_calibration(path: Path) -> None:
    """The whole file beside a damaged one, by its name."""
    nodes = calibrations.opencv_nodes(RIG)
    if path.name == "extrinsics.yml":
        calibrations.write_opencv(path, {name: nodes[name] for name in ("R", "T")})
    elif path.name == "right.yaml":
        path.write_bytes(calibrations.write_ros(path.parent / "ros", RIG)[1].read_bytes())
    else:
        _euroc(path, 1)


def kalibr(path: Path) -> None:
    calibrations.write_kalibr(path, RIG)


def zed(path: Path) -> None:
    calibrations.write_zed(path, RIG)


def kitti(path: Path) -> None:
    write_text(path, "P2: 700 0 600 0 0 700 180 0 0 0 1 0\nP3: 700 0 600 -370 0 700 180 0 0 0 1 0\n")


def middlebury(path: Path) -> None:
    first, second = (f"[3997.684 0 {cx}; 0 3997.684 1011.728; 0 0 1]" for cx in (1176.728, 1307.839))
    write_text(path, f"cam0={first}\ncam1={second}\ndoffs=131.111\nbaseline=193.001\nwidth=1280\nheight=720\n")


def matrix(path: Path) -> None:
    write_text(path, "600 0 320\n0 610 240\n0 0 1\n")


def foundation(path: Path) -> None:
    write_text(path, "754.6 0.0 489.3 0.0 754.6 265.2 0.0 0.0 1.0\n0.063\n")


def four_numbers(path: Path) -> None:
    write_text(path, "# fx fy cx cy\n600, 610, 320, 240\n")


def open3d(path: Path) -> None:
    k = [600.0, 0, 0, 0, 610, 0, 320, 240, 1]
    write_text(path, json.dumps({"width": SIZE[0], "height": SIZE[1], "intrinsic_matrix": k}))


def realsense(path: Path) -> None:
    write_text(path, json.dumps({"width": SIZE[0], "height": SIZE[1], "fx": 600, "fy": 610, "ppx": 320, "ppy": 240}))


def npy_camera(path: Path) -> None:
    np.save(path, np.array([600.0, 610, 320, 240]))


# Images and maps


def sintel_cam(path: Path) -> None:
    write_bytes(path, sintel_camera(100.0))


def dpt(path: Path) -> None:
    header = np.array([202021.25], "<f4").tobytes() + np.array([5, 4], "<i4").tobytes()
    write_bytes(path, header + np.ones(20, "<f4").tobytes())


def sintel_png(path: Path) -> None:
    write_image(path, sintel_disparity(np.full((4, 5), 7.0)))


def segments_png(path: Path) -> None:
    write_image(path, picture(3, 5, 4))


def png_16(path: Path) -> None:
    write_image(path, np.full((4, 5), 700, np.uint16))


def npy(path: Path) -> None:
    np.save(path, np.ones((4, 5), np.float32))


def pfm(path: Path) -> None:
    write_bytes(path, b"Pf\n5 4\n-1.0\n" + np.ones(20, "<f4").tobytes())


def exr(path: Path) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"Z": np.ones((4, 5), np.float32)}) as file:
        file.write(str(path))


def image(path: Path) -> None:
    write_image(path, picture(1, 20, 10))


def turned_jpeg(path: Path) -> None:
    """With an orientation in EXIF, as phones write it."""
    image(path)
    exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    data = path.read_bytes()
    path.write_bytes(data[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + data[2:])


def video(path: Path) -> None:
    write_film(path, [moving_picture(k, *SMALL) for k in range(1, 5)])


# Recordings


def mcap(family: Family) -> Callable[[Path], Any]:
    def write(path: Path) -> None:
        left, right = (rectified_camera(*SMALL, 50.0, 15.5, 11.5, baseline) for baseline in (0.0, 0.1))
        pairs = [(k * 40_000_000, picture(k, *SMALL), picture(99 + k, *SMALL), left, right) for k in (1, 2)]
        write_pairs(path, pairs, family, chunk_size=9_000)

    return write


def shot(number: int) -> depth_recordings.Shot:
    lens = depth_recordings.Lens(width=SMALL[0], height=SMALL[1], fx=50.0, cx=15.5, cy=11.5)
    depth = np.full(SMALL[::-1], 900 + number, np.uint16)
    depth[:, :3] = 0
    return depth_recordings.Shot(
        stamp_ns=1_700_000_000_000_000_007 + number * 40_000_000,
        colour=moving_picture(number, *SMALL),
        depth_mm=depth,
        lens=lens,
    )


def depth_bag(kind: depth_recordings.Format) -> Callable[[Path], Any]:
    """One file of a recording of colour and depth, moved to where it is wanted."""

    def write(path: Path) -> None:
        made = depth_recordings.write_take(_folder(path.parent / "made"), kind, map(shot, (1, 2)), "rvl")
        file = made if made.is_file() else next(each for each in made.iterdir() if each.suffix == path.suffix)
        path.write_bytes(file.read_bytes())

    return write


def _folder(path: Path) -> Path:
    path.mkdir(parents=True, exist_ok=True)
    return path


def video_mcap(path: Path) -> None:
    shots = [shot(number) for number in range(3)]
    coder, options = depth_recordings.CODERS["h264"]
    packets = depth_recordings.Encoder(coder, *SMALL, options).packets([each.colour for each in shots])
    depth_recordings.write_video_take(path, "h264", packets, shots)
