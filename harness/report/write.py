"""Score a run and write its tables and its page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from harness.files import atomic_write
from harness.report.behaviour import behaviour_csv
from harness.report.formats import to_csv
from harness.report.frames import FrameRows
from harness.report.page import render_page
from harness.report.page_data import AttentionLog, Served
from harness.report.posterior_checks import direction_check_table, prediction_set_table
from harness.report.reliability import reliability_figure
from harness.report.stage_times import stage_times_table
from harness.report.tables import render_tables
from harness.report.thumbnails.reader import read_thumbnails
from harness.run.results import FrameRecord, read_results
from harness.score.direction_checks import DirectionLog
from harness.score.prediction_sets import SetLog
from harness.score.reference import Reference
from harness.score.reliability import BeliefLog
from harness.score.score import Scores, score


def score_run(
    results: Path,
    reference: Reference,
    *,
    records: Iterable[FrameRecord] | None = None,
    manifest: Mapping[str, Any] | None = None,
) -> Scores:
    """Score a ``results.jsonl`` and write the tables and the page beside it, each whole or not at all.

    ``frr.csv .md .tex``, ``oracle_ablation.csv``, ``measures.csv``, ``objects.csv``, ``frames.csv``,
    ``behaviour.csv``, ``comparisons.csv .md``, ``report.html``, and ``reliability.svg .png`` where a
    configuration gives probabilities. Nothing is written unless all of them could be made.

    Parameters
    ----------
    records
        Those of the results to score; all if not given.
    manifest
        As for :func:`harness.report.page.render_page`.

    Raises
    ------
    VfoaError
        If the results, or the ``timings.csv`` that a run has beside them, cannot be read.
    """
    frames, beliefs, attention = FrameRows(), BeliefLog(_probabilistic(manifest), reference.labels), AttentionLog()
    chosen = records if records is not None else read_results(results)
    sets, directions = SetLog(reference.labels), DirectionLog()
    watched = directions.watch(sets.watch(beliefs.watch(frames.watch(chosen))))
    scores = score(attention.watch(watched), reference)
    reliabilities, checks = beliefs.reliabilities(), directions.checks()
    scores = replace(scores, notes=(*scores.notes, *(each.sentence() for each in checks if not each.fits)))
    texts = {
        **render_tables(
            scores,
            reliabilities,
            beliefs.by_subject(),
            (prediction_set_table(sets.coverages()), direction_check_table(checks)),
        ),
        "frames.csv": frames.to_csv(scores.verdicts),
        "behaviour.csv": to_csv(behaviour_csv(scores)),
        "report.html": _page(results, scores, attention, manifest),
    }
    for name, text in texts.items():
        atomic_write(results.parent / name, text)
    if reliabilities:
        from harness.report.figures import write_figure

        write_figure(results.parent / "reliability", reliability_figure(reliabilities))
    return scores


def render_run(
    results: Path,
    reference: Reference,
    *,
    records: Iterable[FrameRecord],
    manifest: Mapping[str, Any],
    served: Served,
) -> str:
    """The page that :func:`score_run` writes, as text for a server that opens recordings; nothing is written."""
    attention = AttentionLog()
    scores = score(attention.watch(records), reference)
    return _page(results, scores, attention, manifest, served)


def _page(
    results: Path,
    scores: Scores,
    attention: AttentionLog,
    manifest: Mapping[str, Any] | None,
    served: Served | None = None,
) -> str:
    tables = [stage_times_table(results.parent / "timings.csv")]
    thumbnails = read_thumbnails(results.parent, scores.verdicts)
    return render_page(scores, attention, manifest=manifest, tables=tables, thumbnails=thumbnails, served=served)


def _probabilistic(manifest: Mapping[str, Any] | None) -> list[str]:
    """The configurations whose attention is a probability."""
    configurations = manifest["configurations"] if manifest else {}
    return [name for name, each in configurations.items() if each.get("attention", {}).get("method") == "bayes"]
