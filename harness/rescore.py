"""A run's scores, tables and page, from its directory and the present annotations: no images, no models."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from harness.manifest import ClipManifest, load_manifest
from harness.report.write import score_run
from harness.results import read_results
from harness.run_directory import RunDirectory
from harness.score import Scores, score
from harness.timeline import Timeline
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
        If the run is not finished, or a clip's manifest or labels cannot be read.
    """
    return score_run(directory.results, **_inputs(directory, annotator), manifest=directory.read_manifest())


def read_scores(directory: RunDirectory) -> Scores:
    """Score a finished run and write nothing. Raises as :func:`rescore` does."""
    return score(read_results(directory.results), **_inputs(directory, None))


def _inputs(directory: RunDirectory, annotator: str | None) -> dict[str, Any]:
    """What scoring takes beside the results."""
    run = directory.read_manifest()
    if "finished" not in run:
        raise VfoaError(f"{directory.path}: this run is not finished; the same `vfoa run` again goes on with it")
    annotator = annotator or run.get("annotator")
    found = {clip["name"]: _manifest(clip).labels(_timeline(clip), annotator) for clip in run["clips"]}
    labels = {name: each for name, each in found.items() if each is not None}
    of_clips = [f"{clip['name']}: {note}" for clip in run["clips"] for note in clip["notes"]]
    by_one = [f"Scored against the labels of {annotator!r}."] if annotator else []
    unlabelled = [name for name in found if name not in labels]
    return {
        "labels_by_clip": labels,
        "notes": [*run["notes"], *by_one, *of_clips, *_said_of_unlabelled(directory, unlabelled)],
        "frames_by_clip": {clip["name"]: clip["frames"] for clip in run["clips"]},
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
