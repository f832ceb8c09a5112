"""Differences as tables: pairs of configurations, the oracle ablation, clips needed, and published rates."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, takewhile

import numpy as np

from harness.columns import COMPARISON_COLUMNS
from harness.report.formats import UNKNOWN, Table, csv_share, p_value, percent
from harness.run.directory import PublishedCount
from harness.score.comparison import POWER, Clips, Comparison, Spread, clips_needed, compare, detectable_difference
from harness.score.intervals import LEAST_CLIPS, Units
from harness.score.oracle_ablation import steps, without_oracles
from harness.score.score import Scores
from harness.score.scored_frames import pair
from harness.score.statistics import SIGNIFICANCE, Interval, wilson_interval

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
    names = [name for each in comparisons for name in (each.configuration, each.reference)]
    shared = _shared_folder(names)
    return Table(
        title=_TITLE,
        columns=("Configuration", "Against", "Verdict", "Points", "95 %", "Units", "p", "Corrected", "Detectable"),
        words=3,
        rows=tuple(
            (
                *(name.removeprefix(shared) for name in (each.configuration, each.reference)),
                "not told apart" if not each.is_significant else each.verdict,
                *_points(each),
                _units(each),
                *(p_value(each.p), p_value(each.p_holm), _detectable(each.detectable)),
            )
            for each in comparisons
        ),
        notes=_NOTES,
    )


def comparison_table(comparisons: Sequence[Comparison]) -> Table:
    """Pairs of configurations on their common frames, for people."""
    table = terminal_comparisons(comparisons)
    return replace(
        table,
        columns=(*table.columns, "n", "Better", "Worse"),
        rows=tuple(
            (*row, str(each.n), str(each.better), str(each.worse))
            for row, each in zip(table.rows, comparisons, strict=True)
        ),
    )


def comparisons_csv(comparisons: Sequence[Comparison]) -> Table:
    """The same table for programs: differences as shares."""
    return Table(
        title="Comparisons",
        columns=tuple(COMPARISON_COLUMNS),
        words=2,
        rows=tuple(
            (
                *(each.reference, each.configuration),
                *map(str, (each.n, each.looks, each.clips, each.better, each.worse)),
                *map(csv_share, (each.difference, each.interval.low, each.interval.high)),
                *(each.unit, f"{each.p:.6g}", f"{each.p_holm:.6g}", csv_share(each.detectable), each.sentence),
            )
            for each in comparisons
        ),
    )


def _points(each: Comparison) -> tuple[str, str]:
    return (UNKNOWN if math.isnan(each.difference) else f"{100 * each.difference:+.1f}"), _range(each.interval)


def _units(each: Comparison) -> str:
    return f"{each.clips} clips" if each.unit == "clip" else f"{each.looks} looks"


def _detectable(share: float) -> str:
    return "none" if math.isinf(share) else percent(share)


def _shared_folder(names: Sequence[str]) -> str:
    """The folders that all names have in common, with the slash."""
    levels = zip(*(name.split("/")[:-1] for name in names), strict=False)
    return "".join(f"{level[0]}/" for level in takewhile(lambda level: len(set(level)) == 1, levels))


def ablation_table(scores: Scores) -> Table:
    """Points of FRR that each stage costs, over all clips; no rows for a run without ``--oracle``."""
    return Table(
        title="Oracle ablation: what each stage costs",
        columns=("Step", "Against the row above", "n", "FRR %", "Points", "95 %"),
        words=2,
        rows=tuple(
            (
                step.configuration if step.replaced is None else f"+ true {step.replaced.replace('_', ' ')}",
                step.reads,
                str(step.row.n),
                percent(step.row.frr),
                "" if step.gained is None else f"{100 * step.gained:+.1f}",
                _range(step.interval),
            )
            for step in steps(scores)
        ),
        notes=(
            "Each row replaces one stage more by the truth. Points: FRR gained by that, given the rows above: errors "
            "interact, and a stage's error can hide another's (boxes that are too large forgive a gaze that is off). "
            "95 %: interval of the points, by clips or, below 6 clips, by looks of these clips. As good: it holds 0.",
            "A true head pose can cost frames: a head need not point at what the eyes look at, and one that stops "
            "short of it is turned onto it by an error at times.",
        ),
    )


def terminal_ablation(scores: Scores) -> Table:
    """The same table with shorter notes."""
    return replace(
        ablation_table(scores),
        notes=(
            "Each row replaces one stage more by the truth; points of FRR gained by that, with their 95 % interval "
            "(as good: it holds 0). frr.md says how to read it.",
        ),
    )


def ablation_csv(scores: Scores) -> Table:
    """The same table for programs: shares with six decimals, empty for the first step."""
    return Table(
        title="Oracle ablation",
        columns=("configuration", "replaced", "n", "frr", "gained", "gained_low", "gained_high", "reads"),
        words=2,
        rows=tuple(
            (
                *(step.configuration, step.replaced or "", str(step.row.n), f"{step.row.frr:.6f}"),
                "" if step.gained is None else csv_share(step.gained),
                *_ends(step.interval),
                step.reads,
            )
            for step in steps(scores)
        ),
    )


def _range(interval: Interval | None) -> str:
    if interval is None:
        return ""
    return UNKNOWN if math.isnan(interval.low) else f"{100 * interval.low:+.1f} to {100 * interval.high:+.1f}"


def _ends(interval: Interval | None) -> tuple[str, str]:
    return ("", "") if interval is None else (csv_share(interval.low), csv_share(interval.high))


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Clips that two configurations need: ``clips`` with as many looks each as now, ``clips_longer`` with twice those.

    ``difference`` is the observed one, ``detectable`` the one that this run can detect; both are shares. The tests are
    corrected for ``family`` comparisons. None: not reachable, or not known from so few clips.
    """

    reference: str
    configuration: str
    difference: float
    detectable: float
    spread: Spread
    family: int
    clips: Clips | None
    clips_longer: Clips | None


