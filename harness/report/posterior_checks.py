"""Tables on the posterior: how often its sets hold the truth, and whether directions fit what it believes."""

from __future__ import annotations

from collections.abc import Sequence

from harness.report.formats import UNKNOWN, Table
from harness.score.direction_checks import MOST_SURPRISES, MOST_TIMES_CLAIMED, SMALL_TAIL, DirectionCheck
from harness.score.prediction_sets import LEVEL, SetCoverage


def prediction_set_table(found: Sequence[SetCoverage]) -> Table:
    """One row for each configuration that gives probabilities, over all clips."""
    return Table(
        title=f"Answers in sets of {100 * LEVEL:.0f} % probability",
        columns=("Configuration", "n", "Coverage %", "Mean size"),
        words=1,
        rows=tuple(
            (each.configuration, str(each.n), f"{100 * each.covered / each.n:.1f}", f"{each.mean_size:.2f}")
            for each in found
        ),
        notes=(
            f"The fewest objects, nowhere among them, with {100 * LEVEL:.0f} % of the probability together. Coverage: "
            "share of the scored frames in which the set holds the truth; size: how many it holds.",
        ),
    )


def direction_check_table(found: Sequence[DirectionCheck]) -> Table:
    """One row for each clip and configuration with a posterior."""
    return Table(
        title="Do the measured directions fit the posterior?",
        columns=("Clip", "Configuration", "n", "Surprising %", "Claimed deg", "Implied deg", "Fit"),
        words=2,
        rows=tuple(
            (
                each.clip,
                each.configuration,
                str(each.n),
                f"{100 * each.surprises:.1f}",
                _degrees(each.claimed_deg),
                _degrees(each.implied_deg),
                "yes" if each.fits else "no",
            )
            for each in found
        ),
        notes=(
            f"Surprising: frames whose directions fit worse than all but {100 * SMALL_TAIL:.0f} % of those that the "
            "posterior expected. Claimed: the median of the gaze error that its source states; implied: what the "
            f"directions imply, bias included. No fit: above {100 * MOST_SURPRISES:.0f} % surprises, or errors that "
            f"differ by more than {MOST_TIMES_CLAIMED:g} times.",
        ),
    )


def _degrees(angle_deg: float | None) -> str:
    return UNKNOWN if angle_deg is None else f"{angle_deg:.1f}"
