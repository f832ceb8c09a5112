"""Differences between configurations as tables: pairs, of one run or several, and the steps of the oracle ablation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import takewhile

from harness.report.formats import UNKNOWN, Table
from harness.score.comparison import Comparison, compare
from harness.score.intervals import LEAST_CLIPS
from harness.score.oracle_ablation import steps, without_oracles
from harness.score.score import Scores
from harness.score.statistics import SIGNIFICANCE, Interval

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
                *(_p(each.p), _p(each.p_holm), _number(each.detectable)),
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
        columns=(
            *("reference", "configuration", "n", "looks", "clips", "better", "worse"),
            *("difference", "difference_low", "difference_high", "unit", "p", "p_holm", "detectable", "sentence"),
        ),
        words=2,
        rows=tuple(
            (
                *(each.reference, each.configuration),
                *map(str, (each.n, each.looks, each.clips, each.better, each.worse)),
                *map(_share, (each.difference, each.interval.low, each.interval.high)),
                *(each.unit, f"{each.p:.6g}", f"{each.p_holm:.6g}", _share(each.detectable), each.sentence),
            )
            for each in comparisons
        ),
    )


def _points(each: Comparison) -> tuple[str, str]:
    return (UNKNOWN if math.isnan(each.difference) else f"{100 * each.difference:+.1f}"), _range(each.interval)


def _units(each: Comparison) -> str:
    return f"{each.clips} clips" if each.unit == "clip" else f"{each.looks} looks"


def _number(share: float) -> str:
    return UNKNOWN if math.isnan(share) else "none" if math.isinf(share) else f"{100 * share:.1f}"


def _share(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.6f}"


def _shared_folder(names: Sequence[str]) -> str:
    """The folders that all names have in common, with the slash."""
    levels = zip(*(name.split("/")[:-1] for name in names), strict=False)
    return "".join(f"{level[0]}/" for level in takewhile(lambda level: len(set(level)) == 1, levels))


def _p(p: float) -> str:
    return "<0.001" if p < 0.001 else f"{p:.2g}"


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
                f"{100 * step.row.frr:.1f}",
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
                "" if step.gained is None else _share(step.gained),
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
    return ("", "") if interval is None else (_share(interval.low), _share(interval.high))
