"""Whole files to begin with: texts, and functions that write one at a path by the project's writers or the tests'."""

from __future__ import annotations

import gzip
import json
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import PIL.Image
import yaml
from rosbags.typesys import Stores, get_typestore

from harness.labels.formats import FORMATS
from harness.labels.labels import Labels
from harness.run.fitted import FittedWeights, MethodScore, fitted_text
from tests import calibrations, depth_recordings, orbbec, zed
from tests.disk import labels_text, moving_picture, picture, write_bytes, write_image
from tests.exchanges import cvat_box, cvat_document, cvat_track, exchange, row
from tests.harness.damage import project
from tests.measured import measured_tables
from tests.recordings import Family, rectified_camera, write_pairs
from tests.records import fit_record
from tests.repository import REPOSITORY
from vfoa.logit import LogitSettings

Write = Callable[[Path], Any]

MANIFEST = (
    project.MANIFEST.replace('"../images"\n', '"../images"\nlicence = "CC0"\n')
    .replace('"person"\n', '"person"\nat_px = [10, 20]\n')
    .replace('"cup"\n', '"cup"\ninstance = 2\n')
)
MEASURED = """name = "mine"
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
RECORDED = """name = "mine"
adapter = "rosbag"
root = "../take.bag"
[source]
stamps = "log"
tolerance_ms = 3.5
camera = { fx_px = 50.0, cx_px = 31.5, cy_px = 23.5, baseline_m = 0.1 }
[subjects.anna]
category = "person"
"""
EXPERIMENTS = tuple(
    (REPOSITORY / "harness" / "experiments" / f"{name}.toml").read_text() for name in ("demo", "bandage_2", "filter")
)
_SCORE = MethodScore(method="fitted, forward", n=9, log_loss=0.5, calibration_error=0.1, balanced_frr=0.6, frr=0.7)
FITTED = fitted_text(
    FittedWeights(fit=fit_record(held_out=(_SCORE,), curve=(_SCORE,)), attention=LogitSettings(method="logit"))
)
LABELS = labels_text("1,3,anna,mug,", '4,4,anna,book,"a, b"', "5,9,anna,none,")
DRAWN = (
    "# vfoa drawn 1\nframe,name,kind,u0_px,v0_px,u1_px,v1_px,outside\n"
    "1,mug,box,1,2,30.5,40,\n9,mug,box,4,2,33,40,1\n2,book,point,7,8,,,\n1,anna,head,5,6,25,36,\n"
)
LOOKS = (
    "start;end;person;object;note\n0,04;1,2;girl;bird;far\n0:00:01.2;0:00:01.9;girl;none;\n",
    "frame,subject,target\n1,girl,bird\n2,girl,bird\n1,boy,girl\n",
    "time_ns,subject,target\n40000000,girl,bird\n81000000,girl,none\n",
    "start_ns,end_ns,subject,target\n40000000,81000000,girl,bird\n",
    "image,girl\nleft/0a1b2c3d-frame_000001.png,bird\nleft/1a1b2c3d-frame_000002.png,none\n",
    "image,person,label\n1718000000.100000.png,girl,bird\n1718000001.100000.png,girl,bird\n",
)
AOI_FIXATIONS = (
    "aoi id,aoi name,section id,recording id,fixation id,fixation duration [ms]\n"
    "a,bird,s,girl,1,100\nb,cup,s,girl,3,9\n"
)
FIXATIONS = (
    "section id,recording id,fixation id,start timestamp [ns],end timestamp [ns],duration [ms],"
    "fixation detected in reference image\n"
    "s,girl,1,40000000,140000000,100,True\ns,girl,2,140000000,200000000,60,False\n"
    "s,girl,3,200000000,300000000,100,True\n"
)
ELAN_TEXT = (
    "girl\t\t00:00:00.030\t0.03\t00:00:00.130\t0.13\t00:00:00.100\t0.1\tbird\n",
    "Begin Time - msec\tEnd Time - msec\tDuration - msec\tgirl\tboy\n30\t130\t100\tbird\t\n0\t40\t40\t\tgirl\n",
)
TEXT_GRID = (
    'File type = "ooTextFile"\nObject class = "TextGrid"\nxmin = 0\nxmax = 2\ntiers? <exists>\nsize = 1\n'
    'class = "IntervalTier"\nname = "girl"\nxmin = 0\nxmax = 2\nintervals: size = 1\n'
    'intervals [1]:\nxmin = 0.1\nxmax = 0.9\ntext = "bird"\n'
)
VIA = (
    '{"attribute": {"1": {"aname": "girl", "type": 4, "options": {"0": "bird"}}}, '
    '"file": {"1": {"fid": "1", "fname": "talk.mp4"}}, "view": {"1": {"fid_list": ["1"]}}, '
    '"metadata": {"1_a": {"vid": "1", "flg": 0, "z": [0.1, 0.9], "xy": [], "av": {"1": "0"}}}}',
    '# ATTRIBUTE = {"1": {"aname": "girl", "type": 1, "options": {}}}\n'
    "# CSV_HEADER = metadata_id,file_list,flags,temporal_coordinates,spatial_coordinates,metadata\n"
    '"1_a","[""talk.mp4""]",0,"[0.1,0.9]","[]","{""1"":""bird""}"\n',
    "# CSV_HEADER = metadata_id,file_list,temporal_segment_start,temporal_segment_end,metadata\n"
    '"1_a","[""talk.mp4""]",0.1,0.9,"{""girl"":""bird""}"\n',
)
DATAVYU = (
    "#4\ngirl (MATRIX,true,)-target|NOMINAL,how|NOMINAL\n00:00:00:100,00:00:00:900,(bird,well\\, so)\n",
    "girl.ordinal,girl.onset,girl.offset,girl.target,girl.how,\n1,100,900,bird,so,\n",
    "file,column,onset,offset,ordinal,code01\na,girl,100,900,1,bird\n",
)
LABEL_STUDIO = (
    '[{"data": {"video": "/data/upload/1/3d3ad63e-talk.mp4"}, "annotations": [{"id": 7, "was_cancelled": false, '
    '"result": [{"type": "labels", "from_name": "girl", '
    '"value": {"start": 0.1, "end": 0.9, "channel": 0, "labels": ["bird"]}}]}]}]'
)
OBSERVER = (
    "Time_Relative_sf,Observation,Subject,Behavior,Modifier_1,Event_Type,Comment\n"
    "0.1,talk,girl,bird,,State start,so\n0.4,talk,girl,nods,,Point,\n0.9,talk,girl,bird,,State stop,\n"
)
CVAT = (
    cvat_document(
        cvat_track(
            "bird", cvat_box(0, (4, 4, 20, 20)), cvat_box(9, (8, 4, 24, 20)), cvat_box(10, (8, 4, 24, 20), outside=True)
        ),
        cvat_track("girl_head", cvat_box(0, (30, 4, 40, 14), looks_at="bird"), '<points frame="1" points="3,4;5,6"/>'),
    ),
    cvat_document(
        '<image id="0" name="a/1.jpg" width="64" height="48"><polygon label="cup" points="1,2;9,3;4,12.5"/></image>',
        '<image id="1" name="a/2.jpg" width="64" height="48"><ellipse label="cup" cx="9" cy="8" rx="3" ry="2"/>'
        "</image>",
    ),
    cvat_document(
        '<image id="0" name="a/1.jpg" width="64" height="48"><tag label="girl:bird"/></image>',
        '<image id="1" name="a/2.jpg" width="64" height="48"><tag label="girl"><attribute name="looks_at">bird'
        "</attribute></tag></image>",
    ),
)
COCO = (
    '{"images": [{"id": 1, "file_name": "a/1.jpg", "width": 64, "height": 48}, {"id": 2, "file_name": "a/2.jpg"}], '
    '"categories": [{"id": 1, "name": "bird"}, {"id": 2, "name": "girl"}], "annotations": ['
    '{"id": 1, "image_id": 1, "category_id": 1, "bbox": [4, 4, 16, 16], '
    '"attributes": {"track_id": 0, "keyframe": false}}, '
    '{"id": 2, "image_id": 2, "category_id": 2, "bbox": [9, 4, 5.5, 16], "attributes": {"looks_at": "bird"}}]}',
    '{"images": [{"id": 1, "file_name": "frame_000000.png"}, {"id": 2, "file_name": "frame_000001.png"}], '
    '"categories": [{"id": 1, "name": "bird"}], '
    '"annotations": [{"image_id": 2, "category_id": 1, "bbox": [4, 4, 16, 16], "track_id": 3}]}',
    '[{"image_id": 1, "category_id": 16, "bbox": [4, 4, 16, 16], "score": 0.9}]',
)
COCO_MASKS = (
    '{"images": [{"id": 1, "file_name": "a/1.jpg"}, {"id": 2, "file_name": "a/2.jpg"}], '
    '"categories": [{"id": 1, "name": "person"}], "annotations": ['
    '{"image_id": 1, "category_id": 1, "track_id": 3, "segmentation": [[4, 4, 20.5, 4, 9, 30, 4, 20]]}, '
    '{"image_id": 2, "category_id": 1, "track_id": 0, "segmentation": {"size": [48, 64], "counts": [3000, 40, 32]}}]}',
    '[{"image_id": 1, "category_id": 1, "score": 0.7, '
    '"segmentation": {"size": [48, 64], "counts": "Un04\\\\100000000000000000kb1"}}, '
    '{"image_id": 2, "category_id": 47, "score": 0.9, "segmentation": [[4, 4, 20.5, 4, 9, 30]]}]',
)

BORIS_PROJECT = (
    '{"project_format_version": "7.0", "behaviors_conf": {"0": {"code": "bird", "type": "State event"}, '
    '"1": {"code": "nod", "type": "Point event"}}, "observations": {"talk": {"media_info": {"offset": {"1": 0.5}}, '
    '"events": [[0.5, "girl", "bird", "", "shut", 2], [0.6, "girl", "nod", "", ""], [0.9, "girl", "bird", "", ""]]}}}'
)
BORIS_EXPORTS = (
    "Observation id\tTime offset (s)\tSubject\tBehavior\tModifier #1\tBehavior type\tStart (s)\tStop (s)\t"
    "Comment start\n"
    "talk\t0.5\tgirl\tbird\t\tSTATE\t0.500\t0.900\tshut\ntalk\t0.5\tgirl\tnod\t\tPOINT\t0.600\t0.600\t\n",
    "Time offset (s),0.5,,,\n,,,,\nTime,Subject,Behavior,Comment,Status\n"
    "0.5,girl,bird,shut,START\n0.9,girl,bird,,STOP\n",
)
SIGNALS = "frame,subject,x,y,z\n1,anna,0,0,1\n2,anna,0.5,-0.5,1e0\n2,ben,,,\n"
HEADS = "frame,subject,u0_px,v0_px,u1_px,v1_px,score,instance_id\n1,anna,1,2,30.5,40,0.5,1\n2,anna,1,2,3,4,,\n"
THEIR_ANSWERS = (
    "frame,subject,target,instance_id\n1,anna,mug,3\n1,ben,none,\n2,anna,,\n3,ben,anna,\n",
    "time_s,subject,target,p_mug,p_ben,p_none\n0,anna,mug,0.7,0.2,0.1\n0.04,anna,,0.1,0.9,\n0.08,anna,none,,,1\n",
    "frame,subject,u_px,v_px,in_image\n1,anna,300.5,200,1\n2,anna,,,0\n3,ben,20,30,\n",
)
GAZE3D = (
    "xmin,ymin,xmax,ymax,pid,frame_id,gaze_x,gaze_y,gaze_z\n"
    "10.5,4.0,20.0,18.0,1.0,1.0,0.6,0.0,-0.8\n10.5,4.0,20.0,18.0,1.0,2.0,0.0,0.0,-1.0\n"
)
STAMPS = "# timestamp filename\n1305031102.175304 rgb/1.png\n1305031102.211214 rgb/2.png\n"
KITTI = "P2: 700 0 600 0 0 700 180 0 0 0 1 0\nP3: 700 0 600 -370 0 700 180 0 0 0 1 0\n"
MIDDLEBURY = (
    "cam0=[3997.684 0 1176.728; 0 3997.684 1011.728; 0 0 1]\ncam1=[3997.684 0 1307.839; 0 3997.684 1011.728; 0 0 1]\n"
    "doffs=131.111\nbaseline=193.001\nwidth=1280\nheight=720\n"
)
MATRIX = "600 0 320\n0 610 240\n0 0 1\n"
FOUNDATION = "754.6 0.0 489.3 0.0 754.6 265.2 0.0 0.0 1.0\n0.063\n"
NAMED = "fx: 600.5\nfy: 601\ncx: 319.5\ncy = 239.5\nbaseline_mm: 120\n"
RIG, SIZE = calibrations.RIG, calibrations.SIZE
REALSENSE = json.dumps(
    {
        "width": SIZE[0],
        "height": SIZE[1],
        "fx": 600.0,
        "fy": 610.0,
        "ppx": 320.0,
        "ppy": 240.0,
        "model": "distortion.brown_conrady",
        "coeffs": [0.1, -0.2, 0.0, 0.0, 0.0],
    }
)
OPEN3D = json.dumps({"width": SIZE[0], "height": SIZE[1], "intrinsic_matrix": [600, 0, 0, 0, 610, 0, 320, 240, 1]})


# Labels and tables

_ROWS = Labels([row(1, 3, "bird"), row(4, 9, "none"), row(10, 12, "bird", note="a"), row(2, 8, "cup", "boy")])


def exported(name: str) -> Write:
    def write(path: Path) -> None:
        FORMATS.load(name)().write(path, _ROWS, exchange())

    return write


def datavyu_packed(path: Path) -> None:
    """A spreadsheet that is not compressed, so that damage reaches what is in it."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(zipfile.ZipInfo("db"), DATAVYU[0])
        archive.writestr(
            zipfile.ZipInfo("project"), "!project\nviewerSettings:\n- !vs\n  feed: a.mp4\n  offset: '40'\n"
        )


