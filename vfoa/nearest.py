"""The strongest simple baseline: the target nearest in angle to the mean of gaze and head, up to a limit."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from vfoa.geometry import angle_between
from vfoa.methods import MethodSettings, boxes_of_others
from vfoa.types import CUES, Attention, Cue, NoAttention, Scene, Subject, Target, TargetAttention


class NearestSettings(MethodSettings):
    """Settings of :func:`look_at_nearest`."""

    method: Literal["nearest"]
    """``nearest``: the target nearest in angle."""
    gaze_share: float = Field(default=0.6, ge=0, le=1)
    """Weight of the gaze in the mean of gaze and head. If one cue is missing, the other has all the weight; a cue of
    weight 0 is never used."""
    limit_deg: float | None = Field(default=None, gt=0, le=180)
    """Greatest angle to the middle of a box at which it still is looked at; if not set, some target always is."""


class Nearest:
    """The target nearest in angle, as a :class:`vfoa.methods.AttentionMethod`."""

    Settings = NearestSettings
    probabilistic = False

    def __init__(self, settings: NearestSettings) -> None:
        self._settings = settings

    @property
    def says_nowhere(self) -> bool:
        """Only within a limit: without it, some target always is looked at."""
        return self._settings.limit_deg is not None

    def start(self) -> None:
        """No state."""

    def attend(
        self, subjects: tuple[Subject, ...], scene: Scene, states: tuple[None, ...]
    ) -> tuple[tuple[Attention, ...], tuple[None, ...]]:
        """Compute every subject's attention in one frame, each alone."""
        return tuple(look_at_nearest(subject, scene.targets, self._settings) for subject in subjects), states


def look_at_nearest(subject: Subject, targets: tuple[Target, ...], settings: NearestSettings) -> Attention:
    """Compute one subject's attention: 1 for the target nearest in angle, 0 for the others.

    The angle is to the middle of a target's box, seen from the eyes. Among targets at exactly the same angle, the first
    has the focus. Without an eye origin or a usable direction, the result gives the reason in ``missing`` and has no
    values.
    """
    origin = subject.person.eye_origin_left
    if origin is None:
        return Attention(subject=subject, missing=NoAttention.NO_EYES_3D)
    weights: dict[Cue, float] = {"gaze": settings.gaze_share, "head": 1 - settings.gaze_share}
    cues = {cue: direction for cue in CUES if weights[cue] and (direction := subject.direction(cue)) is not None}
    if not cues:
        return Attention(subject=subject, missing=NoAttention.NO_DIRECTION)
    total = sum(weights[cue] for cue in cues)
    parts = {cue: weights[cue] / total for cue in cues}
    mean = np.sum([parts[cue] * axis for cue, axis in cues.items()], axis=0)
    direction = mean if mean.any() else next(iter(cues.values()))

    boxes = boxes_of_others(subject, targets)
    nearest = None
    if boxes:
        towards = np.array([box.center_m for box in boxes.values()]) - origin
        is_apart = towards.any(axis=1)
        angles = np.full(len(boxes), np.inf)  # of a box about the very point of the eyes
        angles[is_apart] = angle_between(towards[is_apart], direction)
        first = int(angles.argmin())
        if settings.limit_deg is None or angles[first] <= np.deg2rad(settings.limit_deg):
            nearest = tuple(boxes)[first]
    values = tuple(
        TargetAttention(
            instance_id=number,
            gaze=parts.get("gaze", float("nan")) * (number == nearest),
            head=parts.get("head", float("nan")) * (number == nearest),
            total=float(number == nearest),
        )
        for number in boxes
    )
    return Attention(subject=subject, values=values, focus=nearest)
