"""Read a calibration of any supported program."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from harness.files.io import read_text
from harness.sources.calibration import Calibration
from harness.sources.calibration_files import camodocal, euroc, kalibr, kitti, matrix, middlebury, opencv, ros, zed
from harness.sources.calibration_files.documents import SUFFIXES, read_document
from harness.sources.calibration_files.options import METRES, Cameras, ImageSize, Options
from harness.sources.rectification import RawCalibration, RawCamera
from vfoa.errors import VfoaError

NO_OPTIONS = Options()


def read_cameras(paths: Sequence[Path], size: ImageSize, options: Options = NO_OPTIONS) -> Cameras:
    """Read a pair's calibration; its content tells the kind of file.

    Parameters
    ----------
    paths
        One file, or two: left and right of ROS or EuRoC, intrinsics and extrinsics of OpenCV.
    size
        Gives (width, height) of the images.
    options
        Settings that the file does not contain.

    Returns
    -------
    Cameras
        A :class:`RawCalibration`, which rectifies images, or a :class:`Calibration` of rectified ones.

    Raises
    ------
    VfoaError
        If a file cannot be read, is of no known kind, lacks something, or describes no pair with a positive baseline.
    """
    cameras = _read(paths, size, options)
    if options.rectified and not isinstance(cameras, Calibration):
        cameras = cameras.rectified()
    cameras = _in_metres(cameras, METRES[options.unit])
    return cameras if options.baseline_m is None else _with_baseline(cameras, options.baseline_m)


def _read(paths: Sequence[Path], size: ImageSize, options: Options) -> Cameras:
    path = paths[0]
    if any(each.suffix.lower() in SUFFIXES for each in paths):
        return _read_documents(paths, size, options)
    if len(paths) > 1:
        raise VfoaError(f"{paths[1]}: a second calibration file; expected one, or two in YAML or XML")
    if path.suffix.lower() == ".conf":
        _refuse_unused(options, path, "the ZED's")
        return zed.read(path, size)
    return _read_text(path, options)


def _read_text(path: Path, options: Options) -> Calibration:
    """Read the text of KITTI, of Middlebury, or a bare matrix."""
    text = read_text(path)
    if middlebury.is_middlebury(text):
        _refuse_unused(options, path, "Middlebury's")
        return middlebury.read(path, text)
    if matrix.is_matrix(text):
        _refuse_unused(options, path, "a matrix's")
        return matrix.read(path, text, options.baseline_m)
    _refuse_unused(options, path, "KITTI's", cameras=True)
    return kitti.read(path, text, options.cameras or (2, 3))


def _read_documents(paths: Sequence[Path], size: ImageSize, options: Options) -> Cameras:
    documents = [read_document(path) for path in paths]
    where = " and ".join(map(str, paths))
    if all(ros.is_camera_info(document) for document in documents):
        if len(documents) != 2:
            raise VfoaError(f'{where}: one camera of ROS; expected the pair: calibration = ["left.yaml", "right.yaml"]')
        _refuse_unused(options, where, "ROS's")
        left, right = (ros.camera(document, str(path)) for document, path in zip(documents, paths, strict=True))
        return RawCalibration(left=left, right=right, where=where)
    if all(euroc.is_sensor(document) for document in documents):
        if len(documents) != 2:
            raise VfoaError(
                f"{where}: one camera of EuRoC; expected the pair: "
                'calibration = ["cam0/sensor.yaml", "cam1/sensor.yaml"]'
            )
        _refuse_unused(options, where, "EuRoC's")
        return euroc.pair(documents[0], documents[1], (str(paths[0]), str(paths[1])))
    for document, path in zip(documents, paths, strict=True):
        if camodocal.is_camodocal(document):
            camodocal.refuse(document, str(path))
    merged = {name: value for document in documents for name, value in document.items()}
    if kalibr.is_camchain(merged):
        _refuse_unused(options, where, "Kalibr's", cameras=True)
        return kalibr.pair(merged, options.cameras or (0, 1), where)
    _refuse_unused(options, where, "OpenCV's", fisheye=True)
    return opencv.pair(merged, size, options, where)


def _refuse_unused(
    options: Options, where: Path | str, whose: str, *, cameras: bool = False, fisheye: bool = False
) -> None:
    """Reject settings that have no meaning for the kind of the file."""
    if options.cameras is not None and not cameras:
        raise VfoaError(f"{where}: calibration_cameras: found {options.cameras}; expected none for {whose} calibration")
    if options.fisheye and not fisheye:
        raise VfoaError(f"{where}: fisheye: found true; expected it for OpenCV's calibration only, this is {whose}")


def _in_metres(cameras: Cameras, scale: float) -> Cameras:
    if isinstance(cameras, Calibration):
        return replace(cameras, baseline_m=cameras.baseline_m * scale)
    left, right = (_scaled(camera, scale) for camera in (cameras.left, cameras.right))
    return replace(cameras, left=left, right=right)


def _scaled(camera: RawCamera, scale: float) -> RawCamera:
    return replace(camera, p=camera.p * np.array([1, 1, 1, scale]))


def _with_baseline(cameras: Cameras, baseline_m: float) -> Cameras:
    if isinstance(cameras, Calibration):
        return replace(cameras, baseline_m=baseline_m)
    return _in_metres(cameras, baseline_m / cameras.rectified().baseline_m)