def boris_packed(path: Path) -> None:
    path.write_bytes(gzip.compress(BORIS_PROJECT.encode(), mtime=0))


def idiap_arrays(path: Path) -> None:
    np.savez(path, **{"Person 1": [0, 0, 1, 1, 2, 2], "Person 2": [1] * 6})


def measured(path: Path) -> None:
    """The table of the path's name."""
    measured_tables(path.parent, range(1, 5))


def measured_by_a_spreadsheet(path: Path) -> None:
    """The same in UTF-16, with semicolons and decimal commas."""
    measured(path)
    text = path.read_text().replace(",", ";").replace(".", ",")
    path.write_text(f"sep=;\n{text}", encoding="utf-16")


# Calibrations

_NODES = calibrations.opencv_nodes(RIG)


def opencv(*names: str, rectified: bool = False) -> Write:
    nodes = _NODES | (calibrations.rectification(RIG) if rectified else {})
    return lambda path: calibrations.write_opencv(path, {name: nodes[name] for name in names or nodes}, SIZE)


def numpy_calibration(path: Path) -> None:
    np.savez(path, image_size=SIZE, **_NODES)  # type: ignore[arg-type]


def python_calibration(path: Path) -> None:
    path.write_text(yaml.dump({**_NODES, "image_size": SIZE, "rms": np.float64(0.3)}), encoding="utf-8")


