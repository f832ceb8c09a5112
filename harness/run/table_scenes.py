"""The scenes of a run, with the directions of their people, read from its tables frame by frame: what methods take."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.run.frame_sink import Camera
from harness.run.records import TargetRecord
from harness.run.table_files import Row, frames_of, read_columns
from harness.run.table_records import rows_by_frame, target_record
from vfoa.errors import VfoaError
from vfoa.tracking import Tracked
from vfoa.types import (
    Box3D,
    Cues,
    Float,
    Gaze,
    Head,
    HeadPose,
    HeadView,
    Instance,
    NoGaze,
    Person,
    Scene,
    StereoRig,
    Target,
)


class SceneFrame(NamedTuple):
    """A frame of a run's tables: the scene, the tracks of its people, and the names of people by track.

    ``camera`` is None for a clip without images. ``targets`` are the records of the scene's targets, which have the
    numbers of all 3D points; the scene has fewer.
    """

    scene: Scene
    tracked: Tracked
    names: Mapping[int, str]
    camera: Camera | None
    targets: tuple[TargetRecord, ...]


def read_scenes(paths: Mapping[str, Path], cloud_points: int = 0) -> Iterator[SceneFrame]:
    """Yield the frames of a scene and its directions.

    Targets have ``cloud_points`` points, and with 0 none; people who were not followed are left out.

    Parameters
    ----------
    paths
        The files of the tables, as :func:`harness.run.table_files.find_tables` gives them.

    Raises
    ------
    VfoaError
        If a table is missing, damaged or of another version; :class:`NoCloudsError` if it has no clouds of so many
        points.
    """
    groups = frames_of(paths["frames"])
    last, followed = _last_frames(paths["people"], len(groups)), frozenset[int]()
    for group, numbers in enumerate(groups):
        frames = rows_by_frame(paths["frames"], "frames", group, numbers)
        tables = ("instances", "people", "directions", *(("clouds",) if cloud_points else ()))
        parts = [rows_by_frame(paths[table], table, group, numbers) for table in tables]
        for number, ((time_ns, masks_from, masks_age_s, *more),), instances, people, looks, *clouds in zip(
            numbers, frames, *parts, strict=True
        ):
            if clouds:
                points = _clouds(clouds[0], cloud_points)
                targets = tuple(_target(row, points, paths["clouds"], cloud_points) for row in instances)
            else:
                targets = tuple(map(_bare_target, instances))
            names = {row[0]: row[1] for row in instances}
            ids = tuple(row[0] for row in people)
            if ids != tuple(row[0] for row in looks):
                raise VfoaError(f"{paths['directions']}: frame {number}: expected the tracks of people, {ids}")
            followed |= {*ids}
            yield SceneFrame(
                scene=Scene(
                    index=number,
                    time_ns=time_ns,
                    targets=targets,
                    people=tuple(map(_person, people, looks)),
                    masks_from=masks_from,
                    masks_age_s=masks_age_s,
                    names=names,
                    looked_at={row[1]: row[5] for row in people if row[5] is not None},
                ),
                tracked=Tracked(ids=ids, open=followed),
                names={row[0]: row[1] for row in people if row[1] is not None},
                camera=_camera(*more[4:]),
                targets=tuple(map(target_record, instances)),
            )
            followed -= {track for track in ids if last[track] == number}


Clouds = Mapping[int, np.ndarray]
"""The points (N, 3) of the targets of a frame that have any, by instance."""


class NoCloudsError(VfoaError):
    """A scene has no clouds of the points that a method asks for."""


def _clouds(rows: Iterable[Row], cloud_points: int) -> Clouds:
    """The clouds with ``cloud_points`` points, from the rows of ``clouds`` of a frame."""
    return {
        number: np.array(points, dtype=np.float32).reshape(-1, 3)
        for number, count, points in rows
        if count == cloud_points
    }


def _camera(*values: Any) -> Camera | None:
    """The camera from the last columns of ``frames``."""
    *rig, has_right, has_depth = values
    if rig[0] is None:
        return None
    of_rig = dict(zip((each.name for each in fields(StereoRig)), rig, strict=True))
    return Camera(rig=StereoRig(**of_rig), has_right=has_right, has_depth=has_depth)


def _last_frames(path: Path, groups: int) -> dict[int, int]:
    """The last frame of each track: after it, nobody needs to remember the person."""
    last: dict[int, int] = {}
    for group in range(groups):
        frames, tracks, *_ = read_columns(path, "people", group)
        last.update(zip(tracks, frames, strict=True))
    return last


def _target(row: Row, clouds: Clouds, path: Path, cloud_points: int) -> Target:
    """The target of a row of ``instances``, with its cloud."""
    number, count = row[0], row[8]
    if number in clouds:
        return replace(_bare_target(row), points_left=clouds[number])
    if count:
        raise NoCloudsError(
            f"{path}: found no clouds of {cloud_points} points, which the method asks for; run the experiment with "
            "these settings"
        )
    return _bare_target(row)


@lru_cache(maxsize=1024)
def _bare_target(row: Row) -> Target:
    """The target of a row of ``instances``, without a cloud: the same one for rows that are equal."""
    number, _, label, own_name, category_id, is_thing, score, box_px, _, center_m, half_size_m, axes, depth_from = row
    return Target(
        instance=Instance(
            id=number, label=label, category_id=category_id, is_thing=is_thing, score=score, name=own_name
        ),
        box_px=None if box_px is None else np.array(box_px),
        points_left=np.zeros((0, 3), dtype=np.float32),
        box=None
        if center_m is None
        else Box3D(
            center_m=np.array(center_m),
            half_size_m=np.array(half_size_m),
            left_from_box=np.array(axes).reshape(3, 3).T.copy(),
        ),
        depth_from=depth_from,
    )


def _person(person: Row, look: Row) -> Person:
    _, _, instance_id, head_box_px, head_score, _ = person
    _, eye_origin_m, gaze, gaze_sigma_rad, no_gaze, head, head_sigma_rad, _, depth_from = look
    cues: dict[str, Any] = {
        "head_pose": None if head is None else HeadPose(direction=np.array(head), sigma_rad=head_sigma_rad),
        "gaze": None if gaze is None else Gaze(direction=np.array(gaze), sigma_rad=gaze_sigma_rad),
        "no_gaze": None if no_gaze is None else NoGaze(cause=no_gaze),
    }
    in_image = head_box_px is not None
    view = HeadView(head=Head(box_px=np.array(head_box_px), score=head_score), **cues) if in_image else Cues(**cues)
    eyes_m = _array(eye_origin_m)
    return Person(view=view, instance_id=instance_id, eye_origin_left=eyes_m, depth_from=depth_from)


def _array(numbers: tuple[float, ...] | None) -> Float | None:
    return None if numbers is None else np.array(numbers)
