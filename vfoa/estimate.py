"""The result of one frame, with names to print."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vfoa.scoring import NOWHERE
from vfoa.types import Attention, FrameResult, NoAttention, Percepts

_REASONS = {
    NoAttention.NO_EYES_3D: "the position of the eyes is unknown",
    NoAttention.NO_DIRECTION: "neither gaze nor head pose was measured",
    NoAttention.NO_ANSWER: "the method has no answer",
    NoAttention.NO_OBJECT: "there is no target at the point that the person looks at",
    NoAttention.NO_HIT: "nothing was hit",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """One person's answer in one frame. ``str()`` of it is a sentence.

    ``track_id`` is the person's number in the sequence, ``subject`` the name, or one made of it ("person 1").
    ``target`` is the name of the focus of attention. None: the person looks at none of the targets or, if ``missing``
    gives a reason, the answer is unknown. ``attention`` is the target's value in [0, 1], ``distance_m`` the distance
    from the eyes to the middle of its box; both are NaN without a target. ``values`` holds the attention to all targets
    by name.
    """

    track_id: int
    subject: str
    target: str | None
    attention: float
    distance_m: float
    values: Mapping[str, float]
    missing: NoAttention | None = None

    @property
    def answer(self) -> str | None:
        """The answer as :func:`vfoa.score` takes it.

        The target's name, ``"none"`` for nothing (where cones hit nothing, too: a run does not count that as an
        answer), None where it is unknown.
        """
        return NOWHERE if self.target is None and self.missing is None else self.target

    def __str__(self) -> str:
        if self.missing is not None:
            return f"{self.subject}: unknown ({_REASONS[self.missing]})"
        if self.target is None:
            return f"{self.subject} looks at nothing in the scene (targets found: {len(self.values)})"
        return f"{self.subject} looks at {self.target} (attention {self.attention:.2f}), {self.distance_m:.2f} m away"


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """The result of one frame. ``print(estimate)`` says who looks at what, one line per person.

    ``percepts`` holds the outputs of the models, ``result`` the scene in metres with every attention value
    (:mod:`vfoa.types`).
    """

    percepts: Percepts
    result: FrameResult

    @property
    def looks(self) -> tuple[Look, ...]:
        """One answer per person, in the order of their numbers."""
        return looks_of(self.result, self.target_names)

    @property
    def target_names(self) -> Mapping[int, str]:
        """Names of the targets by instance id: ``cup#3``, label and id, as a run calls what its manifest does not name.

        :meth:`vfoa.estimator.Estimator.follow` keeps the ids, and so the names, from frame to frame.
        """
        instances = (target.instance for target in self.result.scene.targets)
        return {instance.id: instance.automatic_name for instance in instances}

    def __str__(self) -> str:
        return "\n".join(map(str, self.looks)) or "nobody was found"


def looks_of(result: FrameResult, names: Mapping[int, str]) -> tuple[Look, ...]:
    """One answer per person, in the order of their numbers; ``names`` are those of the targets by instance id."""
    looks = (_look(attention, result, names) for attention in result.attentions)
    return tuple(sorted(looks, key=lambda look: look.track_id))


def _look(attention: Attention, result: FrameResult, names: Mapping[int, str]) -> Look:
    values = {target_attention.instance_id: target_attention.total for target_attention in attention.values}
    return Look(
        track_id=attention.subject.track_id,
        subject=attention.subject.name or f"person {attention.subject.track_id}",
        target=None if attention.focus is None else names[attention.focus],
        attention=math.nan if attention.focus is None else values[attention.focus],
        distance_m=_distance_m(attention, result),
        values={names[number]: value for number, value in values.items()},
        missing=attention.missing,
    )


def _distance_m(attention: Attention, result: FrameResult) -> float:
    eyes = attention.subject.person.eye_origin_left
    boxes = {target.instance.id: target.box for target in result.scene.targets}
    box = None if attention.focus is None else boxes[attention.focus]
    return math.nan if eyes is None or box is None else float(np.linalg.norm(box.center_m - eyes))
