"""Coverage of intervals, errors of the test, and power of plans, by simulation: writes ``reports/coverage.md``.

A nominal 95 % interval should contain the true rate in 95 % of experiments, a test at 5 % should call two equal
configurations different in 5 %, and an experiment of the planned size should find the difference as often as promised.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from itertools import pairwise, product
from pathlib import Path

import numpy as np

from harness.files.io import atomic_write
from harness.report.formats import Table, to_markdown
from harness.score.comparison import POWER, Spread, clips_needed
from harness.score.intervals import LEAST_CLIPS, Units, difference_interval, rate_interval
from harness.score.statistics import SIGNIFICANCE, Interval, sign_flip_p, wilson_interval
from scripts.measure.simulated_looks import HZ, Simulated, World, simulate

CLIPS, LASTS_S = (2, 3, 4, 5, 6, 8, 12, 24), (0.5, 1.0, 2.0, 4.0, 8.0)
LOOKS_S, MARGINS = (0.7, 3.0), (1.9, 2.6)
PILOTS = (2, 3, 4, 6, 12, 24)
_POOL = 3000
"""Clips of the world that pilots and experiments are drawn from."""
_SIZES = (6, 7, 8, 9, 10, 12, 14, 17, 20, 24, 30, 40, 60, 100, 200)

_Case = tuple[World, int, float]


def coverage_table(experiments: int) -> Table:
    """A row for each duration of errors, number of clips, length of looks and mean rate."""
    cases: list[_Case] = [
        *((World(margin=MARGINS[0], bias_s=lasts), clips, 1.5) for clips, lasts in product(CLIPS, LASTS_S)),
        *((World(margin=MARGINS[0], bias_s=2.0), clips, look_s) for clips, look_s in product((4, 8), LOOKS_S)),
        *((World(margin=MARGINS[1], bias_s=lasts), clips, 1.5) for clips, lasts in product((4, 8), (1.0, 8.0))),
    ]
    with ProcessPoolExecutor() as pool:
        rows = tuple(pool.map(_row, cases, [experiments] * len(cases)))
    return Table(
        title="What intervals and tests are worth, by simulation",
        columns=(
            *("Rate %", "Clips", "Error s", "Look s", "Different by frames %", "Different by this test %"),
            *("Wilson covers %", "Clips resampled covers %", "This interval covers %", "Of a difference covers %"),
            *("It speaks of", "Mean width, points"),
        ),
        words=0,
        rows=rows,
        notes=(
            f"{experiments} experiments a row: clips of 6 to 14 s at {HZ} Hz with one to three subjects; the standard "
            f"error of a share of 5 % is {100 * np.sqrt(0.05 * 0.95 / experiments):.1f} points, of 95 % as much.",
            "Error s: the time after which the slow half of an error is independent. Look s: mean length of a look.",
            "Different: how often two equal configurations, each with an error of its own, are called different at 5 "
            f"%. By frames: McNemar's exact test. This test: sign flips by clip, by joined look below {LEAST_CLIPS} "
            "clips.",
            "Covers: how often a nominal 95 % interval holds the true rate over all clips there could be; this "
            "interval, where it speaks of these clips only, that on these clips. Of a difference: the interval of the "
            "sign-flip test, for the difference of the two equal configurations.",
            "Clips resampled: plain percentiles, without looks and without a correction for small samples.",
        ),
    )


def _row(case: _Case, experiments: int) -> tuple[str, ...]:
    world, clips, look_s = case
    rng = np.random.default_rng([int(1000 * world.margin), clips, int(1000 * look_s), int(1000 * world.bias_s)])
    measures = np.array([_measure(simulate(world, clips, look_s, rng), world, rng) for _ in range(experiments)])
    by_frames, by_units, wilson, plain, ours, of_difference, width = 100 * measures.mean(axis=0)
    speaks_of = "all clips" if clips >= LEAST_CLIPS else "these clips"
    return (
        *(f"{100 * world.rate():.1f}", str(clips), f"{world.bias_s:.1f}", f"{look_s:.1f}"),
        *(f"{percent:.1f}" for percent in (by_frames, by_units, wilson, plain, ours, of_difference)),
        *(speaks_of, f"{width:.1f}"),
    )


def _measure(sample: Simulated, world: World, rng: np.random.Generator) -> tuple[float, ...]:
    units, differences = sample.units(), sample.differences()
    interval, between = rate_interval(units), difference_interval(differences)
    truth = world.rate() if interval.unit == "clip" else sample.rate_here
    frames = sample.right[1].astype(int) - sample.right[0]
    return (
        sign_flip_p(frames) < SIGNIFICANCE,
        sign_flip_p(differences.merged().values) < SIGNIFICANCE,
        _holds(wilson_interval(int(sample.right[0].sum()), sample.right.shape[1]), world.rate()),
        _holds(_plain(sample, rng), world.rate()),
        _holds(interval, truth),
        not (between.low > 0 or between.high < 0),  # no interval says nothing wrong
        interval.high - interval.low,
    )


def _plain(sample: Simulated, rng: np.random.Generator) -> Interval:
    right, frames = np.bincount(sample.clips, sample.right[0]), np.bincount(sample.clips)
    drawn = rng.integers(0, len(frames), (1000, len(frames)))
    low, high = np.quantile(right[drawn].sum(axis=1) / frames[drawn].sum(axis=1), [0.025, 0.975])
    return Interval(low=float(low), high=float(high), unit="clip")


def _holds(interval: Interval, truth: float) -> bool:
    return interval.low <= truth <= interval.high


def power_table(pilots: int) -> Table:
    """A row for each size of a pilot: the power that ``vfoa plan`` promises, and the power that its clips have."""
    cases = [(world, size) for world in _worlds() for size in PILOTS]
    with ProcessPoolExecutor() as pool:
        rows = tuple(pool.map(_power_row, cases, [pilots] * len(cases)))
    return Table(
        title="Power promised and had, by simulation",
        columns=(
            *("Difference, points", "Pilot clips", "Clips needed, median", "80 % of the pilots"),
            *("Promised %", "Had, mean %", "Had, lowest fifth %", "More than 10 below %"),
        ),
        words=0,
        rows=rows,
        notes=(
            f"{pilots} pilots a row, each with its own plan for the true difference at {100 * POWER:.0f} %, and the "
            "power that the test has on as many clips as the plan says. Clips as above, errors of 1 s.",
            "Lowest fifth: 20 % of the pilots lead to less power than this. More than 10 below: pilots whose plan has "
            "more than 10 points less than it promises. A difference so large that the fewest clips show it is found "
            "more often than a small pilot can promise.",
        ),
    )


def _worlds() -> tuple[World, ...]:
    return World(margin=MARGINS[0], advantage=1.08), World(margin=MARGINS[0], advantage=1.15)


def _power_row(case: tuple[World, int], pilots: int) -> tuple[str, ...]:
    world, size = case
    clips = _pool(world)
    rng = np.random.default_rng([size, int(1000 * world.advantage)])
    sums = np.array([[clip.values.sum(), clip.frames.sum()] for clip in clips])
    difference = float(sums[:, 0].sum() / sums[:, 1].sum())
    powers = _true_powers(world)
    plans = []
    for _ in range(pilots):
        drawn = [clips[k] for k in rng.integers(0, len(clips), size)]
        plan = clips_needed(Spread.of(_together(drawn)), difference)
        if plan is not None:
            plans.append((plan.needed, plan.power, float(np.interp(plan.needed, _SIZES, powers))))
    needed, promised, had = np.array(plans).T
    low, high = np.quantile(needed, [0.1, 0.9])
    return (
        *(f"{100 * difference:.1f}", str(size), f"{np.median(needed):.0f}", f"{low:.0f} to {high:.0f}"),
        *(f"{100 * promised.mean():.0f}", f"{100 * had.mean():.0f}", f"{100 * np.quantile(had, 0.2):.0f}"),
        f"{100 * np.mean(had < promised - 0.1):.0f}",
    )


@lru_cache
def _pool(world: World) -> list[Units]:
    """The looks of each clip of a large sample, with the differences of the two configurations."""
    units = simulate(world, _POOL, 1.5, np.random.default_rng(int(1000 * world.advantage))).differences()
    ends = np.searchsorted(units.clips, np.arange(_POOL + 1))
    return [
        Units(clips=units.clips[a:b], frames=units.frames[a:b], values=units.values[a:b]) for a, b in pairwise(ends)
    ]


def _together(clips: Sequence[Units]) -> Units:
    return Units(
        clips=np.repeat(np.arange(len(clips)), [len(clip.frames) for clip in clips]),
        frames=np.concatenate([clip.frames for clip in clips]),
        values=np.concatenate([clip.values for clip in clips]),
    )


@lru_cache
def _true_powers(world: World) -> list[float]:
    """How often the test finds the difference on each number of clips of :data:`_SIZES`, drawn from all."""
    rng = np.random.default_rng(int(1000 * world.advantage))
    values = np.array([clip.values.sum() for clip in _pool(world)])
    return [
        float(np.mean([sign_flip_p(sample) < SIGNIFICANCE for sample in rng.choice(values, (1000, clips))]))
        for clips in _SIZES
    ]


def main() -> None:
    """Write the tables."""
    parser = argparse.ArgumentParser(description="Measure the coverage of intervals, the errors of tests, and plans.")
    parser.add_argument("--out", type=Path, default=Path("reports/coverage.md"), help="The Markdown file to write.")
    parser.add_argument("--experiments", type=int, default=1000, help="Experiments in each row.")
    parser.add_argument("--pilots", type=int, default=400, help="Pilots in each row of the second table.")
    given = parser.parse_args()
    tables = coverage_table(given.experiments), power_table(given.pilots)
    atomic_write(given.out, "\n".join(map(to_markdown, tables)))
