"""Coverage of intervals and error rates of the test, by simulation: ``make coverage`` writes ``reports/coverage.md``.

A nominal 95 % interval should contain the true rate in 95 % of experiments, and a test at 5 % should call two equal
configurations different in 5 %.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from harness.bench.simulated_looks import HZ, Simulated, World, simulate
from harness.files import atomic_write
from harness.report.formats import Table, to_markdown
from harness.score.intervals import rate_interval
from harness.score.statistics import SIGNIFICANCE, Interval, sign_flip_p, wilson_interval

CLIPS, LOOKS_S, MARGINS = (4, 8, 20), (0.7, 1.5, 3.0), (1.9, 2.6)


def coverage_table(experiments: int) -> Table:
    """A row for each mean rate, number of clips and length of looks, with this number of experiments each."""
    return Table(
        title="What intervals and tests are worth, by simulation",
        columns=(
            *("Rate %", "Clips", "Look s", "Different by frames %", "Different by this test %", "Wilson covers %"),
            *("Clips resampled covers %", "This interval covers %", "It speaks of", "Mean width, points"),
        ),
        words=0,
        rows=tuple(
            _row(World(margin=margin), clips, look_s, experiments)
            for margin in MARGINS
            for clips in CLIPS
            for look_s in LOOKS_S
        ),
        notes=(
            f"{experiments} experiments a row: clips of 6 to 14 s at {HZ} Hz with one to three subjects; the standard "
            f"error of a share of 5 % is {100 * np.sqrt(0.05 * 0.95 / experiments):.1f} points, of 95 % as much.",
            "Different: how often two equal configurations, each with an error of its own, are called different at 5 "
            "%. By frames: McNemar's exact test. This test: sign flips by clip, by look below 6 clips.",
            "Covers: how often a nominal 95 % interval holds the true rate over all clips there could be; this "
            "interval, where it speaks of these clips only, that on these clips.",
            "Clips resampled: plain percentiles, without looks and without a correction for small samples.",
        ),
    )


def _row(world: World, clips: int, look_s: float, experiments: int) -> tuple[str, ...]:
    rng = np.random.default_rng([int(1000 * world.margin), clips, int(1000 * look_s)])
    found = np.array([_measure(simulate(world, clips, look_s, rng), world, rng) for _ in range(experiments)])
    by_frames, by_units, wilson, plain, ours, width = 100 * found.mean(axis=0)
    speaks_of = "all clips" if clips >= 6 else "these clips"
    return (
        *(f"{100 * world.rate():.1f}", str(clips), f"{look_s:.1f}", f"{by_frames:.1f}", f"{by_units:.1f}"),
        *(f"{wilson:.1f}", f"{plain:.1f}", f"{ours:.1f}", speaks_of, f"{width:.1f}"),
    )


def _measure(one: Simulated, world: World, rng: np.random.Generator) -> tuple[float, ...]:
    units, differences = one.units(), one.differences()
    interval = rate_interval(units)
    truth = world.rate() if interval.unit == "clip" else one.rate_here
    frames = one.right[1].astype(int) - one.right[0]
    return (
        sign_flip_p(frames) < SIGNIFICANCE,
        sign_flip_p(differences.merged().values) < SIGNIFICANCE,
        _holds(wilson_interval(int(one.right[0].sum()), one.right.shape[1]), world.rate()),
        _holds(_plain(one, rng), world.rate()),
        _holds(interval, truth),
        interval.high - interval.low,
    )


def _plain(one: Simulated, rng: np.random.Generator) -> Interval:
    right, frames = np.bincount(one.clips, one.right[0]), np.bincount(one.clips)
    drawn = rng.integers(0, len(frames), (1000, len(frames)))
    low, high = np.quantile(right[drawn].sum(axis=1) / frames[drawn].sum(axis=1), [0.025, 0.975])
    return Interval(low=float(low), high=float(high), unit="clip")


def _holds(interval: Interval, truth: float) -> bool:
    return interval.low <= truth <= interval.high


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description="Measure the coverage of intervals and the errors of tests.")
    parser.add_argument("--out", type=Path, default=Path("reports/coverage.md"), help="The Markdown file to write.")
    parser.add_argument("--experiments", type=int, default=1000, help="Experiments in each row.")
    given = parser.parse_args()
    atomic_write(given.out, to_markdown(coverage_table(given.experiments)))


if __name__ == "__main__":
    main()
