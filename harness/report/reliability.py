"""How far probabilities can be believed, as tables."""

from __future__ import annotations

from collections.abc import Sequence

from harness.report.formats import Table, interval_range, number, percent
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


def reliability_table(found: Sequence[Reliability]) -> Table:
    """One row for each configuration that gives probabilities, over all clips."""
    return Table.of(
        "Calibration of the probabilities",
        "Configuration | n | Right % | Mean confidence % | ECE | 95 % | ECE, adaptive | Brier",
        ((each.configuration, *_means(each), interval_range(each.interval, ".3f"), *_errors(each)) for each in found),
        words=1,
        notes=(
            f"Over the scored frames with a prediction. ECE: expected calibration error, {BINS} equal bins of the "
            f"probability of what was predicted; 95 %: clips resampled, from {LEAST_CLIPS} clips on. Adaptive: bins "
            "of as many frames each. Brier: squared distance of all probabilities from the truth, 0 to 2.",
        ),
    )


def subject_reliability_table(found: Sequence[Reliability]) -> Table:
    """One row for each subject and configuration that gives probabilities."""
    return Table.of(
        "Calibration by subject",
        "Clip | Subject | Configuration | n | Right % | Mean confidence % | ECE | ECE, adaptive | Brier",
        ((each.clip, each.subject, each.configuration, *_means(each), *_errors(each)) for each in found),
        words=3,
    )


def _means(each: Reliability) -> tuple[object, ...]:
    return each.n, percent(each.share_right), percent(each.mean_confidence), number(each.calibration_error, 3)


def _errors(each: Reliability) -> tuple[str, str]:
    return number(each.adaptive_error, 3), number(each.brier, 3)


def prediction_set_table(found: Sequence[SetCoverage]) -> Table:
    """One row for each configuration that gives probabilities, over all clips."""
    return Table.of(
        f"Answers in sets of {100 * SET_LEVEL:.0f} % probability",
        "Configuration | n | Coverage % | Mean size",
        ((each.configuration, each.n, percent(each.covered / each.n), number(each.mean_size, 2)) for each in found),
        words=1,
        notes=(
            f"The fewest objects, nowhere among them, with {100 * SET_LEVEL:.0f} % of the probability together. "
            "Coverage: share of the scored frames in which the set holds the truth; size: how many it holds.",
        ),
    )


def direction_check_table(found: Sequence[DirectionCheck]) -> Table:
    """One row for each clip and configuration with a posterior."""
    return Table.of(
        "Do the measured directions fit the posterior?",
        "Clip | Configuration | n | Surprising % | Claimed deg | Implied deg | Head share | Fit",
        (
            (
                *(each.clip, each.configuration, each.n, percent(each.surprises), number(each.claimed_deg, 1)),
                *(number(each.implied_deg, 1), number(each.share, 2), "yes" if each.fits else "no"),
            )
            for each in found
        ),
        words=2,
        notes=(
            f"Surprising: frames whose directions fit worse than all but {100 * SMALL_TAIL:.0f} % of those that the "
            "posterior expected. Claimed: the median of the gaze error that its source states; implied: what the "
            f"directions imply, bias included. Head share: share of the way to the targets that heads turn, as the "
            f"directions imply; people turn them 0.35 to 0.75. No fit: above {100 * MOST_SURPRISES:.0f} % surprises, "
            f"errors that differ by more than {MOST_TIMES_CLAIMED:g} times, or a share above {MOST_SHARE:g}: targets "
            "do not explain the heads. A fit does not show that the probabilities are right: only labels do.",
        ),
    )
