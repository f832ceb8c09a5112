"""Attention as a posterior probability: which target explains the measured directions best, given how wrong they are.

A measured direction is the true one plus an error (von Mises-Fisher, kappa = 1 / sigma^2):

    likelihood  of a target: mean of that density over the solid angle in which the eyes see it, so that big things
                are not favoured; of "nowhere": a uniform density over the field of view
    posterior   prior x likelihood of each measured cue, normalised over the targets and "nowhere"

The head only follows the gaze, so its spread about the target holds ``head_lag_deg`` besides the model's error.
With ``smoothing = "forward"`` the prior is what a hidden Markov model predicts from the frame before: a subject
stays on a target for ``dwell_frames`` frames on average. That takes the errors of successive frames as independent: a
model whose error lasts for a second is counted once a frame, and then smoothing makes the answer worse, not better.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal

import numpy as np
from pydantic import Field

from vfoa.geometry import angle_between, box_corners, entry_distance, left_from_crop, unit
from vfoa.settings import Settings
from vfoa.types import CUES, Attention, Box3D, Cue, Float, NoAttention, Subject, Target, TargetAttention

MEAN_ANGLE_PER_SIGMA = float(np.sqrt(np.pi / 2))
"""Mean angle of an error over its standard deviation in each tangent direction (Rayleigh)."""

Belief = Mapping[int | None, float]
"""Probability by instance id; None is "nowhere"."""


class BayesSettings(Settings):
    """Settings of :func:`infer_attention`.

    ``spread`` is the error that the model itself claims, where it claims one, or always the published one: the mean
    angles ``gaze_error_deg`` and ``head_error_deg``. ``head_lag_deg`` is the mean angle between head and gaze.
    ``p_nowhere`` is the prior of looking at none of the targets, ``view_deg`` the full apex angle of the field of
    view over which such looks are spread. ``occlusion``: a target is seen where it is hit first, or wherever it lies.
    ``directions`` is how many directions a target's outline is sampled with. ``cues`` join as independent, or one
    is taken alone.
    """

    method: Literal["bayes"]
    cues: Literal["both", "gaze", "head"] = "both"
    spread: Literal["model", "published"] = "model"
    gaze_error_deg: float = Field(default=11.1, gt=0, le=60)
    head_error_deg: float = Field(default=5.0, gt=0, le=60)
    head_lag_deg: float = Field(default=15.0, ge=0, le=90)
    p_nowhere: float = Field(default=0.1, gt=0, lt=1)
    view_deg: float = Field(default=120.0, gt=0, le=360)
    occlusion: Literal["ignore", "first_hit"] = "first_hit"
    directions: int = Field(default=256, ge=16, le=10_000)
    smoothing: Literal["off", "forward"] = "off"
    dwell_frames: float = Field(default=12.0, gt=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class BeliefState:
    """The last posterior of each track; empty without smoothing."""

    by_track: Mapping[int, Belief] = field(default_factory=dict)


def infer_attentions(
    subjects: tuple[Subject, ...], targets: tuple[Target, ...], state: BeliefState, settings: BayesSettings
) -> tuple[tuple[Attention, ...], BeliefState]:
    """One frame: every subject's attention, and the beliefs that the next frame starts from."""
    results = []
    beliefs = dict(state.by_track)
    for subject in subjects:
        before = beliefs.get(subject.track_id) if settings.smoothing == "forward" else None
        attention = infer_attention(subject, targets, settings, before)
        if attention.missing is None and settings.smoothing == "forward":
            held: dict[int | None, float] = {value.instance_id: value.total for value in attention.values}
            beliefs[subject.track_id] = {**held, None: 1 - sum(held.values())}
        results.append(attention)
    return tuple(results), BeliefState(by_track=beliefs)


def infer_attention(
    subject: Subject, targets: tuple[Target, ...], settings: BayesSettings, before: Belief | None = None
) -> Attention:
    """Compute one subject's posterior over every target that has a box, the subject's own instance apart.

    ``total`` is the posterior probability; "nowhere" has the rest up to 1, and the focus is None where that is the
    most. The cues' parts divide the total by their precision. ``before`` is the belief of the last frame.
    """
    origin = subject.person.eye_origin_left
    if origin is None:
        return Attention(subject=subject, missing=NoAttention.NO_EYES_3D)
    cues = _cues(subject, settings)
    if not cues:
        return Attention(subject=subject, missing=NoAttention.NO_DIRECTION)
    own = subject.person.instance_id
    boxes = {t.instance.id: t.box for t in targets if t.box is not None and t.instance.id != own}

    log_likelihood = _log_likelihood(origin, tuple(boxes.values()), cues, settings)
    log_posterior = log_likelihood + np.log(_prior(tuple(boxes), before, settings))
    weights = np.exp(log_posterior - log_posterior.max())
    posterior = (weights / weights.sum()).tolist()
    values = _values(tuple(boxes), posterior[:-1], cues)
    best = max(posterior)
    if posterior[-1] == best:
        return Attention(subject=subject, values=values)
    first, *tied = (value.instance_id for value in values if value.total == best)
    return Attention(subject=subject, values=values, focus=first, tied=tuple(tied))


