"""Attend: the scenes and directions of a run become answers, without images and stages.

Scenes are read once for all configurations that share them, and attended to frame by frame in their order. A run
attends to a clip when it is perceived (:mod:`harness.run.loop`), and a script to a finished run under other settings.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import fields, replace
from functools import lru_cache
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np

from harness.pipeline.configuration import METHODS_OF_CLIP, Configuration, open_method
from harness.pipeline.stage_runner import Timings, guarded, timed
from harness.run.answers import AnswerWriter, answer_rows, filtered_cues
from harness.run.directory import Pair, RunDirectory
from harness.run.frame_sink import Camera, ClipContext, FinishedFrame, FrameSink, SinkContext, SinkFactory
from harness.run.records import TargetRecord, to_record
from harness.run.scenes import Keys, paths_of
from harness.run.table_files import Row, find_tables, frames_of, read_columns
from harness.run.table_records import rows_by_frame, target_record
from harness.sources import Clip, MeasuredClip
from vfoa.config import dotted_tables, read_steps
from vfoa.errors import StageError, VfoaError, check_known
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
    StereoRig,
    Target,
)

CHANGEABLE = ("attention", "gaze_filter")
"""Tables of a configuration that decide neither scenes nor directions."""


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
        If a table is missing, damaged or of another version, or has no clouds of so many points.
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
            points = {row[0]: row[2] for row in clouds[0] if row[1] == cloud_points} if clouds else None
            targets = tuple(
                _bare_target(row) if points is None else _target(row, points, paths["clouds"], cloud_points)
                for row in instances
            )
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


def read_clouds(paths: Mapping[str, Path], cloud_points: int) -> Iterator[Clouds]:
    """Yield the clouds of so many points of each frame, in the order of :func:`read_scenes`. Raises the same errors."""
    for group, numbers in enumerate(frames_of(paths["frames"])):
        for rows in rows_by_frame(paths["clouds"], "clouds", group, numbers):
            yield {row[0]: _points(row[2]) for row in rows if row[1] == cloud_points}


def _points(numbers: Sequence[float]) -> np.ndarray:
    return np.array(numbers, dtype=np.float32).reshape(-1, 3)


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


def _target(row: Row, clouds: Mapping[int, Any], path: Path, cloud_points: int) -> Target:
    """The target of a row of ``instances``, with its cloud."""
    number, count = row[0], row[8]
    if count and number not in clouds:
        raise VfoaError(
            f"{path}: found no clouds of {cloud_points} points, which the method asks for; run the experiment with "
            "these settings"
        )
    return replace(_bare_target(row), points_left=_points(clouds.get(number, ())))


@lru_cache(maxsize=1024)
def _bare_target(row: Row) -> Target:
    """The target of a row of ``instances``, without a cloud: the same one for rows that are equal."""
    number, _, label, own_name, category_id, is_thing, score, box_px, _, center_m, half_size_m, axes = row
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
    )


def _person(person: Row, look: Row) -> Person:
    _, _, instance_id, head_box_px, head_score, _ = person
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


class Attended(NamedTuple):
    """A frame, the seconds that it took, and its result."""

    frame: SceneFrame
    timings: Timings
    result: FrameResult


class Attender:
    """Attends to the frames of a clip in their order. A smoothed method finishes a frame when later ones are known."""

    def __init__(self, attending: Attending) -> None:
        self._attending = attending
        self._waiting: deque[tuple[SceneFrame, Timings]] = deque()

    def step(self, frame: SceneFrame) -> list[Attended]:
        """Attend to the next frame; return the frames that are finished now. Raises the errors of the method."""
        timings: Timings = {}
        with timed(timings, "attention"):
            ready = guarded("attention", self._attending.step, frame.scene, frame.tracked, frame.names)
        self._waiting.append((frame, timings))
        return self._finished(ready)

    def finish(self) -> list[Attended]:
        """Return the frames that wait for later ones. Raises the errors of the method."""
        return self._finished(guarded("attention", self._attending.finish))

    def _finished(self, ready: Iterable[FrameResult]) -> list[Attended]:
        return [Attended(*self._waiting.popleft(), result) for result in ready]


def attend_scenes(
    paths: Mapping[str, Path], settings: Mapping[str, AttendSettings]
) -> Iterator[tuple[str, SceneFrame, FrameResult]]:
    """Attend to the frames of a scene and its directions under each of these settings.

    Yields the name of the settings, a frame and its result: for each name in the order of the frames.

    Raises
    ------
    VfoaError
        As :func:`read_scenes`, or if a method fails.
    """
    attenders = {name: Attender(guarded("attention", Attending, each)) for name, each in settings.items()}
    clouds = {each.attention.cloud_points for each in settings.values()}
    if len(clouds) > 1:
        raise ValueError(f"found settings with {sorted(clouds)} points of a cloud; expected the same number")
    for frame in read_scenes(paths, *clouds):
        for name, each in attenders.items():
            yield from ((name, attended.frame, attended.result) for attended in each.step(frame))
    for name, each in attenders.items():
        yield from ((name, attended.frame, attended.result) for attended in each.finish())


class Answering:
    """Attends to the frames of a clip in order under one configuration, and hands the answers to sinks.

    It is a context manager, which opens and closes the sinks, and marks the answers as finished. An error ends only
    this configuration: ``error`` is None until then.
    """

    def __init__(
        self,
        clip: Clip | MeasuredClip,
        context: ClipContext,
        configuration: Configuration,
        keys: Keys,
        factories: Iterable[SinkFactory],
    ) -> None:
        self.error: VfoaError | None = None
        self._clip, self._configuration, self._factories = clip, configuration, factories
        of_clip = {each.name: getattr(context, each.name) for each in fields(ClipContext)}
        self._context = SinkContext(**of_clip, configuration=configuration.name)
        self._pair = context.manifest.name, configuration.name
        self._answers = AnswerWriter(context.directory, self._pair, keys, filtered_cues(configuration.plain()))
        self._attender: Attender
        self._sinks: list[FrameSink] = []
        self._open_sinks = ExitStack()

    def __enter__(self) -> Self:
        settings, manifest = self._configuration.attend, self._context.manifest
        try:
            method = guarded("attention", open_method, settings.attention, manifest, self._clip)
            self._attender = Attender(Attending(settings, method))
            for factory in self._factories:
                if (sink := factory.open(self._context)) is not None:
                    self._sinks.append(self._open_sinks.enter_context(sink))
            self._sinks.append(self._open_sinks.enter_context(self._answers))
        except VfoaError as error:
            self.fail(error)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None and self.error is None:
            try:
                self._hand_over(self._attender.finish())
            except VfoaError as late:
                self.fail(late)
        try:
            self._open_sinks.__exit__(kind, error, trace)
        except VfoaError as late:
            self.error = late
        if kind is None and self.error is None:
            self._answers.finish()

    def fail(self, error: VfoaError) -> None:
        """End this configuration. Its sinks are closed, and their files are not whole."""
        if self.error is None:
            self.error = error
            self._open_sinks.__exit__(type(error), error, error.__traceback__)
            self._open_sinks = ExitStack()

    def attend(self, frame: SceneFrame) -> None:
        """Attend to one frame, and hand the frames that are finished now to the sinks: more than one when smoothed."""
        if self.error is not None:
            return
        try:
            self._hand_over(self._attender.step(frame))
        except VfoaError as error:
            if isinstance(error, StageError):
                error.frame = frame.scene.index
            self.fail(error)

    def _hand_over(self, attended: Iterable[Attended]) -> None:
        """Hand frames to every sink, with their records. The time of the sinks, but the last one, counts as writing."""
        for frame, timings, result in attended:
            fx_px = frame.camera.rig.fx_px if frame.camera else None
            record = to_record(*self._pair, result, fx_px, frame.targets)
            finished = FinishedFrame(camera=frame.camera, result=result, record=record, timings=timings)
            for sink in self._sinks:
                with timed(timings, "answers"):
                    sink.write(finished)


_Name = TypeVar("_Name")


def _read_together(
    tables: Mapping[_Name, Mapping[str, Path]], settings: Mapping[_Name, AttendSettings]
) -> Iterator[list[_Name]]:
    """Group the names whose scene, directions and number of points of a cloud are the same: they are read once."""
    alike: dict[tuple[Path, Path, int], list[_Name]] = {}
    for name, paths in tables.items():
        key = paths["frames"], paths["directions"], settings[name].attention.cloud_points
        alike.setdefault(key, []).append(name)
    yield from alike.values()


def attend_clip(
    clip: Clip | MeasuredClip,
    context: ClipContext,
    configurations: Iterable[Configuration],
    keys: Mapping[str, Keys],
    sinks: Iterable[SinkFactory],
    check: Callable[[], None],
) -> dict[str, VfoaError]:
    """Attend to the scenes of a clip under each configuration, and write the answers; return the errors by name.

    Parameters
    ----------
    keys
        Those of the scene and directions of each configuration, by name.
    sinks
        Open the receivers of the answers.
    check
        Called after each frame; an error of it ends all.
    """
    named = {configuration.name: configuration for configuration in configurations}
    tables = {name: paths_of(context.directory, context.manifest.name, keys[name]) for name in named}
    errors: dict[str, VfoaError] = {}
    for names in _read_together(tables, {name: each.attend for name, each in named.items()}):
        group, paths = [named[name] for name in names], tables[names[0]]
        answering = [Answering(clip, context, of, keys[of.name], sinks) for of in group]
        with ExitStack() as opened:
            for each in answering:
                opened.enter_context(each)
            try:
                for frame in read_scenes(paths, group[0].attend.attention.cloud_points):
                    for each in answering:
                        each.attend(frame)
                    check()
            except VfoaError as error:  # a table that is damaged
                for each in answering:
                    each.fail(error)
        errors |= {of.name: each.error for of, each in zip(group, answering, strict=True) if each.error}
    return errors


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
    manifest = directory.read_manifest()
    weights: dict[str, Any] = {name: {"attention": each} for name, each in manifest.fitted.items()}
    plain = {name: {**each, **weights.get(name, {})} for name, each in manifest.configurations.items()}
    for name in configurations:
        check_known(name, plain, f"{directory.path}: no configuration")
    tables = dict(find_tables(directory))
    pairs = [pair for pair in tables if not configurations or pair[1] in configurations]
    settings = {name: _changed(plain[name], changes, name) for name in dict.fromkeys(name for _, name in pairs)}
    rows: dict[Pair, list[Row]] = {pair: [] for pair in pairs}
    for group in _read_together({pair: tables[pair] for pair in pairs}, {pair: settings[pair[1]] for pair in pairs}):
        clip = group[0][0]
        of_clip = {name: _of_clip(settings[name], clip) for _, name in group}
        filtered = {name: filtered_cues(each.model_dump(mode="json")) for name, each in of_clip.items()}
        for name, frame, result in attend_scenes(tables[group[0]], of_clip):
            record = to_record(clip, name, result, targets=frame.targets)
            rows[clip, name].extend(answer_rows(record, filtered[name]))
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
