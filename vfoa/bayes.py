"""Attention as a posterior probability: which target explains the measured directions best, given how wrong they are.

    visible     where each target lies for these eyes, and how far it spreads
    eye_head    the density of the measured directions if it is looked at: errors, their slow part, how heads follow
    dwell       the prior, and how it changes from one frame to the next

    posterior   prior x density, normalised over the targets and "nowhere"

"Nowhere" is a target like any other, as wide as ``nowhere_deg`` about the middle of all. A big target is not favoured:
its density is spread over all that is seen of it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from pydantic import Field

from vfoa.attention import boxes_of_others
from vfoa.dwell import DwellSettings, prior, transition
from vfoa.eye_head import (
    EyeHeadSettings,
    Hypotheses,
    Measured,
    Places,
    first_fixation,
    measured_cues,
    next_frame,
    sigma_rad,
    weigh,
)
from vfoa.geometry import unit
from vfoa.types import CUES, Attention, Float, NoAttention, Subject, Target, TargetAttention
from vfoa.visible import SurfaceSettings, views_of

_OPPOSITE = 1e-9
"""Unit vectors whose mean is shorter cancel, but for rounding."""


class BayesSettings(EyeHeadSettings, DwellSettings, SurfaceSettings):
    """Settings of :func:`infer_attentions`: those of its three parts, and how far looks at no target spread."""

    method: Literal["bayes"]
    nowhere_deg: float = Field(default=50.0, gt=0, le=90)


@dataclass(frozen=True, slots=True, kw_only=True)
class BeliefState:
    """What is believed of each track; empty without smoothing."""

    by_track: Mapping[int, Hypotheses] = field(default_factory=dict)

    def of(self, tracks: Collection[int]) -> BeliefState:
        """What is believed of these tracks alone: those that have ended never come back."""
        return BeliefState(by_track={track: belief for track, belief in self.by_track.items() if track in tracks})


def infer_attentions(
    subjects: tuple[Subject, ...], targets: tuple[Target, ...], state: BeliefState, settings: BayesSettings
) -> tuple[tuple[Attention, ...], BeliefState]:
    """One frame: every subject's attention, and the beliefs that the next frame starts from.

    ``total`` is the probability of each target that has a box, the subject's own instance apart. "Nowhere" has the
    rest up to 1, and the focus is None where that is the most. The cues' parts divide the total by their precision.
    """
    eyes = {
        subject.person.instance_id: subject.person.eye_origin_left
        for subject in subjects
        if subject.person.instance_id is not None and subject.person.eye_origin_left is not None
    }
    results = []
    beliefs = dict(state.by_track)
    for subject in subjects:
        attention, belief = _infer(subject, targets, eyes, beliefs.get(subject.track_id), settings)
        if belief is not None and settings.smoothing != "off":
            beliefs[subject.track_id] = belief
        results.append(attention)
    return tuple(results), BeliefState(by_track=beliefs)


def _infer(
    subject: Subject,
    targets: tuple[Target, ...],
    eyes: Mapping[int, Float],
    before: Hypotheses | None,
    settings: BayesSettings,
) -> tuple[Attention, Hypotheses | None]:
    origin = subject.person.eye_origin_left
    if origin is None:
        return Attention(subject=subject, missing=NoAttention.NO_EYES_3D), None
    measured = measured_cues(subject, settings)
    if not measured:
        return Attention(subject=subject, missing=NoAttention.NO_DIRECTION), None
    boxes = boxes_of_others(subject, targets)
    others = tuple(target for target in targets if target.instance.id in boxes)
    places = _places(origin, others, eyes, settings)

    if before is None:
        evidence = 1.0
        predicted = first_fixation(places, prior(places.keys, settings), measured, settings)
    else:
        evidence = settings.evidence
        held = dict(zip(before.keys, before.weights.tolist(), strict=True))
        weights, stay = transition(held, places.keys, settings)
        predicted = next_frame(before, places, stay, weights, measured, settings)
    belief = weigh(predicted, places, measured, settings, evidence)
    return _attention(subject, others, belief, measured, settings), belief


def _places(origin: Float, targets: tuple[Target, ...], eyes: Mapping[int, Float], settings: BayesSettings) -> Places:
    """The targets that are seen, and nowhere: about the middle of them all."""
    views = views_of(origin, targets, eyes, settings)
    return Places(
        keys=(*views.ids, None),
        directions=np.vstack([views.directions, _middle(views.directions, origin)]),
        variances=np.append(views.variances, sigma_rad(settings.nowhere_deg) ** 2),
    )


def _middle(directions: Float, origin: Float) -> Float:
    """The middle of directions (T, 3); the way to the camera where they have none, being opposite, or no targets."""
    if len(directions) and np.linalg.norm(mean := directions.mean(axis=0)) > _OPPOSITE:
        return unit(mean)
    return unit(-origin if origin.any() else (0, 0, -1))


def _attention(
    subject: Subject, targets: tuple[Target, ...], belief: Hypotheses, measured: Measured, settings: BayesSettings
) -> Attention:
    probability = dict(zip(belief.keys, belief.weights.tolist(), strict=True))
    shares = _cue_shares(measured, settings)
    values = tuple(
        TargetAttention(
            instance_id=target.instance.id,
            gaze=(total := probability.get(target.instance.id, 0.0)) * shares[0],
            head=total * shares[1],
            total=total,
        )
        for target in targets
    )
    best = max(probability.values())
    if probability[None] == best:
        return Attention(subject=subject, values=values)
    first, *tied = (value.instance_id for value in values if value.total == best)
    return Attention(subject=subject, values=values, focus=first, tied=tuple(tied))


def _cue_shares(measured: Measured, settings: EyeHeadSettings) -> tuple[float, float]:
    """What part of the evidence is the gaze's and the head's, by precision; NaN for a cue that was not measured.

    A head says of the target what its own error, its rest and its stay aside leave over, stretched by its share.
    """
    around = sigma_rad(settings.aside_deg) ** 2 + ((1 - settings.head_share) * sigma_rad(settings.rest_deg)) ** 2
    precision = {
        cue: 1 / variance if cue == "gaze" else settings.head_share**2 / (variance + around)
        for cue, (_, variance) in measured.items()
    }
    total = sum(precision.values())
    gaze, head = (precision[cue] / total if cue in precision else float("nan") for cue in CUES)
    return gaze, head
