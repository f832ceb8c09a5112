"""Score a run and write its tables and its page: as it ends, or again from its directory, without images or models."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

from harness.files.garbage import collected_later
from harness.files.io import write_together
from harness.report.comparisons import (
    ablation_csv,
    ablation_table,
    compare_configurations,
    comparison_table,
    comparisons_csv,
    factors_table,
    published_table,
)
from harness.report.csv_tables import scores_table
from harness.report.formats import LATEX_HEAD, Table, to_csv, to_latex, to_markdown
from harness.report.page.data import Served
from harness.report.page.packing import AttentionPart, RunAttention
from harness.report.page.render import RunTables, render_page
from harness.report.stages import (
    StageTimes,
    object_measures_table,
    stage_measures_table,
    stage_times,
    terminal_measures,
)
from harness.report.tables import (
    baselines_table,
    direction_check_table,
    error_types_table,
    frr_table,
    measures_table,
    nowhere_table,
    paper_table,
    phases_table,
    prediction_set_table,
    printed_table,
    reliability_table,
    remarks,
    seeds_table,
    subject_reliability_table,
    subjects_table,
    unlabelled_table,
    visible_table,
)
from harness.report.thumbnails import BUDGET_BYTES, SERVED_BYTES, read_thumbnails
from harness.run.columns import PairColumns
from harness.run.directory import Pair, RunDirectory
from harness.run.executors import Bar, no_bar
from harness.run.manifest import RunManifest
from harness.score.calibration import coverages, reliabilities, reliabilities_by_subject
from harness.score.finished_run import FinishedRun
from harness.score.reference import Reference
from harness.score.score import Scores, score
from harness.score.subset import conditions_of
from harness.score.verdicts import PLAIN
from vfoa.scoring import ALL


class Scored(NamedTuple):
    """The scores of a run, and what else its page shows: the attention, and the present names of renamed targets."""

    scores: Scores
    attention: RunAttention
    names_now: Mapping[str, Mapping[str, str]]


def scored(columns: Iterable[PairColumns], reference: Reference) -> Scored:
    """Score a run; the columns are as for :func:`harness.score.score.score`, and each is read once."""
    attention: dict[Pair, AttentionPart] = {}

    def watched() -> Iterator[PairColumns]:
        for each in columns:
            attention[each.clip, each.configuration] = AttentionPart.of(
                each, probabilistic=reference.traits.get(each.configuration, PLAIN).probabilistic
            )
            yield each

    return Scored(score(watched(), reference), attention, reference.names_now)


def write_scores(directory: RunDirectory, run: Scored, manifest: RunManifest, times: StageTimes) -> Scores:
    """Write the tables and the page of a run into its directory, all or none.

    ``frr.csv .md .tex``, ``oracle_ablation.csv``, ``measures.csv``, ``objects.csv``, ``comparisons.csv .md`` and
    ``report.html``. ``manifest`` and ``times`` are as for
    :func:`harness.report.page.render.render_page`.
    """
    tables = run_tables(run.scores)
    texts = {**render_tables(run.scores, tables), "report.html": _page(directory, run, tables, manifest, times)}
    write_together({directory.path / name: text for name, text in texts.items()})
    return run.scores


def _page(
    directory: RunDirectory,
    run: Scored,
    tables: RunTables,
    manifest: RunManifest,
    times: StageTimes,
    served: Served | None = None,
    where: str = "",
    run_folder: str = "",
) -> str:
    budget = SERVED_BYTES if served else BUDGET_BYTES
    thumbnails = read_thumbnails(directory.path, run.scores.wrong_frames, run.names_now, budget)
    return render_page(
        *(run.scores, tables, run.attention, manifest),
        times=times,
        thumbnails=thumbnails,
        served=served,
        where=where,
        run_folder=run_folder,
        names_now=run.names_now,
    )


def rescore(directory: RunDirectory, annotator: str | None = None, *, bar: Bar = no_bar) -> Scores:
    """Score a finished run and write its tables, its page, and the verdicts of its recordings.

    Parameters
    ----------
    annotator
        Score against this annotator's labels, as all that reads the run then does; None for those that the run names.
    bar
        Shows the progress of the verdicts of recordings, which take longest in a run of many.

    Raises
    ------
    VfoaError
        If the run is not finished, no configuration ran on every clip, or a clip's manifest or labels cannot be read.
    """
    with collected_later():
        run = FinishedRun.read(directory).with_labels_of(annotator)
        labels = run.present_labels()  # before they are read: those that change meanwhile are not scored
        reference = run.reference(compare_content=True)
        found = scored(run.columns(), reference)
        scores = write_scores(directory, found, run.manifest, stage_times(directory))
        # last: a damaged run is refused before anything is written
        if any(directory.path.glob("*.rrd")):
            from harness.record.verdict_layer import write_verdict_layers  # imports Rerun

            write_verdict_layers(directory, reference.labels, reference.names_now, bar)
        run.note_labels(labels)
    return scores


def refresh(directory: RunDirectory) -> Scores:
    """Score a finished run again against the labels of its tables, which changed. Raises as :func:`rescore`."""
    return rescore(directory, directory.read_manifest().tables_annotator)


def report_page(
    directory: RunDirectory, recordings: Mapping[Pair, str] | None, where: str, run_folder: str = ""
) -> str:
    """Return a run's page; nothing is written. A served one also of what is complete of a run that is not finished.

    Parameters
    ----------
    recordings
        The names under which a server opens recordings; None for a page on the disk.
    where
        Only labelled frames that meet these conditions are scored: some, separated by commas, or none.
    run_folder
        As for :func:`harness.report.page.render.render_page`.

    Raises
    ------
    VfoaError
        As :func:`rescore` and :func:`harness.score.subset.subset`.
    """
    run = FinishedRun.read(directory) if recordings is None else FinishedRun.read_so_far(directory)
    found = scored(run.columns(), run.reference(where=conditions_of(where)))
    served = None if recordings is None else Served(run=str(directory.path.resolve()), recordings=recordings)
    tables, times = run_tables(found.scores), stage_times(directory)
    return _page(directory, found, tables, run.manifest, times, served, where, run_folder)


def run_tables(scores: Scores) -> RunTables:
    """Every table of a run by name, also those without rows."""
    comparisons = compare_configurations(scores)
    return {
        "frr": frr_table(scores),
        "phases": phases_table(scores),
        "paper": paper_table(scores),
        "agreement": measures_table(scores),
        "baselines": baselines_table(scores),
        "errors": error_types_table(scores),
        "subjects": subjects_table(scores),
        "unlabelled": unlabelled_table(scores),
        "seeds": seeds_table(scores),
        "visible": visible_table(scores),
        "nowhere": nowhere_table(scores),
        "published": published_table(scores),
        "ablation": ablation_table(scores),
        "stages": stage_measures_table(scores),
        "calibration": reliability_table(reliabilities(scores.judged_subjects)),
        "calibration by subject": subject_reliability_table(reliabilities_by_subject(scores.judged_subjects)),
        "sets": prediction_set_table(coverages(scores.judged_subjects)),
        "directions": direction_check_table(scores.directions),
        "factors": factors_table(scores),
        "comparisons": comparison_table(comparisons),
        "objects": object_measures_table(scores),
        "frr.csv": scores_table(scores),
        "comparisons.csv": comparisons_csv(comparisons),
        "oracle_ablation.csv": ablation_csv(scores),
    }


_NOT_IN_MARKDOWN = ("comparisons", "objects", "frr.csv", "comparisons.csv", "oracle_ablation.csv")
_ALWAYS = ("frr.csv", "comparisons.csv")
"""The files that are written also without rows."""


def render_tables(scores: Scores, tables: RunTables) -> dict[str, str]:
    """Every table by file name; those without rows are left out."""
    printed = [table for name, table in tables.items() if name not in _NOT_IN_MARKDOWN and table.rows]
    if scores.rows or not printed:
        first, *others = printed or [tables["frr"]]
    else:
        first, *others = replace(printed[0], notes=(*map(str, remarks(scores)), *printed[0].notes)), *printed[1:]
    programs = {
        **{name: table for name, table in tables.items() if name.endswith(".csv")},
        "measures.csv": tables["stages"],
        "objects.csv": tables["objects"],
    }
    papers = {
        "frr": printed_table(scores),
        "paper": tables["paper"],
        "oracle_ablation": tables["ablation"],
        "measures": terminal_measures(tables["stages"], scores),
    }
    first, *others = (_all_clips_first(table) for table in (first, *others))
    return {
        "frr.md": "\n".join([to_markdown(first), *(to_markdown(table, level=2) for table in others)]),
        "frr.tex": LATEX_HEAD
        + "\n".join(to_latex(table, label=f"tab:{name}") for name, table in papers.items() if table.rows),
        "comparisons.md": to_markdown(tables["comparisons"]),
        **{name: to_csv(table) for name, table in programs.items() if table.rows or name in _ALWAYS},
    }


_MOST_ROWS = 200
"""Most rows of a table of which the last ones are found."""


def _all_clips_first(table: Table) -> Table:
    """The table; of many rows those over all clips come first, which a reader would not find after them."""
    if len(table.rows) <= _MOST_ROWS:
        return table
    return replace(table, rows=tuple(sorted(table.rows, key=lambda row: row[0] != ALL)))
