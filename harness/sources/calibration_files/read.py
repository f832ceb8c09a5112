"""Read a calibration of any supported program, and find those beside a clip's images."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from pydantic import Field

from harness.files.io import read_text
from harness.sources.calibration import Calibration
from harness.sources.calibration_files import (
    basalt,
    depthai,
    documents,
    dsec,
    icub,
    matlab,
    opencv,
    opencv_names,
    orb_slam,
    ros_text,
    texts,
    vins,
)
from harness.sources.calibration_files.camera_tables import is_camera, realsense_cameras, with_matrices
from harness.sources.calibration_files.documents import METRES, SUFFIXES, Unit
from harness.sources.calibration_files.python_files import FOREIGN_SUFFIXES, head_of, refuse_foreign_calibration
from harness.sources.calibration_files.texts import IncompleteCalibrationError
from harness.sources.media.frame_files import pair_names
from harness.sources.rectification import Cameras, ImageSize, in_metres, scaled_to
from vfoa.errors import VfoaError, listed
from vfoa.settings import Settings

LARGEST_BYTES = 1_000_000
"""Longer texts are not tried as calibrations."""
_LARGEST_ARCHIVE_BYTES = 256_000_000
_MOST_ALIKE = 20
"""Of more files of a kind in a folder (one for each frame), only those that are named as calibrations are tried."""


class Options(Settings):
    """Settings of a manifest for what a calibration's file does not contain.

    ``calibration_cameras``: the left and the right camera of the file; by default (2, 3) for KITTI, (1, 2) for DSEC,
    (0, 1) for Kalibr, Basalt and VINS-Fusion. ``calibration_unit`` is that of the translation; by default metres, or
    what the file says (MATLAB's ``WorldUnits``, ``baseline_mm`` beside OpenCV's matrices). ``fisheye``: OpenCV's
    matrices are of ``cv2.fisheye`` (or, false, are not); by default what the file says. ``rectified``: the images are
    rectified already, although the file also says how to rectify. ``baseline_m``: the distance of the two cameras,
    which replaces the file's or completes a file without one.
    """

    calibration_cameras: tuple[int, int] | None = None
    calibration_unit: Unit = "m"
    baseline_m: float | None = Field(default=None, gt=0)
    fisheye: bool | None = None
    rectified: bool = False


NO_OPTIONS = Options()


class _NoChoiceError(VfoaError):
    """``calibration_cameras`` is given for a file that always holds two cameras."""


_CHOOSING = ("KITTI", "Kalibr", basalt.PROGRAM, dsec.PROGRAM, vins.PROGRAM)
"""Programs whose files may hold more than two cameras."""


def read_cameras(paths: Sequence[Path], size: ImageSize, options: Options = NO_OPTIONS) -> Cameras:
    """Read a pair's calibration; its content tells the kind of file.

    Parameters
    ----------
    paths
        One file, or two: left and right of ROS or EuRoC, intrinsics and extrinsics of OpenCV; or three of OpenCV: the
        left camera, the right one, and how they stand.
    size
        Gives (width, height) of the images.
    options
        Settings that the file does not contain.

    Returns
    -------
    Cameras
        Cameras before rectification, or the calibration of rectified images.

    Raises
    ------
    VfoaError
        If a file cannot be read, is of no known kind, lacks something, or describes no pair with a positive baseline.
    """
    for path in paths:
        refuse_foreign_calibration(path)
    if any(map(documents.document_suffix, paths)):
        program, cameras = _read_documents(paths, size, options)
    elif len(paths) > 1:
        if not all(map(ros_text.is_ros_text, both := [read_text(path) for path in paths])):
            raise VfoaError(
                f"{paths[1]}: a second calibration file; expected one, or two in YAML, XML or JSON, or of ROS"
            )
        where = " and ".join(map(str, paths))
        program, cameras = "ROS", ros_text.read_ros_text(where, "\n".join(both), options.baseline_m)
    else:
        program, cameras = _read_text(paths[0], size, options)
    where = " and ".join(map(str, paths))
    if (chosen := options.calibration_cameras) is not None and program not in _CHOOSING:
        raise _NoChoiceError(f"{where}: calibration_cameras: found {chosen}; expected none for a file of {program}")
    if options.fisheye and program != "OpenCV":
        raise VfoaError(f"{where}: fisheye: found true for a file of {program}; expected it only for files of OpenCV")
    rectified = cameras if isinstance(cameras, Calibration) else cameras.rectified()
    unit_m = METRES[options.calibration_unit]
    if options.baseline_m is not None:
        unit_m = options.baseline_m / rectified.baseline_m
    return in_metres(rectified if options.rectified else cameras, unit_m)


def _read_text(path: Path, size: ImageSize, options: Options) -> tuple[str, Cameras]:
    """The program that a file is of, and its cameras."""
    if path.suffix.lower() == ".conf":
        return "the ZED", texts.read_zed(path, size)
    text = read_text(path)
    if icub.is_icub(text):
        return icub.PROGRAM, icub.read_icub(path, text)
    if ros_text.is_ros_text(text):
        return "ROS", ros_text.read_ros_text(str(path), text, options.baseline_m)
    if texts.is_middlebury(text):
        return "Middlebury", texts.read_middlebury(path, text)
    if named := texts.named_numbers(text):
        return "OpenCV", _opencv_cameras(named, size, str(path), options)
    if texts.is_matrix(text, size):
        return "a matrix", texts.read_matrix(path, text, size, options.baseline_m)
    return "KITTI", texts.read_kitti(path, text, options.calibration_cameras or (2, 3))


def _read_documents(paths: Sequence[Path], size: ImageSize, options: Options) -> tuple[str, Cameras]:
    """As :func:`_read_text`, of one or several files in YAML or XML."""
    contents = [documents.read_document(path) for path in paths]
    where = " and ".join(map(str, paths))
    for program, names, read_pair in (
        ("ROS", {"camera_matrix", "projection_matrix"}, partial(documents.ros_pair, baseline_m=options.baseline_m)),
        ("EuRoC", {"T_BS", "camera_model"}, documents.euroc_pair),
    ):
        if all(names <= content.keys() for content in contents):
            if len(contents) != 2:
                raise VfoaError(
                    f'{where}: one camera of {program}; expected the pair: calibration = ["left.yaml", "right.yaml"]'
                )
            return program, read_pair(contents[0], contents[1], (str(paths[0]), str(paths[1])))
    merged = orb_slam.as_orb_slam(opencv_names.merged(contents), where)
    if dsec.is_dsec(merged):
        return dsec.PROGRAM, dsec.dsec_pair(merged, options.calibration_cameras or dsec.FRAMES, where)
    if (chain := documents.kalibr_chain(merged)) is not None and not opencv.rectifies(merged):
        return "Kalibr", documents.kalibr_pair(chain, options.calibration_cameras or (0, 1), where)
    if basalt.is_basalt(merged):
        return basalt.PROGRAM, basalt.basalt_pair(merged, options.calibration_cameras or (0, 1), where)
    if vins.is_vins(merged):
        chosen, has_baseline = options.calibration_cameras or (0, 1), options.baseline_m is not None
        return vins.PROGRAM, vins.vins_pair(merged, chosen, paths, has_baseline=has_baseline)
    if orb_slam.is_orb_slam(merged) and (options.rectified or not opencv.rectifies(merged)):
        return orb_slam.PROGRAM, orb_slam.orb_slam_pair(merged, size, where, rectified=options.rectified)
    if matlab.is_matlab(merged):
        has_unit = "calibration_unit" in options.model_fields_set
        return matlab.PROGRAM, matlab.matlab_pair(merged, size, where, has_unit=has_unit)
    if depthai.is_depthai(merged):
        if options.rectified:
            raise VfoaError(
                f"{where}: rectified: found true; expected the four numbers of DepthAI's rectified images (fx_px, "
                "cx_px, cy_px, baseline_m in [source.camera]), which this file does not hold"
            )
        return "DepthAI", depthai.depthai_pair(merged, size, where)
    return "OpenCV", _opencv_cameras(merged, size, where, options)


def _opencv_cameras(document: documents.Document, size: ImageSize, where: str, options: Options) -> Cameras:
    """The cameras of a document with OpenCV's matrices, or with cameras by the names of their numbers."""
    named = ["fx"] if is_camera(document) else realsense_cameras(document)
    pair = opencv.with_equal_cameras(with_matrices(document), where, rectified=options.rectified)
    if named and not opencv.is_pair(pair):
        raise IncompleteCalibrationError(
            f"{where}: found {listed(named, 4)} and no matrices of a pair; expected, of rectified images, such as a "
            "RealSense's infrared ones and the ZED's, a baseline and no distortion beside the numbers, or four "
            "numbers, --fx --cx --cy and --baseline in metres (the length of the translation between them); of other "
            "images, K1 D1 K2 D2 R T"
        )
    return opencv.opencv_pair(
        pair if opencv.is_pair(pair) else document,
        size,
        where,
        rectified=options.rectified,
        fisheye=options.fisheye,
        has_unit="calibration_unit" in options.model_fields_set or options.baseline_m is not None,
    )


