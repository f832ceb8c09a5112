"""In what a clip is no longer what a run was made with: labels, names, content."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from harness.clips.manifest import ClipManifest
from harness.files import digest_files
from harness.run.manifest import differences
from vfoa.errors import VfoaError

RUN_LABELS = "run_labels_sha256"
"""The key of a run's manifest with the labels that it was made with, where the tables are of others."""
TABLE_LABELS = "labels_sha256"
"""The key with the labels that the tables are of."""


def labels_digest(manifest: ClipManifest, annotator: str | None) -> str | None:
    """The sha256 of a clip's label file; None where there is none."""
    path = manifest.annotations.find(annotator)
    return digest_files([("labels", path)]) if path else None


def said_of_labels(run: Mapping[str, Any], clip: Mapping[str, Any], manifest: ClipManifest) -> Iterator[str]:
    """A sentence if the labels are not those of the run: edited since, or another file."""
    before = _labels_of_run(run, clip)
    if before is None or labels_digest(manifest, run.get("annotator")) == before:
        return
    path = manifest.annotations.find(run.get("annotator"))
    now = f"scored against {path.parent.name}/{path.name} as it is" if path else "and there are none now"
    yield f"{clip['name']}: its labels are not those that the run was made with; {now}."


def said_of_names(clip: Mapping[str, Any], manifest: ClipManifest) -> Iterator[str]:
    """A sentence if subjects or targets were renamed, or are found in another way: the results have the old names."""
    names = manifest.naming()
    if different := differences(clip.get("names", names), names):
        yield (
            f"{clip['name']}: the names in {manifest.path.name} are not those that the run was made with "
            f"({different}), and its results have the old ones; to score the new ones, run it again."
        )


def said_of_content(run: Mapping[str, Any], clip: Mapping[str, Any], manifest: ClipManifest) -> Iterator[str]:
    """A sentence if another clip has taken this one's name.

    Reading a clip whole takes time, so it is done only where its manifest or its labels are others than the run's. A
    clip that cannot be opened is not compared: scoring needs no images.
    """
    same_labels = labels_digest(manifest, run.get("annotator")) == _labels_of_run(run, clip)
    if "live" in run or "sha256" not in clip or (same_labels and Path(clip["manifest"]) == manifest.path):
        return
    try:
        found = manifest.open().digest()
    except VfoaError:
        return
    if found != clip["sha256"]:
        yield (
            f"{clip['name']}: the images or the calibration of {manifest.path.name} are not those that the run was "
            "made with, and its labels may be of another clip; to score this one, run it again."
        )


def _labels_of_run(run: Mapping[str, Any], clip: Mapping[str, Any]) -> str | None:
    found: Mapping[str, str | None] = run.get(RUN_LABELS) or run.get(TABLE_LABELS) or {}
    return found.get(clip["name"])
