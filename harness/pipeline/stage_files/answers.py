"""Answers of another system as a method of attention, from a table (:mod:`harness.pipeline.stage_files.answer_tables`).

Answers are joined by name, so they count whether or not this pipeline found the person or the object: what it did not
find is added to the scene without a box. Of a point the target is the object whose mask holds it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from harness.clips.manifest import ClipManifest
from harness.clips.naming import FrameNames, NameRule, is_automatic
from harness.files.digests import file_digest
from harness.files.remote import expand
from harness.labels.labels import NOWHERE
from harness.pipeline.configuration import CLIP_VARIABLE
from harness.pipeline.stage_files.answer_tables import NO_HIT, Answer, Answers, read_answers
from harness.sources import Clip, MeasuredClip
from vfoa.errors import VfoaError
from vfoa.methods import MethodSettings
from vfoa.tracking import Tracked
from vfoa.types import (
    Attention,
    Cues,
    Instance,
    NoAttention,
    Person,
    Scene,
    Subject,
    Target,
    TargetAttention,
)

_FIRST_TRACK = 1_000_000
"""Tracks of people whom no detector found are numbered from here."""
_HEATMAP_PX, _MOST_CELL_PX = 64, 4
"""Side of the heatmap of networks that follow gazes, and the least size of its cells, in pixels, that is noticed."""
_LAST_ID = 65535
"""Instances that no segmenter found are numbered from here, downwards."""


class AnswersSettings(MethodSettings):
    """Location of the answers, and how their frames are numbered."""

    method: Literal["answers"]
    """``answers``: those of another system, from a table."""
    file: str = Field(min_length=1)
    """Table of the answers; ``${CLIP}`` stands for the clip's name."""
    frame_offset: int = 0
    """Added to the table's frame numbers: 1 where it counts from 0 and the clip from 1."""

    def for_clip(self, clip: str) -> AnswersSettings:
        """Return the settings with the clip's name in the file's."""
        return self.model_copy(update={"file": self.file.replace(CLIP_VARIABLE, clip)})


class FileAnswers:
    """The answers of a table, as a :class:`vfoa.methods.AttentionMethod`."""

    Settings = AnswersSettings
    says_nowhere = True
    from_file = True

    def __init__(self, settings: AnswersSettings, manifest: ClipManifest, clip: Clip | MeasuredClip) -> None:
        self._path = expand(settings.file, Path.cwd(), "attention.file")
        if not self._path.is_file():
            raise VfoaError(f"attention.file: {self._path}: no such file; expected a table of answers")
        self._rules: Mapping[str, NameRule] = {**manifest.targets, **manifest.subjects}
        self._people, self._is_measured = tuple(manifest.subjects), isinstance(clip, MeasuredClip)
        frames = tuple(clip.frames)
        times_ns = tuple(map(clip.time_ns, frames))
        key = file_digest(self._path), frames, times_ns, tuple(self._rules), self._people, settings.frame_offset
        self._answers = _read_once(self._path, *key)
        if self._answers.has_points and self._is_measured:
            raise VfoaError(
                f"{self._path}:1: u_px, v_px: found points of an image, and the clip {manifest.name} has no images; "
                "expected the column target"
            )

    @property
    def doubts(self) -> tuple[str, ...]:
        """What is in question about the table. Images numbered from 1 on begin a frame after 0, and have no clock."""
        begin_s = self._answers.own_begin_s
        if begin_s is None or not self._is_measured:
            return ()
        return (
            f"{self._path}: time_s: times are read as since the clip's first frame, which is at {begin_s:g} s on the "
            f"clip's own clock; if they are of this clock: subtract {begin_s:g}.",
        )

    @property
    def probabilistic(self) -> bool:
        """Whether the table has probabilities."""
        return self._answers.probabilistic

    def digest(self) -> str:
        """Hexadecimal sha256 of the table."""
        return file_digest(self._path)

    def start(self) -> None:
        """No state."""

    def attend(
        self, subjects: tuple[Subject, ...], scene: Scene, states: tuple[None, ...]
    ) -> tuple[tuple[Attention, ...], tuple[None, ...]]:
        """Give each subject of a name the table's answer; the scene has what :meth:`complete` added."""
        answers = self._answers.by_frame.get(scene.index, {})
        return tuple(_attention(subject, answers.get(subject.name or ""), scene) for subject in subjects), states

    def complete(
        self, scene: Scene, tracked: Tracked, names: FrameNames, masks: NDArray[np.uint16] | None = None
    ) -> tuple[Scene, Tracked, FrameNames]:
        """Add the people and targets that the table names in this frame and that were not found, without a box.

        And what is at the points of the image that it says: ``masks`` (H, W) has the instance of each pixel.
        """
        answers = self._answers.by_frame.get(scene.index, {})
        if masks is not None:
            self._check_pixels(masks.shape[1])
        known = {*names.targets.values()}
        wanted = dict.fromkeys(name for answer in answers.values() for name in answer.names)
        unseen = [subject for subject in answers if subject not in names.subjects.values()]
        used = {target.instance.id for target in scene.targets}
        free = (number for number in range(_LAST_ID, 0, -1) if number not in used)
        added = {next(free): name for name in dict.fromkeys((*wanted, *unseen)) if name not in known}
        of_targets = {**names.targets, **added}
        ids = {name: number for number, name in reversed(of_targets.items())}
        people = tuple(
            Person(view=Cues(head_pose=None, gaze=None), instance_id=ids[name], eye_origin_left=None) for name in unseen
        )
        tracks = {name: _FIRST_TRACK + self._people.index(name) for name in unseen}
        targets = tuple(self._target(number, name) for number, name in added.items())
        return (
            replace(
                scene,
                targets=scene.targets + targets,
                people=scene.people + people,
                names=of_targets,
                looked_at={} if masks is None else _looked_at(answers, masks, scene.index),
            ),
            Tracked(ids=(*tracked.ids, *tracks.values()), open=tracked.open | {*tracks.values()}),
            FrameNames(
                subjects={**names.subjects, **{track: name for name, track in tracks.items()}}, targets=of_targets
            ),
        )

    def _check_pixels(self, width_px: int) -> None:
        """Reject points that are places in a network's heatmap, all in a corner of an image of this width."""
        most_px = self._answers.most_px
        if most_px is not None and most_px < _HEATMAP_PX <= width_px / _MOST_CELL_PX:
            raise VfoaError(
                f"{self._path}: u_px, v_px: found at most {most_px:g}, of an image {width_px} wide; expected its "
                f"pixels: multiply places in a heatmap of {_HEATMAP_PX} x {_HEATMAP_PX} by the image's size over that"
            )

    def _target(self, number: int, name: str) -> Target:
        label = name.partition("#")[0] if is_automatic(name) else self._rules[name].category
        instance = Instance(id=number, label=label, category_id=0, is_thing=True, score=0.0)
        return Target(instance=instance, box_px=None, points_left=np.zeros((0, 3), np.float32), box=None)