def find_calibrations(
    root: Path, size: ImageSize, options: Options = NO_OPTIONS
) -> tuple[list[tuple[str, ...]], list[str]]:
    """Return every file, or pair of files, that calibrates images of this (width, height), scaled if necessary.

    Paths are relative to ``root``: all files in the folder and in two levels of folders below it or, if none of them is
    a calibration, ROS's ``ost.txt`` or KITTI's for all drives of a day. If there is none, the second list has a note
    for every file that seems to be a calibration and cannot be used: it is faulty, incomplete, of other images or of a
    kind that is not read. ``options.calibration_cameras`` applies to files that may hold more than two cameras.
    """
    calibrations, faults = list[tuple[str, ...]](), dict[tuple[str, ...], str]()
    candidates = [*_candidates(root), _OF_THE_DAY]
    candidates.sort(key=_rank)
    for names in candidates:
        if calibrations and _rank(names) > _rank(calibrations[0]):
            break
        paths = [root / name for name in names]
        try:
            if any(map(_is_large, paths)):
                refuse_foreign_calibration(paths[0])
                continue
            try:
                cameras = read_cameras(paths, size, options)
            except _NoChoiceError:  # the numbers of cameras are for other files here
                cameras = read_cameras(paths, size, options.model_copy(update={"calibration_cameras": None}))
            scaled_to(cameras, size())
            calibrations.append(names)
        except IncompleteCalibrationError as error:
            faults[names] = str(error)
        except VfoaError as error:
            if names != _OF_THE_DAY and all(map(_seems_calibration, paths)):
                faults[names] = f"{'' if str(root) in str(error) else f'{paths[0]}: '}{error}"
    notes = [fault for names, fault in faults.items() if not any({*names} < {*others} for others in faults)]
    return calibrations, [] if calibrations else notes


