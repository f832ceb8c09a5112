"""A run's tables and page made again, from its directory and the present annotations: no images, no models."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from harness.record.verdict_layer import write_verdict_layers
from harness.report.kept_parts import KeptParts
from harness.report.page.data import Served
from harness.report.write import probabilistic, render_run, write_scores
from harness.run.directory import Pair, RunDirectory
from harness.score.finished_run import FinishedRun
from harness.score.score import Scores


def rescore(directory: RunDirectory, annotator: str | None = None) -> Scores:
    """Score a finished run and write its tables, its page, and the verdicts of its recordings.

    Parameters
    ----------
    annotator
        Score against this annotator's labels; None for those that the run was made with.

    Raises
    ------
    VfoaError
        If the run is not finished, no configuration ran on every clip, or a clip's manifest or labels cannot be read.
    """
    run = FinishedRun.read(directory)
    reference = run.reference(annotator, compare_content=True)
    with _collector_paused():
        kept = KeptParts(run, reference, probabilistic(run.manifest))
        scores = write_scores(directory.results, kept.logs(), run.manifest)
    write_verdict_layers(directory, reference.labels)  # last: a damaged run is refused before anything is written
    run.note_labels(annotator)
    return scores


def report_page(directory: RunDirectory, recordings: Mapping[Pair, str]) -> str:
    """A finished run's page for a server that opens ``recordings`` by these names; writes nothing.

    Raises as :func:`rescore` does.
    """
    run = FinishedRun.read(directory)
    served = Served(run=str(directory.path.resolve()), recordings=recordings)
    return render_run(directory.results, run.reference(), records=run.records(), manifest=run.manifest, served=served)


@contextmanager
def _collector_paused() -> Iterator[None]:
    """No search for reference cycles: a run is a million small values that have none, and looking takes a fifth."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
