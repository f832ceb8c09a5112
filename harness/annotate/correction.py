"""Correct one label through the store, and score the run again."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from harness.annotate import edits
from harness.annotate.clip_stores import open_store
from harness.clips.manifest import load_manifest
from harness.labels.timeline import timeline_of
from harness.report.write import rescore
from harness.run.directory import RunDirectory
from vfoa.errors import VfoaError, did_you_mean


@dataclass(frozen=True, slots=True, kw_only=True)
class Correction:
    """The true target of a subject from ``first`` to ``last``, in the source's own frame numbers."""

    clip: str
    subject: str
    target: str
    first: int
    last: int

    def __str__(self) -> str:
        frames = f"frame {self.first}" if self.first == self.last else f"frames {self.first} to {self.last}"
        return f"{self.clip}, {frames}: {self.subject} looks at {self.target}"


def choices(directory: RunDirectory, clip: str, subject: str) -> tuple[str, ...]:
    """Possible targets of a subject of a run's clip, ``none`` and ``ignore`` last.

    Raises
    ------
    VfoaError
        If the run has no such clip, or the clip no such subject.
    """
    manifest = load_manifest(_place(directory, clip), clip)
    if subject not in manifest.subjects:
        raise VfoaError(f"{clip}: unknown subject {subject!r}; {did_you_mean(subject, manifest.subjects)}")
    others = (name for name in manifest.subjects if name != subject)
    return (*manifest.targets, *others, "none", "ignore")


def correct(directory: RunDirectory, correction: Correction) -> Path:
    """Write a correction into the labels that a run is scored against, and score the run again.

    It is written to the journal of the labelling page, where it can be undone. Tables, page and recordings are updated.

    Returns
    -------
    Path
        The file of the labels.

    Raises
    ------
    VfoaError
        If a name or a frame is not the clip's, or another process labels the clip.
    """
    manifest = load_manifest(_place(directory, correction.clip), correction.clip)
    timeline = timeline_of(manifest.open())
    frames = list(timeline.frames)
    for frame in (correction.first, correction.last):
        if frame not in frames:
            raise VfoaError(f"{correction.clip}: no frame {frame}; expected {frames[0]} to {frames[-1]}")
    stretch = edits.mark_range(frames.index(correction.first), frames.index(correction.last), correction.target)
    with closing(open_store(manifest, directory.read_manifest().get("annotator"), timeline)) as store:
        store.put(store.revision, correction.subject, stretch)
        path = store.path
    rescore(directory)
    return path


def _place(directory: RunDirectory, clip: str) -> str:
    """The manifest of a run's clip where the run found it or, if it has moved since, its name."""
    places = {each["name"]: each["manifest"] for each in directory.read_manifest()["clips"]}
    if clip not in places:
        raise VfoaError(f"{directory.path}: no clip {clip!r}; {did_you_mean(clip, places)}")
    return places[clip] if Path(places[clip]).is_file() else clip
