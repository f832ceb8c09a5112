"""Answers from the scenes of a run against those of the scenes in memory, where nothing was written or read."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np

from harness.pipeline.configuration import Configuration
from harness.pipeline.perception import FollowedFrame, Perception, pose_frames
from harness.run.attend import attend_scenes
from harness.run.directory import RunDirectory
from harness.run.plan import PreparedClip
from harness.run.table_files import find_tables
from harness.sources import MeasuredClip
from vfoa.pipeline import Attending
from vfoa.types import Attention, FrameResult


def attended_in_memory(prepared: PreparedClip, configurations: Sequence[Configuration]) -> dict[str, list[FrameResult]]:
    """Perceive a clip again, and attend to each scene as it comes; results by configuration."""
    clip, manifest = prepared.clip, prepared.manifest
    if isinstance(clip, MeasuredClip):
        frames = pose_frames(configurations, clip, prepared.frames, manifest)
    else:
        perception = Perception(configurations, clip, manifest=manifest, drawn=prepared.drawn)
        frames = perception.frames(prepared.frames)
    attending = {each.name: Attending(each.attend) for each in configurations}
    results = defaultdict[str, list[FrameResult]](list)
    for shared in frames:
        for name, each in attending.items():
            followed = shared.by_configuration[name]
            assert isinstance(followed, FollowedFrame), followed
            results[name] += each.step(followed.scene, followed.tracked, followed.names.subjects)
    return {name: results[name] + each.finish() for name, each in attending.items()}


def assert_scenes_give_the_same(
    directory: RunDirectory, prepared: PreparedClip, configurations: Sequence[Configuration]
) -> None:
    """The scenes of a run must give the same answers as those in memory: every value and ray, by ``==``."""
    clip, tables = prepared.manifest.name, dict(find_tables(directory))
    settings = [configuration.for_clip(clip) for configuration in configurations]
    for name, expected in attended_in_memory(prepared, settings).items():
        (attend,) = (each.attend for each in settings if each.name == name)
        results = [result for _, _, result in attend_scenes(tables[clip, name], {name: attend})]
        assert [result.scene.index for result in results] == list(prepared.frames)
        for ours, theirs in zip(results, expected, strict=True):
            assert values_of(ours) == values_of(theirs), f"{name}, frame {theirs.scene.index}"
        assert sum(bool(each.values) for result in results for each in result.attentions) > len(results) // 2, name


def values_of(result: FrameResult) -> list[list[Any]]:
    """Everything in a frame's answers as plain values; NaN as text, so that it is equal to itself."""
    return [_values(attention) for attention in result.attentions]


def _values(attention: Attention) -> list[Any]:
    subject, rays = attention.subject, attention.rays
    found = [
        (subject.track_id, subject.name, subject.person.instance_id, subject.person.eye_origin_left),
        *((each.direction, each.sigma_rad) if each else None for each in (subject.gaze, subject.head_pose)),
        [(each.instance_id, each.gaze, each.head, each.total) for each in attention.values],
        (attention.focus, attention.tied, attention.missing, attention.fit),
        [(each.cue, each.apex_left, each.axis, each.fov_rad, each.n_rays) for each in attention.cones],
        None if rays is None else (rays.origin_left, rays.directions, rays.cone_index, rays.entry_m),
    ]
    return [_plain(each) for each in found]


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, tuple | list):
        return [_plain(each) for each in value]
    return "nan" if isinstance(value, float) and value != value else value
