"""The gaze filter: a Kalman filter of each subject's gaze, and optionally of the head, that lets saccades through.

Toivanen's method, as Simões and Moreno use it: state [position, velocity], constant velocity between frames, and a
measurement noise that falls while the direction moves fast, so that fixations are smoothed and saccades are not:

change  angle from the last estimate to the measurement, degrees per frame: the derivative of the position
s       1 / (1 + exp(-LAMBDA (change - ALPHA noise)))        a saccade (1) or a fixation (0)
theta   the greatest s of the last ``hold`` frames, m: m itself when it rises, else 0.7 m + 0.3 theta
R       diag(noise^2 (1 - theta), same, 1, 1)

Positions are angles on the tangent plane of the sphere at the last estimate, in degrees, so that all directions are
treated alike; the unit of time is one frame. Two things differ from the paper: the velocity is measured from the last
estimate, not from the last measurement, whose noise would count twice; and the velocity is damped (DAMPING), since eyes
that moved have usually arrived, and an extrapolation over missing frames must not run away.
``python -m scripts.measure gaze_filter`` measures the effect.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveInt

from vfoa.geometry import left_from_crop, perturb, tangent_offset
from vfoa.settings import CountsWith, Settings
from vfoa.types import CUES, Cue, Float, Gaze, HeadPose, Person, Subject

LAMBDA = 0.5
"""Steepness of the step from fixation to saccade, per degree and frame."""

ALPHA = 3.0
"""Position of that step, in units of the noise: a change that noise alone seldom reaches."""

DAMPING = 0.5
"""Factor of the velocity from one frame to the next."""

PROCESS_NOISE = np.diag([1.0, 1.0, 0.01, 0.01])
"""Q: variance that a frame adds, degrees^2 and (degrees per frame)^2."""

TRANSITION = np.block([[np.eye(2), np.eye(2)], [np.zeros((2, 2)), DAMPING * np.eye(2)]])
"""F: the transition from one frame to the next."""


class GazeFilterSettings(Settings):
    """Settings of :func:`filter_cues`.

    Nobody turns by more than ``gate_deg`` in a frame. After ``max_missing`` frames the cue counts as missing, and the
    filter restarts with the next measurement, at whatever angle.
    """

    counts_with: ClassVar[CountsWith] = dict.fromkeys(
        ("noise_deg", "hold", "gate_deg", "max_missing"), ("cues", ("gaze", "both"))
    )

    cues: Literal["off", "gaze", "both"] = "off"
    """Directions that are filtered: none, the gaze, or gaze and head pose."""
    noise_deg: float = Field(default=6.0, gt=0)
    """Error of one measurement along one axis."""
    hold: PositiveInt = 5
    """Frames for which a saccade opens the filter."""
    gate_deg: float = Field(default=90.0, gt=0)
    """A measurement farther from the prediction than this counts as missing."""
    max_missing: NonNegativeInt = 5
    """Most frames for which the prediction replaces a missing measurement."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CueFilter:
    """Filter state of one cue of one subject.

    ``direction`` (3,) is the estimate, unit, camera frame. ``velocity_deg`` (3,) is its change in degrees per frame,
    camera frame. ``covariance`` (4, 4) is of (right, down, velocity right, velocity down) on the tangent plane,
    degrees; it does not depend on the choice of right and down. ``saccades`` are the last values of s, the newest last.
    """

    direction: Float
    velocity_deg: Float
    covariance: Float
    saccades: tuple[float, ...] = ()
    theta: float = 0.0
    missing: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class GazeFilterState:
    """The running filters, by track id and cue."""

    filters: Mapping[tuple[int, Cue], CueFilter] = field(default_factory=dict)


