"""Simulated experiments with known truth, to measure the coverage of intervals and the errors of tests.

A look is right while the gaze's error is smaller than the look's margin. The error is that of the simulated models
(:mod:`harness.pipeline.ground_truth`): half of its variance is a slow bias, independent after ``bias_s``.
Margins differ between clips and between looks, so that some clips are easier than others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.score.intervals import Units
from harness.score.looks import LEAST_S, correlation_time_s, number_looks
from vfoa.types import Codes, Flags, Float

HZ = 25
_BIAS_SHARE = 0.5
_SHORTEST_S, _LONGEST_S = 6, 14
_MOST_SUBJECTS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """Difficulty of clips and looks. ``margin`` is the median margin, in standard deviations of the error.

    ``clip_spread`` and ``look_spread`` are standard deviations of its logarithm; ``advantage`` multiplies the margins
    of the second configuration: 1 for two equal ones. ``bias_s`` is how long the slow part of an error lasts.
    """

    margin: float
    clip_spread: float = 0.3
    look_spread: float = 0.3
    advantage: float = 1.0
    bias_s: float = 1.0

    def rate(self, advantage: float = 1.0) -> float:
        """The rate over the population of clips."""
        return float(_mean_rate(np.array([self.margin * advantage]), np.hypot(self.clip_spread, self.look_spread))[0])

    def difference(self) -> float:
        """The true difference of the two configurations over the population of clips."""
        return self.rate(self.advantage) - self.rate()


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulated:
    """One experiment: two configurations with errors of their own on the same clips.

    ``clips``, ``tracks`` and ``looks`` (n,) are the clip, the subject and the look of every frame, numbered
    consecutively; ``right`` (2, n) is whether each configuration is right. ``rate_here`` is the expected rate of the
    first configuration on these clips.
    """

    clips: Codes
    tracks: Codes
    looks: Codes
    right: Flags
    rate_here: float

    def units(self) -> Units:
        """The looks of the first configuration, with their right frames."""
        return self._units(self.right[0].astype(np.float64))

    def differences(self) -> Units:
        """The looks with the second's right frames minus the first's."""
        return self._units(self.right[1].astype(np.float64) - self.right[0])

    def _units(self, values: Float) -> Units:
        first = np.unique(self.looks, return_index=True)[1]
        return Units(
            clips=self.clips[first],
            tracks=self.tracks[first],
            frames=np.bincount(self.looks).astype(np.float64),
            values=np.bincount(self.looks, values).astype(np.float64),
        )


def simulate(world: World, clips: int, look_s: float, rng: np.random.Generator) -> Simulated:
    """Draw one experiment with looks of ``look_s`` seconds on average, each between 0.5 and 1.5 times that."""
    hardness = world.margin * np.exp(world.clip_spread * rng.standard_normal(clips))
    of_clip: list[tuple[int, Codes, Flags]] = []
    frames_of = np.zeros(clips)
    for clip in range(clips):
        n = int(rng.integers(_SHORTEST_S * HZ, _LONGEST_S * HZ))
        for _ in range(int(rng.integers(1, _MOST_SUBJECTS + 1))):
            lengths = rng.uniform(0.5 * look_s, 1.5 * look_s, size=int(2 * n / (HZ * look_s)) + 2) * HZ
            looks = np.searchsorted(np.cumsum(lengths), np.arange(n), side="right")
            margins = hardness[clip] * np.exp(world.look_spread * rng.standard_normal(looks[-1] + 1))[looks]
            sizes = np.linalg.norm(_errors(world.bias_s, n, rng), axis=2)
            of_clip.append((clip, looks, sizes < margins * np.array([[1.0], [world.advantage]])))
            frames_of[clip] += n
    places = [np.arange(len(looks)) for _, looks, _ in of_clip]
    alike_s = correlation_time_s(
        (is_right, place, HZ) for (_, _, right), place in zip(of_clip, places, strict=True) for is_right in right
    )
    numbers, total = [], 0
    for (_, looks, _), place in zip(of_clip, places, strict=True):
        units = number_looks(looks, place, HZ, max(LEAST_S, 2 * alike_s))
        numbers.append(units + total)
        total += int(units[-1]) + 1
    return Simulated(
        clips=np.concatenate([np.full(len(looks), clip) for clip, looks, _ in of_clip]),
        tracks=np.concatenate([np.full(len(looks), track) for track, (_, looks, _) in enumerate(of_clip)]),
        looks=np.concatenate(numbers),
        right=np.concatenate([right for _, _, right in of_clip], axis=1),
        rate_here=float(np.average(_mean_rate(hardness, world.look_spread), weights=frames_of)),
    )


def _errors(bias_s: float, n: int, rng: np.random.Generator) -> Float:
    """Errors (2, n, 2) of two configurations in the two tangent directions, in standard deviations."""
    every = round(bias_s * HZ)
    places = np.arange(n) + int(rng.integers(every))
    knots, within = np.divmod(places, every)
    biases = rng.standard_normal((2, knots[-1] + 2, 2))
    turn = (np.pi / 2 * within / every)[:, None]
    bias = np.cos(turn) * biases[:, knots] + np.sin(turn) * biases[:, knots + 1]
    return np.sqrt(_BIAS_SHARE) * bias + np.sqrt(1 - _BIAS_SHARE) * rng.standard_normal((2, n, 2))


def _mean_rate(margins: Float, spread: float) -> Float:
    """The mean rate (m,) at log-normal margins about these (m,): 1 - exp(-x^2 / 2) at a margin x."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(41)
    drawn = margins[:, None] * np.exp(spread * nodes)
    return (1 - np.exp(-(drawn**2) / 2)) @ weights / weights.sum()
