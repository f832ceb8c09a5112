"""Attend again: the scenes and directions of a run become answers under other settings, without images and stages.

Scenes are read once for all configurations that share them, and attended to frame by frame in their order, as in the
loop (:mod:`harness.run.loop`), so that equal settings give equal answers.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.pipeline.configuration import METHODS_OF_CLIP
from harness.pipeline.stage_runner import guarded
from harness.run.answers import answer_rows, filtered_cues
from harness.run.directory import Pair, RunDirectory
from harness.run.records import to_record
from harness.run.table_records import frames_of, rows_by_frame
from harness.run.tables import Row, find_tables, read_columns
from vfoa.config import dotted_tables, read_steps
from vfoa.errors import VfoaError, check_known
from vfoa.pipeline import Attending, AttendSettings
from vfoa.tracking import Tracked
from vfoa.types import (
    Box3D,
    Cues,
    Float,
    FrameResult,
    Gaze,
    Head,
    HeadPose,
    HeadView,
    Instance,
    NoGaze,
    Person,
    Scene,
    Target,
)

CHANGEABLE = ("attention", "gaze_filter")
"""Tables of a configuration that decide neither scenes nor directions."""


class SceneFrame(NamedTuple):
    """A frame of a run's tables: the scene, the tracks of its people, and the names of people by track."""

    scene: Scene
    tracked: Tracked
    names: Mapping[int, str]


def read_scenes(paths: Mapping[str, Path], cloud_points: int = 0) -> Iterator[SceneFrame]:
    """Yield the frames of a scene and its directions.

    Targets have ``cloud_points`` points, and with 0 none; people who were not followed are left out.

    Parameters
    ----------
    paths
        The files of the tables, as :func:`harness.run.tables.find_tables` gives them.

    Raises
    ------
    VfoaError
        If a table is missing, damaged or of another version, or has no clouds of so many points.
    """
    groups = frames_of(paths["frames"])
    last = _last_frames(paths["people"], len(groups))
    for group, numbers in enumerate(groups):
        frames = rows_by_frame(paths["frames"], "frames", group, numbers)
        tables = ("instances", "people", "directions", *(("clouds",) if cloud_points else ()))
        parts = [rows_by_frame(paths[table], table, group, numbers) for table in tables]
        for number, ((time_ns, masks_from, masks_age_s, *_),), instances, people, looks, *clouds in zip(
            numbers, frames, *parts, strict=True
        ):
            points = {row[0]: row[2] for row in clouds[0] if row[1] == cloud_points} if clouds else None
            targets = tuple(_target(row, points, paths["clouds"], cloud_points) for row in instances)
            names = {row[0]: row[1] for row in instances}
            ids = tuple(row[0] for row in people)
            if ids != tuple(row[0] for row in looks):
                raise VfoaError(f"{paths['directions']}: frame {number}: expected the tracks of people, {ids}")
            yield SceneFrame(
                scene=Scene(
                    index=number,
                    time_ns=time_ns,
                    targets=targets,
                    people=tuple(map(_person, people, looks)),
                    masks_from=masks_from,
                    masks_age_s=masks_age_s,
                    names=names,
                ),
                tracked=Tracked(ids=ids, open=frozenset(track for track, end in last.items() if end >= number)),
                names={row[0]: row[1] for row in people if row[1] is not None},
            )


def _last_frames(path: Path, groups: int) -> dict[int, int]:
    """The last frame of each track: after it, nobody needs to remember the person."""
    last: dict[int, int] = {}
    for group in range(groups):
        frames, tracks, *_ = read_columns(path, "people", group)
        last.update(zip(tracks, frames, strict=True))
    return last


def _target(row: Row, points: Mapping[int, Any] | None, path: Path, cloud_points: int) -> Target:
    number, _, label, own_name, category_id, is_thing, score, box_px, count, center_m, half_size_m, axes = row
    if points is not None and count and number not in points:
        raise VfoaError(
            f"{path}: found no clouds of {cloud_points} points, which the method asks for; run the experiment with "
            "these settings"
        )
    return Target(
        instance=Instance(
            id=number, label=label, category_id=category_id, is_thing=is_thing, score=score, name=own_name
        ),
        box_px=None if box_px is None else np.array(box_px),
        points_left=np.array((points or {}).get(number, ()), dtype=np.float32).reshape(-1, 3),
        box=None
        if center_m is None
        else Box3D(
            center_m=np.array(center_m),
            half_size_m=np.array(half_size_m),
            left_from_box=np.array(axes).reshape(3, 3).T.copy(),
        ),
    )