STELLA = """Camera:
  setup: "stereo"
  fx: 435.2
  fy: 435.2
  cx: 367.4
  cy: 252.2
  cols: 752
  rows: 480
  focal_x_baseline: 47.9
StereoRectifier:
  model: "perspective"
  K_left: [458.6, 0.0, 367.2, 0.0, 457.2, 248.3, 0.0, 0.0, 1.0]
  D_left: [-0.28, 0.07, 0.0001, 0.00001, 0.0]
  R_left: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
  K_right: [457.5, 0.0, 379.9, 0.0, 456.1, 255.2, 0.0, 0.0, 1.0]
  D_right: [-0.28, 0.07, -0.0001, -0.00003, 0.0]
  R_right: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
"""


def ros(side: int) -> Write:
    return lambda path: path.write_bytes(calibrations.write_ros(path.parent / "ros", RIG)[side].read_bytes())


def ros_echo(side: int) -> Write:
    return lambda path: path.write_bytes(
        calibrations.write_ros_echo(path.parent / "ros", RIG, is_ros_2=True)[side].read_bytes()
    )


def euroc(side: int) -> Write:
    pose = np.eye(4)
    pose[0, 3] = 0.12 * side
    document = {
        "sensor_type": "camera",
        "T_BS": {"cols": 4, "rows": 4, "data": pose.ravel().tolist()},
        "camera_model": "pinhole",
        "intrinsics": RIG.k[side][[0, 1, 0, 1], [0, 1, 2, 2]].tolist(),
        "distortion_model": "radial-tangential",
        "distortion_coefficients": RIG.d[side].tolist(),
        "resolution": list(SIZE),
        "rate_hz": 20,
    }
    return lambda path: calibrations.write_yaml(path, document)


