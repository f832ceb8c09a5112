"""Clips without images, made on disk: Anna and Ben talk, a robot stands at the origin, a cup moves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from harness.sources import ADAPTERS, MeasuredClip
from tests.depth_recordings import messages
from tests.disk import labels_text
from vfoa.errors import VfoaError
from vfoa.geometry import unit

ANNA, BEN, ROBOT = (np.array(place) for place in ([-0.4, 0.0, 1.2], [0.4, 0.05, 1.0], [0.0, 0.0, 0.0]))
PEOPLE_HEADER = (
    "frame,time_ns,person,x_m,y_m,z_m,head_x,head_y,head_z,head_sigma_deg,gaze_x,gaze_y,gaze_z,gaze_sigma_deg"
)
OBJECTS_HEADER = "frame,object,category,x_m,y_m,z_m,size_x_m,size_y_m,size_z_m"
MANIFEST = """\
name = "talk"
adapter = "measured"
root = "../data/talk"
[source]
people_file = "people.csv"
objects_file = "objects.csv"
[subjects.anna]
category = "person"
instance = 1
[subjects.ben]
category = "person"
instance = 2
[targets.robot]
category = "robot"
[targets.cup]
category = "cup"
"""
"""A clip ``talk`` of the files of :func:`measured_tables`, in ``data/talk``."""
EXPERIMENT = """\
clips = ["talk"]
preset = "measured"
[[configuration]]
name = "cones"
attention.cones_cm = [25]
[[configuration]]
name = "forward"
attention.method = "bayes"
attention.smoothing = "forward"
"""
"""An experiment on a clip ``talk`` of :func:`measured_tables`."""
START_NS, STEP_NS = 1_700_000_000_000_000_000, 40_000_000


def measured_tables(folder: Path, frames: Sequence[int] = range(1, 13), step_ns: int = STEP_NS) -> Path:
    """Both look at each other in the first half, and at the robot in the second; Ben's eyes are not measured."""
    people, objects = [PEOPLE_HEADER], [OBJECTS_HEADER, f",robot,robot,{_cells(ROBOT)},0.3,0.3,0.3"]
    for place, number in enumerate(frames):
        looks = {"anna": BEN, "ben": ANNA} if place < len(frames) / 2 else dict.fromkeys(("anna", "ben"), ROBOT)
        for name, eyes in (("anna", ANNA), ("ben", BEN)):
            towards = _cells(unit(looks[name] - eyes))
            gaze = f"{towards},8" if name == "anna" else ",,,"
            people.append(f"{number},{START_NS + number * step_ns},{name},{_cells(eyes)},{towards},5,{gaze}")
        objects.append(f"{number},cup,cup,{0.05 * place},0.4,0.9,,,")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "people.csv").write_text("\n".join(people) + "\n")
    (folder / "objects.csv").write_text("\n".join(objects) + "\n")
    return folder


def true_labels(count: int = 12) -> str:
    """The labels of :func:`measured_tables` with so many frames from 1 on."""
    half = count // 2
    rows = [
        f"{first},{last},{subject},{target},"
        for subject, other in (("anna", "ben"), ("ben", "anna"))
        for first, last, target in ((1, half, other), (half + 1, count, "robot"))
    ]
    return labels_text(*rows)


def idiap_file(folder: Path, count: int = 6) -> Path:
    """Lines as Idiap's tracker writes them: both look into the camera."""
    lines = [
        f"{START_NS + frame * STEP_NS},{person},10,20,30,40,0,{_cells(eyes)},0,0,0,Robot,0.9,Unfocused,0.1"
        for frame in range(count)
        for person, eyes in ((1, ANNA), (2, BEN))
    ]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "tracker.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def openface_header(*, points: bool = True) -> list[str]:
    """The columns of a sequence as OpenFace 2's ``RecorderCSV.cpp`` writes them, without those of action units."""
    eyes = [f"eye_lmk_{axis}_{point}" for axis in "xyXYZ" for point in range(56)]
    landmarks = [f"{axis}_{point}" for axis in "xyXYZ" for point in range(68)]
    return [
        *("frame", "face_id", "timestamp", "confidence", "success"),
        *(f"gaze_{eye}_{axis}" for eye in "01" for axis in "xyz"),
        *("gaze_angle_x", "gaze_angle_y", *eyes),
        *(f"pose_T{axis}" for axis in "xyz"),
        *(f"pose_R{axis}" for axis in "xyz"),
        *(landmarks if points else []),
    ]


