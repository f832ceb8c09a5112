"""What a run keeps of each frame: named, plain values, one JSON line each in ``results.jsonl``.

Everything the scores, tables and pages need is here, so that none of them needs images or models.
"""

from __future__ import annotations

from dataclasses import dataclass

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
    """One instance of a frame. ``name`` is the manifest's name for it, or ``label#id``; it may occur twice."""

    instance_id: int
    name: str
    label: str
    score: float
    box_px: BoxPx
    points: int
    box: BoxRecord | None


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

    ``name`` is the manifest's name, None for a person it does not know. Directions are unit vectors after
    filtering, camera frame. ``missing`` is ``no_eyes_3d``, ``no_direction`` or None. ``focus`` is the instance id
    with the most attention, None for nowhere.
    """

    track_id: int
    name: str | None
    instance_id: int | None
    head_box_px: BoxPx
    eye_origin_m: Vector | None
    gaze: Vector | None
    gaze_sigma_rad: float | None
    head: Vector | None
    missing: str | None
    attention: tuple[AttentionRecord, ...]
    focus: int | None
    tied: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameRecord:
    """All of one frame of one clip under one configuration."""

    clip: str
    configuration: str
    frame: int
    time_ns: int
    targets: tuple[TargetRecord, ...]
    subjects: tuple[SubjectRecord, ...]

    def target(self, instance_id: int) -> TargetRecord:
        """The target with this instance id."""
        return next(target for target in self.targets if target.instance_id == instance_id)