def _person(person: Row, look: Row) -> Person:
    _, _, instance_id, head_box_px, head_score = person
    _, eye_origin_m, gaze, gaze_sigma_rad, no_gaze, head, head_sigma_rad, _ = look
    cues: dict[str, Any] = {
        "head_pose": None if head is None else HeadPose(direction=np.array(head), sigma_rad=head_sigma_rad),
        "gaze": None if gaze is None else Gaze(direction=np.array(gaze), sigma_rad=gaze_sigma_rad),
        "no_gaze": None if no_gaze is None else NoGaze(cause=no_gaze),
    }
    in_image = head_box_px is not None
    view = HeadView(head=Head(box_px=np.array(head_box_px), score=head_score), **cues) if in_image else Cues(**cues)
    return Person(view=view, instance_id=instance_id, eye_origin_left=_array(eye_origin_m))


def _array(numbers: tuple[float, ...] | None) -> Float | None:
    return None if numbers is None else np.array(numbers)


def attend_scenes(
    paths: Mapping[str, Path], settings: Mapping[str, AttendSettings]
) -> Iterator[tuple[str, FrameResult]]:
    """Attend to the frames of a scene and its directions under each of these settings.

    Yields the name of the settings and a frame's result: for each name in the order of the frames.

    Raises
    ------
    VfoaError
        As :func:`read_scenes`, or if a method fails.
    """
    attending = {name: guarded("attention", Attending, each) for name, each in settings.items()}
    clouds = {each.attention.cloud_points for each in settings.values()}
    if len(clouds) > 1:
        raise ValueError(f"found settings with {sorted(clouds)} points of a cloud; expected the same number")
    for frame in read_scenes(paths, *clouds):
        for name, each in attending.items():
            for result in guarded("attention", each.step, frame.scene, frame.tracked, frame.names):
                yield name, result
    for name, each in attending.items():
        for result in guarded("attention", each.finish):
            yield name, result


def attend_again(
    directory: RunDirectory, changes: Mapping[str, Any], configurations: Collection[str] = ()
) -> Iterator[tuple[dict[str, str], list[Row]]]:
    """Yield the answers of a finished run's configurations with changed settings: keys and rows of each table.

    Tables come by clip and configuration, as the experiment has them. ``changes`` are settings by dotted key, such as
    ``attention.cones_cm``; without a configuration, all are changed.

    Raises
    ------
    VfoaError
        If a key, a value or a configuration is wrong, a setting decides what is perceived, or as :func:`read_scenes`.
    """
    plain: dict[str, Any] = directory.read_manifest()["configurations"]
    for name in configurations:
        check_known(name, plain, f"{directory.path}: no configuration")
    tables = dict(find_tables(directory))
    pairs = [pair for pair in tables if not configurations or pair[1] in configurations]
    settings = {name: _changed(plain[name], changes, name) for name in dict.fromkeys(name for _, name in pairs)}
    alike: dict[tuple[Path, Path, int], list[Pair]] = {}
    for pair in pairs:
        paths, points = tables[pair], settings[pair[1]].attention.cloud_points
        alike.setdefault((paths["frames"], paths["directions"], points), []).append(pair)
    rows: dict[Pair, list[Row]] = {pair: [] for pair in pairs}
    for group in alike.values():
        clip = group[0][0]
        of_clip = {name: _of_clip(settings[name], clip) for _, name in group}
        filtered = {name: filtered_cues(each.model_dump(mode="json")) for name, each in of_clip.items()}
        for name, result in attend_scenes(tables[group[0]], of_clip):
            rows[clip, name].extend(answer_rows(to_record(clip, name, result), filtered[name]))
    for pair, of_pair in rows.items():
        scene, directions = (tables[pair][table].parts[-3] for table in ("frames", "directions"))
        yield {"clip": pair[0], "scene": scene, "directions": directions, "configuration": pair[1]}, of_pair


def _of_clip(settings: AttendSettings, clip: str) -> AttendSettings:
    return settings.model_copy(update={"attention": settings.attention.for_clip(clip)})


def _changed(plain: Mapping[str, Any], changes: Mapping[str, Any], configuration: str) -> AttendSettings:
    """The settings of a configuration in a run's manifest with these changes."""
    for dotted in changes:
        if dotted.partition(".")[0] not in CHANGEABLE:
            raise VfoaError(
                f"attend: {dotted}: expected settings of {' and '.join(CHANGEABLE)}, which decide nothing that is "
                "perceived; run the experiment with this one"
            )
    tables = {step: plain[step] for step in ("tracking", *CHANGEABLE)}
    for table, changed in dotted_tables(changes.items(), CHANGEABLE, "attend").items():
        is_other = changed.get("method", tables[table].get("method")) != tables[table].get("method")
        tables[table] = changed if is_other else {**tables[table], **changed}
    method = tables["attention"]["method"]
    if method in METHODS_OF_CLIP:
        raise VfoaError(f'attend: {configuration}: attention.method = "{method}" reads the clip; run the experiment')
    return read_steps(tables, None, f"attend: {configuration}")[1]
