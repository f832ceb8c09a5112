"""Attention as a conditional logit: what a few labelled seconds say about how gaze and head show a look.

McFadden's model (1974): the probability of target j is exp(u_j) / (1 + sum of exp(u)). "Nowhere" is the outside option,
with the utility 0. With the weights w, over the cues c of :mod:`vfoa.logit_cues`::

    u_j = constant + size log(radius_j) - sum of w[c, now] f_cj + w[c, before] mean(f_cj) (+ w[c, after] mean(f_cj))

f grows with the angle between cue and target, the means are running means over earlier and later frames, and
``radius`` is the angular radius of the target. Frames with both measured directions, with the gaze alone, and with the
head alone have weights of their own. One cue is the posterior's answer (:mod:`vfoa.bayes`).

Without labels the weights are those of the posterior's answer alone: what is learned in some settings of the other cues
is wrong in the next one. How much people look at nothing differs most between settings, so that such weights have a
``spread``: the probabilities are means over a normal distribution of the constant.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from vfoa.bayes import BayesSettings, HeldBelief, believed, eyes_of
from vfoa.errors import VfoaError
from vfoa.logit_cues import (
    LOGIT_CUES,
    ROWS,
    Case,
    FrameFeatures,
    Means,
    PosteriorAnswer,
    features,
    later_means,
    observe,
)
from vfoa.methods import MethodSettings, answer_of, revised
from vfoa.posterior.belief import MeasuredCues, fit_of
from vfoa.posterior.cues import cue_shares
from vfoa.posterior.filter import answered
from vfoa.recent import Recent
from vfoa.settings import CountsWith, Settings
from vfoa.times import seconds_between
from vfoa.types import Attention, Float, FrameResult, NoAttention, Scene, Subject


class Weights(Settings):
    """Weights of one case, by cue: of f in the frame itself, of its mean before and, if later frames are known, after.

    Where they are positive, a target near the cue is more likely.
    """

    constant: float
    """Utility of a target over nowhere."""
    size: float
    """Weight of the logarithm of the angular radius."""
    gaze: tuple[float, ...] = ()
    """Weights of the gaze."""
    middle: tuple[float, ...] = ()
    """Weights of the direction midway between gaze and head."""
    head: tuple[float, ...] = ()
    """Weights of the head."""
    head_swing: tuple[float, ...] = ()
    """Weights of the extrapolated head."""
    head_overlap: tuple[float, ...] = ()
    """Weights of the overlap of head and outline."""
    posterior: tuple[float, ...] = ()
    """Weights of the posterior's log odds."""
    spread: float = Field(default=0.0, ge=0, le=5)
    """Standard deviation of the constant between settings; 0 for weights that were fitted in the setting itself."""

    @property
    def vector(self) -> Float:
        """The weights (F,) in the order of :func:`features`."""
        return np.array([self.constant, self.size, *(weight for name in LOGIT_CUES for weight in getattr(self, name))])

    @classmethod
    def of(cls, case: Case, vector: Sequence[float]) -> Weights:
        """Return the weights of a case from their vector (F,)."""
        rows = np.reshape(vector[2:], (len(ROWS[case]), -1)).tolist()
        named = {LOGIT_CUES[cue]: tuple(row) for cue, row in zip(ROWS[case], rows, strict=True)}
        return cls.model_validate({"constant": float(vector[0]), "size": float(vector[1]), **named})


class Cases(Settings):
    """The weights of frames with both directions, with the gaze alone and with the head alone."""

    both: Weights
    gaze: Weights
    head: Weights


class LogitWeights(Settings):
    """All weights: with earlier frames alone (``forward``), and with later ones, too (``both``)."""

    forward: Cases
    both: Cases

    @model_validator(mode="after")
    def _check_shapes(self) -> LogitWeights:
        for smoothing, scales in (("forward", 2), ("both", 3)):
            for case, rows in ROWS.items():
                weights = getattr(getattr(self, smoothing), case)
                counts = [len(getattr(weights, cue)) for cue in LOGIT_CUES]
                if counts != [scales * (row in rows) for row in range(len(LOGIT_CUES))]:
                    cues = ", ".join(LOGIT_CUES[row] for row in rows)
                    found = ", ".join(f"{cue} {count}" for cue, count in zip(LOGIT_CUES, counts, strict=True))
                    raise ValueError(
                        f"{smoothing}.{case}: expected {scales} weights of {cues} and of no other cue, found {found}"
                    )
        return self


BETWEEN_SETTINGS = 2.0
"""Standard deviation of the constant between settings: the least log loss, by settings, of 1, 2 and 3."""


@lru_cache(maxsize=1)
def default_weights() -> LogitWeights:
    """The weights of people whom nobody labelled: the posterior's answer, with the spread of the constant."""

    def of(case: Case, scales: int) -> Weights:
        weights = Weights.of(case, [0.0] * (2 + scales * len(ROWS[case])))
        return weights.model_copy(update={"posterior": (1.0, *[0.0] * (scales - 1)), "spread": BETWEEN_SETTINGS})

    forward, both = (Cases(**{case: of(case, scales) for case in ROWS}) for scales in (2, 3))
    return LogitWeights(forward=forward, both=both)


