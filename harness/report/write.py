"""Score a run and write its tables and its page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from harness.files import atomic_write
from harness.report.behaviour import behaviour_csv
from harness.report.formats import Table, to_csv
from harness.report.frames import FrameRows
from harness.report.page.attention_log import AttentionLog
from harness.report.page.data import Served
from harness.report.page.render import render_page
from harness.report.posterior_checks import direction_check_table, prediction_set_table
from harness.report.reliability import reliability_figure, subject_reliability_table
from harness.report.stage_times import stage_times
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
        As for :func:`harness.report.page.render.render_page`.

    Raises
    ------
    VfoaError
        If the results, or the ``timings.csv`` that a run has beside them, cannot be read.
    """
    frames, logs = FrameRows(), _Logs.of(reference, manifest)
    scores = logs.score(frames.watch(records if records is not None else read_results(results)), reference)
    reliabilities = logs.beliefs.reliabilities()
    texts = {
        **render_tables(scores, reliabilities, logs.beliefs.by_subject(), logs.tables()),
        "frames.csv": frames.to_csv(scores.verdicts),
        "behaviour.csv": to_csv(behaviour_csv(scores)),
        "report.html": logs.page(results, scores, manifest),
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
    logs = _Logs.of(reference, manifest)
    return logs.page(results, logs.score(records, reference), manifest, served)


@dataclass(frozen=True, slots=True)
class _Logs:
    """What is kept of the records while they are scored, for the page and the tables of probabilities."""

    beliefs: BeliefLog
    sets: SetLog
    directions: DirectionLog
    attention: AttentionLog

    @classmethod
    def of(cls, reference: Reference, manifest: Mapping[str, Any] | None) -> _Logs:
        beliefs = BeliefLog(_probabilistic(manifest), reference.labels)
        return cls(beliefs, SetLog(reference.labels), DirectionLog(), AttentionLog())

    def score(self, records: Iterable[FrameRecord], reference: Reference) -> Scores:
        """The scores, whose notes tell where measured directions do not fit the posterior."""
        watched = self.directions.watch(self.sets.watch(self.beliefs.watch(records)))
        scores = score(self.attention.watch(watched), reference)
        unfit = (each.sentence() for each in self.directions.checks() if not each.fits)
        return replace(scores, notes=(*scores.notes, *unfit))

    def tables(self) -> tuple[Table, ...]:
        """How sets of answers and measured directions do."""
        return prediction_set_table(self.sets.coverages()), direction_check_table(self.directions.checks())

    def page(
        self, results: Path, scores: Scores, manifest: Mapping[str, Any] | None, served: Served | None = None
    ) -> str:
        """The page of a run, or that of a server."""
        return render_page(
            scores,
            self.attention,
            manifest=manifest,
            times=stage_times(results.parent / "timings.csv"),
            reliabilities=self.beliefs.reliabilities(),
            checks=(subject_reliability_table(self.beliefs.by_subject()), *self.tables()),
            thumbnails=read_thumbnails(results.parent, scores.verdicts),
            served=served,
        )


def _probabilistic(manifest: Mapping[str, Any] | None) -> list[str]:
    """The configurations whose attention is a probability."""
    configurations = manifest["configurations"] if manifest else {}
    return [name for name, each in configurations.items() if each.get("attention", {}).get("method") == "bayes"]
