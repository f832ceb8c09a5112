"""Pairs of configurations, of one run or of several, as tables."""

from __future__ import annotations

from collections.abc import Sequence

from harness.report.formats import Table
from harness.scores.comparison import SIGNIFICANCE, Comparison


def comparison_table(comparisons: Sequence[Comparison]) -> Table:
    """Pairs of configurations on their common frames, for people."""
    return Table(
        title="Configurations compared on the same frames",
        columns=("In words", "n", "Better", "Worse", "p", "p (Holm)"),
        words=1,
        rows=tuple(
            (each.sentence, str(each.n), str(each.better), str(each.worse), _p(each.p), _p(each.p_holm))
            for each in comparisons
        ),
        notes=(
            "Better: (frame, subject) pairs, over all clips, that the first gets right and the second wrong. p: exact "
            f"McNemar test, two-sided; Holm: corrected for all comparisons in this table; significant below "
            f"{100 * SIGNIFICANCE:.0f} % after it. The test takes frames as independent: read a small p of long looks "
            "with care.",
        ),
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


def _p(p: float) -> str:
    return "<0.001" if p < 0.001 else f"{p:.2g}"
