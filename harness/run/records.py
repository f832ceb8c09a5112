"""The record of a frame: named, plain values, made from a frame's result.

Everything the scores, tables and pages need is here, so that none of them needs images or models.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from vfoa.types import Attention, Box3D, DirectionFit, Float, FrameResult, Person, Target

Vector = tuple[float, float, float]
BoxPx = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxRecord:
    """A 3D box in the camera frame: centre and half extents in metres, axes as rows (the rotation's columns)."""

    center_m: Vector
    half_size_m: Vector
    axes: tuple[Vector, Vector, Vector]


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetRecord:
    """One instance of a frame. ``name`` is the manifest's name for it, or ``label#id``; names may repeat.

    ``box_px`` is None if the clip has no images. ``depth_from`` is the frame whose depth places the box,
    None for this one.
    """

    instance_id: int
    name: str
    label: str
    score: float
    box_px: BoxPx | None
    points: int
    box: BoxRecord | None
    depth_from: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class AttentionRecord:
    """A subject's attention to one instance, each in [0, 1]; None: that cue was not measured."""

    instance_id: int
    gaze: float | None
    head: float | None
    total: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SubjectRecord:
    """One tracked person of a frame.

    ``name`` is the manifest's name, None for an unknown person. Directions are unit vectors after filtering, camera
    frame. ``missing`` is ``no_eyes_3d``, ``no_direction`` or None. ``focus`` is the instance id with the most
    attention, None for nowhere. ``head_box_px`` is None if the clip has no images. ``fit`` is set if the attention is a
    probability. ``no_gaze`` is the gaze model's reason to give none: ``face_turned_away`` or None. ``head_width_m`` is
    the width of the head's box at the depth of the eyes; None if either is not known. ``depth_from`` is the frame whose
    depth places the eyes; None: this one.
    """

    track_id: int
    name: str | None
    instance_id: int | None
    head_box_px: BoxPx | None
    eye_origin_m: Vector | None
    gaze: Vector | None
    gaze_sigma_rad: float | None
    head: Vector | None
    missing: str | None
    attention: tuple[AttentionRecord, ...]
    focus: int | None
    tied: tuple[int, ...]
    fit: DirectionFit | None = None
    no_gaze: str | None = None
    head_width_m: float | None = None
    depth_from: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameRecord:
    """One frame of one clip under one configuration.

    ``masks_from`` is the key frame whose masks were carried to this one, ``masks_age_s`` the seconds between; None if
    they were found in this one.
    """

    clip: str
    configuration: str
    frame: int
    time_ns: int
    targets: tuple[TargetRecord, ...]
    subjects: tuple[SubjectRecord, ...]
    masks_from: int | None = None
    masks_age_s: float | None = None

    def __post_init__(self) -> None:
        known = {target.instance_id for target in self.targets}
        if len(known) != len(self.targets):
            raise ValueError(f"frame {self.frame}: expected distinct instance ids in targets")
        for subject in self.subjects:
            named = {value.instance_id for value in subject.attention}
            if subject.focus is not None:
                named.add(subject.focus)
            if not named <= known:
                raise ValueError(
                    f"frame {self.frame}: track {subject.track_id} attends to instances {sorted(named - known)}, "
                    "which are not in targets"
                )

    def target(self, instance_id: int) -> TargetRecord:
        """The target with this instance id."""
        return next(target for target in self.targets if target.instance_id == instance_id)

    def sums_by_name(self, subject: SubjectRecord) -> dict[str, float]:
        """A subject's total attention by the targets' name, in its order; of targets that share a name, the sum."""
        names = {target.instance_id: target.name for target in self.targets}
        sums: dict[str, float] = {}
        for value in subject.attention:
            name = names[value.instance_id]
            sums[name] = sums.get(name, 0.0) + value.total
        return sums


def renamed(record: FrameRecord, names: Mapping[str, str]) -> FrameRecord:
    """The same record with the present names of renamed targets."""
    if not names:
        return record
    targets = tuple(replace(target, name=names.get(target.name, target.name)) for target in record.targets)
    return replace(record, targets=targets)


def to_record(
    clip: str,
    configuration: str,
    result: FrameResult,
    fx_px: float | None = None,
    targets: tuple[TargetRecord, ...] | None = None,
) -> FrameRecord:
    """The record of one frame, every number exactly as computed.

    The scene has the names of targets, and each subject its own. ``fx_px`` is the focal length; None without images.
    ``targets`` are the records of the scene's targets, if they are known.
    """
    if targets is None:
        targets = tuple(_target(target, result.scene.names[target.instance.id]) for target in result.scene.targets)
    return FrameRecord(
        clip=clip,
        configuration=configuration,
        frame=result.scene.index,
        time_ns=result.scene.time_ns,
        targets=targets,
        subjects=tuple(_subject(attention, fx_px) for attention in result.attentions),
        masks_from=result.scene.masks_from,
        masks_age_s=result.scene.masks_age_s,
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
        depth_from=target.depth_from,
    )


def _box(box: Box3D) -> BoxRecord:
    first, second, third = (_vector(axis) for axis in box.left_from_box.T)
    return BoxRecord(
        center_m=_vector(box.center_m),
        half_size_m=_vector(box.half_size_m),
        axes=(first, second, third),
    )


def _subject(attention: Attention, fx_px: float | None) -> SubjectRecord:
    subject = attention.subject
    origin, gaze, head = subject.person.eye_origin_left, subject.direction("gaze"), subject.direction("head")
    box_px = None if subject.person.head is None else _box_px(subject.person.head.box_px)
    return SubjectRecord(
        track_id=subject.track_id,
        name=subject.name,
        instance_id=subject.person.instance_id,
        head_box_px=box_px,
        eye_origin_m=None if origin is None else _vector(origin),
        gaze=None if gaze is None else _vector(gaze),
        gaze_sigma_rad=None if subject.gaze is None else subject.gaze.sigma_rad,
        no_gaze=None if subject.person.view.no_gaze is None else subject.person.view.no_gaze.cause,
        head=None if head is None else _vector(head),
        missing=None if attention.missing is None else attention.missing.value,
        attention=attention_records(attention),
        focus=attention.focus,
        tied=attention.tied,
        fit=attention.fit,
        head_width_m=head_width_m(subject.person, fx_px),
        depth_from=subject.person.depth_from,
    )


def head_width_m(person: Person, fx_px: float | None) -> float | None:
    """The width of a head's box at the depth of the eyes, with the focal length; None if one of them is not known."""
    head, origin = person.head, person.eye_origin_left
    if head is None or origin is None or not fx_px:
        return None
    return float((head.box_px[2] - head.box_px[0]) * origin[2] / fx_px)


def attention_records(attention: Attention) -> tuple[AttentionRecord, ...]:
    """A subject's attention to every target."""
    return tuple(
        AttentionRecord(
            instance_id=value.instance_id,
            gaze=_none_if_nan(value.gaze),
            head=_none_if_nan(value.head),
            total=float(value.total),
        )
        for value in attention.values
    )


def _none_if_nan(value: float) -> float | None:
    return None if math.isnan(value) else float(value)


def _vector(array: Float) -> Vector:
    x, y, z = array.tolist()
    return x, y, z


def _box_px(array: Float) -> BoxPx:
    u0, v0, u1, v1 = array.tolist()
    return u0, v0, u1, v1
