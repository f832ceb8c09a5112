"""Pairs of configurations, of one run or of several, as tables."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile

from harness.report.formats import Table
from harness.scores.comparison import SIGNIFICANCE, Comparison, compare
from harness.scores.ladder import without_rungs
from harness.scores.score import Scores

_TITLE = "Configurations compared on the same frames"
_BETTER = "Better: (frame, subject) pairs, over all clips, that the first gets right and the second wrong."
_TEST = (
    "p: exact McNemar test, two-sided; Holm: corrected for all comparisons in this table; significant below "
    f"{100 * SIGNIFICANCE:.0f} % after it. The test takes frames as independent: read a small p of long looks with "
    "care."
)


def compare_configurations(scores: Scores) -> tuple[Comparison, ...]:
    """Every two configurations of a run; oracle rungs have a table of their own, and would weigh on the correction."""
    return compare({name: scores.verdicts_of(name) for name in without_rungs(scores.configurations)})


def terminal_comparisons(comparisons: Sequence[Comparison]) -> Table:
    """A line for each pair: what all names begin with, such as the one run's folder, is left out."""
    names = [name for each in comparisons for name in (each.configuration, each.reference)]
    shared = _shared_folder(names)
    return Table(
        title=_TITLE,
        columns=("Configuration", "Against", "Significant", "n", "Better", "Worse", "p", "p (Holm)"),
        words=3,
        rows=tuple(
            (
                *(name.removeprefix(shared) for name in (each.configuration, each.reference)),
                ("worse" if each.is_significant_drop else "better") if each.is_significant else "no",
                *(str(each.n), str(each.better), str(each.worse), _p(each.p), _p(each.p_holm)),
            )
            for each in comparisons
        ),
        notes=(_BETTER, _TEST),
    )


def comparison_table(comparisons: Sequence[Comparison]) -> Table:
    """Pairs of configurations on their common frames, for people."""
    return Table(
        title=_TITLE,
        columns=("In words", "n", "Better", "Worse", "p", "p (Holm)"),
        words=1,
        rows=tuple(
            (each.sentence, str(each.n), str(each.better), str(each.worse), _p(each.p), _p(each.p_holm))
            for each in comparisons
        ),
        notes=(f"{_BETTER} {_TEST}",),
    )


def comparisons_csv(comparisons: Sequence[Comparison]) -> Table:
    """The same for programs."""
    return Table(
        title="Comparisons",
        columns=("reference", "configuration", "n", "better", "worse", "p", "p_holm", "sentence"),
        words=2,
        rows=tuple(
            (
                *(each.reference, each.configuration, str(each.n), str(each.better), str(each.worse)),
                *(f"{each.p:.6g}", f"{each.p_holm:.6g}", each.sentence),
            )
            for each in comparisons
        ),
    )


def _shared_folder(names: Sequence[str]) -> str:
    """The folders in which all names stand, with the slash."""
    levels = zip(*(name.split("/")[:-1] for name in names), strict=False)
    return "".join(f"{level[0]}/" for level in takewhile(lambda level: len(set(level)) == 1, levels))


def _p(p: float) -> str:
    return "<0.001" if p < 0.001 else f"{p:.2g}"
