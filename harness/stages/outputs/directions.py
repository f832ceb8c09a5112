"""Head pose and gaze of other programs, from CSV tables.

frame,subject,x,y,z[,sigma_deg]                          both: a unit direction in the camera frame
frame,subject,yaw_deg,pitch_deg,roll_deg[,sigma_deg]     head pose: angles in the crop's axes
frame,subject,theta_deg,phi_deg[,sigma_deg]              gaze: angles in the crop's axes, like Gaze360's

Camera frame: of the rectified left camera, x right, y down, z away. Crop's axes: z along the ray from the camera to the
head, so that angles of 0 look into the camera wherever the person stands. The ray goes through the middle of the face's
box if the table of heads has one, else of the head's. yaw > 0 and theta > 0 turn to the image's left, pitch > 0 and phi
> 0 up, roll > 0 clockwise in the image. ``sigma`` is the error that the model claims. Every angle may be in radians
instead: ``yaw_rad``, ``sigma_rad``.

A row is joined to a head by ``subject`` and the table of heads (``heads``): it belongs to the head of its frame whose
box overlaps that subject's box most, whichever detector found that head. A head without a row has no direction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydantic import Field

from harness.data_folders import expand
from harness.files import digest_files
from harness.sources import Clip
from harness.stages.ground_truth.oracle import LEAST_OVERLAP
from harness.stages.outputs.heads import read_heads
from harness.stages.outputs.tables import Row, read_table, write_table
from vfoa.crops import center
from vfoa.errors import VfoaError
from vfoa.geometry import box_iou, direction_from_crop, gaze_direction_crop, head_direction_crop, pixel_ray
from vfoa.settings import Settings
from vfoa.types import Float, Gaze, Head, HeadPose, StereoFrame

DIRECTION = ("x", "y", "z")
HEAD_ANGLES = ("yaw", "pitch", "roll")
GAZE_ANGLES = ("theta", "phi")
_UNITS = ("_deg", "_rad")
_LENGTH_TOLERANCE = 0.01


class FileHeadPoseSettings(Settings):
    """Location of the poses: the table ``file`` under ``root``; ``heads``, relative to ``root``, has the boxes."""

    root: str
    """Folder of the tables; ``${CLIP}`` stands for the clip's name."""
    file: str = Field(default="head_pose.csv", min_length=1)
    """Table of head poses below ``root``."""
    heads: str = Field(default="heads.csv", min_length=1)
    """Table of head boxes below ``root``; it joins each row to a head."""


class FileGazeSettings(Settings):
    """Location of the gazes: the table ``file`` under ``root``; ``heads``, relative to ``root``, has the boxes."""

    root: str
    """Folder of the tables; ``${CLIP}`` stands for the clip's name."""
    file: str = Field(default="gaze.csv", min_length=1)
    """Table of gaze directions below ``root``."""
    heads: str = Field(default="heads.csv", min_length=1)
    """Table of head boxes below ``root``; it joins each row to a head."""


class FileHeadPose:
    """A head-pose model that reads poses from a table, with the model's angles if the table has them."""

    Settings = FileHeadPoseSettings

    def __init__(self, settings: FileHeadPoseSettings, clip: Clip) -> None:
        root = expand(settings.root, Path.cwd(), "head_pose.root")
        self._rows = _JoinedRows(root / settings.file, root / settings.heads, HEAD_ANGLES, clip, angles_beside=True)

    def estimate(self, frame: StereoFrame, head: Head) -> HeadPose | None:
        """Return the pose of one head, or None."""
        found = self._rows.find(frame.index, head)
        if found is None:
            return None
        row, boxes = found
        angles, direction = _angles(row, HEAD_ANGLES), _direction(row)
        yaw, pitch, roll = (math.nan,) * 3 if angles is None else angles.tolist()
        if direction is None:
            _required(angles, row, HEAD_ANGLES)
            direction = _from_crop(head_direction_crop(yaw, pitch), boxes, frame)
        return HeadPose(direction=direction, yaw_rad=yaw, pitch_rad=pitch, roll_rad=roll, sigma_rad=_sigma(row))

    def digest(self) -> str:
        """Hexadecimal sha256 of both tables."""
        return self._rows.digest()


class FileGaze:
    """A gaze model that reads gaze directions from a table."""

    Settings = FileGazeSettings

    def __init__(self, settings: FileGazeSettings, clip: Clip) -> None:
        root = expand(settings.root, Path.cwd(), "gaze.root")
        self._rows = _JoinedRows(root / settings.file, root / settings.heads, GAZE_ANGLES, clip)

    def estimate(self, frame: StereoFrame, head: Head, head_pose: HeadPose | None) -> Gaze | None:
        """Return the gaze of one head, or None."""
        found = self._rows.find(frame.index, head)
        if found is None:
            return None
        row, boxes = found
        direction = _direction(row)
        if direction is None:
            theta, phi = _required(_angles(row, GAZE_ANGLES), row, GAZE_ANGLES)
            direction = _from_crop(gaze_direction_crop(theta, phi), boxes, frame)
        return Gaze(direction=direction, sigma_rad=_sigma(row))

    def digest(self) -> str:
        """Hexadecimal sha256 of both tables."""
        return self._rows.digest()


