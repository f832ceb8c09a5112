"""From a frame's result to its record: arrays to plain numbers, ids to names."""

from __future__ import annotations

import math

from harness.clips.naming import Names
from harness.run.results import (
    AttentionRecord,
    BoxPx,
    BoxRecord,
    DirectionFitRecord,
    FrameRecord,
    SubjectRecord,
    TargetRecord,
    Vector,
)
from harness.stages.measures import FrameMeasures
from vfoa.types import Attention, Box3D, DirectionFit, Float, FrameResult, Target


def to_record(
    clip: str, configuration: str, result: FrameResult, names: Names, measures: FrameMeasures | None = None
) -> FrameRecord:
    """The record of one frame, every number exactly as computed."""
    return FrameRecord(
        clip=clip,
        configuration=configuration,
        frame=result.scene.index,
        time_ns=result.scene.time_ns,
        targets=tuple(_target(target, names.targets[target.instance.id]) for target in result.scene.targets),
        subjects=tuple(
            _subject(attention, names.subjects.get(attention.subject.track_id)) for attention in result.attentions
        ),
        measures=measures,
    )


def _target(target: Target, name: str) -> TargetRecord:
    return TargetRecord(
        instance_id=target.instance.id,
        name=name,
        label=target.instance.label,
        score=float(target.instance.score),
        box_px=None if target.box_px is None else _box_px(target.box_px),
        points=len(target.points_left),
        box=None if target.box is None else _box(target.box),
    )


def _box(box: Box3D) -> BoxRecord:
    first, second, third = (_vector(axis) for axis in box.left_from_box.T)
    return BoxRecord(
        center_m=_vector(box.center_m),
        half_size_m=_vector(box.half_size_m),
        axes=(first, second, third),
    )


def _subject(attention: Attention, name: str | None) -> SubjectRecord:
    subject = attention.subject
    origin, gaze, head = subject.person.eye_origin_left, subject.direction("gaze"), subject.direction("head")
    return SubjectRecord(
        track_id=subject.track_id,
        name=name,
        instance_id=subject.person.instance_id,
        head_box_px=None if subject.person.head is None else _box_px(subject.person.head.box_px),
        eye_origin_m=None if origin is None else _vector(origin),
        gaze=None if gaze is None else _vector(gaze),
        gaze_sigma_rad=None if subject.gaze is None else subject.gaze.sigma_rad,
        head=None if head is None else _vector(head),
        missing=None if attention.missing is None else attention.missing.value,
        attention=attention_records(attention),
        focus=attention.focus,
        tied=attention.tied,
        fit=None if attention.fit is None else _fit(attention.fit),
    )


def attention_records(attention: Attention) -> tuple[AttentionRecord, ...]:
    """A subject's attention to every target."""
    return tuple(
        AttentionRecord(
            instance_id=value.instance_id,
            gaze=_measured(value.gaze),
            head=_measured(value.head),
            total=float(value.total),
        )
        for value in attention.values
    )


def _fit(fit: DirectionFit) -> DirectionFitRecord:
    return DirectionFitRecord(
        tail=float(fit.tail),
        claimed_error_rad=None if fit.claimed_error_rad is None else float(fit.claimed_error_rad),
        implied_error_rad=None if fit.implied_error_rad is None else float(fit.implied_error_rad),
    )


def _measured(value: float) -> float | None:
    return None if math.isnan(value) else float(value)


def _vector(array: Float) -> Vector:
    x, y, z = array.tolist()
    return x, y, z


def _box_px(array: Float) -> BoxPx:
    u0, v0, u1, v1 = array.tolist()
    return u0, v0, u1, v1
