"""Differences as tables: pairs of configurations, the oracle ablation, clips needed, and published rates."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations, takewhile

import numpy as np

from harness.report.csv_tables import COMPARISON_COLUMNS
from harness.report.formats import (
    UNKNOWN,
    Table,
    csv_share,
    p_value,
    percent,
    percent_range,
    points,
    points_range,
)
from harness.run.directory import PublishedCount
from harness.score.comparison import POWER, Clips, Comparison, Spread, clips_needed, compare, detectable_difference
from harness.score.intervals import LEAST_CLIPS, Units, pair
from harness.score.oracle_ablation import steps, without_oracles
from harness.score.score import ScoreRow, Scores
from harness.score.statistics import SIGNIFICANCE, wilson_interval
from harness.score.statistics import UNKNOWN as NO_INTERVAL

_TITLE = "Configurations compared on the same frames"
_NOTES = (
    "Points: difference of the FRR on the common frames. Better, worse: frames that only the first, only the second "
    "gets right.",
    f"p: exact sign-flip test, two-sided, by clip from {LEAST_CLIPS} clips on, by joined look below that; a test by "
    "look speaks of these clips only. Corrected: for the number of comparisons in this table, by Holm's method; "
    f"significant below {100 * SIGNIFICANCE:.0f} %. 95 %: the differences that the corrected test does not reject.",
    "Detectable: the true difference that would be significant, corrected, in 80 of 100 such experiments, if clips "
    "vary as these do. None: with so few units, no difference can be significant. n units give p = 2 / 2^n at best, "
    "0.031 with six.",
)


def compare_configurations(scores: Scores) -> tuple[Comparison, ...]:
    """Compare every two configurations of a run, without the oracle ablation, which has a table of its own."""
    return compare({name: scores.frames_of(name) for name in without_oracles(scores.scored_configurations)})


def terminal_comparisons(comparisons: Sequence[Comparison]) -> Table:
    """One line for each pair. A common beginning of all names, such as the folder of the only run, is left out."""
    table = comparison_table(comparisons)
    return table.only(table.columns[:-3])


def comparison_table(comparisons: Sequence[Comparison]) -> Table:
    """Pairs of configurations on their common frames, for people."""
    shared = _shared_folder([name for comparison in comparisons for name in comparison.names])
    return Table.of(
        _TITLE,
        "Configuration | Against | Verdict | Points | 95 % | Units | p | Corrected | Detectable | n | Better | Worse",
        (
            (
                *(comparison.configuration.removeprefix(shared), comparison.reference.removeprefix(shared)),
                comparison.verdict if comparison.is_significant else "not told apart",
                *(points(comparison.difference), points_range(comparison.interval), _units(comparison)),
                *(p_value(comparison.p), p_value(comparison.p_holm), _detectable(comparison.detectable)),
                *(comparison.n, comparison.better, comparison.worse),
            )
            for comparison in comparisons
        ),
        words=3,
        notes=_NOTES,
    )


def comparisons_csv(comparisons: Sequence[Comparison]) -> Table:
    """The same table for programs: differences as shares."""
    return Table.of(
        "Comparisons",
        "|".join(COMPARISON_COLUMNS),
        (
            (
                *(*comparison.names, comparison.n, comparison.looks, comparison.clips),
                *(comparison.better, comparison.worse),
                *map(csv_share, (comparison.difference, comparison.interval.low, comparison.interval.high)),
                *(comparison.unit, f"{comparison.p:.6g}", f"{comparison.p_holm:.6g}"),
                *(csv_share(comparison.detectable), comparison.sentence),
            )
            for comparison in comparisons
        ),
        words=2,
    )


def _units(comparison: Comparison) -> str:
    return f"{comparison.clips} clips" if comparison.unit == "clip" else f"{comparison.looks} looks"


def _detectable(share: float) -> str:
    return "none" if math.isinf(share) else percent(share)


def _shared_folder(names: Sequence[str]) -> str:
    """The folders that all names have in common, with the slash."""
    levels = zip(*(name.split("/")[:-1] for name in names), strict=False)
    return "".join(f"{level[0]}/" for level in takewhile(lambda level: len(set(level)) == 1, levels))


def ablation_table(scores: Scores) -> Table:
    """Points of FRR that each stage costs, over all clips; no rows for a run without ``--oracle``."""
    return Table.of(
        "Oracle ablation: what each stage costs",
        "Step | Against the row above | n | FRR % | Points | 95 %",
        (
            (
                step.configuration if step.replaced is None else f"+ true {step.replaced.replace('_', ' ')}",
                *(step.reads, step.row.n, percent(step.row.frr)),
                *("" if step.gained is None else points(step.gained), points_range(step.interval)),
            )
            for step in steps(scores)
        ),
        words=2,
        notes=(
            "Each row replaces one stage more by the truth. Points: FRR gained by that, given the rows above: errors "
            "interact, and a stage's error can hide another's (boxes that are too large forgive a gaze that is off). "
            "95 %: interval of the points, by clips or, below 6 clips, by looks of these clips. As good: it holds 0.",
            "A true head pose can cost frames: a head need not point at what the eyes look at, and one that stops "
            "short of it is turned onto it by an error at times.",
        ),
    )


def ablation_csv(scores: Scores) -> Table:
    """The same table for programs: shares with six decimals, empty for the first step."""
    return Table.of(
        "Oracle ablation",
        "configuration | replaced | n | frr | gained | gained_low | gained_high | reads",
        (
            (
                *(step.configuration, step.replaced or "", step.row.n),
                *map(csv_share, (step.row.frr, step.gained, interval.low, interval.high)),
                step.reads,
            )
            for step in steps(scores)
            for interval in [step.interval or NO_INTERVAL]
        ),
        words=2,
    )


def plan_table(scores: Scores, difference: float) -> Table:
    """The clips and looks that every two configurations need to see a difference in points of FRR.

    Tests are corrected for the number of these comparisons. Cells are unknown where it is not reachable, or if there
    are too few clips to tell.
    """
    compared = combinations(without_oracles(scores.scored_configurations), 2)
    known = [(names, units) for names in compared if (units := pair(*map(scores.frames_of, names)).units)]
    family = max(len(known), 1)
    return Table.of(
        f"Clips needed to see a difference of {difference:g} points",
        "Configuration | Against | Points now | Detectable now | Spread of clips | Spread of looks | Clips | Range | "
        "Power % | Twice the looks",
        (
            (configuration, reference, *_plan(units, difference / 100, family))
            for (reference, configuration), units in known
        ),
        words=2,
        notes=(
            f"Clips: as many as find a true difference of this size significant at 5 %, corrected for {family} "
            f"comparison{'s' if family > 1 else ''}, with a probability of {100 * POWER:.0f} %; at least "
            f"{LEAST_CLIPS}, the fewest that a test by clip takes. Power: that probability for the clips given. Twice "
            "the looks: the clips if each has twice as many looks.",
            "The spread of few clips is uncertain itself: power is averaged over the spreads that these clips leave "
            "possible. Range: the clips if the spread is at the ends of its own 80 % interval. Few clips make it wide: "
            "plan again when there are more.",
            "Spread: standard deviation of the difference between clips, and what the looks of one clip add to it, "
            "in points. The differences of clips are taken as normal and independent.",
        ),
    )


def _plan(units: Units, difference: float, family: int) -> Iterator[str]:
    """Yield the numbers of a row: those of now, the clips for a difference (a share), and those with longer clips."""
    spread = Spread.of(units)
    longer = clips_needed(spread, difference, looks=2 * spread.looks, family=family)
    yield from (points(units.rate), _detectable(detectable_difference(units, family)))
    yield from (percent(math.sqrt(spread.between)), percent(math.sqrt(spread.within)))
    yield from _clips(clips_needed(spread, difference, family=family))
    yield UNKNOWN if longer is None else str(longer.needed)


def _clips(clips: Clips | None) -> tuple[str, str, str]:
    if clips is None:
        return UNKNOWN, UNKNOWN, UNKNOWN
    return str(clips.needed), f"{clips.fewest} to {clips.most or 'more than 100000'}", f"{100 * clips.power:.0f}"


def published_table(scores: Scores) -> Table:
    """Published rates beside those of this run; no rows if none was published.

    p is of Fisher's exact two-sided test of equality. The publication's frames are not known one by one, so the two
    samples are treated as independent.
    """
    source, counts = (scores.published.source, scores.published.counts) if scores.published else ("", {})
    return Table.of(
        "Beside the published figures",
        "Configuration | Published FRR % | Wilson | Here FRR % | Wilson here | Points | p",
        (
            (
                *(row.configuration, *_rate(count.correct, count.n), *_rate(row.correct, row.n)),
                *(points(row.frr - count.correct / count.n), p_value(_fisher_p(count, row))),
            )
            for row in scores.overall()
            if (count := counts.get(row.configuration))
        ),
        words=1,
        notes=(
            f"Published: {source}. p: Fisher's exact test that both rates are the same, two-sided; it takes "
            "frames as independent.",
        ),
    )


def _fisher_p(published: PublishedCount, row: ScoreRow) -> float:
    from scipy.stats import fisher_exact

    table = np.array([[count.correct, count.n - count.correct] for count in (row, published)])
    return float(fisher_exact(table).pvalue)


def _rate(correct: int, n: int) -> tuple[str, str]:
    return percent(correct / n), percent_range(wilson_interval(correct, n))
