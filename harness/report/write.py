"""Score a run and write its tables and its page: as it ends, or again from its directory, without images or models."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from harness.files.io import write_together
from harness.report.comparisons import (
    ablation_csv,
    ablation_table,
    compare_configurations,
    comparison_table,
    comparisons_csv,
    published_table,
    terminal_ablation,
)
from harness.report.csv_tables import scores_table
from harness.report.formats import LATEX_HEAD, Table, to_csv, to_latex, to_markdown
from harness.report.page.data import Served
from harness.report.page.render import render_page
from harness.report.record_logs import KeptParts, RecordLogs
from harness.report.stages import (
    StageTimes,
    object_measures_table,
    stage_measures_table,
    stage_times,
    terminal_measures,
)
from harness.report.tables import (
    baselines_table,
    error_types_table,
    frr_table,
    measures_table,
    nowhere_table,
    paper_table,
    reliability_table,
    seeds_table,
    subjects_table,
    terminal_table,
    visible_table,
)
from harness.report.thumbnails import read_thumbnails
from harness.run.directory import Pair, RunDirectory
from harness.score.calibration import Reliability
from harness.score.finished_run import FinishedRun
from harness.score.score import Scores


def write_scores(directory: RunDirectory, logs: RecordLogs, manifest: Mapping[str, Any], times: StageTimes) -> Scores:
    """Write the tables and the page of records that the logs have seen into the run's directory, all or none.

    ``frr.csv .md .tex``, ``oracle_ablation.csv``, ``measures.csv``, ``objects.csv``, ``frames.csv``,
    ``comparisons.csv .md`` and ``report.html``. ``manifest`` and ``times`` are as for
    :func:`harness.report.page.render.render_page`.
    """
    scores = logs.scores()
    texts = {
        **render_tables(scores, logs.calibration.reliabilities(), logs.tables()),
        "frames.csv": logs.frames.to_csv(scores.verdicts),
        "report.html": _page(directory, logs, scores, manifest, times),
    }
    write_together({directory.path / name: text for name, text in texts.items()})
    return scores


def _page(
    directory: RunDirectory,
    logs: RecordLogs,
    scores: Scores,
    manifest: Mapping[str, Any],
    times: StageTimes,
    served: Served | None = None,
) -> str:
    return render_page(
        scores,
        logs.attention,
        manifest,
        times=times,
        reliabilities=logs.calibration.reliabilities(),
        checks=logs.tables(),
        thumbnails=read_thumbnails(directory.path, scores.verdicts, logs.names_now),
        served=served,
    )


def rescore(directory: RunDirectory, annotator: str | None = None) -> Scores:
    """Score a finished run and write its tables, its page, and the verdicts of its recordings.

    Parameters
    ----------
    annotator
        Score against this annotator's labels; None for the labels that the run was made with.

    Raises
    ------
    VfoaError
        If the run is not finished, no configuration ran on every clip, or a clip's manifest or labels cannot be read.
    """
    with _collector_paused():
        run = FinishedRun.read(directory)
        reference = run.reference(annotator, compare_content=True)
        kept = KeptParts(run, reference)
        scores = write_scores(directory, kept.logs(), run.manifest, kept.times())
        # last: a damaged run is refused before anything is written
        if any(directory.path.glob("*.rrd")):
            from harness.record.verdict_layer import write_verdict_layers  # imports Rerun

            write_verdict_layers(directory, reference.labels, kept.blocks, reference.names_now)
        run.note_labels(annotator)
    return scores


def report_page(directory: RunDirectory, recordings: Mapping[Pair, str]) -> str:
    """Return a finished run's page for a server that opens ``recordings`` by these names; nothing is written.

    Raises the errors of :func:`rescore`.
    """
    run = FinishedRun.read(directory)
    logs = RecordLogs(run.reference())
    logs.watch(run.records())
    served = Served(run=str(directory.path.resolve()), recordings=recordings)
    return _page(directory, logs, logs.scores(), run.manifest, stage_times(directory.timings), served)


@contextmanager
def _collector_paused() -> Iterator[None]:
    """Pause the garbage collector, which takes a fifth of the time: a run is a million small values without cycles."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def render_tables(
    scores: Scores, reliabilities: Sequence[Reliability] = (), checks: Sequence[Table] = ()
) -> dict[str, str]:
    """Every table but ``frames.csv``, by file name; ``checks`` are on the page. Tables without rows are left out."""
    comparisons = compare_configurations(scores)
    compared = comparison_table(comparisons)
    sections = (paper_table, measures_table, baselines_table, error_types_table, subjects_table)
    pages = [to_markdown(frr_table(scores)), *(to_markdown(make(scores), level=2) for make in sections)]
    ablation, measures = ablation_table(scores), stage_measures_table(scores)
    more = (
        seeds_table(scores),
        visible_table(scores),
        nowhere_table(scores),
        published_table(scores),
        ablation,
        measures,
        reliability_table(reliabilities),
        *checks,
    )
    pages += [to_markdown(table, level=2) for table in more if table.rows]
    programs = {
        "oracle_ablation.csv": ablation_csv(scores),
        "measures.csv": measures,
        "objects.csv": object_measures_table(scores),
    }
    return {
        "frr.csv": to_csv(scores_table(scores)),
        "frr.md": "\n".join(pages),
        "frr.tex": _latex_tables(scores),
        **{name: to_csv(table) for name, table in programs.items() if table.rows},
        "comparisons.csv": to_csv(comparisons_csv(comparisons)),
        "comparisons.md": to_markdown(compared),
    }


def _latex_tables(scores: Scores) -> str:
    """The tables that fit a page of paper."""
    papers = {
        "frr": terminal_table(scores),
        "paper": paper_table(scores),
        "oracle_ablation": terminal_ablation(scores),
        "measures": terminal_measures(scores),
    }
    return LATEX_HEAD + "\n".join(to_latex(table, label=f"tab:{name}") for name, table in papers.items() if table.rows)
