"""How gaze and head follow what is looked at: a linear Gaussian model of one subject, one copy for every target.

If a subject looks at a target whose middle lies in direction c, then

    gaze measured = c + offset + bias + noise
    head measured = head + noise
    head          -> a share ``head_pace`` of the way, each frame, to its goal: ``head_share`` of the way from rest to
                     c + offset, and ``aside`` besides

    offset  where on the target the eyes rest; new in each fixation
    bias    the slow part of the gaze model's error: an Ornstein-Uhlenbeck process
    aside   how far the head stays off its goal: heads do not always follow; new in each fixation
    head    where the head points      rest    where it points when at ease, all but constant

Successive errors of a model are alike, and a filter that takes them as independent counts the same error once a frame:
hence the bias. Heads take a share of a gaze shift that differs between people and lag behind it by a tenth of a second
and more: hence the share and the pace. Directions are unit vectors; differences of them are chords, so that a
Gaussian of a chord is von Mises and Fisher's density. The covariances are the same for every tangent direction.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from pydantic import Field

from vfoa.geometry import angle_between, unit
from vfoa.settings import Settings
from vfoa.types import CUES, Cue, Float, Subject

OFFSET, BIAS, ASIDE, HEAD, REST = range(5)
_SIZE = 5

MEAN_ANGLE_PER_SIGMA = float(np.sqrt(np.pi / 2))
"""Mean angle of an error over its standard deviation in each tangent direction (Rayleigh)."""

_SHARPEST_RAD = float(np.deg2rad(0.01))
"""A model may claim to be certain: no error is taken to be smaller."""

_HEAD_NOISE_RAD = float(np.deg2rad(3.0))
_REST_DRIFT_RAD = float(np.deg2rad(0.2))


class EyeHeadSettings(Settings):
    """Settings of the model; every angle in degrees, errors and ``aside`` as mean angles.

    ``cues`` is what is used. ``spread`` is the error that the model of a cue itself claims, where it claims one, or
    always the published one. ``bias_share`` of the errors' variance is slow, and fades within ``bias_frames``.
    ``evidence`` is how much a frame counts that is not the first, since errors last in more ways than the model knows.
    ``rest_deg`` is how far a head at ease points from the middle of all targets. The defaults of what is not
    published were tuned on rendered clips that no table reports.
    """

    cues: Literal["both", "gaze", "head"] = "both"
    spread: Literal["model", "published"] = "model"
    gaze_error_deg: float = Field(default=11.1, gt=0, le=60)
    head_error_deg: float = Field(default=5.0, gt=0, le=60)
    bias_share: float = Field(default=0.35, ge=0, lt=1)
    bias_frames: float = Field(default=20.0, gt=0)
    evidence: float = Field(default=0.7, gt=0, le=1)
    head_share: float = Field(default=0.5, gt=0, le=1)
    head_pace: float = Field(default=0.1, gt=0, le=1)
    aside_deg: float = Field(default=10.0, gt=0, le=90)
    rest_deg: float = Field(default=37.0, gt=0, le=90)


@dataclass(frozen=True, slots=True, kw_only=True)
class Hypotheses:
    """What is believed of a subject, once for every thing that it may look at: ``keys`` (T,), None for nowhere.

    ``weights`` (T,) sum to 1; ``means`` (T, 5, 3) are chords and directions, ``covariances`` (T, 5, 5) rad^2.
    """

    keys: tuple[int | None, ...]
    weights: Float
    means: Float
    covariances: Float


@dataclass(frozen=True, slots=True, kw_only=True)
class Places:
    """Where everything is that may be looked at: directions (T, 3), and the variances (T,) of the looks at it."""

    keys: tuple[int | None, ...]
    directions: Float
    variances: Float


Measured = Mapping[Cue, tuple[Float, float]]
"""The direction (3,) and the error's variance per tangent direction, rad^2, of each cue that was measured."""


def measured_cues(subject: Subject, settings: EyeHeadSettings) -> Measured:
    """The cues of a subject that were measured and are wanted."""
    found: dict[Cue, tuple[Float, float]] = {}
    for cue, source, error_deg in (
        (CUES[0], subject.gaze, settings.gaze_error_deg),
        (CUES[1], subject.head_pose, settings.head_error_deg),
    ):
        if source is None or settings.cues not in ("both", cue):
            continue
        claimed = source.sigma_rad if settings.spread == "model" else None
        sigma = sigma_rad(error_deg) if claimed is None else claimed
        found[cue] = source.direction, max(sigma, _SHARPEST_RAD) ** 2
    return found


def sigma_rad(error_deg: float) -> float:
    """The standard deviation per tangent direction of an error with this mean angle."""
    return float(np.deg2rad(error_deg)) / MEAN_ANGLE_PER_SIGMA


def first_fixation(places: Places, weights: Float, measured: Measured, settings: EyeHeadSettings) -> Hypotheses:
    """The belief before a subject's first frame: the head has reached its goal."""
    count = len(places.keys)
    rest = unit(places.directions.mean(axis=0))
    means = np.zeros((count, _SIZE, 3))
    means[:, REST] = rest
    means[:, HEAD] = _goals(means, places, settings)
    covariances = np.zeros((count, _SIZE, _SIZE))
    covariances[:, OFFSET, OFFSET] = places.variances
    covariances[:, BIAS, BIAS] = _bias_variance(measured, settings)
    covariances[:, ASIDE, ASIDE] = sigma_rad(settings.aside_deg) ** 2
    covariances[:, REST, REST] = sigma_rad(settings.rest_deg) ** 2
    to_goal = _follow(1.0, 1.0, settings)
    return Hypotheses(keys=places.keys, weights=weights, means=means, covariances=to_goal @ covariances @ to_goal.T)