# Images and maps


def palette(path: Path) -> None:
    """A picture whose pixels are the numbers of a palette's colours."""
    image = PIL.Image.fromarray(np.full((4, 5), 7, np.uint8))
    image.putpalette([*range(256)] * 3)
    image.save(path)


def array(values: np.ndarray) -> Write:
    """An array as npy, npz, PFM, EXR, Middlebury's DPT or an image."""

    def write(path: Path) -> None:
        if path.suffix == ".npy":
            np.save(path, values)
        elif path.suffix == ".npz":
            np.savez_compressed(path, depth=values)
        elif path.suffix == ".pfm":
            write_bytes(path, b"Pf\n5 4\n-1.0\n" + values.astype("<f4").tobytes())
        elif path.suffix == ".dpt":
            write_bytes(path, struct.pack("<fii", 202021.25, 5, 4) + values.astype("<f4").tobytes())
        elif path.suffix == ".exr":
            header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
            with OpenEXR.File(header, {"Z": values.astype(np.float32)}) as file:
                file.write(str(path))
        else:
            write_image(path, values)

    return write


def turned_jpeg(path: Path) -> None:
    """With an orientation in EXIF, as phones write it."""
    write_image(path, picture(1, 20, 10))
    exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    data = path.read_bytes()
    path.write_bytes(data[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + data[2:])


# Recordings and messages

SMALL = (32, 24)
"""Width and height of images in recordings."""
LENS = depth_recordings.Lens(width=SMALL[0], height=SMALL[1], fx=50.0, cx=15.5, cy=11.5)
DEPTH_MM = np.pad(np.full((SMALL[1], SMALL[0] - 3), 901, np.uint16), ((0, 0), (3, 0)))
_SHOTS = [
    depth_recordings.Shot(
        stamp_ns=1_700_000_000_000_000_007 + number * 40_000_000,
        colour=moving_picture(number, *SMALL),
        depth_mm=DEPTH_MM,
        lens=LENS,
    )
    for number in range(3)
]


def mcap(family: Family) -> Write:
    left, right = (rectified_camera(*SMALL, 50.0, 15.5, 11.5, baseline) for baseline in (0.0, 0.1))
    pairs = [(k * 40_000_000, picture(k, *SMALL), picture(99 + k, *SMALL), left, right) for k in (1, 2)]
    return lambda path: write_pairs(path, pairs, family, chunk_size=9_000)


def depth_bag(kind: depth_recordings.Format) -> Write:
    """One file of a recording of colour and depth, moved to its place."""

    def write(path: Path) -> None:
        (folder := path.parent / "made").mkdir(parents=True, exist_ok=True)
        made = depth_recordings.write_take(folder, kind, _SHOTS[1:], "png")
        file = made if made.is_file() else next(each for each in made.iterdir() if each.suffix == path.suffix)
        path.write_bytes(file.read_bytes())

    return write


def video_mcap(path: Path) -> None:
    coder, options = depth_recordings.CODERS["h264"]
    packets = depth_recordings.Encoder(coder, *SMALL, options).packets([each.colour for each in _SHOTS])
    depth_recordings.write_video_take(path, "h264", packets, _SHOTS)


def zed_message(path: Path) -> None:
    path.write_bytes(zed.message(zed.strips(moving_picture(1, *SMALL))))


def orbbec_image(layout: orbbec.Layout) -> Write:
    pixels = moving_picture(1, *SMALL)
    return lambda path: path.write_bytes(orbbec.image(layout, SMALL, "rgb8", 3 * SMALL[0], pixels.tobytes()))


def orbbec_profile(path: Path) -> None:
    turn = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    path.write_bytes(orbbec.Profile(size_px=SMALL, fx=30.0, cx=15.5, cy=11.5, rotation=turn).message())


def ros_message(kind: str, **fields: Any) -> Write:
    """A message of ``sensor_msgs`` in CDR, with a header."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    types, name = store.types, f"sensor_msgs/msg/{kind}"
    header = types["std_msgs/msg/Header"](stamp=types["builtin_interfaces/msg/Time"](5, 7), frame_id="optical")
    if kind == "CameraInfo":
        fields["roi"] = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    return lambda path: path.write_bytes(bytes(store.serialize_cdr(types[name](header=header, **fields), name)))


def compressed(form: depth_recordings.DepthForm) -> Write:
    said, data = depth_recordings.compressed_depth(DEPTH_MM, form)
    return ros_message("CompressedImage", format=said, data=np.frombuffer(data, np.uint8))


RAW_DEPTH = {"encoding": "16UC1", "is_bigendian": 0, "step": 64, "data": np.frombuffer(DEPTH_MM.tobytes(), np.uint8)}
CAMERA_INFO = {
    "d": np.zeros(5),
    "k": np.array([50.0, 0, 15.5, 0, 50, 11.5, 0, 0, 1]),
    "r": np.eye(3).ravel(),
    "p": np.arange(12.0),
    "binning_x": 0,
    "binning_y": 0,
    "distortion_model": "plumb_bob",
}