def openface_file(path: Path, rows: Sequence[Mapping[str, Any]], *, points: bool = True, old: bool = False) -> Path:
    """A table as OpenFace writes it; in an ``old`` one a blank follows each comma of the header.

    A row gives the values of some columns, all others are 0; ``eyes_mm`` gives those of X_36 to Z_47 (by
    default the place of the head), ``box_px`` those
    of x_0 to y_67, which lie on the edge of the box.
    """
    header = openface_header(points=points)
    lines = [("," + " " * old).join(header)]
    for given in rows:
        cells: dict[str, Any] = {"confidence": 0.98, "success": 1, **given}
        eyes_mm = given.get("eyes_mm", [cells.get(f"pose_T{axis}", 0) for axis in "xyz"])
        for axis, value in zip("XYZ", eyes_mm, strict=True):
            cells.update({f"{axis}_{point}": value for point in range(36, 48)})
        if box := given.get("box_px"):
            u0, v0, u1, v1 = box
            for point in range(68):
                share = point / 67
                cells[f"x_{point}"], cells[f"y_{point}"] = u0 + share * (u1 - u0), v0 + share * (v1 - v0)
        lines.append(",".join(f"{cells.get(name, 0):g}" for name in header))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return path


def pose(place: Sequence[float], rotation: Rotation | None = None, frames: int = 3) -> NDArray[Any]:
    """The pose of a body at rest, as the files below take it: a row x, y, z, w and its place for each frame."""
    quaternion = (Rotation.identity() if rotation is None else rotation).as_quat()
    return np.tile([*quaternion, *place], (frames, 1))


def motive_file(path: Path, bodies: Mapping[str, NDArray[Any]], *, kind: str = "Rigid Body", **said: str) -> Path:
    """A take as Motive's CSV export lays it out, 100 frames a second from 0; ``said`` are entries of the first line.

    A pose is a row (7,) of x, y, z, w and the position for each frame, blank where it is NaN. Each body has a marker.
    """
    entries = {"Rotation_Type": "Quaternion", "Length_Units": "Meters", "Coordinate_Space": "Global", **said}
    first = ["Format Version", "1.23", "Take Name", "talk", "Take Notes", ""]
    first += [text for name, value in entries.items() for text in (name.replace("_", " "), value)]
    pose = [*(("Rotation", axis) for axis in "XYZW"), *(("Position", axis) for axis in "XYZ")]
    each = [*pose, ("Mean Marker Error", "")]
    columns = [(kind, name, *what) for name in bodies for what in each]
    columns += [(f"{kind} Marker", f'"{name}:Marker1"', "Position", axis) for name in bodies for axis in "XYZ"]
    kinds, names, quantities, axes = zip(*columns, strict=True)
    above = [["", "Type", *kinds], ["", "Name", *names], ["", "ID", *names], ["", "", *quantities]]
    rows: list[list[str]] = [first, [], *above, ["Frame", "Time (Seconds)", *axes]]
    for number, poses in enumerate(zip(*bodies.values(), strict=True)):
        cells = [*(cell for pose in poses for cell in (*pose, 0.0007)), *(0.1 for _ in range(3 * len(bodies)))]
        rows.append([str(number), f"{number / 100:.6f}", *("" if np.isnan(cell) else f"{cell:.6f}" for cell in cells)])
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")
    return path


def qualisys_file(path: Path, bodies: Mapping[str, NDArray[Any]], *, times: bool = True, **said: str) -> Path:
    """6DOF data as QTM's TSV export lays it out, 100 frames a second; poses and ``said`` as in :func:`motive_file`.

    The room's z is up. Lines end with a tab, as QTM writes them.
    """
    entries = {"NO_OF_FRAMES": "3", "FREQUENCY": "100", "DATA_INCLUDED": "6D", **said, "BODY_NAMES": "\t".join(bodies)}
    others = ["Y", "Z", "Roll", "Pitch", "Yaw", "Residual", *(f"Rot[{place}]" for place in range(9))]
    columns = [column for name in bodies for column in (f"{name} X", *others)]
    lines = [f"{name}\t{value}" for name, value in entries.items()]
    lines.append("\t".join([*(["Frame", "Time"] if times else []), *columns, ""]))
    for number, poses in enumerate(zip(*bodies.values(), strict=True), start=1):
        cells = [str(number), f"{(number - 1) / 100:.5f}"] if times else []
        for pose in poses:
            if np.isnan(pose).any():
                cells += [""] * 16
                continue
            matrix = Rotation.from_quat(pose[:4]).as_matrix()
            cells += [f"{value:.5f}" for value in (*(1000 * pose[4:]), 0, 0, 0, 0.4, *matrix.T.ravel())]
        lines.append("\t".join([*cells, ""]))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return path


