"""How far probabilities can be believed, as tables."""

from __future__ import annotations

import math
from collections.abc import Sequence

from harness.report.formats import UNKNOWN, Table, number
from harness.score.calibration import (
    BINS,
    MOST_SHARE,
    MOST_SURPRISES,
    MOST_TIMES_CLAIMED,
    SET_LEVEL,
    SMALL_TAIL,
    DirectionCheck,
    Reliability,
    SetCoverage,
)
from harness.score.intervals import LEAST_CLIPS
from harness.score.statistics import Interval


def reliability_table(found: Sequence[Reliability]) -> Table:
    """One row for each configuration that gives probabilities, over all clips."""
    return Table(
        title="Calibration of the probabilities",
        columns=("Configuration", "n", "Right %", "Mean confidence %", "ECE", "95 %", "ECE, adaptive", "Brier"),
        words=1,
        rows=tuple((each.configuration, *_means(each), _range(each.interval), *_last(each)) for each in found),
        notes=(
            f"Over the scored frames with a prediction. ECE: expected calibration error, {BINS} equal bins of the "
            f"probability of what was predicted; 95 %: clips resampled, from {LEAST_CLIPS} clips on. Adaptive: bins "
            "of as many frames each. Brier: squared distance of all probabilities from the truth, 0 to 2.",
        ),
    )


def subject_reliability_table(found: Sequence[Reliability]) -> Table:
    """One row for each subject and configuration that gives probabilities."""
    return Table(
        title="Calibration by subject",
        columns=(
            "Clip",
            "Subject",
            "Configuration",
            "n",
            "Right %",
            "Mean confidence %",
            "ECE",
            "ECE, adaptive",
            "Brier",
        ),
        words=3,
        rows=tuple(
            (str(each.clip), str(each.subject), each.configuration, *_means(each), *_last(each)) for each in found
        ),
    )


def _means(each: Reliability) -> tuple[str, ...]:
    shares = (f"{100 * each.share_right:.1f}", f"{100 * each.mean_confidence:.1f}")
    return (str(each.n), *shares, f"{each.calibration_error:.3f}")


def _last(each: Reliability) -> tuple[str, str]:
    return f"{each.adaptive_error:.3f}", f"{each.brier:.3f}"


def _range(interval: Interval) -> str:
    return UNKNOWN if math.isnan(interval.low) else f"{interval.low:.3f} to {interval.high:.3f}"


def prediction_set_table(found: Sequence[SetCoverage]) -> Table:
    """One row for each configuration that gives probabilities, over all clips."""
    return Table(
        title=f"Answers in sets of {100 * SET_LEVEL:.0f} % probability",
        columns=("Configuration", "n", "Coverage %", "Mean size"),
        words=1,
        rows=tuple(
            (each.configuration, str(each.n), f"{100 * each.covered / each.n:.1f}", f"{each.mean_size:.2f}")
            for each in found
        ),
        notes=(
            f"The fewest objects, nowhere among them, with {100 * SET_LEVEL:.0f} % of the probability together. "
            "Coverage: share of the scored frames in which the set holds the truth; size: how many it holds.",
        ),
    )


def direction_check_table(found: Sequence[DirectionCheck]) -> Table:
    """One row for each clip and configuration with a posterior."""
    return Table(
        title="Do the measured directions fit the posterior?",
        columns=("Clip", "Configuration", "n", "Surprising %", "Claimed deg", "Implied deg", "Head share", "Fit"),
        words=2,
        rows=tuple(
            (
                each.clip,
                each.configuration,
                str(each.n),
                f"{100 * each.surprises:.1f}",
                number(each.claimed_deg, 1),
                number(each.implied_deg, 1),
                number(each.share, 2),
                "yes" if each.fits else "no",
            )
            for each in found
        ),
        notes=(
            f"Surprising: frames whose directions fit worse than all but {100 * SMALL_TAIL:.0f} % of those that the "
            "posterior expected. Claimed: the median of the gaze error that its source states; implied: what the "
            f"directions imply, bias included. Head share: share of the way to the targets that heads turn, as the "
            f"directions imply; people turn them 0.35 to 0.75. No fit: above {100 * MOST_SURPRISES:.0f} % surprises, "
            f"errors that differ by more than {MOST_TIMES_CLAIMED:g} times, or a share above {MOST_SHARE:g}: targets "
            "do not explain the heads. A fit does not show that the probabilities are right: only labels do.",
        ),
    )
