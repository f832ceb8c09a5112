"""The whole pipeline on one screen.

perceive     images -> percepts: disparity, instances, heads, head poses, gazes. Stateless, slow, cached.
             Shapes that a person drew join the instances and heads of the models, and are cut out by depth.
reconstruct  percepts -> scene: clouds, boxes and eye origins in metres. Stateless.
attend       scene, memory -> result, memory: tracks, filtered cues, cones, attention. Ordered and cheap.

The first two run out of order and in parallel; configurations that differ in attention repeat only the third. A
temporal gaze model needs the neighbouring frames: perceive keeps its crops, and a
:class:`vfoa.gaze.temporal.HeadWindow` adds the gazes, in order.
"""

from __future__ import annotations

from concurrent.futures import Executor, wait
from contextvars import copy_context
from dataclasses import dataclass, field
from typing import cast

from vfoa.attention import AttentionSettings, pay_attention
from vfoa.bayes import BayesSettings, BeliefState, infer_attentions
from vfoa.drawn import Drawing, Placed
from vfoa.gaze import GazeModel, TemporalGazeModel
from vfoa.gaze_filter import GazeFilterSettings, GazeFilterState, filter_cues
from vfoa.head_pose import HeadPoseModel
from vfoa.heads import FaceDetector, HeadDetector
from vfoa.logit import LogitSettings, Traces, weigh_attentions
from vfoa.nearest import NearestSettings, look_at_nearest
from vfoa.reconstruction import reconstruct
from vfoa.segmentation import Segmenter
from vfoa.settings import Settings
from vfoa.stereo import RegionMatcher, StereoMatcher
from vfoa.stereo.region import needed_region
from vfoa.tracking import TrackerState, TrackingSettings, track_people
from vfoa.types import Disparity, FrameResult, Gaze, Head, HeadView, Instances, NoGaze, Percepts, Scene, StereoFrame

__all__ = ["AttendSettings", "Memory", "Stages", "attend", "perceive", "reconstruct"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Stages:
    """The models and matchers of one configuration. None: that cue is not measured.

    Gaze is estimated from one frame or from several: at most one of the two models is set. A region matcher replaces
    the matcher and matches only the region of things and heads. ``drawing`` holds the shapes that a person drew; None:
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


def perceive(frame: StereoFrame, stages: Stages, *, beside: Executor | None = None) -> Percepts:
    """Run every model on one frame. A temporal gaze model leaves its crops in the views; the gazes are added later.

    ``beside`` finds faces in another thread during segmentation, and runs the models of the heads there during
    matching. The result is the same.
    """
    instances, heads = _find(frame, stages, beside)
    drawn: tuple[Placed, ...] = ()
    if stages.drawing:
        drawn = stages.drawing.place(frame, instances)
        heads = stages.drawing.add_heads(frame, heads, drawn)
    if beside is None:
        disparity = _match(frame, instances, heads, drawn, stages)
        views = _view(frame, heads, stages)
    else:
        viewed = beside.submit(copy_context().run, _view, frame, heads, stages)
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


def _find(frame: StereoFrame, stages: Stages, beside: Executor | None) -> tuple[Instances, tuple[Head, ...]]:
    """The instances and the heads: a detector that is a :class:`vfoa.heads.FaceDetector` does not wait for masks."""
    if not (hasattr(stages.heads, "faces") and hasattr(stages.heads, "with_people")):
        instances = stages.segmenter.segment(frame)
        return instances, stages.heads.detect(frame, instances)
    detector = cast("FaceDetector", stages.heads)
    if beside is None:
        instances = stages.segmenter.segment(frame)
        faces = detector.faces(frame)
    else:
        pending_faces = beside.submit(copy_context().run, detector.faces, frame)
        try:
            instances = stages.segmenter.segment(frame)
        finally:
            wait([pending_faces])
        faces = pending_faces.result()
    return instances, detector.with_people(faces, frame, instances)


def _match(
    frame: StereoFrame, instances: Instances, heads: tuple[Head, ...], drawn: tuple[Placed, ...], stages: Stages
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
    """Settings of :func:`attend`."""

    tracking: TrackingSettings = TrackingSettings()
    gaze_filter: GazeFilterSettings = GazeFilterSettings()
    attention: AttentionSettings | BayesSettings | LogitSettings | NearestSettings = AttentionSettings()


@dataclass(frozen=True, slots=True, kw_only=True)
class Memory:
    """State that :func:`attend` carries from one frame to the next."""

    tracker: TrackerState = field(default_factory=TrackerState)
    gaze_filter: GazeFilterState = field(default_factory=GazeFilterState)
    beliefs: BeliefState = field(default_factory=BeliefState)
    traces: Traces = field(default_factory=Traces)


def attend(scene: Scene, memory: Memory, settings: AttendSettings) -> tuple[FrameResult, Memory]:
    """Follow the people of one frame and compute the attention of each."""
    tracked, tracker = track_people(scene.people, memory.tracker, settings.tracking)
    subjects, gaze_filter = filter_cues(tracked, memory.gaze_filter, settings.gaze_filter)
    beliefs, traces = memory.beliefs, memory.traces
    followed = {track.id for track in tracker.tracks}
    if isinstance(settings.attention, BayesSettings):
        attentions, beliefs = infer_attentions(subjects, scene.targets, beliefs, settings.attention, scene.time_ns)
        beliefs = beliefs.of(followed)
    elif isinstance(settings.attention, LogitSettings):
        attentions, traces = weigh_attentions(subjects, scene.targets, traces, settings.attention, scene.time_ns)
        traces = traces.of(followed)
    elif isinstance(settings.attention, NearestSettings):
        attentions = tuple(look_at_nearest(subject, scene.targets, settings.attention) for subject in subjects)
    else:
        attentions = tuple(pay_attention(subject, scene.targets, settings.attention) for subject in subjects)
    memory = Memory(tracker=tracker, gaze_filter=gaze_filter, beliefs=beliefs, traces=traces)
    return FrameResult(scene=scene, attentions=attentions), memory
