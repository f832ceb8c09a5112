"""One known pair of cameras, and the files in which different programs would describe it."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from harness.sources.calibrate.solve import StereoCalibration
from harness.sources.calibrate.views import BoardView
from tests.disk import write_text

Array = NDArray[np.float64]
SIZE = (1280, 720)


@dataclass(frozen=True, kw_only=True)
class Rig:
    """x_right = rotation(rotation_vector) x_left + translation_m; ``d`` are four coefficients of the model."""

    k: tuple[Array, Array]
    d: tuple[Array, Array]
    rotation_vector: Array
    translation_m: Array
    model: str = "plumb_bob"

    @property
    def rotation(self) -> Array:
        return np.asarray(cv2.Rodrigues(self.rotation_vector)[0], dtype=np.float64)

    def project(self, points_left: Array) -> tuple[Array, Array]:
        """Positions in both cameras of points (N, 3) of the left camera's frame: pixels (N, 2) before rectification."""
        poses = ((np.zeros(3), np.zeros(3)), (self.rotation_vector, self.translation_m))
        project = cv2.fisheye.projectPoints if self.model == "equidistant" else cv2.projectPoints
        points = points_left.reshape(-1, 1, 3)
        left, right = (
            project(points, rotation.reshape(3, 1), translation.reshape(3, 1), k, d)[0].reshape(-1, 2)
            for (rotation, translation), k, d in zip(poses, self.k, self.d, strict=True)
        )
        return left, right


def matrix(fx: float, fy: float, cx: float, cy: float) -> Array:
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


RIG = Rig(
    k=(matrix(700.5, 701.0, 630.0, 362.5), matrix(698.0, 699.5, 645.0, 355.0)),
    d=(np.array([-0.17, 0.03, 0.0004, -0.0003]), np.array([-0.165, 0.027, -0.0002, 0.0005])),
    rotation_vector=np.array([0.012, -0.02, 0.007]),
    translation_m=np.array([-0.1199, 0.0011, -0.0007]),
)


def opencv_nodes(rig: Rig) -> dict[str, Array]:
    (k1, k2), (d1, d2) = rig.k, rig.d
    return {"K1": k1, "D1": d1[None], "K2": k2, "D2": d2[None], "R": rig.rotation, "T": rig.translation_m[:, None]}


def rectification(rig: Rig) -> dict[str, Array]:
    nodes = opencv_nodes(rig)
    pair = nodes["K1"], nodes["D1"], nodes["K2"], nodes["D2"], SIZE, nodes["R"], nodes["T"]
    return dict(zip(("R1", "R2", "P1", "P2"), cv2.stereoRectify(*pair, alpha=0), strict=False))


def write_opencv(path: Path, nodes: dict[str, Array], size: tuple[int, int] | None = None) -> Path:
    """Write by OpenCV itself, YAML or XML."""
    path.parent.mkdir(parents=True, exist_ok=True)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in zip(("image_width", "image_height"), size or (), strict=False):
        storage.write(name, value)
    for name, value in nodes.items():
        storage.write(name, value)
    storage.release()
    return path


def write_yaml(path: Path, value: object) -> Path:
    return write_text(path, yaml.safe_dump(value, default_flow_style=None))