def write_head_poses(path: Path, rows: Sequence[tuple[int, str, HeadPose]]) -> None:
    """Write poses by frame and subject: direction, and angles in radians, so that they read back exactly."""
    columns = (*DIRECTION, *(f"{name}_rad" for name in HEAD_ANGLES), "sigma_rad")
    table = []
    for frame, subject, pose in rows:
        angles = (pose.yaw_rad, pose.pitch_rad, pose.roll_rad)
        known = [None if math.isnan(angle) else angle for angle in angles]
        table.append((frame, subject, *pose.direction.tolist(), *known, pose.sigma_rad))
    write_table(path, columns, table)


def write_gazes(path: Path, rows: Sequence[tuple[int, str, Gaze]]) -> None:
    """Write gazes by frame and subject: direction, and sigma in radians, so that they read back exactly."""
    table = [(frame, subject, *gaze.direction.tolist(), gaze.sigma_rad) for frame, subject, gaze in rows]
    write_table(path, (*DIRECTION, "sigma_rad"), table)


class _JoinedRows:
    """The rows of a table of directions, found by their heads. All rows are checked when the table is read.

    ``angles_beside``: a row may have angles beside its direction.
    """

    def __init__(
        self, path: Path, heads: Path, angles: Sequence[str], clip: Clip, *, angles_beside: bool = False
    ) -> None:
        columns = (*DIRECTION, *(f"{name}{unit}" for name in (*angles, "sigma") for unit in _UNITS))
        self._paths = [("directions", path), ("heads", heads)]
        self._heads = read_heads(heads, clip)
        self._rows: dict[tuple[int, str], Row] = {}
        for row in read_table(path, columns, clip.frames):
            if row.subject not in self._heads.get(row.frame, {}):
                raise VfoaError(f"{row.where}: subject {row.subject!r} has no head in frame {row.frame} of {heads}")
            found = _angles(row, angles)
            if _direction(row) is None:
                _required(found, row, angles)
            elif found is not None and not angles_beside:
                raise VfoaError(f"{row.where}: found x, y, z and {', '.join(angles)}; expected one of them")
            _sigma(row)
            self._rows[row.frame, row.subject] = row

    def digest(self) -> str:
        """Hexadecimal sha256 of both tables."""
        return digest_files(self._paths)

    def find(self, frame: int, head: Head) -> tuple[Row, Head] | None:
        """Return the row of a head and that subject's own boxes; None for a head that belongs to no subject."""
        heads = self._heads.get(frame, {})
        # Of equal boxes, take the one with the same instance; if these are also equal, the first.
        overlaps = [
            (box_iou(each.box_px, head.box_px), each.instance_id == head.instance_id, subject)
            for subject, each in heads.items()
        ]
        overlap, _, subject = max(overlaps, key=lambda each: each[:2], default=(0.0, False, ""))
        row = self._rows.get((frame, subject))
        return (row, heads[subject]) if row and overlap >= LEAST_OVERLAP else None


def _direction(row: Row) -> Float | None:
    direction = row.numbers(DIRECTION)
    if direction is not None and abs((length := math.hypot(*direction)) - 1) > _LENGTH_TOLERANCE:
        raise VfoaError(f"{row.where}: x, y, z: expected a unit direction, found one of length {length:.4g}")
    return direction


def _angles(row: Row, names: Sequence[str]) -> Float | None:
    """Angles in radians, from the columns in degrees or in radians; None if both are blank."""
    degrees, radians = (row.numbers([f"{name}{unit}" for name in names]) for unit in _UNITS)
    if degrees is not None and radians is not None:
        raise VfoaError(f"{row.where}: {names[0]}: found degrees and radians; expected one of them")
    return radians if degrees is None else np.radians(degrees)


def _sigma(row: Row) -> float | None:
    found = _angles(row, ["sigma"])
    if found is not None and found[0] < 0:
        raise VfoaError(f"{row.where}: sigma: expected an angle of at least 0, found {found[0]:g} rad")
    return None if found is None else float(found[0])


def _required(angles: Float | None, row: Row, names: Sequence[str]) -> Float:
    if angles is None:
        raise VfoaError(f"{row.where}: no direction; expected x, y, z or {', '.join(f'{name}_deg' for name in names)}")
    return angles


def _from_crop(direction_crop: Float, boxes: Head, frame: StereoFrame) -> Float:
    u, v = center(boxes.box_px if boxes.face_box_px is None else boxes.face_box_px)
    return direction_from_crop(direction_crop, pixel_ray(u, v, frame.rig))
