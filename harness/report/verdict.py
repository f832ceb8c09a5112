"""The result of a run in at most five lines: the best configuration, what makes a difference, and what to try next."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from harness.report.advice import advice
from harness.report.factors import compare_factors
from harness.report.formats import interval_range, percent, shortened
from harness.run.grid import base_of
from harness.score.baselines import BASELINES, SEES_LABELS
from harness.score.comparison import Comparison, compare
from harness.score.oracle_ablation import without_oracles
from harness.score.score import ScoreRow, Scores
from harness.score.verdicts import ERROR_TYPES

MOST_LINES, MOST_CHARACTERS = 5, 100
"""Most lines of a verdict, and most characters of each."""
NOTHING_SCORED = "Nothing is scored: no frame has a label."
_MOST_STEPS = 2
_SCOPES = {"clip": "on clips like these", "look": "on these clips only"}
_BEATS = {"yes": "Beats the best", "not shown": "Not shown to beat a", "no": "No better than a"}


def verdict_lines(scores: Scores) -> list[str]:
    """The result of a run, the answer first, in at most :data:`MOST_LINES` lines of :data:`MOST_CHARACTERS`.

    The best configuration over all clips and its interval; whether it beats the best baseline, and the rate of constant
    answers that saw the labels if they are as good; which differences between configurations are shown, in a grid by
    factor over all values of the others; what to try next, by the errors of the best one. The oracle ablation is left
    out. Long names lose their middles.
    """
    rows = compared_rows(scores)
    if not rows:
        return [NOTHING_SCORED]
    best = max(rows, key=lambda row: row.frr)
    lines = [_best_line(best, rows), _baseline_line(best)]
    if len(rows) > 1:
        lines += _difference_lines(scores, [row.configuration for row in rows])
    return [*lines, *_next_lines(scores, best.configuration, is_alone=len(rows) == 1, room=MOST_LINES - len(lines))]


def compared_rows(scores: Scores) -> list[ScoreRow]:
    """The row of each configuration over all clips, without the oracle ablation."""
    compared = without_oracles(scores.scored_configurations)
    return [row for row in scores.overall() if row.configuration in compared]


def best_of(rows: Sequence[ScoreRow]) -> str:
    """Of how many rows the best one is the best, and how many are as good if it is not alone."""
    equals = Counter(row.frr for row in rows)[max(row.frr for row in rows)]
    return f"Best of {len(rows)}{f' ({equals} equally good)' if equals > 1 else ''}"


def _best_line(best: ScoreRow, rows: Sequence[ScoreRow]) -> str:
    who = f"{best_of(rows)}: {{}}, right" if len(rows) > 1 else "{} is right"
    short = f"{who} in {percent(best.frr)} %"
    rate = f"{short} of the frames"
    if math.isnan(best.interval.low):
        end = "(too few looks for an interval)."
        return _fitting(*(_Sentence(f"{begin} {end}", [best.configuration]) for begin in (rate, short)))
    ends = f"{interval_range(best.interval, '.0f', 100)} % {_SCOPES[best.interval.unit]}"
    briefly = f"{interval_range(best.interval, '.0f', 100)} %"
    forms = (
        f"{rate} (95 % confidence: {ends}).",
        *(f"{begin} (95 %: {end})." for begin, end in ((rate, ends), (short, ends), (short, briefly))),
    )
    return _fitting(*(_Sentence(form, [best.configuration]) for form in forms))


def _baseline_line(best: ScoreRow) -> str:
    rule, rate, constant = BASELINES[best.best_baseline], best.baselines[best.best_baseline], best.baselines["constant"]
    if any(rate for name, rate in best.baselines.items() if name not in SEES_LABELS):
        beats = f"{_BEATS[best.beats]} simple rule"
        forms = [f"{beats}: {words} ({percent(rate)} %)" for words in (rule, rule.split("object ")[-1])]
    else:
        forms = ["The simple rules are right in none of the frames"]
    if constant >= best.frr and constant > rate:
        ends = (f"; {words}: {percent(constant)} %" for words in ("always one answer", "one answer"))
        forms = [f"{form}{end}" for end in ends for form in forms]
    return _fitting(*(_Sentence(f"{form}.", []) for form in forms))


def _difference_lines(scores: Scores, names: Sequence[str]) -> list[str]:
    """At most two lines on the differences between configurations; the factors of a grid that fit none are counted."""
    frames = {name: scores.frames_of(name) for name in names}
    groups = compare_factors(frames, scores.factors)
    if not groups:
        return [_fitting(*sentences) for sentences in _Contrast.of(compare(frames)).sentences()]
    factors = {key: _Contrast.of(group) for key, group in groups.items()}
    if len(factors) > 2:
        return _many_factors(factors)
    return [
        _fitting(*(_Sentence(f"{{}}: {form}", [key, *names]) for form, names in contrast.sentence()))
        for key, contrast in factors.items()
    ]


def _many_factors(factors: Mapping[str, _Contrast]) -> list[str]:
    """A line on the factors that make a difference, and one on the others."""
    gains = [f"{key} ({contrast.best}: {contrast.gains})" for key, contrast in factors.items() if contrast.beaten]
    unshown = {key: contrast.possible for key, contrast in factors.items() if not contrast.beaten}
    possible = max((points for points in unshown.values() if not math.isnan(points)), default=0)
    remaining = f" (at most {possible:.1f} points)" if possible else ""
    lines = []
    if gains:
        lines.append(_listed("A difference is shown for {}.", gains))
    if unshown:
        lines.append(_listed(f"No difference is shown for {{}}{remaining}.", list(unshown)))
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

    def sentences(self) -> Iterator[list[_Sentence]]:
        """A sentence on those that are beaten, and one on those that cannot be told from the best one."""
        if self.beaten:
            yield self._of_beaten()
        if self.tied:
            yield self._of_tied()

    def sentence(self) -> list[_Sentence]:
        """One sentence on all, in several lengths."""
        if not self.beaten:
            return self._of_tied()
        if not self.tied:
            return self._of_beaten()
        others = len(self.beaten) + len(self.tied)
        beats = f"{{}} beats {len(self.beaten)} of {others} others by {self.gains}"
        rest = f"; over the rest, {self._describe_tied}.", "; over the rest, no difference shown."
        return [_Sentence(f"{beats}{end}", [self.best]) for end in rest]

    def _of_beaten(self) -> list[_Sentence]:
        names = [self.best, *(comparison.reference for comparison in self.beaten)]
        if len(self.beaten) == 1:
            interval = self.beaten[0].interval
            ends = "" if math.isnan(interval.low) else f" (95 % confidence: {interval_range(interval, '.1f', 100)})"
            return [_Sentence(f"{{}} beats {{}} by {self.gains}{end}.", names) for end in (ends, "")]
        parts = [f"{{}} by {100 * comparison.difference:.1f}" for comparison in self.beaten]
        return [
            _Sentence(f"{{}} beats {_joined(parts)} points.", names),
            _Sentence(f"{{}} beats {len(self.beaten)} others by {self.gains}.", [self.best]),
        ]

    def _of_tied(self) -> list[_Sentence]:
        others = [comparison.reference for comparison in self.tied]
        names = [name for name in self._names if name in (self.best, *others)]
        all_named = _Sentence(f"{_joined(['{}'] * len(names), 'or')}, {self._describe_tied}.", names)
        counted = _Sentence(f"{{}} or {len(others)} others, {self._describe_tied}.", [self.best])
        if len(others) == 1:
            return [all_named]
        return [counted] if self._alike is self.tied else [all_named, counted]

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
        share = f"its errors: {100 * count / counts.total():.0f} % {name}"
        return [_fitting(*(_Sentence(f"Next{why}: {{}}.", steps[:1]) for why in (f" ({share})", "")))]
    whose, names = ("", []) if is_alone else (" of {}", [best])
    meaning = ERROR_TYPES[name]
    why = f"{count} of {counts.total()} wrong frames{whose} are {name}: {meaning}."
    in_short = f"Errors{'' if is_alone else ' of the best'}: {count} of {counts.total()} {name}"
    fitting = [steps[:number] for number in range(len(steps), 1, -1)]
    return [
        _fitting(_Sentence(why, names), *(_Sentence(f"{in_short}{rest}.", []) for rest in (f": {meaning}", ""))),
        _fitting(*(_Sentence("Next: {}.", ["; ".join(each)]) for each in (*fitting, steps[:1]))),
    ]


def _error_types(scores: Scores, configurations: Collection[str]) -> Counter[str]:
    """The number of wrong frames by error type; among equal numbers, in the order of :data:`ERROR_TYPES`."""
    counts = Counter[str]()
    for of_subject in scores.judged_subjects:
        if of_subject.configuration in configurations:
            counts.update(of_subject.error_types)
    return Counter({name: counts[name] for name in ERROR_TYPES if counts[name]})


class _Sentence(NamedTuple):
    """A sentence with a ``{}`` for each of its names."""

    form: str
    names: Sequence[str]


def _fitting(*sentences: _Sentence) -> str:
    """The first sentence that fits a line, else the last one, whose longest names lose their middles."""
    for form, names in sentences:
        sentence = form.format(*names)
        if len(sentence) <= MOST_CHARACTERS:
            return sentence
    widths = [len(name) for name in names]
    for _ in range(len(sentence) - MOST_CHARACTERS):
        widths[widths.index(max(widths))] -= 1
    return form.format(*map(shortened, names, widths))


def _listed(form: str, words: Sequence[str]) -> str:
    """The sentence with as many of the words as fit a line, the others counted."""
    shorter = [[*words[:number], f"{len(words) - number} more"] for number in range(len(words) - 1, 0, -1)]
    return _fitting(*(_Sentence(form, [_joined(each)]) for each in ([*words], *shorter)))


def _joined(words: Sequence[str], conjunction: str = "and") -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {conjunction} {words[-1]}"
