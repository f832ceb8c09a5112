"""Metrics: further columns of ``frr.csv``, one file and one registry line each.

A metric gives one number for each row of the table. Rows are single subjects, whole clips, and all clips together; a
row's *group* holds the frames of every subject that it covers. Another distribution adds a metric through the
entry-point group ``vfoa.metrics``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from harness.score.outcomes import Outcomes
from vfoa.registry import Registry


class Metric(Protocol):
    """One column of ``frr.csv``. Built as ``Class()``; its registered name is the column's name.

    Attributes
    ----------
    title
        Heading of its column in ``frr.md`` and on the report page.
    meaning
        One sentence that a reader of the table needs.
    """

    title: str
    meaning: str

    def __call__(self, group: Sequence[Outcomes]) -> float:
        """The value of one row; NaN where it has none (an empty cell in the table)."""
        ...


METRICS = Registry(
    kind="metric",
    builtin={
        "macro_f1": "harness.score.metrics.agreement:MacroF1",
        "kappa": "harness.score.metrics.agreement:Kappa",
    },
    group="vfoa.metrics",
)


def load_metrics() -> Mapping[str, Metric]:
    """Every metric by name: those of this project, then those of other distributions, sorted."""
    others = (name for name in METRICS.names() if name not in METRICS.builtin)
    return {name: METRICS.load(name)() for name in (*METRICS.builtin, *others)}
