"""Which of two configurations is better, on the frames that both were scored on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from harness.scores.statistics import holm, mcnemar_exact
from harness.scores.verdicts import Verdict

SIGNIFICANCE = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A configuration against an earlier one (``reference``) on ``n`` common frames.

    ``better`` frames are right now and were wrong, ``worse`` the other way about. ``p`` is McNemar's exact, ``p_holm``
    the same corrected for the number of comparisons made together (``family``).
    """

    reference: str
    configuration: str
    n: int
    better: int
    worse: int
    p: float
    p_holm: float
    family: int

    @property
    def is_significant(self) -> bool:
        """Whether the corrected p is below 5 %."""
        return self.p_holm < SIGNIFICANCE

    @property
    def is_significant_drop(self) -> bool:
        """Whether the configuration is significantly worse than the reference."""
        return self.is_significant and self.worse > self.better

    @property
    def sentence(self) -> str:
        """The comparison in words."""
        frames = "frame" if self.better == 1 else "frames"
        corrected = f" ({format_p(self.p_holm)} after Holm)" if self.family > 1 else ""
        verdict = "not distinguishable"
        if self.is_significant:
            verdict = "significantly worse" if self.worse > self.better else "significantly better"
        return (
            f"{self.configuration} vs {self.reference}: {self.better} {frames} better, {self.worse} worse, "
            f"{format_p(self.p)}{corrected}: {verdict}"
        )


def compare(verdicts: Mapping[str, Iterable[Verdict]]) -> tuple[Comparison, ...]:
    """Compare every two of several configurations (of one run, or of several), the later with the earlier.

    ``verdicts`` are keyed by what each is called. Frames are paired by clip, frame and subject; frames that either
    did not score are left out. No common frame gives n = 0 and p = 1.
    """
    outcomes = [
        {(each.clip, each.frame, each.subject): each.outcome == "correct" for each in one if each.outcome != "unscored"}
        for one in verdicts.values()
    ]
    frames = list(dict.fromkeys(key for one in outcomes for key in one))
    scored = np.array([[key in one for key in frames] for one in outcomes], dtype=np.bool_)
    correct = np.array([[one.get(key, False) for key in frames] for one in outcomes], dtype=np.bool_)
    found = []
    for (i, first), (j, second) in combinations(enumerate(verdicts), 2):
        common = scored[i] & scored[j]
        better = int(np.count_nonzero(common & correct[j] & ~correct[i]))
        worse = int(np.count_nonzero(common & correct[i] & ~correct[j]))
        p = mcnemar_exact(better, worse)
        found.append(
            Comparison(
                reference=first,
                configuration=second,
                n=int(np.count_nonzero(common)),
                better=better,
                worse=worse,
                p=p,
                p_holm=p,
                family=1,
            )
        )
    corrected = holm([each.p for each in found])
    return tuple(replace(each, p_holm=p, family=len(found)) for each, p in zip(found, corrected, strict=True))


def format_p(p: float) -> str:
    """A p value for people: two significant digits, ``p < 0.001`` below that."""
    return "p < 0.001" if p < 0.001 else f"p = {p:.2g}"
