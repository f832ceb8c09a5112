"""Panels of the report: the foldable sections under "More measures", one file and one registry line each.

A panel is a function of the scores that gives a table or a picture. Another distribution adds one through the
entry-point group ``vfoa.panels``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from harness.report.formats import Table
from harness.score.score import Scores
from vfoa.registry import Registry


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """An SVG drawing on the page. ``svg`` is only the ``<svg>`` element, without scripts or links to other files.

    ``notes`` are shown with it, each one sentence or more.
    """

    title: str
    svg: str
    notes: tuple[str, ...] = ()


class Panel(Protocol):
    """One section of the page."""

    def __call__(self, scores: Scores) -> Table | Picture:
        """Draw the panel for a run. A table without rows is left out of the page."""
        ...


PANELS = Registry(
    kind="report panel",
    builtin={
        "subjects": "harness.report.tables:subjects_table",
        "agreement": "harness.report.tables:measures_table",
        "baselines": "harness.report.tables:baselines_table",
        "stages": "harness.report.stages:stage_measures_table",
        "objects": "harness.report.stages:object_measures_table",
    },
    group="vfoa.panels",
)


def draw_panels(scores: Scores) -> Iterator[Table | Picture]:
    """Yield every panel with content: those of this project, then those of other distributions, sorted."""
    others = (name for name in PANELS.names() if name not in PANELS.builtin)
    for name in (*PANELS.builtin, *others):
        panel: Panel = PANELS.load(name)
        drawn = panel(scores)
        if isinstance(drawn, Picture) or drawn.rows:
            yield drawn