class LogitSettings(MethodSettings):
    """Settings of :class:`Logit`."""

    counts_with: ClassVar[CountsWith] = {"look_ahead_s": ("smoothing", ("both",))}

    method: Literal["logit"]
    """``logit``: a conditional logit over the targets and nowhere, fitted to labels."""
    smoothing: Literal["forward", "both"] = "forward"
    """``forward``: also earlier frames; ``both``: also later ones."""
    look_ahead_s: float = Field(default=2.0, gt=0, le=120)
    """Seconds of later frames that count with ``both``."""
    weights: LogitWeights | Literal["left-out"] = Field(default_factory=default_weights)
    """The weights, as ``vfoa fit`` writes them. Default: the posterior's answer alone. ``left-out``, in an experiment:
    ``vfoa run`` fits the weights for each clip to the labels of the experiment's other clips."""
    by_clip: dict[str, LogitWeights] = Field(default_factory=dict)
    """Weights of single clips, which ``left-out`` writes."""

    @property
    def cloud_points(self) -> int:
        """As the posterior, whose answer is a cue."""
        return _POSTERIOR.cloud_points

    @property
    def is_unfitted(self) -> bool:
        """Whether the weights are still to be fitted: ``"left-out"``."""
        return self.weights == "left-out"

    @property
    def idle(self) -> dict[str, str]:
        """Also ``smoothing = "both"`` with the default weights, which use no later frames."""
        needed = "weights that use later frames (vfoa fit)"
        if self.smoothing == "both" and self.weights == default_weights() and not self.by_clip:
            return dict.fromkeys(("smoothing", "look_ahead_s"), needed)
        return super().idle

    @property
    def expectation(self) -> str:
        """The calibration errors of the default weights in reports/benchmark.md, and beside fits (reports/fit_*.md)."""
        if self.weights != default_weights():
            return ""
        return (
            "logit: nothing is fitted to this clip; in five settings the calibration error of its default weights was "
            "0.04 to 0.29. Fitted to 20 labelled seconds it was 0.06 instead of 0.09 (people in a room), and 0.08 "
            "instead of 0.12 (a conversation)."
        )

    def for_clip(self, clip: str) -> Self:
        """Return the settings with the weights of this clip, if it has its own."""
        if clip not in self.by_clip:
            return self
        return self.model_copy(update={"weights": self.by_clip[clip], "by_clip": {}})

    def of_case(self, case: Case, *, later: bool) -> Weights:
        """Return the weights of a case, for answers with or without later frames."""
        if not isinstance(self.weights, LogitWeights):
            raise VfoaError(
                'attention.weights: "left-out" is filled in by `vfoa run EXPERIMENT`; expected weights here'
            )
        weights: Weights = getattr(self.weights.both if later else self.weights.forward, case)
        return weights


class Remembered(NamedTuple):
    """What a person's frames leave for the next one: the running means, and the posterior's belief with its time."""

    means: Means = Means()
    held: HeldBelief | None = None


_POSTERIOR = BayesSettings(method="bayes")
"""The settings of the cue ``posterior``."""


class Logit:
    """The conditional logit, as a :class:`vfoa.methods.RevisingMethod`."""

    Settings = LogitSettings
    probabilistic = True
    says_nowhere = True

    def __init__(self, settings: LogitSettings) -> None:
        self._settings = settings
        self.look_ahead_s = settings.look_ahead_s if settings.smoothing == "both" else 0.0

    def start(self) -> Remembered:
        """No running means and no belief."""
        return Remembered()

    def attend(
        self, subjects: tuple[Subject, ...], scene: Scene, states: tuple[Remembered, ...]
    ) -> tuple[tuple[Attention, ...], tuple[Remembered, ...]]:
        """Compute every subject's attention in one frame, and what the next frame starts from.

        ``total`` is the probability of each target that has a box, except the subject's own instance. "Nowhere" has the
        rest up to 1. The focus is the likeliest of them, by the targets' names (:func:`vfoa.methods.likeliest`). The
        total is divided between the cues by the sums of their weights; without any, as the posterior divides it.
        ``belief`` is the input of :func:`weigh_again`; ``fit`` says how well the directions fit the posterior.
        """
        eyes = eyes_of(subjects)
        attentions, after = [], []
        for subject, before in zip(subjects, states, strict=True):
            found = believed(subject, scene, eyes, before.held, _POSTERIOR)
            if isinstance(found, NoAttention):
                attentions.append(Attention(subject=subject, missing=found))
                after.append(before)
                continue
            held, cues = found
            seen, means = _observed(subject, scene, before.means, held, cues)
            weights = self._settings.of_case(seen.case, later=False)
            attentions.append(_attention(subject, seen, weights, scene.names))
            after.append(Remembered(means, held))
        return tuple(attentions), tuple(after)

    def revise(self, window: Sequence[FrameResult], count: int) -> list[FrameResult]:
        """Return the first frames with every subject's attention given the whole window: :func:`weigh_again`."""
        return weigh_again(window, count, self._settings)


