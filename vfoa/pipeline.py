"""The whole pipeline on one screen.

perceive     images -> percepts: disparity, instances, heads, head poses, gazes. Stateless, slow, cached.
             Shapes that a person drew join the instances and heads of the models, and are cut out by depth.
reconstruct  percepts -> scene: clouds, boxes and eye origins in metres. Stateless.
follow       heads -> tracks: :class:`vfoa.tracking.Tracker`; instances -> the same ones under lasting numbers:
             :class:`vfoa.instance_tracking.InstanceTracker`. Ordered, with a memory. The parts of a divided person
             are joined before (:func:`vfoa.divided_people.join_people`), and objects and eyes that a frame shows
             without a depth have their last one (:mod:`vfoa.depth_memory`). :mod:`vfoa.following` does all of it.
attend       scenes and tracks -> results: filtered cues, attention by a method. Ordered, with a memory, and cheap.

The first two run out of order and in parallel; configurations that differ in attention repeat only the last.
Instances are numbered before they are reconstructed, as the scene's targets have these numbers. A temporal gaze model
needs the neighbouring frames: perceive keeps its crops, and a :class:`vfoa.gaze.temporal.HeadWindow` adds the gazes, in
order.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor, wait
from contextvars import copy_context
from dataclasses import dataclass, replace
from typing import Any, cast

from pydantic import InstanceOf, SerializeAsAny

from vfoa.cones import ConesSettings
from vfoa.drawn import Drawing, PlacedShape
from vfoa.gaze import GazeModel, TemporalGazeModel
from vfoa.gaze_filter import GazeFilterSettings, GazeFilterState, filter_cues
from vfoa.head_pose import HeadPoseModel
from vfoa.heads import FaceDetector, HeadDetector
from vfoa.methods import (
    AttentionMethod,
    FramesMethod,
    MethodSettings,
    RevisingMethod,
    look_ahead_s,
    open_method,
    person_key,
)
from vfoa.reconstruction import reconstruct
from vfoa.segmentation import Segmenter
from vfoa.settings import Settings
from vfoa.stereo import RegionMatcher, StereoMatcher
from vfoa.stereo.region import needed_region
from vfoa.times import FRAME_S
from vfoa.tracking import Tracked, TrackingSettings
from vfoa.types import (
    Attention,
    Disparity,
    FrameResult,
    Gaze,
    Head,
    HeadView,
    Instances,
    NoGaze,
    Percepts,
    Scene,
    StereoFrame,
    Subject,
)

__all__ = ["AttendSettings", "Attending", "Stages", "perceive", "reconstruct"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Stages:
    """The models and matchers of one configuration. None: that cue is not measured.

    Gaze is estimated from one frame or from several: at most one of the two models is set. A region matcher replaces
    the matcher and matches only the region of objects and heads. ``drawing`` holds the shapes that a person drew; None:
    none.
    """

    matcher: StereoMatcher
    segmenter: Segmenter
    heads: HeadDetector
    head_pose: HeadPoseModel | None
    gaze: GazeModel | None
    temporal_gaze: TemporalGazeModel | None = None
    region_matcher: RegionMatcher | None = None
    drawing: Drawing | None = None


def perceive(frame: StereoFrame, stages: Stages, *, executor: Executor | None = None) -> Percepts:
    """Return the outputs of all models for one frame. A temporal gaze model's gazes are added later, from its crops.

    ``executor`` finds faces in another thread during segmentation, and runs the models of the heads there during
    matching. The result is the same.
    """
    instances, heads = _find(frame, stages, executor)
    drawn: tuple[PlacedShape, ...] = ()
    if stages.drawing:
        drawn = stages.drawing.place(frame, instances)
        heads = stages.drawing.add_heads(frame, heads, drawn)
    if executor is None:
        disparity = _match(frame, instances, heads, drawn, stages)
        views = _view(frame, heads, stages)
    else:
        viewed = executor.submit(copy_context().run, _view, frame, heads, stages)
        try:
            disparity = _match(frame, instances, heads, drawn, stages)
        finally:
            wait([viewed])  # wait for the other thread, so that no stage runs on after an error
        views = viewed.result()
    if stages.drawing:
        instances = stages.drawing.add_masks(frame, instances, drawn, disparity)
    return Percepts(
        index=frame.index,
        time_ns=frame.time_ns,
        rig=frame.rig,
        disparity=disparity,
        instances=instances,
        views=views,
    )


def _find(frame: StereoFrame, stages: Stages, executor: Executor | None) -> tuple[Instances, tuple[Head, ...]]:
    """The instances and the heads: a detector that is a :class:`vfoa.heads.FaceDetector` does not wait for masks."""
    if not (hasattr(stages.heads, "faces") and hasattr(stages.heads, "with_people")):
        instances = stages.segmenter.segment(frame)
        return instances, stages.heads.detect(frame, instances)
    detector = cast("FaceDetector", stages.heads)
    if executor is None:
        instances = stages.segmenter.segment(frame)
        faces = detector.faces(frame)
    else:
        pending_faces = executor.submit(copy_context().run, detector.faces, frame)
        try:
            instances = stages.segmenter.segment(frame)
        finally:
            wait([pending_faces])
        faces = pending_faces.result()
    return instances, detector.with_people(faces, frame, instances)


def _match(
    frame: StereoFrame, instances: Instances, heads: tuple[Head, ...], drawn: tuple[PlacedShape, ...], stages: Stages
) -> Disparity:
    if stages.region_matcher:
        windows = [placed.window for placed in drawn]
        return stages.region_matcher.match_region(frame, needed_region(instances, heads, frame.rig, windows))
    return stages.matcher.match(frame)


def _view(frame: StereoFrame, heads: tuple[Head, ...], stages: Stages) -> tuple[HeadView, ...]:
    views = []
    for head in heads:
        head_pose = stages.head_pose.estimate(frame, head) if stages.head_pose else None
        gaze = stages.gaze.estimate(frame, head, head_pose) if stages.gaze else None
        crop = stages.temporal_gaze.crop(frame, head) if stages.temporal_gaze else None
        cause = gaze if isinstance(gaze, NoGaze) else None
        seen = gaze if isinstance(gaze, Gaze) else None
        views.append(HeadView(head=head, head_pose=head_pose, gaze=seen, no_gaze=cause, crop=crop))
    return tuple(views)


class AttendSettings(Settings):
    """Settings of :class:`vfoa.tracking.Tracker` and of :class:`Attending`."""

    tracking: TrackingSettings = TrackingSettings()
    gaze_filter: GazeFilterSettings = GazeFilterSettings()
    attention: SerializeAsAny[InstanceOf[MethodSettings]] = ConesSettings()


MOST_REMEMBERED = 64
"""Named people who are gone and whose states are kept: a robot in a hall may meet thousands."""


class Attending:
    """Attends to the frames of a sequence in order, and holds the memory: filters, and each person's state.

    The result of a frame comes at once, unless the method needs later frames
    (:class:`vfoa.methods.RevisingMethod`). Then it waits for the frames of that time and is revised with them. Results
    come in blocks of that length, so that one revision serves a block, and always in the order of the frames.
    """

    def __init__(self, settings: AttendSettings, method: AttentionMethod[Any] | None = None) -> None:
        """Begin a sequence. ``method`` is that of ``settings.attention``; None: one of :data:`vfoa.methods.METHODS`."""
        self._settings = settings
        self._method = open_method(settings.attention) if method is None else method
        self._look_ahead_s = look_ahead_s(self._method)
        self._gaze_filter = GazeFilterState()
        self._states: dict[int | str, Any] = {}
        self._waiting: list[FrameResult] = []

    @property
    def takes_many(self) -> bool:
        """Whether :meth:`steps` answers its frames together."""
        return hasattr(self._method, "attend_frames")

    def steps(self, frames: Sequence[tuple[Scene, Tracked, Mapping[int, str] | None]]) -> list[FrameResult]:
        """Attend to the next frames as :meth:`step` does, with its errors: together if the method can, else one by one.

        After an error of a method that answers them together, none of the frames has been attended to.
        """
        if not self.takes_many:
            return [result for frame in frames for result in self.step(*frame)]
        asked, gaze_filter = [], self._gaze_filter
        for scene, tracked, names in frames:
            subjects, gaze_filter = self._subjects(scene, tracked, names, gaze_filter)
            asked.append((subjects, scene))
        answers = cast("FramesMethod", self._method).attend_frames(asked)
        if len(answers) != len(asked):
            raise ValueError(f"answers to {len(answers)} frames; expected {len(asked)}, in order")
        results = []
        for (subjects, scene), attentions in zip(asked, answers, strict=True):
            _check_answers(subjects, attentions)
            results.append(FrameResult(scene=scene, attentions=attentions))
        self._gaze_filter = gaze_filter
        return results

    def step(self, scene: Scene, tracked: Tracked, names: Mapping[int, str] | None = None) -> list[FrameResult]:
        """Attend to the next frame; return the frames whose results are ready, which may be none.

        ``tracked`` are the tracks of the scene's people, ``names`` the names of people by track; None: they have none.

        Raises
        ------
        ValueError
            If the method does not answer for each subject in order, or does not revise each frame.
        """
        subjects, gaze_filter = self._subjects(scene, tracked, names, self._gaze_filter)
        before = tuple(map(self._state_of, subjects))
        attentions, after = self._method.attend(subjects, scene, before)
        _check_answers(subjects, attentions)
        if len(after) != len(subjects):
            raise ValueError(f"{len(after)} states for {len(subjects)} subjects; expected one of each, in their order")
        self._remember(dict(zip(map(person_key, subjects), after, strict=True)), tracked)
        self._gaze_filter = gaze_filter
        self._waiting.append(FrameResult(scene=scene, attentions=tuple(attentions)))
        awaited = self._awaited() if self._look_ahead_s else 0
        return self._release(len(self._waiting) - awaited) if len(self._waiting) > 2 * awaited else []

    def _state_of(self, subject: Subject) -> Any:
        """The method's state of a person: that of the name, else that of the track before it was named, else none."""
        known = (key for key in (subject.name, subject.track_id) if key in self._states)
        key = next(known, None)
        return self._method.start() if key is None else self._states[key]

    def _remember(self, states: Mapping[int | str, Any], tracked: Tracked) -> None:
        """Keep the states of a frame, those of the other open tracks, and those of the people who were named last."""
        before = {key: state for key, state in self._states.items() if key not in states}
        named = [key for key in before if isinstance(key, str)]
        kept = {*named[max(0, len(named) - MOST_REMEMBERED) :], *tracked.open}
        self._states = {**{key: state for key, state in before.items() if key in kept}, **states}

    def _subjects(
        self, scene: Scene, tracked: Tracked, names: Mapping[int, str] | None, gaze_filter: GazeFilterState
    ) -> tuple[tuple[Subject, ...], GazeFilterState]:
        """The subjects of a frame with filtered cues and names, and the filters after it."""
        subjects, gaze_filter = filter_cues(tracked.people(scene.people), gaze_filter, self._settings.gaze_filter)
        if names:
            subjects = tuple(replace(subject, name=names.get(subject.track_id)) for subject in subjects)
        return subjects, gaze_filter

    def finish(self) -> list[FrameResult]:
        """Return the results that still wait, at the end of the sequence."""
        return self._release(len(self._waiting)) if self._waiting else []

    def _awaited(self) -> int:
        """Number of frames that wait and have later frames to come: those of the last ``look_ahead_s`` seconds.

        A mean rate would not do: a gap in the times makes it too low for the frames on both sides.
        """
        last_ns = self._waiting[-1].scene.time_ns
        if last_ns <= self._waiting[0].scene.time_ns:
            return math.ceil(self._look_ahead_s / FRAME_S)
        return sum(last_ns - result.scene.time_ns < 1e9 * self._look_ahead_s for result in self._waiting)

    def _release(self, count: int) -> list[FrameResult]:
        ready = self._waiting[:count]
        if self._look_ahead_s:
            revised = cast("RevisingMethod[Any]", self._method).revise(tuple(self._waiting), count)
            if [result.scene.index for result in revised] != [result.scene.index for result in ready]:
                raise ValueError(f"{len(revised)} revised frames; expected the first {count}, in order")
            ready = revised
        del self._waiting[:count]
        return ready


def _check_answers(subjects: tuple[Subject, ...], attentions: Sequence[Attention]) -> None:
    """Refuse answers that are not one for each subject in order."""
    ids = [subject.track_id for subject in subjects]
    found = [attention.subject.track_id for attention in attentions]
    if found != ids:
        raise ValueError(f"answers for the subjects {found}; expected one for each of {ids}, in their order")
