"""The page of ``vfoa compare``: the ranking, the differences, and the frames that changed their verdict."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from harness.report.compared_runs import changes_table, compared_lines, ranking_table
from harness.report.comparisons import comparison_table, run_in_words, shared_folder, verdict_in_words
from harness.report.formats import percent_range, points, points_range
from harness.report.page.packing import pack_json
from harness.report.page.render import address_of, plain_table, printed_count, script, template
from harness.score.compared_runs import ComparedRuns
from harness.score.comparison import Comparison
from harness.score.statistics import Interval
from harness.score.verdicts import Verdict

Link = Callable[[Path, Verdict], str | None]
"""The address that a frame of a run leads to; None for none."""


def render_comparison(compared: ComparedRuns, link: Link, *, is_served: bool = False, where: str = "") -> str:
    """Return the page as text.

    Parameters
    ----------
    link
        Where a frame that changed leads to, in each of the two runs.
    is_served
        Whether a server delivers the page, and makes it anew for other conditions.
    where
        The conditions on labelled frames that hold, as their user wrote them.
    """
    changes = list(compared.changes())
    shared = shared_folder(compared.places)
    changed = changes_table(changes, shared)
    links = {
        changed.columns.index(column): [link(compared.places[name][0], verdict) for name, verdict in judged]
        for column, judged in (
            ("Then", [(change.reference, change.before) for change in changes]),
            ("Now", [(change.configuration, change.after) for change in changes]),
        )
    }
    tables = [plain_table(changed) | {"links": links}, plain_table(ranking_table(compared))]
    tables.append(plain_table(comparison_table(compared.comparisons)))
    return template("compare.html.jinja").render(
        title="Comparison of runs",
        facts=[
            printed_count(len(compared.scores), "run"),
            printed_count(len(compared.places), "configuration"),
            printed_count(len(compared.comparisons), "pair"),
            printed_count(sum(len(change.frames) for change in changes), "changed verdict"),
        ],
        verdict=compared_lines(compared),
        tables=[table["title"] for table in tables],
        has_changes=bool(changes),
        is_served=is_served,
        where=where,
        packs={"tables": pack_json(tables)},
        script=script("compare"),
        data=_figures(compared, shared),
    )


def _figures(compared: ComparedRuns, shared: str) -> dict[str, Any]:
    """Data of the figures: rows as ``intervals.js`` draws them. Configurations of one name have one number."""
    names = list(dict.fromkeys(configuration for _, configuration in compared.places.values()))
    number = {name: names.index(configuration) for name, (_, configuration) in compared.places.items()}
    return {
        "ranking": [
            {
                "label": row.name.removeprefix(shared),
                "number": number[row.name],
                "n": row.scores.n,
                "value": row.scores.frr,
                **_ends(row.scores.interval),
                "ends": percent_range(row.scores.interval),
            }
            for row in compared.ranked()
        ],
        "differences": [
            {
                "label": _pair_label(compared, comparison, shared),
                "number": number[comparison.configuration],
                "n": comparison.n,
                "value": None if comparison.n == 0 else comparison.difference,
                **_ends(comparison.interval),
                "printed": "identical" if comparison.is_identical else points(comparison.difference),
                "ends": "" if comparison.is_identical else points_range(comparison.interval),
                "words": f"{verdict_in_words(comparison)}; {comparison.sentence}",
                "is_significant": comparison.is_significant,
            }
            for comparison in compared.comparisons
        ],
    }


def _pair_label(compared: ComparedRuns, comparison: Comparison, shared: str) -> str:
    """``two: b vs a`` for a configuration of two runs, ``a/two vs a/one`` for others."""
    (reference_run, reference), (run, configuration) = (compared.places[name] for name in comparison.names)
    if reference == configuration:
        runs = (run_in_words(each, shared) for each in (run, reference_run))
        return f"{configuration}: {' vs '.join(runs)}"
    return " vs ".join(name.removeprefix(shared) for name in reversed(comparison.names))


def _ends(interval: Interval) -> dict[str, float | None]:
    known = not math.isnan(interval.low)
    return {"low": interval.low if known else None, "high": interval.high if known else None}


def report_link(page: Path) -> Link:
    """Links to the frame on the report pages of the runs, relative to the folder of this page."""

    def link(run: Path, verdict: Verdict) -> str | None:
        report = run / "report.html"
        if not report.is_file():
            return None
        shown = {"clip": verdict.clip, "config": verdict.configuration, "subject": verdict.subject}
        return f"{address_of(report, page)}#{urlencode(shown | {'frame': verdict.frame})}"

    return link
