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
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from harness.files.digests import digest_files
from harness.files.remote import expand
from harness.pipeline.ground_truth import LEAST_OVERLAP
from harness.pipeline.stage_files.heads import FrameTable, read_heads, read_table
from harness.sources import Clip
from vfoa.crops import center
from vfoa.errors import VfoaError
from vfoa.geometry import box_iou, direction_from_crop, gaze_direction_crop, head_direction_crop, pixel_ray
from vfoa.settings import Settings
from vfoa.types import Float, Gaze, Head, HeadPose, StereoFrame

DIRECTION = ("x", "y", "z")
HEAD_ANGLES = ("yaw", "pitch", "roll")
_UNITS = ("_deg", "_rad")
_LENGTH_TOLERANCE = 0.01
_MOST_RAD = 2 * math.pi
_MANY_ROWS, _QUARTER_TURN_RAD = 20, 1.58
"""Rows of which some are further than this, in degrees, from looking into the camera; in radians most are not."""
_LARGEST_SIGMA_RAD = math.radians(30)
"""No model of faces claims an error of so few degrees."""


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


class _FileDirections:
    """A model that reads its answers from a table; a row belongs to the head of its subject.

    All rows are checked when the table is read.
    """

    slot: ClassVar[Literal["head_pose", "gaze"]]
    angles: ClassVar[tuple[str, ...]]
    may_have_both: ClassVar[bool] = False
    """Whether a row may have angles beside its direction."""

    def __init__(self, settings: FileDirectionSettings, clip: Clip) -> None:
        root = expand(settings.root, Path.cwd(), f"{self.slot}.root")
        path, heads = root / settings.file, root / settings.heads
        columns = (*DIRECTION, *(f"{name}{unit}" for name in (*self.angles, "sigma") for unit in _UNITS))
        self._paths = [("directions", path), ("heads", heads)]
        self._heads = read_heads(heads, clip)
        table = read_table(path, self.slot, columns, clip.frames)
        self._keys = table.keys()
        table.columns.refuse_first(
            ~self._heads.has(table),
            lambda row: f"subject {table.subjects[row]!r} has no head in frame {table.frames[row]} of {heads}",
        )
        self._angles, self._directions, self._sigmas = _angles(table, self.angles), _directions(table), _sigmas(table)
        _check_degrees(table, self.angles, _QUARTER_TURN_RAD)
        _check_degrees(table, ["sigma"], _LARGEST_SIGMA_RAD)
        has_angles, has_direction = ~np.isnan(self._angles[:, 0]), ~np.isnan(self._directions[:, 0])
        in_degrees = ", ".join(f"{name}_deg" for name in self.angles)
        table.columns.refuse_first(
            ~(has_angles | has_direction), lambda row: f"no direction; expected x, y, z or {in_degrees}"
        )
        table.columns.refuse_first(
            has_angles & has_direction & (not self.may_have_both),
            lambda row: f"found x, y, z and {', '.join(self.angles)}; expected one of them",
        )

    def digest(self) -> str:
        """Hexadecimal sha256 of both tables."""
        return digest_files(self._paths)

    def find(
        self, frame: StereoFrame, head: Head, from_angles: Callable[..., Float]
    ) -> tuple[Float, list[float], float | None] | None:
        """Return the direction (3,), the angles and the claimed error of a head, radians; None if it has no row.

        Angles that a row lacks are NaN. ``from_angles`` makes a direction of them, in the crop's axes.
        """
        heads = self._heads.of(frame.index)
        # Of equal boxes, take the one with the same instance; if these are also equal, the first.
        overlaps = [
            (box_iou(boxes.box_px, head.box_px), boxes.instance_id == head.instance_id, subject)
            for subject, boxes in heads.items()
        ]
        overlap, _, subject = max(overlaps, key=lambda candidate: candidate[:2], default=(0.0, False, ""))
        row = next((row for row in self._keys.rows(frame.index) if self._keys.subjects[row] == subject), None)
        if row is None or overlap < LEAST_OVERLAP:
            return None
        angles, direction, sigma_rad = self._angles[row].tolist(), self._directions[row], float(self._sigmas[row])
        if math.isnan(direction[0]):
            direction = _from_crop(from_angles(*angles), heads[subject], frame)
        return direction, angles, None if math.isnan(sigma_rad) else sigma_rad