def filter_cues(
    tracked: tuple[tuple[int, Person], ...], state: GazeFilterState, settings: GazeFilterSettings
) -> tuple[tuple[Subject, ...], GazeFilterState]:
    """Turn the tracked people of one frame into subjects; cues are filtered as the settings say.

    A filtered direction keeps the uncertainty of its own measurement. A filtered head has no angles: the model's angles
    belong to the unfiltered direction.
    """
    cues: tuple[Cue, ...] = {"off": (), "gaze": CUES[:1], "both": CUES}[settings.cues]
    measurements = {(track_id, cue): _measured(person, cue) for track_id, person in tracked for cue in cues}
    filters = {}
    for key in {**state.filters, **measurements}:
        after = follow(state.filters.get(key), measurements.get(key), settings)
        if after is not None:
            filters[key] = after
    subjects = tuple(_subject(track_id, person, cues, filters) for track_id, person in tracked)
    return subjects, GazeFilterState(filters=filters)


def follow(before: CueFilter | None, direction: Float | None, settings: GazeFilterSettings) -> CueFilter | None:
    """Advance one filter by a frame; ``direction`` (3,) is the measured unit vector. None: there is nothing to use."""
    if before is None:
        return None if direction is None else _start(direction, settings)

    from filterpy.kalman import predict, update

    axes = left_from_crop(before.direction)[:, :2]
    x, P = predict(
        np.concatenate([np.zeros(2), before.velocity_deg @ axes]), before.covariance, TRANSITION, PROCESS_NOISE
    )
    offset_deg = None if direction is None else np.rad2deg(tangent_offset(before.direction, direction))
    if offset_deg is None or np.linalg.norm(offset_deg - x[:2]) > settings.gate_deg:
        if before.missing == settings.max_missing:
            return follow(None, direction, settings)
        return _moved(replace(before, missing=before.missing + 1), axes, x, P)

    saccades = (*before.saccades, _saccade(float(np.linalg.norm(offset_deg)), settings))[-settings.hold :]
    theta = max(saccades) if max(saccades) > before.theta else 0.7 * max(saccades) + 0.3 * before.theta
    r = settings.noise_deg**2 * (1 - theta)
    z = np.concatenate([offset_deg, offset_deg])
    x, P = update(x, P, z, np.diag([r, r, 1.0, 1.0]), np.eye(4))
    return _moved(replace(before, saccades=saccades, theta=theta, missing=0), axes, x, P)


def _start(direction: Float, settings: GazeFilterSettings) -> CueFilter:
    variance = settings.noise_deg**2
    return CueFilter(direction=direction, velocity_deg=np.zeros(3), covariance=np.diag([variance, variance, 1.0, 1.0]))


def _saccade(change_deg: float, settings: GazeFilterSettings) -> float:
    """The logistic function, written as a tanh, which cannot overflow."""
    return (1 + math.tanh(LAMBDA * (change_deg - ALPHA * settings.noise_deg) / 2)) / 2


def _moved(before: CueFilter, axes: Float, x: Float, covariance: Float) -> CueFilter:
    """Return the filter whose new estimate is the state ``x`` (4,) on the tangent plane with these ``axes`` (3, 2)."""
    right_rad, down_rad = np.deg2rad(x[:2])
    direction = perturb(before.direction, right_rad, down_rad)
    return replace(before, direction=direction, velocity_deg=axes @ x[2:], covariance=covariance)


def _measured(person: Person, cue: Cue) -> Float | None:
    source = person.view.gaze if cue == "gaze" else person.view.head_pose
    return None if source is None else source.direction


def _subject(
    track_id: int, person: Person, cues: tuple[Cue, ...], filters: Mapping[tuple[int, Cue], CueFilter]
) -> Subject:
    gaze, head_pose = person.view.gaze, person.view.head_pose
    if "gaze" in cues:
        sigma_rad, estimate = gaze.sigma_rad if gaze else None, filters.get((track_id, "gaze"))
        gaze = Gaze(direction=estimate.direction, sigma_rad=sigma_rad) if estimate else None
    if "head" in cues:
        sigma_rad, estimate = head_pose.sigma_rad if head_pose else None, filters.get((track_id, "head"))
        head_pose = HeadPose(direction=estimate.direction, sigma_rad=sigma_rad) if estimate else None
    return Subject(track_id=track_id, person=person, gaze=gaze, head_pose=head_pose)
