"""A run's scores and tables, from its directory and the present annotations: no images, no models."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from harness.manifest import ClipManifest, load_manifest
from harness.report.tables import score_run
from harness.results import read_results
from harness.run_directory import RunDirectory
from harness.score import Scores, score
from vfoa.errors import VfoaError


def rescore(directory: RunDirectory) -> Scores:
    """Score a finished run and write its tables.

    Raises
    ------
    VfoaError
        If the run is not finished, or a clip's manifest or labels cannot be read.
    """
    return score_run(directory.results, **_inputs(directory))


def read_scores(directory: RunDirectory) -> Scores:
    """Score a finished run and write nothing. Raises as :func:`rescore` does."""
    return score(read_results(directory.results), **_inputs(directory))


def _inputs(directory: RunDirectory) -> dict[str, Any]:
    """What scoring takes beside the results."""
    run = directory.read_manifest()
    if "finished" not in run:
        raise VfoaError(f"{directory.path}: this run is not finished; the same `vfoa run` again goes on with it")
    manifests = {clip["name"]: _manifest(clip) for clip in run["clips"]}
    labels = {name: manifest.labels(None) for name, manifest in manifests.items()}
    return {
        "labels_by_clip": {name: found for name, found in labels.items() if found is not None},
        "notes": [*run["notes"], *(f"{clip['name']}: {note}" for clip in run["clips"] for note in clip["notes"])],
        "frames_by_clip": {clip["name"]: clip["frames"] for clip in run["clips"]},
    }


def _manifest(clip: dict[str, Any]) -> ClipManifest:
    """The clip's manifest where the run found it, or, if it has moved since, by name."""
    place = Path(clip["manifest"])
    return load_manifest(place if place.is_file() else clip["name"])
