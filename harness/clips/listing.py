"""The clips that can be found: those of the working directory and those of the package, and which can be here."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

from harness.clips.families import clip_files
from harness.clips.manifest import ClipManifest, clips_here, load_manifest
from harness.files.folders import folders
from harness.files.remote import unset_variables
from harness.labels.labels import IGNORED, Labels, timeline_of
from harness.sources import Clip, MeasuredClip
from vfoa.errors import VfoaError, listed

Value = TypeVar("Value")


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipRow:
    """One clip of the list. ``frames`` is None if it cannot be opened; ``problem`` says why.

    ``unset`` is the environment variable that its root needs and that is not set.
    """

    name: str
    adapter: str | None = None
    frames: int | None = None
    subjects: tuple[str, ...] = ()
    targets: tuple[str, ...] = ()
    licence: str | None = None
    labels: int | None = None
    problem: str | None = None
    unset: str | None = None


def list_clips() -> list[ClipRow]:
    """Return every clip that can be found: those of the working directory by name, then those of the package."""
    paths = clip_files()
    own = _own(paths)
    return [_row(name, path) for name, path in {**own, **paths}.items()]


def _own(paths: Mapping[str, Path]) -> dict[str, Path]:
    """The clips of the working directory."""
    return {name: path for name, path in paths.items() if path.parent == folders("datasets")[0]}


def unset_lines(unset: Mapping[str, str | None]) -> list[str]:
    """A line for each environment variable that is not set, with the clips that need it; ``unset`` has it by clip."""
    return [
        f"{variable} is not set: {', '.join(name for name, of_clip in unset.items() if of_clip == variable)}"
        for variable in dict.fromkeys(filter(None, unset.values()))
    ]


def clips_at_hand() -> tuple[list[str], list[str]]:
    """Return the clips that ``vfoa clips check`` checks by default, and a line for each kind that it leaves out.

    They are those of the working directory, or of the package if there are none, whose data can be here: the
    variables in their root are set. A manifest that cannot be read is one of them.
    """
    paths = clip_files()
    own = _own(paths)
    manifests = {name: attempt(partial(load_manifest, path, name))[0] for name, path in (own or paths).items()}
    unset = {name: _unset(manifest) if manifest else None for name, manifest in manifests.items()}
    here, left_out = [name for name, variable in unset.items() if variable is None], unset_lines(unset)
    if own and (packaged := len(paths) - len(own)):
        left_out.append(f"{packaged} clips that came with vfoa; name one to check it")
    return here, left_out


def clips_named(names: Iterable[str]) -> tuple[list[str], list[str]]:
    """Return the clips that are asked for, each once, and a line for those that are left out.

    A family, by its name or file, stands for those of its clips that are here. Raises the errors of
    :func:`~harness.clips.manifest.clips_here`.
    """
    here, absent = clips_here(names)
    return [*here], [f"no files here: {listed(absent)}"] if absent else []


def _row(name: str, path: Path) -> ClipRow:
    try:
        manifest = load_manifest(path, name)
    except VfoaError as error:
        return ClipRow(name=name, problem=str(error))
    clip, problems = attempt(manifest.open)
    labels, label_problems = labels_of(manifest, clip)
    return ClipRow(
        name=manifest.name,
        adapter=manifest.adapter,
        frames=None if clip is None else len(clip.frames),
        subjects=tuple(manifest.subjects),
        targets=tuple(manifest.targets),
        licence=manifest.licence,
        labels=scored_labels(labels, clip),
        problem=next(iter((*problems, *label_problems)), None),
        unset=_unset(manifest),
    )


def _unset(manifest: ClipManifest) -> str | None:
    """The first variable that the root needs and that is not set."""
    return next(iter(unset_variables(manifest.root or "")), None)


def labels_of(manifest: ClipManifest, clip: Clip | MeasuredClip | None) -> tuple[Labels | None, tuple[str, ...]]:
    """A clip's labels, without its times if it cannot be opened, and their problems."""
    return attempt(lambda: manifest.labels(None if clip is None else timeline_of(clip)))


def scored_labels(labels: Labels | None, clip: Clip | MeasuredClip | None) -> int | None:
    """Number of scored (frame, subject) pairs; counted by the lengths of the ranges if the clip cannot be opened."""
    if labels is None:
        return None
    if clip is None:
        scored = [label_range for label_range in labels.ranges if label_range.label.target != IGNORED]
        return sum(label_range.last_frame - label_range.first_frame + 1 for label_range in scored)
    return sum(1 for _, _, label in labels.labelled(clip.frames) if label.target != IGNORED)


def attempt(read: Callable[[], Value]) -> tuple[Value | None, tuple[str, ...]]:
    """What ``read`` returns, or None and its error."""
    try:
        return read(), ()
    except VfoaError as error:
        return None, (str(error),)
