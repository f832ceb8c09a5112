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

from harness.files.digests import digest_files
from harness.pipeline.ground_truth import LEAST_OVERLAP
from harness.pipeline.outputs.heads import FrameTable, RowIndex, read_heads, read_table
from harness.remote import expand
from harness.sources import Clip
from vfoa.crops import center
from vfoa.geometry import box_iou, direction_from_crop, gaze_direction_crop, head_direction_crop, pixel_ray
from vfoa.settings import Settings
from vfoa.types import Float, Gaze, Head, HeadPose, StereoFrame

DIRECTION = ("x", "y", "z")
HEAD_ANGLES = ("yaw", "pitch", "roll")
GAZE_ANGLES = ("theta", "phi")
_UNITS = ("_deg", "_rad")
_LENGTH_TOLERANCE = 0.01


class FileDirectionSettings(Settings):
    """Location of the directions: the table ``file`` under ``root``; ``heads``, relative to ``root``, has the boxes."""

    root: str
    """Folder of the tables; ``${CLIP}`` stands for the clip's name."""
    file: str = Field(min_length=1)
    """Table of directions below ``root``."""
    heads: str = Field(default="heads.csv", min_length=1)
    """Table of head boxes below ``root``; it joins each row to a head."""


class FileHeadPoseSettings(FileDirectionSettings):
    """Location of the poses."""

    file: str = Field(default="head_pose.csv", min_length=1)
    """Table of head poses below ``root``."""


class FileGazeSettings(FileDirectionSettings):
    """Location of the gazes."""

    file: str = Field(default="gaze.csv", min_length=1)
    """Table of gaze directions below ``root``."""


class _OfFile:
    """A model that reads its answers from a table."""

    _rows: _JoinedRows

    def digest(self) -> str:
        """Hexadecimal sha256 of both tables."""
        return self._rows.digest()


class FileHeadPose(_OfFile):
    """A head-pose model that reads poses from a table, with the model's angles if the table has them."""

    Settings = FileHeadPoseSettings

    def __init__(self, settings: FileHeadPoseSettings, clip: Clip) -> None:
        self._rows = _JoinedRows(settings, "head_pose.root", HEAD_ANGLES, clip, angles_beside=True)

    def estimate(self, frame: StereoFrame, head: Head) -> HeadPose | None:
        """Return the pose of one head, or None."""
        match = self._rows.find(frame.index, head)
        if match is None:
            return None
        row, boxes = match
        yaw, pitch, roll = self._rows.angles[row].tolist()
        direction = self._rows.direction(row)
        if direction is None:
            direction = _from_crop(head_direction_crop(yaw, pitch), boxes, frame)
        sigma = self._rows.sigma(row)
        return HeadPose(direction=direction, yaw_rad=yaw, pitch_rad=pitch, roll_rad=roll, sigma_rad=sigma)


class FileGaze(_OfFile):
    """A gaze model that reads gaze directions from a table."""

    Settings = FileGazeSettings

    def __init__(self, settings: FileGazeSettings, clip: Clip) -> None:
        self._rows = _JoinedRows(settings, "gaze.root", GAZE_ANGLES, clip)

    def estimate(self, frame: StereoFrame, head: Head, head_pose: HeadPose | None) -> Gaze | None:
        """Return the gaze of one head, or None."""
        match = self._rows.find(frame.index, head)
        if match is None:
            return None
        row, boxes = match
        direction = self._rows.direction(row)
        if direction is None:
            theta, phi = self._rows.angles[row].tolist()
            direction = _from_crop(gaze_direction_crop(theta, phi), boxes, frame)
        return Gaze(direction=direction, sigma_rad=self._rows.sigma(row))