class FileHeadPose(_FileDirections):
    """A head-pose model that reads poses from a table, with the model's angles if the table has them."""

    Settings = FileHeadPoseSettings
    slot, angles, may_have_both = "head_pose", HEAD_ANGLES, True

    def estimate(self, frame: StereoFrame, head: Head) -> HeadPose | None:
        """Return the pose of one head, or None."""
        if (found := self.find(frame, head, lambda yaw, pitch, roll: head_direction_crop(yaw, pitch))) is None:
            return None
        direction, (yaw, pitch, roll), sigma = found
        return HeadPose(direction=direction, yaw_rad=yaw, pitch_rad=pitch, roll_rad=roll, sigma_rad=sigma)


class FileGaze(_FileDirections):
    """A gaze model that reads gaze directions from a table."""

    Settings = FileGazeSettings
    slot, angles = "gaze", ("theta", "phi")

    def estimate(self, frame: StereoFrame, head: Head, head_pose: HeadPose | None) -> Gaze | None:
        """Return the gaze of one head, or None."""
        if (found := self.find(frame, head, gaze_direction_crop)) is None:
            return None
        direction, _, sigma = found
        return Gaze(direction=direction, sigma_rad=sigma)


def _directions(table: FrameTable) -> Float:
    """Unit directions (n, 3), NaN where they are blank."""
    directions = table.columns.group(DIRECTION)
    lengths = np.linalg.norm(directions, axis=1)
    table.columns.refuse_first(
        np.abs(lengths - 1) > _LENGTH_TOLERANCE,
        lambda row: f"x, y, z: expected a unit direction, found one of length {lengths[row]:.4g}",
    )
    return directions


def _angles(table: FrameTable, names: Sequence[str]) -> Float:
    """Angles (n, names) in radians, from the columns in degrees or in radians; NaN where both are blank."""
    degrees, radians = (table.columns.group([f"{name}{unit}" for name in names]) for unit in _UNITS)
    in_degrees, in_radians = ~np.isnan(degrees[:, :1]), ~np.isnan(radians[:, :1])
    most = np.nanmax(np.abs(radians), axis=1, initial=0.0)
    table.columns.refuse_first(
        most > _MOST_RAD,
        lambda row: (
            f"{', '.join(f'{name}_rad' for name in names)}: found {', '.join(f'{each:g}' for each in radians[row])}; "
            f"expected radians, at most {_MOST_RAD:.3g}, or columns of degrees ({names[0]}_deg)"
        ),
    )
    table.columns.refuse_first(
        (in_degrees & in_radians)[:, 0],
        lambda row: f"{names[0]}: found degrees and radians; expected one of them",
    )
    return np.where(in_degrees, np.radians(degrees), radians)


def _check_degrees(table: FrameTable, names: Sequence[str], most_rad: float) -> None:
    """Raise a :class:`VfoaError` for degrees that are probably radians: many rows, and none above ``most_rad``."""
    columns = [f"{name}_deg" for name in names]
    degrees = np.abs(table.columns.group(columns))
    count, most = np.count_nonzero(~np.isnan(degrees[:, 0])), np.nanmax(degrees, initial=0.0)
    if count >= _MANY_ROWS and 0 < most <= most_rad:
        raise VfoaError(
            f"{table.columns.path}: {', '.join(columns)}: found at most {most:.3g} in {count} rows; expected degrees, "
            f"or columns of radians ({names[0]}_rad)"
        )


def _sigmas(table: FrameTable) -> Float:
    """Claimed errors (n,) in radians, NaN where they are blank."""
    sigmas: Float = _angles(table, ["sigma"])[:, 0]
    table.columns.refuse_first(
        sigmas < 0, lambda row: f"sigma: expected an angle of at least 0, found {sigmas[row]:g} rad"
    )
    return sigmas


def _from_crop(direction_crop: Float, boxes: Head, frame: StereoFrame) -> Float:
    u, v = center(boxes.box_px if boxes.face_box_px is None else boxes.face_box_px)
    return direction_from_crop(direction_crop, pixel_ray(u, v, frame.rig))