def next_frame(
    before: Hypotheses, places: Places, stay: Float, weights: Float, measured: Measured, settings: EyeHeadSettings
) -> Hypotheses:
    """The belief before the next frame is looked at.

    ``weights`` (T,) are the predicted ones, and ``stay`` (T,) is which part of each comes from the same target: the
    rest comes from all, with a new fixation. Each target's mixture is collapsed to one Gaussian (Blom and
    Bar-Shalom 1988).
    """
    means, covariances = _mixed(before, places, stay, settings)
    keep = float(np.exp(-1 / settings.bias_frames))
    goals = _goals(means, places, settings) + means[:, ASIDE]
    means[:, HEAD] += settings.head_pace * (goals - means[:, HEAD])
    means[:, BIAS] *= keep
    step = _follow(settings.head_pace, keep, settings)
    covariances = step @ covariances @ step.T
    covariances[:, BIAS, BIAS] += (1 - keep**2) * _bias_variance(measured, settings)
    covariances[:, HEAD, HEAD] += _HEAD_NOISE_RAD**2
    covariances[:, REST, REST] += _REST_DRIFT_RAD**2
    return Hypotheses(keys=places.keys, weights=weights, means=means, covariances=covariances)


def weigh(
    predicted: Hypotheses, places: Places, measured: Measured, settings: EyeHeadSettings, evidence: float = 1.0
) -> Hypotheses:
    """The belief after a frame: a Kalman update of every hypothesis, and Bayes' rule over them.

    ``evidence`` is the power to which the likelihood counts: 1 for a frame by itself.
    """
    seen = np.zeros((len(measured), _SIZE))
    noise = np.zeros(len(measured))
    expected = np.empty((len(places.keys), len(measured), 3))
    for row, (cue, (_, variance)) in enumerate(measured.items()):
        # of a head's error the slow part is among what keeps it off its goal
        noise[row] = variance * (1 - settings.bias_share)
        if cue == "gaze":
            seen[row, [OFFSET, BIAS]] = 1
            expected[:, row] = places.directions + predicted.means[:, OFFSET] + predicted.means[:, BIAS]
        else:
            seen[row, HEAD] = 1
            expected[:, row] = predicted.means[:, HEAD]
    spread = seen @ predicted.covariances @ seen.T + np.diag(noise)
    inverse = np.linalg.inv(spread)
    surprise = np.array([direction for direction, _ in measured.values()]) - expected
    gain = predicted.covariances @ seen.T @ inverse
    log_likelihood = -np.linalg.slogdet(spread)[1] - np.einsum("tax,tab,tbx->t", surprise, inverse, surprise) / 2
    with np.errstate(divide="ignore"):
        log_weights = np.log(predicted.weights) + evidence * log_likelihood
    weights = np.exp(log_weights - log_weights.max())
    return replace(
        predicted,
        weights=weights / weights.sum(),
        means=predicted.means + gain @ surprise,
        covariances=predicted.covariances - gain @ seen @ predicted.covariances,
    )


def _bias_variance(measured: Measured, settings: EyeHeadSettings) -> float:
    variance = measured["gaze"][1] if "gaze" in measured else sigma_rad(settings.gaze_error_deg) ** 2
    return settings.bias_share * variance


def _follow(pace: float, keep: float, settings: EyeHeadSettings) -> Float:
    """One frame of the linear model (5, 5)."""
    step = np.eye(_SIZE)
    step[BIAS, BIAS] = keep
    step[HEAD, [OFFSET, ASIDE, HEAD, REST]] = (
        pace * settings.head_share,
        pace,
        1 - pace,
        pace * (1 - settings.head_share),
    )
    return step


def _goals(means: Float, places: Places, settings: EyeHeadSettings) -> Float:
    """Where the heads (T, 3) would come to rest: a share of the great circle from rest to what is looked at."""
    rest, aim = unit(means[:, REST]), unit(places.directions + means[:, OFFSET])
    angle = np.maximum(angle_between(rest, aim), 1e-6)[:, None]
    share = settings.head_share
    return np.asarray((np.sin((1 - share) * angle) * rest + np.sin(share * angle) * aim) / np.sin(angle))


def _mixed(before: Hypotheses, places: Places, stay: Float, settings: EyeHeadSettings) -> tuple[Float, Float]:
    """Means and covariances of each target: what was believed of it, and a new fixation after any other."""
    mean = np.einsum("t,tnx->nx", before.weights, before.means)
    covariance = np.einsum("t,tnm->nm", before.weights, before.covariances)
    covariance += _spread(before.means - mean, before.weights)
    fixation = [OFFSET, ASIDE]
    mean[fixation] = 0
    covariance[fixation, :] = covariance[:, fixation] = 0
    covariance[ASIDE, ASIDE] = sigma_rad(settings.aside_deg) ** 2

    fresh = np.repeat(covariance[None], len(places.keys), axis=0)
    fresh[:, OFFSET, OFFSET] = places.variances
    index = {key: row for row, key in enumerate(before.keys)}
    rows = [index.get(key, 0) for key in places.keys]  # one that was not there has stay = 0
    old = before.means[rows]
    part = stay[:, None, None]
    apart = old - mean
    covariances = part * before.covariances[rows] + (1 - part) * fresh
    covariances += part * (1 - part) * np.einsum("tnx,tmx->tnm", apart, apart) / 2
    return part * old + (1 - part) * mean, covariances


def _spread(apart: Float, weights: Float) -> Float:
    """Covariance (5, 5), per tangent direction, of means that lie apart (T, 5, 3)."""
    return np.asarray(np.einsum("t,tnx,tmx->nm", weights, apart, apart) / 2)
