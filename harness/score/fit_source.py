"""The input of ``vfoa fit`` from a finished run: one configuration's records by clip, labels and settings."""

from __future__ import annotations

from harness.run.directory import RunDirectory
from harness.run.records import FrameRecord
from harness.score.finished_run import FinishedRun
from harness.score.fit_posterior import LabelledRecords
from vfoa.errors import VfoaError, did_you_mean


def read_labelled(directory: RunDirectory, configuration: str | None) -> LabelledRecords:
    """Read a finished run. Without a name, take the first configuration with a posterior, or else the first one.

    Raises
    ------
    VfoaError
        If the run is not finished, or has no such configuration.
    """
    run = FinishedRun.read(directory)
    known = run.manifest["configurations"]
    posteriors = [name for name, each in known.items() if each.get("attention", {}).get("method") == "bayes"]
    chosen = configuration or next(iter((*posteriors, *known)))
    if chosen not in known:
        raise VfoaError(f"{directory.path}: no configuration {chosen!r}; {did_you_mean(chosen, known)}")
    by_clip: dict[str, list[FrameRecord]] = {}
    for record in run.records():
        if record.configuration == chosen:
            by_clip.setdefault(record.clip, []).append(record)
    attention = known[chosen].get("attention", {})
    return LabelledRecords(
        experiment=run.manifest.get("experiment", ""),
        by_clip=by_clip,
        labels=run.reference().labels,
        attention=attention if attention.get("method") == "bayes" else {},
    )
