"""A run's scores, tables and page, from its directory and the present annotations: no images, no models."""

from __future__ import annotations

import gc
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from harness.annotations.timeline import Timeline
from harness.clips.manifest import ClipManifest, load_manifest
from harness.report.page_data import Served
from harness.report.write import render_run, score_run
from harness.runs.directory import Pair, RunDirectory
from harness.runs.results import FrameRecord, read_results
from harness.scores.published import Published
from harness.scores.score import Scores, score
from vfoa.errors import VfoaError


def rescore(directory: RunDirectory, annotator: str | None = None) -> Scores:
    """Score a finished run and write its tables and its page.

    Parameters
    ----------
    annotator
        Score against this annotator's labels; None for those that the run was made with.

    Raises
    ------
    VfoaError
        If the run is not finished, no configuration ran on every clip, or a clip's manifest or labels cannot be read.
    """
    run = _finished_manifest(directory)
    inputs = _inputs(directory, run, annotator)
    with _collector_paused():
        return score_run(directory.results, records=_records(directory, run), **inputs, manifest=run)


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


def read_scores(directory: RunDirectory) -> Scores:
    """Score a finished run and write nothing. Raises as :func:`rescore` does."""
    run = _finished_manifest(directory)
    return score(_records(directory, run), **_inputs(directory, run, None))


def report_page(directory: RunDirectory, recordings: Mapping[Pair, str]) -> str:
    """A finished run's page for a server that opens ``recordings`` by these names; writes nothing.

    Raises as :func:`rescore` does.
    """
    run = _finished_manifest(directory)
    inputs = _inputs(directory, run, None)
    records = _records(directory, run)
    served = Served(run=str(directory.path.resolve()), recordings=recordings)
    return render_run(directory.results, records=records, **inputs, manifest=run, served=served)


def _finished_manifest(directory: RunDirectory) -> dict[str, Any]:
    run = directory.read_manifest()
    if "finished" not in run:
        raise VfoaError(f"{directory.path}: this run is not finished; the same `vfoa run` again goes on with it")
    return run


def _records(directory: RunDirectory, run: dict[str, Any]) -> Iterator[FrameRecord]:
    """The records of all that can be compared: every configuration here has run on every clip here."""
    clips, configurations, _notes = _left_out(run)
    if not run["configurations"].keys() - configurations:
        raise VfoaError(f"{directory.path}: no configuration ran on every clip; vfoa run --retry-failed tries again")
    found: Counter[Pair] = Counter()
    for record in read_results(directory.results):
        found[record.clip, record.configuration] += 1
        if record.clip not in clips and record.configuration not in configurations:
            yield record
    _check_complete(directory, run, found)


def _check_complete(directory: RunDirectory, run: dict[str, Any], found: Counter[Pair]) -> None:
    """A run's results that have lost lines would be scored as frames without a prediction."""
    failed = {(each["clip"], each["configuration"]) for each in run.get("failed", [])}
    for clip in run["clips"]:
        for configuration in run["configurations"]:
            pair, expected = (clip["name"], configuration), len(clip["frames"])
            if pair not in failed and found[pair] != expected:
                raise VfoaError(
                    f"{directory.results}: found {found[pair]} frames of {clip['name']} under {configuration}; "
                    f"expected {expected}, as the run had"
                )


def _left_out(run: dict[str, Any]) -> tuple[set[str], set[str], list[str]]:
    """The clips on which everything failed, the configurations that failed on another, and a sentence for each.

    A configuration that ran on some of the clips would have a rate over other frames than the rest of the table.
    """
    failed = run.get("failed", [])
    counts = Counter(each["clip"] for each in failed)
    clips = {clip for clip, count in counts.items() if count == len(run["configurations"])}
    configurations = {each["configuration"] for each in failed if each["clip"] not in clips}
    notes: dict[str, str] = {}
    for each in failed:
        if each["clip"] in clips:
            notes.setdefault(each["clip"], f"left out, every configuration failed: {each['error']}")
        else:
            notes.setdefault(each["configuration"], f"left out, failed on {each['clip']}: {each['error']}")
    return clips, configurations, [f"{name}: {reason}" for name, reason in notes.items()]


def _inputs(directory: RunDirectory, run: dict[str, Any], annotator: str | None) -> dict[str, Any]:
    """What scoring takes beside the results."""
    annotator = annotator or run.get("annotator")
    found = {clip["name"]: _manifest(clip).labels(_timeline(clip), annotator) for clip in run["clips"]}
    labels = {name: each for name, each in found.items() if each is not None}
    of_clips = [f"{clip['name']}: {note}" for clip in run["clips"] for note in clip["notes"]]
    by_one = [f"Scored against the labels of {annotator!r}."] if annotator else []
    unlabelled = [name for name in found if name not in labels]
    return {
        "labels_by_clip": labels,
        "notes": [*_left_out(run)[2], *run["notes"], *by_one, *of_clips, *_said_of_unlabelled(directory, unlabelled)],
        "frames_by_clip": {clip["name"]: clip["frames"] for clip in run["clips"]},
        "published": Published.model_validate(run["published"]) if run.get("published") else None,
    }


def _said_of_unlabelled(directory: RunDirectory, clips: list[str]) -> list[str]:
    """One sentence for each clip without labels: that it is not scored, and whom the run found in it."""
    if not clips:
        return []
    people = dict.fromkeys(clips, 0)
    for record in read_results(directory.results):
        if record.clip in people:
            people[record.clip] = max(people[record.clip], len(record.subjects))
    return [
        f"{clip}: no annotations, not scored; {f'up to {most} people' if most else 'nobody'} found in its frames."
        for clip, most in people.items()
    ]


def _manifest(clip: dict[str, Any]) -> ClipManifest:
    """The clip's manifest where the run found it, or, if it has moved since, by name."""
    place = Path(clip["manifest"])
    return load_manifest(place if place.is_file() else clip["name"])


def _timeline(clip: dict[str, Any]) -> Timeline | None:
    """The frames that were run and their times; None where an older run does not tell the times."""
    if "times_ns" not in clip:
        return None
    return Timeline(frames=clip["frames"], times_ns=clip["times_ns"], is_whole=False)