def write_ros(folder: Path, rig: Rig) -> list[Path]:
    found = rectification(rig)

    def table(value: Array, rows: int) -> dict[str, object]:
        return {"rows": rows, "cols": value.size // rows, "data": value.ravel().tolist()}

    return [
        write_yaml(
            folder / f"{side}.yaml",
            {
                "image_width": SIZE[0],
                "image_height": SIZE[1],
                "camera_name": side,
                "camera_matrix": table(k, 3),
                "distortion_model": "plumb_bob",
                "distortion_coefficients": table(np.append(d, 0.0), 1),
                "rectification_matrix": table(found[f"R{n}"], 3),
                "projection_matrix": table(found[f"P{n}"], 3),
            },
        )
        for n, side, k, d in zip((1, 2), ("left", "right"), rig.k, rig.d, strict=True)
    ]


def write_ros_text(path: Path, rig: Rig) -> Path:
    """What camera_calibration saves beside these files, and prints."""
    found = rectification(rig)
    lines = ["**** Calibrating ****", "Left:", "D = [-0.17, 0.03]"]
    for n, side, k, d in zip((1, 2), ("left", "right"), rig.k, rig.d, strict=True):
        lines += ["# oST version 5.0 parameters", "", "", "[image]", ""]
        lines += ["width", f"{SIZE[0]}", "", "height", f"{SIZE[1]}", "", f"[narrow_stereo/{side}]", ""]
        distortion = np.append(d, 0.0)[None]
        titles = ("camera matrix", k), ("distortion", distortion), ("rectification", found[f"R{n}"])
        for title, matrix_ in (*titles, ("projection", found[f"P{n}"])):
            lines += [title, *(" ".join(f"{value:8f}" for value in row) for row in matrix_), ""]
    return write_text(path, "\n".join(lines) + "\n")


def write_ros_ini(folder: Path, rig: Rig) -> list[Path]:
    """The same, a file for each camera."""
    _, *cameras = write_ros_text(folder / "both.txt", rig).read_text(encoding="utf-8").split("# oST")
    (folder / "both.txt").unlink()
    return [
        write_text(folder / f"{side}.ini", f"# oST{text}")
        for side, text in zip(("left", "right"), cameras, strict=True)
    ]


def write_ros_echo(folder: Path, rig: Rig, *, is_ros_2: bool) -> list[Path]:
    """The messages that ``rostopic echo -n1`` and ``ros2 topic echo --once`` print."""
    return [
        write_text(path, _echoed(yaml.safe_load(path.read_text(encoding="utf-8")), is_ros_2=is_ros_2))
        for path in write_ros(folder, rig)
    ]


def _echoed(camera: dict[str, Any], *, is_ros_2: bool) -> str:
    """The message of a file of ROS; ROS 2 writes a line for each number."""
    stamp = {"sec": 1, "nanosec": 2} if is_ros_2 else {"secs": 1, "nsecs": 2}
    message = {
        "header": {"stamp": stamp, "frame_id": camera["camera_name"]},
        "height": camera["image_height"],
        "width": camera["image_width"],
        "distortion_model": camera["distortion_model"],
        **{
            short.lower() if is_ros_2 else short: camera[name]["data"]
            for short, name in (
                ("D", "distortion_coefficients"),
                ("K", "camera_matrix"),
                ("R", "rectification_matrix"),
                ("P", "projection_matrix"),
            )
        },
        "binning_x": 0,
        "binning_y": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
    }
    return yaml.safe_dump(message, default_flow_style=False if is_ros_2 else None, sort_keys=False) + "---\n"


def write_kalibr(path: Path, rig: Rig) -> Path:
    """cam0 is the left one: T_cn_cnm1 of cam1 takes points of cam0 to cam1."""
    names = {"plumb_bob": "radtan", "equidistant": "equidistant"}
    cameras: dict[str, dict[str, object]] = {
        f"cam{n}": {
            "camera_model": "pinhole",
            "intrinsics": k[[0, 1, 0, 1], [0, 1, 2, 2]].tolist(),
            "distortion_model": names[rig.model],
            "distortion_coeffs": d.tolist(),
            "resolution": list(SIZE),
            "rostopic": f"/cam{n}/image_raw",
        }
        for n, (k, d) in enumerate(zip(rig.k, rig.d, strict=True))
    }
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rig.rotation, rig.translation_m
    cameras["cam1"]["T_cn_cnm1"] = pose.tolist()
    return write_yaml(path, cameras)


def write_depthai(path: Path, rig: Rig) -> Path:
    """The left camera (socket 1) leads to the right one, and that to the colour camera (socket 0); centimetres."""
    poses = (rig.rotation, rig.translation_m * 100, 2), (np.eye(3), np.array([3.7, 0.1, -0.1]), 0)
    colour = {"extrinsics": {"rotationMatrix": [], "toCameraSocket": -1}}
    cameras: list[list[object]] = [[0, colour]]
    for number, k, d, (rotation, shift, leads_to) in zip((1, 2), rig.k, rig.d, poses, strict=True):
        extrinsics = {
            "rotationMatrix": rotation.tolist(),
            "specTranslation": {"x": -7.5, "y": 0.0, "z": 0.0},
            "toCameraSocket": leads_to,
            "translation": dict(zip("xyz", shift.tolist(), strict=True)),
        }
        camera = {
            "cameraType": int(rig.model == "equidistant"),
            "distortionCoeff": [*d.tolist(), *[0.0] * 10],
            "extrinsics": extrinsics,
            "height": SIZE[1],
            "intrinsicMatrix": k.tolist(),
            "width": SIZE[0],
        }
        cameras.append([number, camera])
    pair = {"leftCameraSocket": 1, "rightCameraSocket": 2}
    return write_text(path, json.dumps({"cameraData": cameras, "stereoRectificationData": pair}, indent=4))


def matlab_struct(rig: Rig) -> dict[str, Any]:
    """What toStruct of MATLAB's stereoParams has: rows times matrices, pixels from 1, millimetres."""

    def camera(k: Array, d: Array) -> dict[str, Any]:
        return {
            "RadialDistortion": d[:2].tolist(),
            "TangentialDistortion": d[2:].tolist(),
            "ImageSize": [SIZE[1], SIZE[0]],
            "WorldUnits": "millimeters",
            "EstimateSkew": False,
            "IntrinsicMatrix": (k + np.outer([1, 1, 0], [0, 0, 1])).T.tolist(),
        }

    return {
        **{f"CameraParameters{number}": camera(k, d) for number, k, d in zip((1, 2), rig.k, rig.d, strict=True)},
        "RotationOfCamera2": rig.rotation.T.tolist(),
        "TranslationOfCamera2": (1000 * rig.translation_m).tolist(),
        "Version": {"Name": "MATLAB", "Release": "(R2021b)"},
    }


def write_matlab(path: Path, rig: Rig) -> Path:
    return write_text(path, json.dumps({"stereoParams": matlab_struct(rig)}))


def write_matlab_matrices(path: Path, rig: Rig) -> Path:
    """The matrices of both cameras by OpenCV, as scripts copy them from MATLAB, metres."""
    struct = matlab_struct(rig)
    nodes = {
        f"{name}{number}": np.array(struct[f"CameraParameters{number}"][name], np.float64)
        for number in (1, 2)
        for name in ("IntrinsicMatrix", "RadialDistortion", "TangentialDistortion")
    }
    pose = {"RotationOfCamera2": rig.rotation.T, "TranslationOfCamera2": rig.translation_m}
    return write_opencv(path, {**nodes, **pose, "ImageSize": np.array([[SIZE[1], SIZE[0]]], np.float64)})


def write_mat(path: Path, values: dict[str, Any]) -> Path:
    """Write a file of MATLAB by SciPy, with a large matrix and a struct beside the values."""
    path.parent.mkdir(parents=True, exist_ok=True)
    savemat(path, {**values, "x_1": np.zeros((2, 5000)), "stereoParams": {"K": 1.0}}, do_compression=True)
    return path


def write_toolbox(path: Path, rig: Rig) -> Path:
    """What Bouguet's toolbox saves, mm."""
    values: dict[str, Any] = {"R": rig.rotation, "T": 1000 * rig.translation_m[:, None], "nx": 1.0 * SIZE[0]}
    for side, k, d in zip(("left", "right"), rig.k, rig.d, strict=True):
        values |= {
            f"fc_{side}": k[[0, 1], [0, 1]][:, None],
            f"cc_{side}": k[:2, 2:],
            f"alpha_c_{side}": k[0, 1] / k[0, 0],
        }
        values[f"kc_{side}"] = np.append(d, 0.0)[:, None]
    return write_mat(path, {**values, "ny": 1.0 * SIZE[1], "om": rig.rotation_vector[:, None]})


def write_matlab_for_opencv(path: Path, rig: Rig) -> Path:
    """What stereoParametersToOpenCV returns, by its names, metres; the size is rows, columns."""
    names = {"K1": "intrinsicMatrix1", "K2": "intrinsicMatrix2", "R": "rotationOfCamera2", "T": "translationOfCamera2"}
    names |= {"D1": "distortionCoefficients1", "D2": "distortionCoefficients2"}
    values = {names[name]: value.tolist() for name, value in opencv_nodes(rig).items()}
    values["imageSize"] = [SIZE[1] * 1.0, SIZE[0] * 1.0]
    return write_mat(path, values) if path.suffix == ".mat" else write_text(path, json.dumps(values))


def write_opencv_lists(path: Path, rig: Rig) -> Path:
    """Write by OpenCV itself with the types of C++: a table for each camera, and sequences of numbers."""

    def sequence(name: str, values: Iterable[float]) -> None:
        storage.startWriteStruct(name, cv2.FileNode_SEQ | cv2.FileNode_FLOW)
        for value in values:
            storage.write("", value)
        storage.endWriteStruct()

    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    sequence("imageSize", SIZE)
    for side, k, d in zip(("left", "right"), rig.k, rig.d, strict=True):
        storage.startWriteStruct(f"camera_{side}", cv2.FileNode_MAP)
        storage.write("K", k)
        sequence("distortion", d.tolist())
        storage.endWriteStruct()
    storage.write("R", rig.rotation)
    sequence("T", rig.translation_m.tolist())
    storage.release()
    return path


def write_orb_slam_3(path: Path, rig: Rig) -> Path:
    """Without blanks after some keys, as people write these settings."""
    kind, names = ("PinHole", "k1 k2 p1 p2") if rig.model == "plumb_bob" else ("KannalaBrandt8", "k1 k2 k3 k4")
    lines = ["%YAML:1.0", 'File.version: "1.0"', f'Camera.type: "{kind}"', f"Camera.width: {SIZE[0]}"]
    for n, k, d in zip((1, 2), rig.k, rig.d, strict=True):
        values = dict(zip(("fx", "fy", "cx", "cy"), k[[0, 1, 0, 1], [0, 1, 2, 2]], strict=True))
        values |= dict(zip(names.split(), d, strict=True))
        lines += [f"Camera{n}.{name}: {value:.17g}" for name, value in values.items()]
    left_from_right = np.eye(4)
    left_from_right[:3, :3], left_from_right[:3, 3] = rig.rotation.T, -rig.rotation.T @ rig.translation_m
    lines += _opencv_lines("Stereo.T_c1_c2", left_from_right)
    return write_text(path, "\n".join([*lines, f"Camera.height: {SIZE[1]}", "Viewer.PointSize:2"]) + "\n")


def write_orb_slam_2(path: Path, rig: Rig) -> Path:
    """With the rectified pair, and what rectifies images."""
    found = rectification(rig)
    fx, fy, cx, cy = found["P1"][[0, 1, 0, 1], [0, 1, 2, 2]]
    values = {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "k1": 0.0, "k2": 0.0, "bf": -found["P2"][0, 3], "fps": 20.0}
    lines = ["%YAML:1.0", "", *(f"Camera.{name}: {value:.17g}" for name, value in values.items())]
    for n, side, k, d in zip((1, 2), ("LEFT", "RIGHT"), rig.k, rig.d, strict=True):
        lines += [f"{side}.height: {SIZE[1]}", f"{side}.width: {SIZE[0]}"]
        matrices = {"D": np.append(d, 0.0)[None], "K": k, "R": found[f"R{n}"], "P": found[f"P{n}"]}
        lines += [line for name, value in matrices.items() for line in _opencv_lines(f"{side}.{name}", value)]
    return write_text(path, "\n".join([*lines, "Viewer.PointSize:2"]) + "\n")


def _opencv_lines(name: str, value: Array) -> list[str]:
    rows, columns = value.shape
    data = ", ".join(f"{number:.17g}" for number in value.ravel())
    return [f"{name}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {columns}", "   dt: d", f"   data:[{data}]"]


IMU_FROM_LEFT = np.array([[0.0, 0, 1, 0.2], [-1, 0, 0, -0.1], [0, -1, 0, 0.05], [0, 0, 0, 1]])


def _imu_from_cameras(rig: Rig) -> list[Array]:
    right_from_left = np.eye(4)
    right_from_left[:3, :3], right_from_left[:3, 3] = rig.rotation, rig.translation_m
    return [IMU_FROM_LEFT, IMU_FROM_LEFT @ np.linalg.inv(right_from_left)]


def write_openvins(path: Path, rig: Rig, *, is_inverse: bool = False) -> Path:
    """Kalibr's chain with the poses of both cameras in the frame of an IMU, or the IMU's in those of the cameras."""
    chain = yaml.safe_load(write_kalibr(path, rig).read_text(encoding="utf-8"))
    del chain["cam1"]["T_cn_cnm1"]
    for camera, pose in zip(chain.values(), _imu_from_cameras(rig), strict=True):
        camera["T_cam_imu" if is_inverse else "T_imu_cam"] = (np.linalg.inv(pose) if is_inverse else pose).tolist()
    return write_text(path, "%YAML:1.0 # OpenCV reads it\n" + write_yaml(path, chain).read_text(encoding="utf-8"))


def write_vins(path: Path, rig: Rig) -> Path:
    """The configuration of VINS-Fusion, and the files of both cameras beside it."""
    lines = ["%YAML:1.0", "", "imu: 1", "num_of_cam: 2", 'imu_topic: "/imu0"', "estimate_extrinsic: 0   # accurate"]
    for (n, pose), camera in zip(enumerate(_imu_from_cameras(rig)), write_camodocal(path.parent, rig), strict=True):
        lines += [f'cam{n}_calib: "{camera.name}"', *_opencv_lines(f"body_T_cam{n}", pose)]
    return write_text(path, "\n".join([*lines, "gyr_w: 1.0e-4", "td: 0.0"]) + "\n")


def write_camodocal(folder: Path, rig: Rig) -> list[Path]:
    """A file of each camera."""
    is_pinhole = rig.model == "plumb_bob"
    kind, of_lens = ("PINHOLE", "k1 k2 p1 p2") if is_pinhole else ("KANNALA_BRANDT", "k2 k3 k4 k5")
    of_matrix = "fx fy cx cy" if is_pinhole else "mu mv u0 v0"
    paths = []
    for n, (k, d) in enumerate(zip(rig.k, rig.d, strict=True)):
        lens, matrix_ = (
            [f"   {name}: {value:.16e}" for name, value in zip(names.split(), values, strict=True)]
            for names, values in ((of_lens, d), (of_matrix, k[[0, 1, 0, 1], [0, 1, 2, 2]]))
        )
        lines = ["%YAML:1.0", "---", f"model_type: {kind}", "camera_name: camera"]
        lines += [f"image_width: {SIZE[0]}", f"image_height: {SIZE[1]}"]
        lines += ["distortion_parameters:", *lens] if is_pinhole else []
        lines += ["projection_parameters:", *([] if is_pinhole else lens), *matrix_]
        paths.append(write_text(folder / f"lens{n}.yaml", "\n".join(lines) + "\n"))
    return paths


def write_basalt(path: Path, rig: Rig) -> Path:
    kind, names = ("pinhole-radtan8", "k1 k2 p1 p2 k3 k4 k5 k6") if rig.model == "plumb_bob" else ("kb4", "k1 k2 k3 k4")
    poses, intrinsics = [], []
    for k, d, pose in zip(rig.k, rig.d, _imu_from_cameras(rig), strict=True):
        quaternion = Rotation.from_matrix(pose[:3, :3]).as_quat()
        values = (*pose[:3, 3].tolist(), *quaternion.tolist())
        poses.append(dict(zip(("px", "py", "pz", "qx", "qy", "qz", "qw"), values, strict=True)))
        of_lens = dict(zip(("fx", "fy", "cx", "cy"), k[[0, 1, 0, 1], [0, 1, 2, 2]].tolist(), strict=True))
        of_lens |= dict(zip(names.split(), [*d.tolist(), *[0.0] * 4], strict=False))
        intrinsics.append({"camera_type": kind, "intrinsics": of_lens})
    content = {"T_imu_cam": poses, "intrinsics": intrinsics, "resolution": [list(SIZE)] * 2}
    return write_text(path, json.dumps({"value0": content}))


def write_zed(path: Path, rig: Rig) -> Path:
    """Write for 1280 x 720, with another resolution's section that must not be used; millimetres."""
    names, lines = (("k1", "k2", "p1", "p2", "k3") if rig.model == "plumb_bob" else ("k1", "k2", "k3", "k4")), []
    for side, k, d in zip(("LEFT", "RIGHT"), rig.k, rig.d, strict=True):
        for name, scale in (("FHD", 1.5), ("HD", 1.0)):
            values = dict(zip(("fx", "fy", "cx", "cy"), k[[0, 1, 0, 1], [0, 1, 2, 2]] * scale, strict=True))
            values |= dict(zip(names, [*d, 0.0][: len(names)], strict=True))
            lines += [f"[{side}_CAM_{name}]", *(f"{key}={value:.17g}" for key, value in values.items()), ""]
    x, y, z = rig.translation_m * 1000
    lines += ["[STEREO]", f"Baseline={-x:.17g}", f"TY={y:.17g}", f"TZ={z:.17g}", "CV_FHD=0", "RX_FHD=0", "RZ_FHD=0"]
    lines += [f"{key}_HD={value:.17g}" for key, value in zip(("RX", "CV", "RZ"), rig.rotation_vector, strict=True)]
    return write_text(path, "\n".join(lines) + "\n")


def write_icub(path: Path, rig: Rig) -> Path:
    sections = []
    for side, k, d in zip(("LEFT", "RIGHT"), rig.k, rig.d, strict=True):
        values = {"w": SIZE[0], "h": SIZE[1], "fx": k[0, 0], "fy": k[1, 1], "cx": k[0, 2], "cy": k[1, 2]}
        values |= dict(zip(("k1", "k2", "p1", "p2"), d, strict=True))
        lines = [f"[CAMERA_CALIBRATION_{side}]", "projection         pinhole", "drawCenterCross    0", ""]
        sections.append("\n".join([*lines, *(f"{name} {value}" for name, value in values.items())]))
    pose = np.vstack([np.column_stack([rig.rotation, rig.translation_m]), [0, 0, 0, 1]])
    row = " ".join(map(str, pose.ravel().tolist()))
    sections.append(f"[STEREO_DISPARITY]\nHN ({row})\nQL (-0.000767\t-0.000192)\n")
    return write_text(path, "\n\n".join(sections))


def rectified_rows_px(calibration: StereoCalibration, view: BoardView) -> Array:
    """Row differences (N,), pixels, of a view's corners after rectification: right minus left."""
    pair = calibration.rectification
    left, right = (
        cv2.undistortPoints(pixels[:, None], camera.k, camera.d, R=camera.r, P=camera.p)[:, 0, 1]
        for pixels, camera in ((view.left_px, pair.left), (view.right_px, pair.right))
    )
    return np.asarray(right - left, dtype=np.float64)