def _cues(subject: Subject, settings: BayesSettings) -> dict[Cue, tuple[Float, float]]:
    """The direction (3,) and the concentration of each cue that was measured and is wanted."""
    found: dict[Cue, tuple[Float, float]] = {}
    for cue, source, error_deg, lag_deg in (
        (CUES[0], subject.gaze, settings.gaze_error_deg, 0.0),
        (CUES[1], subject.head_pose, settings.head_error_deg, settings.head_lag_deg),
    ):
        if source is None or settings.cues not in ("both", cue):
            continue
        claimed = source.sigma_rad if settings.spread == "model" else None
        sigma = np.deg2rad(error_deg) / MEAN_ANGLE_PER_SIGMA if claimed is None else claimed
        lag = np.deg2rad(lag_deg) / MEAN_ANGLE_PER_SIGMA
        # a model may claim to be certain: no density is sharper than a hundredth of a degree
        found[cue] = source.direction, float(1 / max(sigma**2 + lag**2, np.deg2rad(0.01) ** 2))
    return found


def _prior(ids: tuple[int, ...], before: Belief | None, settings: BayesSettings) -> Float:
    """Prior (T + 1,), "nowhere" last: equal over the targets, or what the belief of the last frame predicts."""
    share = (1 - settings.p_nowhere) / max(len(ids), 1)
    fresh = np.array([share] * len(ids) + [settings.p_nowhere])
    fresh /= fresh.sum()
    if before is None:
        return fresh
    held = np.array([before.get(key, 0.0) for key in (*ids, None)])
    # what the belief held on targets that are gone is open again
    held = held + (1 - held.sum()) * fresh
    leave = 1 / settings.dwell_frames
    return np.asarray((1 - leave) * held + leave * fresh)


def _log_likelihood(
    origin: Float, boxes: tuple[Box3D, ...], cues: Mapping[Cue, tuple[Float, float]], settings: BayesSettings
) -> Float:
    """Log likelihood (T + 1,) of the measured cues for each target and, last, for "nowhere"."""
    view = 2 * np.pi * (1 - np.cos(np.deg2rad(settings.view_deg) / 2))
    total = np.append(np.zeros(len(boxes)), -len(cues) * np.log(view))
    if not boxes:
        return total
    rays = np.stack([_rays_about(origin, box, settings.directions) for box in boxes])
    seen = _seen(origin, rays, boxes, settings.occlusion)
    for direction, kappa in cues.values():
        exponent = kappa * (rays @ direction - 1)
        density = np.where(seen, np.exp(np.maximum(exponent, -700)), 0).sum(axis=1)
        count = seen.sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = np.where(count > 0, density / count, 0)
            # c(kappa) = kappa / (2 pi (1 - exp(-2 kappa))), with exp(kappa) taken into the exponent
            total[:-1] += np.log(mean) + np.log(kappa / (2 * np.pi * -np.expm1(-2 * kappa)))
    return total


def _seen(origin: Float, rays: Float, boxes: tuple[Box3D, ...], occlusion: str) -> np.ndarray:
    """Which of each target's rays (T, K) reach it (first, unless occlusion is ignored)."""
    count = len(boxes)
    entry = entry_distance(origin, rays.reshape(-1, 3), boxes).reshape(count, -1, count)
    own = np.einsum("tkt->tk", entry)
    if occlusion == "ignore":
        return np.isfinite(own)
    return np.isfinite(own) & (own <= np.fmin.reduce(entry, axis=2))


def _rays_about(origin: Float, box: Box3D, count: int) -> Float:
    """Unit rays (K, 3), even over the narrowest cap about the box's centre that holds all of its corners.

    The whole sphere for eyes inside of the box or so near that it fills half of what they see.
    """
    corners = box_corners(box) - origin
    towards = box.center_m - origin
    if np.linalg.norm(towards) <= box.d_max_m:
        return _cap(count, float(np.pi), (0.0, 0.0, 1.0))
    reach = float(angle_between(corners, towards).max())
    return _cap(count, reach, tuple(towards.tolist()))


def _cap(count: int, reach_rad: float, towards: tuple[float, ...]) -> Float:
    """A Fibonacci lattice (K, 3) over a cap; its first ray is the axis."""
    share, right, down = _spiral(count)
    z = 1 - share * (1 - np.cos(reach_rad))
    aside = np.sqrt(np.maximum(1 - z**2, 0))
    return np.stack([aside * right, aside * down, z], axis=-1) @ left_from_crop(unit(towards)).T


@lru_cache(maxsize=4)
def _spiral(count: int) -> tuple[Float, Float, Float]:
    number = np.arange(count)
    angle = np.pi * (3 - np.sqrt(5)) * number
    return number / (count - 1), np.cos(angle), np.sin(angle)


def _values(
    ids: tuple[int, ...], posterior: list[float], cues: Mapping[Cue, tuple[Float, float]]
) -> tuple[TargetAttention, ...]:
    precision = sum(kappa for _, kappa in cues.values())
    gaze, head = (cues[cue][1] / precision if cue in cues else float("nan") for cue in CUES)
    return tuple(
        TargetAttention(instance_id=key, gaze=p * gaze, head=p * head, total=p)
        for key, p in zip(ids, posterior, strict=True)
    )
