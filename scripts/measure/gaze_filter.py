"""Error and delay of the gaze filter on a signal of known truth: fixations, pursuits and saccades."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.report.formats import UNKNOWN, Table
from scripts.measure.printing import print_tables
from vfoa.gaze_filter import CueFilter, GazeFilterSettings, follow
from vfoa.geometry import angle_between, perturb
from vfoa.types import Float

FRAMES = 1000
SACCADE_DEG = 30.0
NEAR_DEG = 5.0
LOOK_AHEAD = 15
"""Number of frames after a saccade in which the estimate is measured."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterQuality:
    """One row: at this noise per axis, the root mean square angle to the truth of the raw and the filtered signal.

    ``after_3_deg`` is the median error in the third frame of a new fixation after a saccade of 30 degrees, and
    ``frames_to_near`` the first frame in which the median error is 5 degrees or less, None if in none of 15.
    """

    noise_deg: float
    raw_rmse_deg: float
    filtered_rmse_deg: float
    after_3_deg: float
    frames_to_near: int | None

    @property
    def ratio(self) -> float:
        """Filtered over raw error: below 1 the filter helps."""
        return self.filtered_rmse_deg / self.raw_rmse_deg


def measure_gaze_filter(
    settings: GazeFilterSettings | None = None, noises_deg: Sequence[float] = (2, 4, 8), seeds: Sequence[int] = range(4)
) -> list[FilterQuality]:
    """Filter seeded signals of 1000 frames, and 20 saccades of 30 degrees per seed, with one setting for all noises."""
    settings = settings or GazeFilterSettings(cues="gaze")
    return [_measure(noise_deg, settings, seeds) for noise_deg in noises_deg]


def gaze_filter_table(rows: Sequence[FilterQuality]) -> Table:
    """Errors with and without the filter, and its delay after a saccade."""
    return Table(
        title="Gaze filter on fixations, pursuits and saccades",
        columns=("noise deg", "raw RMSE deg", "filtered", "ratio", "3 frames after", "frames to near"),
        rows=tuple(
            (
                f"{row.noise_deg:g}",
                f"{row.raw_rmse_deg:.1f}",
                f"{row.filtered_rmse_deg:.1f}",
                f"{row.ratio:.2f}",
                f"{row.after_3_deg:.1f}",
                UNKNOWN if row.frames_to_near is None else str(row.frames_to_near),
            )
            for row in rows
        ),
        words=0,
        notes=(
            f"Noise is per axis. After a saccade of {SACCADE_DEG:g} deg: median error in the third frame, deg, "
            f"and the first frame in which it is {NEAR_DEG:g} deg or less.",
        ),
    )


def steps_and_pursuits(rng: np.random.Generator, frames: int = FRAMES) -> Float:
    """True directions (N, 3), 25 a second: fixations and pursuits of 0.5 to 3 s with saccades of 5 to 40 deg between.

    Three in ten are pursuits of 5 to 25 deg/s. All stay within about 60 degrees of straight ahead.
    """
    at_deg, pieces, length = rng.uniform(-15, 15, 2), [], 0
    while length < frames:
        n = int(rng.integers(13, 76))
        speed = rng.uniform(0.2, 1.0) if rng.random() < 0.3 else 0.0
        piece = at_deg + speed * np.arange(n)[:, None] * _towards(rng)
        pieces.append(piece)
        length += n
        at_deg = np.clip(piece[-1] + rng.uniform(5, 40) * _towards(rng), -40, 40)
    return _directions(np.concatenate(pieces)[:frames])


def saccade(rng: np.random.Generator, frames_before: int = 20) -> Float:
    """True directions (N, 3): a fixation, then a new one 30 degrees away that lasts 15 frames."""
    from_deg = rng.uniform(-15, 15, 2)
    start = _directions(from_deg)
    end = perturb(start, *(np.deg2rad(SACCADE_DEG) * _towards(rng)))
    return np.concatenate([np.tile(start, (frames_before, 1)), np.tile(end, (LOOK_AHEAD, 1))])


def noisy(true: Float, noise_deg: float, rng: np.random.Generator) -> Float:
    """Directions (N, 3) with independent normal errors along both axes of each frame."""
    right, down = np.deg2rad(rng.normal(0, noise_deg, (2, len(true))))
    return perturb(true, right, down)


def filtered(measured: Float, settings: GazeFilterSettings) -> Float:
    """The filter's estimates (N, 3) for measurements (N, 3) without gaps."""
    estimate: CueFilter | None = None
    estimates = []
    for direction in measured:
        estimate = follow(estimate, direction, settings)
        assert estimate is not None
        estimates.append(estimate.direction)
    return np.array(estimates)


def _measure(noise_deg: float, settings: GazeFilterSettings, seeds: Sequence[int]) -> FilterQuality:
    raw, smooth, after = [], [], []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        true = steps_and_pursuits(rng)
        measured = noisy(true, noise_deg, rng)
        raw.append(angle_between(measured, true))
        smooth.append(angle_between(filtered(measured, settings), true))
        for _ in range(20):
            jump = saccade(rng)
            after.append(angle_between(filtered(noisy(jump, noise_deg, rng), settings), jump)[-LOOK_AHEAD:])
    typical_deg = np.rad2deg(np.median(after, axis=0))
    near = np.flatnonzero(typical_deg <= NEAR_DEG)
    return FilterQuality(
        noise_deg=noise_deg,
        raw_rmse_deg=_rms_deg(raw),
        filtered_rmse_deg=_rms_deg(smooth),
        after_3_deg=float(typical_deg[2]),
        frames_to_near=int(near[0]) + 1 if len(near) else None,
    )


def _rms_deg(errors_rad: Sequence[Float]) -> float:
    return float(np.rad2deg(np.sqrt(np.mean(np.square(errors_rad)))))


def _towards(rng: np.random.Generator) -> Float:
    angle = rng.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _directions(angles_deg: Float) -> Float:
    """Unit directions (..., 3) at (right, down) angles (..., 2) from straight ahead."""
    right, down = np.moveaxis(np.deg2rad(angles_deg), -1, 0)
    return perturb(np.broadcast_to([0.0, 0.0, 1.0], (*right.shape, 3)), right, down)


def main() -> None:
    """Measure and print the table."""
    argparse.ArgumentParser(description="Measure the gaze filter on a drawn signal.").parse_args()
    print_tables(gaze_filter_table(measure_gaze_filter()))
