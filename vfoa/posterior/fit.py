"""Estimates of the assumptions from labelled sequences: error, bias, gain, head share, dwell, temperatures and more.

Every quantity is estimated with each clip left out in turn. Settings for a clip come from the other clips only, and the
spread of the estimates gives the interval (delete-one jackknife, Efron 1982).

In the tangent plane of the direction to the camera, where o is the offset of a direction (log map on the sphere):

o(gaze) = gain o(target) + bias of the person + error        o(head) = share o(target) + rest of the person + aside
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from vfoa.geometry import tangent_offset
from vfoa.posterior.belief import Belief, Measured, Scenery
from vfoa.posterior.filter import update
from vfoa.posterior.settings import PosteriorSettings
from vfoa.posterior.smoothing import smoothed
from vfoa.types import Float

QUANTITIES = ("gaze_error_deg", "bias_deg", "gain", "head_share", "aside_deg", "rest_deg", "dwell_s", "p_nowhere")
_TEMPERATURES = np.round(np.geomspace(1.0, 10.0, 48), 2)
_T_95 = (12.71, 4.30, 3.18, 2.78, 2.57, 2.45, 2.36, 2.31, 2.26, 2.23)
"""Student's t, two-sided 95 %, for 1 to 10 degrees of freedom."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledFrame:
    """One frame of one person: the targets, the measured directions, and the key of the target that is looked at."""

    time_s: float
    scenery: Scenery
    measured: Measured
    looked_at: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledPerson:
    """One person in one clip: the labelled frames in order of time. People of one ``clip`` are left out together."""

    clip: Hashable
    frames: Sequence[LabelledFrame]


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A quantity, the number of frames or looks that it is estimated from, and its 95 % interval; NaN if unknown."""

    value: float
    n: int
    low: float
    high: float


def fit(people: Sequence[LabelledPerson]) -> dict[str, Estimate]:
    """Estimate each of :data:`QUANTITIES`; intervals need at least two clips."""
    values, counts = _estimates(people)
    without = [_estimates([each for each in people if each.clip != clip])[0] for clip in _clips(people)]
    return {name: _with_interval(values[name], counts[name], [each[name] for each in without]) for name in QUANTITIES}


def settings_from(
    people: Sequence[LabelledPerson], base: PosteriorSettings, *, without: Hashable | None = None
) -> PosteriorSettings:
    """Return ``base`` with the quantities that these people show; those of the clip ``without`` are left out.

    A fitted error is a prior, as a claimed one is: ``error`` is not changed. Quantities that the people do not show
    keep the value of ``base``.
    """
    values, counts = _estimates([each for each in people if without is None or each.clip != without])
    allowed = dict.fromkeys(("gaze_error_deg", "bias_deg"), 60.0) | {"gain": 1.5, "head_share": 1.0}
    allowed |= dict.fromkeys(("aside_deg", "rest_deg"), 90.0)
    values_of: dict[str, object] = {
        name: float(np.clip(value, 0.02, allowed.get(name, np.inf)))
        for name, value in values.items()
        if name in type(base).model_fields and counts[name] and np.isfinite(value)
    }
    if "gaze_error_deg" in values_of:
        values_of["spread"] = "published"
    if "p_nowhere" in values_of:
        # Laplace's rule of succession: a few looks without nowhere do not exclude it
        looks = counts["p_nowhere"]
        values_of["p_nowhere"] = (values["p_nowhere"] * looks + 1) / (looks + 2)
    fitted = type(base).model_validate({**base.model_dump(), **values_of})
    shown = [each for each in people if without is None or each.clip != without]
    return fitted.model_copy(update=fitted_temperatures(shown, fitted))


def fitted_temperatures(people: Sequence[LabelledPerson], settings: PosteriorSettings) -> dict[str, float]:
    """Return the temperatures at which the labels are likeliest; empty if no gaze of unknown error was measured.

    ``temperature`` scales forward answers, ``smoothed_temperature`` those with later frames (Guo et al. 2017).
    """
    if settings.error == "told":
        return {}
    forward: list[tuple[Float, int]] = []
    smooth: list[tuple[Float, int]] = []
    for person in people:
        beliefs = _beliefs(person, settings)
        for frame, belief, later in zip(person.frames, beliefs, smoothed(beliefs) if beliefs else [], strict=True):
            if belief.error is not None and frame.looked_at in belief.keys:
                column = belief.keys.index(frame.looked_at)
                forward.append((belief.probabilities, column))
                smooth.append((later, column))
    if not forward:
        return {}
    return {"temperature": _likeliest(forward), "smoothed_temperature": _likeliest(smooth)}


def _beliefs(person: LabelledPerson, settings: PosteriorSettings) -> list[Belief]:
    found: list[Belief] = []
    for k, frame in enumerate(person.frames):
        dt_s = frame.time_s - person.frames[k - 1].time_s if k else 0.0
        found.append(update(found[-1] if found else None, frame.scenery, frame.measured, dt_s, settings))
    return found


def _likeliest(answers: Sequence[tuple[Float, int]]) -> float:
    """The temperature with the least mean negative log likelihood of the true columns."""
    logs = np.full((len(answers), max(len(each) for each, _ in answers)), -np.inf)
    for row, (probabilities, _) in enumerate(answers):
        logs[row, : len(probabilities)] = np.log(np.maximum(probabilities, 1e-12))
    true = logs[np.arange(len(answers)), [column for _, column in answers]]
    surprise = [(np.log(np.exp(logs / each).sum(axis=1)) - true / each).mean() for each in _TEMPERATURES]
    return float(_TEMPERATURES[int(np.argmin(surprise))])


def _clips(people: Sequence[LabelledPerson]) -> list[Hashable]:
    return list(dict.fromkeys(each.clip for each in people))


def _with_interval(value: float, n: int, without: Sequence[float]) -> Estimate:
    clips = len(without)
    if clips < 2 or not np.isfinite(without).all():
        return Estimate(value=value, n=n, low=float("nan"), high=float("nan"))
    spread = float(np.sqrt((clips - 1) / clips * ((np.array(without) - np.mean(without)) ** 2).sum()))
    half = spread * (_T_95[clips - 2] if clips - 2 < len(_T_95) else 1.96)
    return Estimate(value=value, n=n, low=value - half, high=value + half)


def _estimates(people: Sequence[LabelledPerson]) -> tuple[dict[str, float], dict[str, int]]:
    """Values by quantity, and the number of frames or looks behind each."""
    gain, bias_deg, error_deg, gazes = _line([_offsets(each, "gaze") for each in people])
    share, rest_deg, aside_deg, heads = _line([_offsets(each, "head") for each in people])
    ended, watched_s, looks, nowhere = np.sum([_looks(each) for each in people] or [(0, 0.0, 0, 0)], axis=0).tolist()
    values = {
        "gaze_error_deg": error_deg,
        "bias_deg": bias_deg,
        "gain": gain,
        "head_share": share,
        "aside_deg": aside_deg,
        "rest_deg": rest_deg,
        "dwell_s": watched_s / ended if ended else float("nan"),
        "p_nowhere": nowhere / looks if looks else float("nan"),
    }
    of_gaze = dict.fromkeys(("gaze_error_deg", "bias_deg", "gain"), gazes)
    of_head = dict.fromkeys(("head_share", "aside_deg", "rest_deg"), heads)
    return values, {**of_gaze, **of_head, "dwell_s": int(ended), "p_nowhere": int(looks)}


def _offsets(person: LabelledPerson, cue: str) -> Float:
    """Offsets (N, 4) from the direction to the camera, radians: (2) of the focus, (2) of the measured cue."""
    rows = []
    for frame in person.frames:
        direction = frame.measured.gaze if cue == "gaze" else frame.measured.head
        if frame.looked_at is None or direction is None or frame.looked_at not in frame.scenery.keys:
            continue
        target = frame.scenery.directions[frame.scenery.keys.index(frame.looked_at)]
        rows.append(tangent_offset(frame.scenery.to_camera, np.stack([target, direction])).ravel())
    return np.array(rows).reshape(-1, 4)


def _line(offsets: Sequence[Float]) -> tuple[float, float, float, int]:
    """Slope over all people, mean angle of their constants and of the residual, in degrees; and the number of frames.

    The slope is the one within people (least squares), so that a person's constant does not affect it.
    """
    offsets = [each for each in offsets if len(each)]
    n = sum(len(each) for each in offsets)
    if not n:
        return float("nan"), float("nan"), float("nan"), 0
    means = [each.mean(axis=0) for each in offsets]
    apart = np.concatenate([each - mean for each, mean in zip(offsets, means, strict=True)])
    aim, found = apart[:, :2], apart[:, 2:]
    power = float((aim**2).sum())
    slope = float((aim * found).sum()) / power if power > 1e-9 else float("nan")
    used = slope if np.isfinite(slope) else 1.0
    constants = [np.hypot(*(mean[2:] - used * mean[:2])) for mean in means]
    left = np.hypot(*(found - used * aim).T)
    return slope, float(np.degrees(np.mean(constants))), float(np.degrees(left.mean())), n


def _looks(person: LabelledPerson) -> tuple[int, float, int, int]:
    """Looks that ended, seconds watched, all looks, looks at nowhere. The clip's end cuts off the last look."""
    frames = person.frames
    if not frames:
        return 0, 0.0, 0, 0
    starts = [0] + [k for k in range(1, len(frames)) if frames[k].looked_at != frames[k - 1].looked_at]
    nowhere = sum(frames[k].looked_at is None for k in starts)
    return len(starts) - 1, frames[-1].time_s - frames[0].time_s, len(starts), nowhere