_CALIBRATION_NAME = re.compile(
    r"calib|stereo|camchain|intrinsic|extrinsic|camera_?(?:info|param|matrix)|rectif|^sn[0-9]+\.conf$|^k\.txt$",
    re.IGNORECASE,
)
_POSE_NAME = re.compile(r"stereo|extrinsic", re.IGNORECASE)
"""Of a file with the pose of two cameras, whose lenses are in files of their own."""
_CALIBRATION_CONTENT = re.compile(
    rb"\b(?:[KMP]1\b(?!\"?\s*[:=]\s*[0-9]+\s*(?:,\s*\"|[,}]?\s*$))|camera[_ ]?matrix|dist_?coeff|P_rect_|P2:|"
    rb"opencv-matrix|T_BS\b|intrinsics\b|projection_matrix|cameraData\b|CameraParameters1\b|Camera1?\.fx\b|"
    rb"T_imu_cam\b|RotationOfCamera2\b|CAMERA_CALIBRATION_|body_T_cam0\b)",
    re.IGNORECASE | re.MULTILINE,
)
"""A whole number alone is no matrix, but a parameter of block matching."""


def _is_large(path: Path) -> bool:
    """Whether a file is too long to be tried as a calibration."""
    most = _LARGEST_ARCHIVE_BYTES if path.suffix.lower() in (".npz", ".mat") else LARGEST_BYTES
    return path.is_file() and path.stat().st_size > most


def _seems_calibration(path: Path) -> bool:
    """Whether a file that cannot be read as a calibration is meant as one, by its name or its first bytes."""
    try:
        return bool(_CALIBRATION_NAME.search(path.name) or _CALIBRATION_CONTENT.search(head_of(path)))
    except VfoaError:
        return False


_OF_THE_DAY = ("../calib_cam_to_cam.txt",)


def _rank(names: tuple[str, ...]) -> int:
    """Files count only if none with a lower rank do: they say again, or for more images, what those say.

    1 is that of three files, of which two may be a pair, 2 that of ROS's ``ost.txt`` and of KITTI's day.
    """
    return 2 if names == _OF_THE_DAY or Path(names[0]).name.lower() == ros_text.FILE_NAME else len(names) // 3


def _candidates(root: Path) -> Iterator[tuple[str, ...]]:
    suffixes = SUFFIXES | FOREIGN_SUFFIXES | {".conf", ".ini", ".txt"}
    found = (path for pattern in ("*", "*/*", "*/*/*") for path in sorted(root.glob(pattern)))
    files = [path for path in found if path.suffix.lower() in suffixes and path.is_file()]
    counts = Counter((path.parent, path.suffix) for path in files)
    names = [
        path.relative_to(root).as_posix()
        for path in files
        if counts[path.parent, path.suffix] <= _MOST_ALIKE or _CALIBRATION_NAME.search(path.name)
    ]
    yield from ((name,) for name in names)
    in_documents = [name for name in names if Path(name).suffix.lower() in (*SUFFIXES, ".ini")]
    pairs = pair_names(in_documents, numbered=False)
    yield from pairs
    of_poses = [name for name in in_documents if _POSE_NAME.search(Path(name).name)]
    yield from ((*pair, name) for pair in pairs for name in of_poses if name not in pair)
    others = ((name, name.replace("intrinsic", "extrinsic")) for name in in_documents)
    yield from ((name, other) for name, other in others if other != name and (root / other).is_file())