class _JoinedRows:
    """The rows of a table of directions, found by their heads. All rows are checked when the table is read.

    ``angles`` (n, k), in radians, are NaN in rows without them. ``angles_beside``: a row may have angles beside its
    direction.
    """

    def __init__(
        self,
        settings: FileDirectionSettings,
        where: str,
        angles: Sequence[str],
        clip: Clip,
        *,
        angles_beside: bool = False,
    ) -> None:
        root = expand(settings.root, Path.cwd(), where)
        path, heads = root / settings.file, root / settings.heads
        columns = (*DIRECTION, *(f"{name}{unit}" for name in (*angles, "sigma") for unit in _UNITS))
        self._paths = [("directions", path), ("heads", heads)]
        self._heads = read_heads(heads, clip)
        table = read_table(path, columns, clip.frames)
        table.reject(
            ~self._heads.has(table.frames.tolist(), table.subjects),
            lambda row: f"subject {table.subjects[row]!r} has no head in frame {table.frames[row]} of {heads}",
        )
        self.angles = _angles(table, angles)
        self._directions = _directions(table)
        self._sigmas = _sigmas(table)
        self._subjects, self._rows = table.subjects, RowIndex(table.frames)
        has_angles, has_direction = ~np.isnan(self.angles[:, 0]), ~np.isnan(self._directions[:, 0])
        in_degrees = ", ".join(f"{name}_deg" for name in angles)
        table.reject(~(has_angles | has_direction), lambda row: f"no direction; expected x, y, z or {in_degrees}")
        table.reject(
            has_angles & has_direction & (not angles_beside),
            lambda row: f"found x, y, z and {', '.join(angles)}; expected one of them",
        )

    def direction(self, row: int) -> Float | None:
        """The direction (3,) in a row; None if it has angles alone."""
        direction: Float = self._directions[row]
        return None if math.isnan(direction[0]) else direction

    def sigma(self, row: int) -> float | None:
        """The claimed error in a row, radians."""
        sigma_rad = float(self._sigmas[row])
        return None if math.isnan(sigma_rad) else sigma_rad

    def digest(self) -> str:
        """Hexadecimal sha256 of both tables."""
        return digest_files(self._paths)

    def find(self, frame: int, head: Head) -> tuple[int, Head] | None:
        """Return the row of a head and that subject's own boxes; None for a head that belongs to no subject."""
        heads = self._heads.of(frame)
        # Of equal boxes, take the one with the same instance; if these are also equal, the first.
        overlaps = [
            (box_iou(boxes.box_px, head.box_px), boxes.instance_id == head.instance_id, subject)
            for subject, boxes in heads.items()
        ]
        overlap, _, subject = max(overlaps, key=lambda candidate: candidate[:2], default=(0.0, False, ""))
        row = next((row for row in self._rows.of(frame) if self._subjects[row] == subject), None)
        return (row, heads[subject]) if row is not None and overlap >= LEAST_OVERLAP else None


def _directions(table: FrameTable) -> Float:
    """Unit directions (n, 3), NaN where they are blank."""
    directions = table.columns.group(DIRECTION)
    lengths = np.linalg.norm(directions, axis=1)
    table.reject(
        np.abs(lengths - 1) > _LENGTH_TOLERANCE,
        lambda row: f"x, y, z: expected a unit direction, found one of length {lengths[row]:.4g}",
    )
    return directions


def _angles(table: FrameTable, names: Sequence[str]) -> Float:
    """Angles (n, names) in radians, from the columns in degrees or in radians; NaN where both are blank."""
    degrees, radians = (table.columns.group([f"{name}{unit}" for name in names]) for unit in _UNITS)
    in_degrees, in_radians = ~np.isnan(degrees[:, :1]), ~np.isnan(radians[:, :1])
    table.reject(
        (in_degrees & in_radians)[:, 0],
        lambda row: f"{names[0]}: found degrees and radians; expected one of them",
    )
    return np.where(in_degrees, np.radians(degrees), radians)


def _sigmas(table: FrameTable) -> Float:
    """Claimed errors (n,) in radians, NaN where they are blank."""
    sigmas: Float = _angles(table, ["sigma"])[:, 0]
    table.reject(sigmas < 0, lambda row: f"sigma: expected an angle of at least 0, found {sigmas[row]:g} rad")
    return sigmas


def _from_crop(direction_crop: Float, boxes: Head, frame: StereoFrame) -> Float:
    u, v = center(boxes.box_px if boxes.face_box_px is None else boxes.face_box_px)
    return direction_from_crop(direction_crop, pixel_ray(u, v, frame.rig))
