"""The result of a run in at most five lines: the best configuration, what makes a difference, and what to try next."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from harness.report.advice import advice
from harness.report.comparisons import compare_configurations, compare_levels
from harness.report.formats import interval_range, percent
from harness.run.grid import base_of
from harness.score.baselines import BASELINES, SEES_LABELS
from harness.score.comparison import Comparison
from harness.score.oracle_ablation import without_oracles
from harness.score.rows import ScoreRow
from harness.score.score import Scores
from harness.score.verdicts import ERROR_TYPES
from vfoa.errors import listed

MOST_LINES = 5
"""Most lines of a verdict."""
_MOST_NAMED = 4
"""Most configurations or factors that a line names; of more, it counts the others."""
NOTHING_SCORED = "Nothing is scored: no frame has a label."
_MOST_STEPS = 2
"""Most error types of the notes of tables, and most steps of a verdict."""
_SCOPES = {"clip": "on clips like these", "look": "on these clips only"}
_BEATS = {"yes": "Beats the best", "not shown": "Not shown to beat a", "no": "No better than a"}


def verdict_lines(scores: Scores) -> list[str]:
    """The result of a run, the answer first, in at most :data:`MOST_LINES` lines.

    The best configuration over all clips and its interval; whether it beats the best baseline, and the rate of constant
    answers that saw the labels if they are as good; which differences between configurations are shown, in a grid by
    factor over all values of the others; what to try next, by the errors of the best one. The oracle ablation is left
    out.
    """
    rows = compared_rows(scores)
    if not rows:
        return [NOTHING_SCORED]
    best = max(rows, key=lambda row: row.frr)
    lines = [_best_line(best, rows), _baseline_line(best)]
    if len(rows) > 1:
        lines += _difference_lines(scores)
    return [*lines, *_next_lines(scores, best.configuration, is_alone=len(rows) == 1, room=MOST_LINES - len(lines))]


def compared_rows(scores: Scores) -> list[ScoreRow]:
    """The row of each configuration over all clips, without the oracle ablation."""
    compared = without_oracles(scores.scored_configurations)
    return [row for row in scores.rows.overall if row.configuration in compared]


def best_of(rows: Sequence[ScoreRow]) -> str:
    """Of how many rows the best one is the best, and how many are as good if it is not alone."""
    equals = Counter(row.frr for row in rows)[max(row.frr for row in rows)]
    return f"Best of {len(rows)}{f' ({equals} equally good)' if equals > 1 else ''}"


def _best_line(best: ScoreRow, rows: Sequence[ScoreRow]) -> str:
    name = best.configuration
    who = f"{best_of(rows)}: {name}, right" if len(rows) > 1 else f"{name} is right"
    ends = "too few looks for an interval"
    if not math.isnan(best.interval.low):
        ends = f"95 %: {interval_range(best.interval, '.0f', 100)} % {_SCOPES[best.interval.unit]}"
    return f"{who} in {percent(best.frr)} % of the frames ({ends})."


def _baseline_line(best: ScoreRow) -> str:
    rule, rate, constant = BASELINES[best.best_baseline], best.baselines[best.best_baseline], best.baselines["constant"]
    if any(rate for name, rate in best.baselines.items() if name not in SEES_LABELS):
        line = f"{_BEATS[best.beats]} simple rule: {rule} ({percent(rate)} %)"
    else:
        line = "The simple rules are right in none of the frames"
    is_as_good = constant >= best.frr and constant > rate
    return f"{line}{f'; always one answer: {percent(constant)} %' if is_as_good else ''}."


def _difference_lines(scores: Scores) -> list[str]:
    """At most two lines on the differences between configurations; the factors of a grid that fit none are counted."""
    groups = compare_levels(scores)
    if not groups:
        return list(_Contrast.of(compare_configurations(scores)).sentences())
    factors = {key: _Contrast.of(group) for key, group in groups.items()}
    if len(factors) > 2:
        return _many_factors(factors)
    return [f"{key}: {contrast.sentence()}" for key, contrast in factors.items()]


def _many_factors(factors: Mapping[str, _Contrast]) -> list[str]:
    """A line on the factors that make a difference, and one on the others."""
    gains = [f"{key} ({contrast.best}: {contrast.gains})" for key, contrast in factors.items() if contrast.beaten]
    unshown = {key: contrast.possible for key, contrast in factors.items() if not contrast.beaten}
    possible = max((points for points in unshown.values() if not math.isnan(points)), default=0)
    remaining = f" (at most {possible:.1f} points)" if possible else ""
    lines = []
    if gains:
        lines.append(f"A difference is shown for {listed(gains, _MOST_NAMED)}.")
    if unshown:
        lines.append(f"No difference is shown for {listed(list(unshown), _MOST_NAMED)}{remaining}.")
    return lines


@dataclass(frozen=True, slots=True)
class _Contrast:
    """The best of several configurations, or of the labels of a factor, against each of the others.

    ``pairs`` are the comparisons of every two. ``beaten`` are those in which the best one is significantly better,
    ``tied`` those of it that are not significant, both seen from it.
    """

    best: str
    pairs: Sequence[Comparison]
    beaten: Sequence[Comparison]
    tied: Sequence[Comparison]

    @classmethod
    def of(cls, pairs: Sequence[Comparison]) -> _Contrast:
        leads = dict.fromkeys((name for comparison in pairs for name in comparison.names), 0.0)
        for comparison in pairs:
            if not math.isnan(comparison.difference):
                leads[comparison.configuration] += comparison.difference
                leads[comparison.reference] -= comparison.difference
        best = max(leads, key=lambda name: leads[name])
        against = [_seen_from(best, comparison) for comparison in pairs if best in comparison.names]
        beaten = [comparison for comparison in against if comparison.is_significant and comparison.difference > 0]
        return cls(best, pairs, beaten, [comparison for comparison in against if not comparison.is_significant])

    @property
    def gains(self) -> str:
        """The significant differences from the best one, in words."""
        gains = [f"{100 * comparison.difference:.1f}" for comparison in self.beaten]
        low, high = min(gains, key=float), max(gains, key=float)
        return f"{low} points" if low == high else f"{low} to {high} points"

    @property
    def possible(self) -> float:
        """The largest difference in points that is not ruled out where none is shown; NaN if that is not known."""
        ends = [abs(end) for comparison in self._alike for end in _ends(comparison)]
        return 100 * min(max(ends), 1.0) if ends else math.nan

    @property
    def _alike(self) -> Sequence[Comparison]:
        """The comparisons that show no difference: every two, or those with the best one if others differ."""
        return self.tied if any(comparison.is_significant for comparison in self.pairs) else self.pairs

    def sentences(self) -> Iterator[str]:
        """A sentence on those that are beaten, and one on those that cannot be told from the best one."""
        if self.beaten:
            yield self._of_beaten()
        if self.tied:
            yield self._of_tied()

    def sentence(self) -> str:
        """One sentence on all."""
        if not self.beaten:
            return self._of_tied()
        if not self.tied:
            return self._of_beaten()
        others = len(self.beaten) + len(self.tied)
        beats = f"{self.best} beats {len(self.beaten)} of {others} others by {self.gains}"
        return f"{beats}; over the rest, {self._describe_tied}."

    def _of_beaten(self) -> str:
        first, *others = self.beaten
        if len(others) >= _MOST_NAMED:
            return f"{self.best} beats {len(self.beaten)} others by {self.gains}."
        if others:
            parts = [f"{comparison.reference} by {100 * comparison.difference:.1f}" for comparison in self.beaten]
            return f"{self.best} beats {_joined(parts)} points."
        interval = first.interval
        ends = "" if math.isnan(interval.low) else f" (95 %: {interval_range(interval, '.1f', 100)})"
        return f"{self.best} beats {first.reference} by {self.gains}{ends}."

    def _of_tied(self) -> str:
        others = [comparison.reference for comparison in self.tied]
        if len(others) > 1 and (self._alike is self.tied or len(others) >= _MOST_NAMED):
            return f"{self.best} or {len(others)} others, {self._describe_tied}."
        names = [name for name in self._names if name in (self.best, *others)]
        return f"{_joined(names, 'or')}, {self._describe_tied}."

    @property
    def _describe_tied(self) -> str:
        """Those that no test tells apart, in words."""
        if all(comparison.n == 0 for comparison in self._alike):
            return "no frame is scored for both"
        if all(comparison.is_identical for comparison in self._alike):
            return "no difference: right in the same frames"
        if not math.isnan(self.possible):
            return f"no difference shown (at most {self.possible:.1f} points)"
        if any(comparison.can_be_significant for comparison in self._alike):
            return "no difference shown (how large one may be is not known)"
        first = self._alike[0]
        seen = f" ({100 * abs(first.difference):.1f} points seen)" if len(self._alike) == 1 else ""
        return f"{first.counted_units} cannot show a difference{seen}"

    @property
    def _names(self) -> list[str]:
        return list(dict.fromkeys(name for comparison in self.pairs for name in comparison.names))


def _ends(comparison: Comparison) -> list[float]:
    interval = comparison.interval
    return [] if math.isnan(interval.low) else [interval.low, interval.high]


def _seen_from(name: str, comparison: Comparison) -> Comparison:
    """The comparison with this one of its two configurations as the later one."""
    if comparison.configuration == name:
        return comparison
    return replace(
        comparison,
        reference=comparison.configuration,
        configuration=name,
        difference=0.0 - comparison.difference,
        interval=replace(comparison.interval, low=-comparison.interval.high, high=-comparison.interval.low),
    )


def next_steps(scores: Scores, configurations: Collection[str]) -> list[str]:
    """A sentence for each of the most frequent error types: its number of wrong frames, its meaning, and what to try.

    Empty if nothing is wrong under these configurations. Frames of several configurations count each. They are notes of
    tables, which are the same with recordings and without.
    """
    counts = _error_types(scores, configurations)
    return [
        f"{count} of {counts.total()} wrong frames: {name} ({ERROR_TYPES[name]}). Next: "
        f"{'; '.join(advice(name, scores.settings.values()))}."
        for name, count in counts.most_common(_MOST_STEPS)
    ]


def _next_lines(scores: Scores, best: str, *, is_alone: bool, room: int) -> list[str]:
    """The best configuration's most frequent error type and what to try next, in one or two lines.

    Empty if nothing is wrong under it. The others are left out: a grid has tried what would help them.
    """
    counts = _error_types(scores, [name for name in scores.configurations if base_of(name) == best])
    if not counts:
        return []
    ((name, count),) = counts.most_common(1)
    steps = advice(name, scores.settings.values(), recorded=scores.is_recorded)
    if room == 1:
        return [f"Next (its errors: {100 * count / counts.total():.0f} % {name}): {steps[0]}."]
    whose = "" if is_alone else f" of {best}"
    return [
        f"{count} of {counts.total()} wrong frames{whose} are {name}: {ERROR_TYPES[name]}.",
        f"Next: {'; '.join(steps[:_MOST_STEPS])}.",
    ]


def _error_types(scores: Scores, configurations: Collection[str]) -> Counter[str]:
    """The number of wrong frames by error type; among equal numbers, in the order of :data:`ERROR_TYPES`."""
    counts = Counter[str]()
    for of_subject in scores.judged_subjects:
        if of_subject.configuration in configurations:
            counts.update(of_subject.error_types)
    return Counter({name: counts[name] for name in ERROR_TYPES if counts[name]})


def _joined(words: Sequence[str], conjunction: str = "and") -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {conjunction} {words[-1]}"