def plans(scores: Scores, points: float, power: float = POWER) -> list[Plan]:
    """Plan for every two configurations how to detect a difference of ``points`` points of FRR."""
    pairs = list(_pairs(scores))
    return [_plan(one, two, units, points / 100, power, len(pairs)) for one, two, units in pairs]


def _pairs(scores: Scores) -> Iterator[tuple[str, str, Units]]:
    for one, two in combinations(without_oracles(scores.scored_configurations), 2):
        units = pair(scores.frames_of(one), scores.frames_of(two)).units
        if units is not None:
            yield one, two, units


def _plan(reference: str, configuration: str, units: Units, difference: float, power: float, family: int) -> Plan:
    spread = Spread.of(units)
    return Plan(
        reference=reference,
        configuration=configuration,
        difference=units.rate,
        detectable=detectable_difference(units, family, power),
        spread=spread,
        family=family,
        clips=clips_needed(spread, difference, power=power, family=family),
        clips_longer=clips_needed(spread, difference, looks=2 * spread.looks, power=power, family=family),
    )


def plan_table(found: list[Plan], points: float, power: float = POWER) -> Table:
    """The clips and looks that every two configurations need."""
    family = found[0].family if found else 1
    return Table(
        title=f"Clips needed to see a difference of {points:g} points",
        columns=(
            *("Configuration", "Against", "Points now", "Detectable now", "Spread of clips", "Spread of looks"),
            *("Clips", "Range", "Power %", "Twice the looks"),
        ),
        words=2,
        rows=tuple(
            (
                *(each.configuration, each.reference, f"{100 * each.difference:+.1f}", _detectable(each.detectable)),
                *(_deviation(each.spread.between), _deviation(each.spread.within)),
                *_clips(each.clips),
                UNKNOWN if each.clips_longer is None else str(each.clips_longer.needed),
            )
            for each in found
        ),
        notes=(
            f"Clips: as many as find a true difference of this size significant at 5 %, corrected for {family} "
            f"comparison{'s' if family > 1 else ''}, with a probability of {100 * power:.0f} %; at least "
            f"{LEAST_CLIPS}, the fewest that a test by clip takes. Power: that probability for the clips given. Twice "
            "the looks: the clips if each has twice as many looks.",
            "The spread of few clips is uncertain itself: power is averaged over the spreads that these clips leave "
            "possible. Range: the clips if the spread is at the ends of its own 80 % interval. Few clips make it wide: "
            "plan again when there are more.",
            "Spread: standard deviation of the difference between clips, and what the looks of one clip add to it, "
            "in points. The differences of clips are taken as normal and independent.",
        ),
    )


def _clips(clips: Clips | None) -> tuple[str, str, str]:
    if clips is None:
        return UNKNOWN, UNKNOWN, UNKNOWN
    most = "more than 100000" if clips.most is None else str(clips.most)
    return str(clips.needed), f"{clips.fewest} to {most}", f"{100 * clips.power:.0f}"


def _deviation(variance: float) -> str:
    return percent(math.sqrt(variance))


@dataclass(frozen=True, slots=True, kw_only=True)
class Reproduction:
    """One configuration's rates here and as published; ``p`` is of Fisher's exact two-sided test of equality."""

    configuration: str
    published: PublishedCount
    correct: int
    n: int
    p: float


def reproductions(scores: Scores) -> list[Reproduction]:
    """The configurations that were scored here and have a published count, in the order of the scores.

    The publication's frames are not known one by one, so the two samples are treated as independent.
    """
    if scores.published is None:
        return []
    from scipy.stats import fisher_exact

    found = []
    for row in scores.overall():
        if count := scores.published.counts.get(row.configuration):
            table = np.array([[row.correct, row.n - row.correct], [count.correct, count.n - count.correct]])
            found.append(
                Reproduction(
                    configuration=row.configuration,
                    published=count,
                    correct=row.correct,
                    n=row.n,
                    p=float(fisher_exact(table).pvalue),
                )
            )
    return found


def published_table(scores: Scores) -> Table:
    """Published rates beside those of this run; no rows if none was published."""
    source = scores.published.source if scores.published else ""
    return Table(
        title="Beside the published figures",
        columns=("Configuration", "Published FRR %", "Wilson", "Here FRR %", "Wilson here", "Points", "p"),
        words=1,
        rows=tuple(
            (
                each.configuration,
                *_rate(each.published.correct, each.published.n),
                *_rate(each.correct, each.n),
                f"{100 * (each.correct / each.n - each.published.correct / each.published.n):+.1f}",
                p_value(each.p),
            )
            for each in reproductions(scores)
        ),
        notes=(
            f"Published: {source}. p: Fisher's exact test that both rates are the same, two-sided; it takes "
            "frames as independent.",
        ),
    )


def _rate(correct: int, n: int) -> tuple[str, str]:
    interval = wilson_interval(correct, n)
    return percent(correct / n), f"{100 * interval.low:.0f}–{100 * interval.high:.0f}"