def _attention(subject: Subject, answer: Answer | None, scene: Scene) -> Attention:
    if answer is None:
        return Attention(subject=subject, missing=NoAttention.NO_ANSWER)
    if answer.target == NO_HIT:
        return Attention(subject=subject, missing=NoAttention.NO_HIT)
    if answer.point_px is not None:
        return _attention_to(subject, scene.looked_at[subject.name or ""], scene)
    ids: dict[str, int] = {}
    for number, name in scene.names.items():
        ids.setdefault(name, number)
    if answer.instance_id is not None and scene.names.get(answer.instance_id) == answer.target:
        ids[answer.target] = answer.instance_id
    chances = answer.chances or dict.fromkeys(answer.names, 1.0)
    totals = {ids[name]: chance for name, chance in chances.items() if name != NOWHERE}
    focus = None if answer.target == NOWHERE else ids[answer.target]
    return Attention(subject=subject, values=_values(subject, scene, totals), focus=focus)


def _attention_to(subject: Subject, found: int, scene: Scene) -> Attention:
    """The attention of a person who looks at a point of the image: the instance there has all of it."""
    values = _values(subject, scene, {found: 1.0})
    if found not in {value.instance_id for value in values}:
        return Attention(subject=subject, missing=NoAttention.NO_OBJECT)
    return Attention(subject=subject, values=values, focus=found)


def _looked_at(answers: Mapping[str, Answer], ids: NDArray[np.uint16], frame: int) -> dict[str, int]:
    """The instance at the point that each person looks at, by name; 0: none."""
    (height, width), found = ids.shape, {}
    for name, answer in answers.items():
        if answer.point_px is not None:
            u, v = answer.point_px
            column, row = math.floor(u + 0.5), math.floor(v + 0.5)
            if not (0 <= column < width and 0 <= row < height):
                raise VfoaError(
                    f"{name} in frame {frame} looks at u_px = {u:g}, v_px = {v:g}, outside the image of "
                    f"{width} x {height}; expected a point of it, or in_image = 0"
                )
            found[name] = int(ids[row, column])
    return found


def _values(subject: Subject, scene: Scene, totals: Mapping[int, float]) -> tuple[TargetAttention, ...]:
    """The attention to each target but the person's own body."""
    return tuple(
        TargetAttention(instance_id=number, gaze=math.nan, head=math.nan, total=totals.get(number, 0.0))
        for number in (target.instance.id for target in scene.targets)
        if number != subject.person.instance_id
    )


@lru_cache(maxsize=4)
def _read_once(
    path: Path,
    digest: str,
    frames: tuple[int, ...],
    times_ns: tuple[int, ...],
    names: tuple[str, ...],
    people: tuple[str, ...],
    frame_offset: int,
) -> Answers:
    """Read a table once per content: the description of the run needs it, perception, and the method."""
    return read_answers(path, frames, times_ns, names, people, frame_offset=frame_offset)
