"""Differences as tables: pairs of configurations, the oracle ablation, clips needed, and published rates."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations, takewhile
from typing import NamedTuple

import numpy as np

from harness.report.csv_tables import COMPARISON_COLUMNS
from harness.report.factors import compare_factors
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
from harness.run.manifest import PublishedCount
from harness.score.comparison import (
    MOST_CLIPS,
    NO_COMMON_FRAME,
    POWER,
    SPREAD_LEVEL,
    Clips,
    Comparison,
    Spread,
    clips_needed,
    compare,
    detectable_difference,
    identical_on,
)
from harness.score.intervals import LEAST_CLIPS, Pairs, ScoredFrames, Units, pair
from harness.score.oracle_ablation import steps, without_oracles
from harness.score.rows import ScoreRow
from harness.score.score import Scores
from harness.score.statistics import NO_INTERVAL, SIGNIFICANCE, wilson_interval
from vfoa.errors import counted

_TITLE = "Configurations compared on the same frames"
_FACTORS = "Factors of the grid compared over all values of the others"
_POINTS = "Points: difference of the FRR on the common frames."
_COUNTS = "Better, worse: frames that only the first, only the second gets right."
_NOTES = (
    f"p: exact sign-flip test, two-sided, by clip from {LEAST_CLIPS} clips on, by joined look below that; a test by "
    "look speaks of these clips only. Corrected: for the number of comparisons in this table, by Holm's method; "
    f"significant below {100 * SIGNIFICANCE:.0f} %. 95 %: the differences that the corrected test does not reject.",
    "Detectable: the true difference that would be significant, corrected, in 80 of 100 such experiments, if clips "
    "vary as these do. None: with so few units, no difference can be significant. n units give p = 2 / 2^n at best, "
    "0.031 with six. Identical: right on the same frames.",
)


def compare_configurations(scores: Scores) -> tuple[Comparison, ...]:
    """Compare every two configurations of a run, without the oracle ablation, which has a table of its own."""
    return scores.memoized("comparisons", lambda: compare(_compared_frames(scores)))


def compare_levels(scores: Scores) -> dict[str, tuple[Comparison, ...]]:
    """Compare every two labels of each factor of a grid, as :func:`harness.report.factors.compare_factors` does."""
    return scores.memoized("factors", lambda: compare_factors(_compared_frames(scores), scores.factors))


def factors_table(scores: Scores) -> Table:
    """The labels of each factor of a grid, compared over all values of the others; no rows for a run without a grid."""
    groups = compare_levels(scores).values()
    return comparison_table([comparison for group in groups for comparison in group], title=_FACTORS)


def _compared_frames(scores: Scores) -> dict[str, list[ScoredFrames]]:
    """The scored frames of each configuration that has some."""
    names = without_oracles(scores.scored_configurations)
    return {name: frames for name in names if (frames := scores.frames_of(name))}


def terminal_comparisons(comparisons: Sequence[Comparison]) -> Table:
    """One line for each pair, without numbers of frames.

    A common beginning of all names, such as the folder of the only run, is left out.
    """
    table = comparison_table(comparisons)
    return replace(table.only(table.columns[:-3]), notes=(_POINTS, *_NOTES))


def comparison_table(comparisons: Sequence[Comparison], *, title: str = _TITLE) -> Table:
    """Pairs of configurations on their common frames, for people."""
    shared = shared_folder([name for comparison in comparisons for name in comparison.names])
    return Table.of(
        title,
        "Configuration | Against | Verdict | Points | 95 % | Units | p | Corrected | Detectable | n | Better | Worse",
        (
            (
                *(comparison.configuration.removeprefix(shared), comparison.reference.removeprefix(shared)),
                verdict_in_words(comparison),
                points(comparison.difference),
                points_range(comparison.interval),
                _units(comparison),
                *(p_value(comparison.p), p_value(comparison.p_holm), _detectable(comparison.detectable)),
                *(comparison.n, comparison.better, comparison.worse),
            )
            for comparison in comparisons
        ),
        words=3,
        notes=(f"{_POINTS} {_COUNTS}", *_NOTES),
    )


def verdict_in_words(comparison: Comparison) -> str:
    """The result of a comparison in a table."""
    if comparison.is_identical:
        return identical_on(comparison.n)
    if comparison.n == 0:
        return NO_COMMON_FRAME
    return comparison.verdict if comparison.is_significant else "not told apart"


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
    return counted(comparison.clips, "clip") if comparison.unit == "clip" else counted(comparison.looks, "look")


def _detectable(share: float) -> str:
    return "none" if math.isinf(share) else percent(share)


def shared_folder(names: Iterable[str]) -> str:
    """The folders that all names have in common, with the slash."""
    levels = zip(*(name.split("/")[:-1] for name in names), strict=False)
    return "".join(f"{level[0]}/" for level in takewhile(lambda level: len(set(level)) == 1, levels))


def run_in_words(run: object, shared: str) -> str:
    """The path of a run without the :func:`shared_folder` of the names."""
    return f"{run}/".removeprefix(shared).rstrip("/")


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


MOST_IDENTICAL = 3
"""Most pairs of configurations without a difference that the notes of a plan name."""


class PlannedPair(NamedTuple):
    """Two configurations on a run, and the clips that it takes to tell them apart: as they are, and twice as long.

    Both are None if not even :data:`harness.score.comparison.MOST_CLIPS` clips do, or their spread is not known.
    """

    names: tuple[str, str]
    pairs: Pairs
    units: Units
    spread: Spread
    clips: Clips | None
    longer: Clips | None

    @property
    def is_known(self) -> bool:
        """Whether the run has a spread between clips."""
        return not (math.isnan(self.spread.between) or self.pairs.is_identical)


def plan_pairs(scores: Scores, difference: float) -> list[PlannedPair]:
    """Plan for a difference (a share) between every two configurations, without the oracle ablation.

    Tests are corrected for the number of these comparisons.
    """
    compared = combinations(without_oracles(scores.scored_configurations), 2)
    paired = [(names, pair(*map(scores.frames_of, names))) for names in compared]
    known = [(names, pairs, pairs.units) for names, pairs in paired if pairs.units]
    planned = []
    for names, pairs, units in known:
        spread = Spread.of(units)
        needs = partial(clips_needed, spread, difference, family=len(known))
        clips, longer = (None, None) if pairs.is_identical else (needs(), needs(looks=2 * spread.looks))
        planned.append(PlannedPair(names, pairs, units, spread, clips, longer))
    return planned


def plan_sentence(planned: Sequence[PlannedPair], difference: float) -> str:
    """The clips for a difference (a share) between any two configurations, their range, and what that assumes."""
    known = [each for each in planned if each.is_known]
    if not known:
        return (
            "How many clips it takes is not known: it follows from how much clips differ, and this run has no two "
            "clips on which two configurations differ."
        )
    hardest = max(known, key=lambda each: each.clips.needed if each.clips else math.inf)
    between = "the two configurations" if len(planned) == 1 else "any two configurations"
    corrected = f", corrected for {len(planned)} comparisons" if len(planned) > 1 else ""
    number = f"More than {MOST_CLIPS} clips" if hardest.clips is None else f"{hardest.clips.needed} clips"
    of_spread = f"the ends of the {100 * SPREAD_LEVEL:.0f} % interval of the spread"
    ends = "" if hardest.clips is None else f" ({_range(hardest.clips)}: {of_spread})"
    return (
        f"{number}{ends} find a true difference of {100 * difference:g} points between {between} with a probability of "
        f"{100 * POWER:.0f} %, assuming that clips differ as the {hardest.spread.clips} of this run do, normally and "
        f"independently; test by clip at {100 * SIGNIFICANCE:.0f} %{corrected}."
    )


def plan_table(planned: Sequence[PlannedPair], difference: float) -> Table:
    """For every two configurations, the number of clips needed, and the figures that it follows from, where known."""
    identical = [each for each in planned if each.pairs.is_identical]
    return Table.of(
        f"Clips needed to see a difference of {100 * difference:g} points",
        "Configuration | Against | Clips | Range | Twice the looks | Points now | Detectable now | Spread of clips | "
        "Spread of looks",
        (_planned_row(each, len(planned)) for each in planned),
        words=2,
        notes=(
            *(
                f"{each.names[1]} vs {each.names[0]}: {identical_on(each.pairs.n)}, so that their spread is not known."
                for each in identical[:MOST_IDENTICAL]
            ),
            *([f"So are {more} more pairs."] if (more := len(identical) - MOST_IDENTICAL) > 0 else []),
            f"Clips: the fewest that find the difference with a probability of {100 * POWER:.0f} %, averaged over the "
            f"spreads that the clips of this run leave possible; at least {LEAST_CLIPS}, the fewest that a test by "
            "clip takes. Range: the fewest for the same probability if the spread is at the ends of its "
            f"{100 * SPREAD_LEVEL:.0f} % interval. Few clips make it wide: plan again when there are more. Twice the "
            "looks: the clips if each has twice as many looks.",
            "Spread: standard deviation of the difference between clips, and what the looks of one clip add to it, "
            "in points.",
        ),
    )


def _planned_row(planned: PlannedPair, family: int) -> tuple[str, ...]:
    (reference, configuration), clips, spread = planned.names, planned.clips, planned.spread
    return (
        *(configuration, reference),
        *((UNKNOWN, UNKNOWN) if clips is None else (str(clips.needed), _range(clips))),
        UNKNOWN if planned.longer is None else str(planned.longer.needed),
        *(points(planned.units.rate), _detectable(detectable_difference(planned.units, family))),
        *((UNKNOWN, UNKNOWN) if planned.pairs.is_identical else map(_deviation, (spread.between, spread.within))),
    )


def _deviation(variance: float) -> str:
    return percent(math.sqrt(variance))


def _range(clips: Clips) -> str:
    return f"{clips.fewest} to {clips.most or f'more than {MOST_CLIPS}'}"


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
            for row in scores.rows.overall
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