def vicon_file(path: Path, bodies: Mapping[str, NDArray[Any]], *, rate: str = "100") -> Path:
    """Objects as Vicon Tracker exports them, with quaternions; poses as in :func:`motive_file`, the room's z is up."""
    columns = ["RX", "RY", "RZ", "RW", "TX", "TY", "TZ"]
    names = [cell for name in bodies for cell in (f"Global Angle (Quaternion) {name}:{name}", *[""] * 6)]
    rows = [["Objects"], [rate], ["", "", *names], ["Frame", "Sub Frame", *columns * len(bodies)]]
    rows.append(["", "", *["", "", "", "", "mm", "mm", "mm"] * len(bodies)])
    for number, poses in enumerate(zip(*bodies.values(), strict=True), start=1):
        cells = [cell for pose in poses for cell in (*pose[:4], *(1000 * pose[4:]))]
        rows.append([str(number), "0", *("" if np.isnan(cell) else f"{cell:.6f}" for cell in cells)])
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")
    return path


def ros_file(path: Path, bodies: Mapping[str, NDArray[Any]]) -> Path:
    """A ROS 1 bag as vrpn_client_ros fills it, 100 messages a second of each body; poses as in :func:`motive_file`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    with messages(path.parent, "bag", path.stem) as (bag, write):
        for number, poses in enumerate(zip(*bodies.values(), strict=True), start=1):
            for name, pose in zip(bodies, poses, strict=True):
                write.pose(f"/vrpn_client_node/{name}/pose", number * 10**7, "world", pose[4:], pose[:4])
    return bag


def refusal(read: Callable[[Path], object], path: Path, before: str, after: str) -> str:
    """What reading a file says after a part of its text, which is there, was replaced everywhere."""
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after))
    with pytest.raises(VfoaError) as refused:
        read(path)
    return str(refused.value)


def open_measured(adapter: str, root: Path, **source: object) -> MeasuredClip:
    """A clip as a manifest opens it."""
    kind = ADAPTERS.load(adapter)
    clip: MeasuredClip = kind(kind.Settings.model_validate(source), root)
    return clip


def vr_session(folder: Path) -> Path:
    """A session as jov2023-vr-objects lays it out: at 90 Hz a head looks ahead (z), the gaze at a cup, then at a wall.

    Of 1.2 s of preview, the gaze is 0.4 s on the cup, 0.05 s on the wall, 0.3 s invalid, then on the wall; in 0.5 s of
    response on a copy of the cup.
    """
    session = folder / "kitchen_laser" / "3" / "S001"
    (session / "trackers").mkdir(parents=True)
    box = "0.0,1.5,2.0,0.2,0.3,0.2"
    (session / "trial_results.csv").write_text(
        "ppid,trial_num,target,target_label,"
        + ",".join(f"target_bbox_{what}_{axis}" for what in ("center", "size") for axis in "xyz")
        + ",t_scene_preview_start,t_scene_preview_end,t_response_start,t_response_end\n"
        f"3,1,K01_L02,cup,{box},10.5,11.69,13,13.49\n3,2,K01_L20,lamp,1,1,1,0.1,0.1,0.1,20,21,22,23\n"
    )
    spans = (
        (10.9, "K01_L02_01", 0.0),
        (10.95, "Wall", 1.0),
        (11.25, "", 0.0),
        (12.0, "Wall", 1.0),
        (20, "K01_L02(Clone)", 0),
    )
    moves, gazes = [], []
    for sample in range(360):
        time_s = 10 + sample / 90
        name, right = next((name, right) for end_s, name, right in spans if time_s < end_s)
        moves.append(f"{time_s:.5f},0,1.5,0,0,0,0")
        hit = f"{2 * right},1.5,2" if name else "-99999,-99999,-99999"
        gazes.append(f"{time_s:.5f},{_cells(unit(np.array([2 * right, 0.0, 2.0])))},{hit},{name}")
    for name, columns, rows in (
        ("VR_move", "head_pos_x,head_pos_y,head_pos_z,head_rot_x,head_rot_y,head_rot_z", moves),
        ("Eye_gaze", "dir_x,dir_y,dir_z,gaze_x,gaze_y,gaze_z,gaze_object", gazes),
    ):
        (session / "trackers" / f"{name}_T001.csv").write_text("\n".join([f"time,{columns}", *rows]) + "\n")
    return session


def _cells(vector: np.ndarray) -> str:
    return ",".join(repr(float(value)) for value in vector)