@lru_cache(maxsize=16)
def _offsets(spread: float) -> tuple[Float, Float]:
    """Nodes of a normal distribution about 0 and their weights (Gauss and Hermite).

    They are as many as keep the errors of probabilities below .005: a wide distribution needs more.
    """
    nodes, weights = np.polynomial.hermite_e.hermegauss(9 if spread <= 3 else 21)
    return spread * nodes, weights / weights.sum()


def probabilities(utility: Float, spread: float = 0.0) -> Float:
    """Probabilities (..., T) of targets with these utilities (..., T); nowhere has the rest up to 1.

    ``spread``: the standard deviation of a normal offset of all utilities, over which they are means (by Gauss-Hermite
    quadrature).
    """
    top = utility.max(axis=-1, initial=0.0, keepdims=True)
    power = np.exp(utility - top)
    total = power.sum(axis=-1, keepdims=True)
    if spread == 0:
        return np.asarray(power / (np.exp(-top) + total))
    # exp(offset) times power over 1 + exp(offset) times total, a mean over the offsets
    offsets, weights = _offsets(spread)
    return np.asarray(power * (1 / (np.exp(-top - offsets) + total) @ weights)[..., None])


_RECENT: Recent[tuple[FrameFeatures, Means]] = Recent(16)
"""The last features of all configurations: those that differ in their weights share them."""


def _observed(
    subject: Subject, scene: Scene, means: Means, held: HeldBelief, cues: MeasuredCues
) -> tuple[FrameFeatures, Means]:
    """:func:`observe` with what the posterior holds of the same frame: of its targets, faces and directions."""
    belief = held.belief

    def compute() -> tuple[FrameFeatures, Means]:
        answer = answered(belief, belief.probabilities, _POSTERIOR.error)
        chance = dict(zip(belief.keys, answer.tolist(), strict=True))
        dt_s = seconds_between(means.time_ns, scene.time_ns)
        posterior = PosteriorAnswer(chance, cue_shares(cues, belief), fit_of(belief, cues))
        return observe(subject, scene.targets, held.sights.eyes, means, dt_s, posterior, scene.time_ns)

    claimed = None if subject.gaze is None else subject.gaze.sigma_rad
    asked = subject.person.instance_id, claimed, scene.time_ns
    return _RECENT.get((belief, means, *scene.targets), asked, compute)


def weigh_again(window: Sequence[FrameResult], count: int, settings: LogitSettings) -> list[FrameResult]:
    """Return the first ``count`` frames of a window with every subject's attention given the later ones, too."""

    def of_person(frames: list[tuple[FrameResult, Attention]]) -> Iterator[Attention]:
        seen = [attention.belief for _, attention in frames]
        gaps_s = [seconds_between(*times) for times in pairwise(frame.scene.time_ns for frame, _ in frames)]
        for (frame, attention), each, after in zip(frames, seen, later_means(seen, gaps_s), strict=True):
            weights = settings.of_case(each.case, later=True)
            yield _attention(attention.subject, each, weights, frame.scene.names, after)

    return revised(window, count, FrameFeatures, of_person)


def target_probabilities(seen: FrameFeatures, weights: Weights, after: Float | None) -> Float:
    """Probabilities (T,) of the targets of a frame; ``after`` (C, T) are the means of later frames, where known."""
    return probabilities(features(seen, seen.case, after) @ _prepared(weights)[0], weights.spread)


def _attention(
    subject: Subject, seen: FrameFeatures, weights: Weights, names: Mapping[int, str], after: Float | None = None
) -> Attention:
    probability = target_probabilities(seen, weights, after)
    totals = dict(zip(seen.ids, probability.tolist(), strict=True))
    by_weights = _prepared(weights)[1] if seen.case == "both" else None
    nowhere = 1 - float(probability.sum())
    return answer_of(subject, totals, nowhere, by_weights or seen.shares, names, belief=seen, fit=seen.fit)


_PREPARED: Recent[tuple[Float, tuple[float, float] | None]] = Recent(16)


def _prepared(weights: Weights) -> tuple[Float, tuple[float, float] | None]:
    """The vector of weights, and the shares of gaze and head in the frames with both; None without weights of them."""

    def compute() -> tuple[Float, tuple[float, float] | None]:
        on_gaze = sum(weights.gaze) + sum(weights.middle) / 2
        on_head = sum(map(sum, (weights.head, weights.head_swing, weights.head_overlap))) + sum(weights.middle) / 2
        return weights.vector, _shares(on_gaze, on_head)

    return _PREPARED.get((weights,), (), compute)


def _shares(gaze: float, head: float) -> tuple[float, float] | None:
    """The shares of two sums of weights; negative sums count as 0, and two of them have no shares."""
    gaze, head = max(gaze, 0.0), max(head, 0.0)
    return (gaze / (gaze + head), head / (gaze + head)) if gaze + head > 0 else None
