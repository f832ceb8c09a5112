"""The records of one clip of a finished run, under one of its configurations."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from harness.clips.manifest import ClipManifest
from harness.run.directory import RunDirectory
from harness.run.grid import base_of, is_meant
from harness.run.records import FrameRecord, renamed
from harness.run.table_records import read_records
from vfoa.errors import VfoaError, did_you_mean, listed


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipRecords:
    """The configuration's name, its records by frame number, and the records of all configurations.

    Attention values are probabilities with ``has_probabilities``. Without ``says_nowhere``, no focus is no answer.
    """

    configuration: str
    by_frame: dict[int, FrameRecord]
    all: list[FrameRecord]
    has_probabilities: bool
    says_nowhere: bool


def read_clip_records(run: Path, clip: ClipManifest | str, configuration: str | None) -> ClipRecords:
    """Read the records from a run's directory; ``configuration`` may be None if the run has only one for the clip.

    With the clip's manifest, renamed targets have their present names.

    Raises
    ------
    VfoaError
        If the run has no such clip or configuration, or several configurations and none was chosen; or its tables
        cannot be read.
    """
    directory = RunDirectory(run)
    manifest = directory.read_manifest()
    name, names_now = clip if isinstance(clip, str) else clip.name, dict[str, str]()
    if isinstance(clip, ClipManifest):
        then = next((of_run.names for of_run in manifest.clips if of_run.name == clip.name), None)
        names_now = clip.names_now(then.targets if then else {})
    records = [renamed(frame, names_now) for frame in read_records(directory, {name})]
    if not records:
        raise VfoaError(f"{run}: the run has no frames of clip {name!r}")
    names = list(dict.fromkeys(record.configuration for record in records))
    chosen = choose(names, configuration, run)
    by_frame = {record.frame: record for record in records if record.configuration == chosen}
    traits = manifest.traits(chosen, directory.manifest)
    return ClipRecords(
        configuration=chosen,
        by_frame=by_frame,
        all=records,
        has_probabilities=traits.probabilistic,
        says_nowhere=traits.says_nowhere,
    )


def choose(names: list[str], wanted: str | None, run: Path) -> str:
    """Return the chosen one of a run's configurations; the only one, if none was chosen.

    Raises
    ------
    VfoaError
        If there is no such configuration, or there are several: none was chosen, or a name of several seeds.
    """
    meant = [name for name in names if name == wanted] or [name for name in names if is_meant(name, wanted)]
    if len(meant) > 1:
        if wanted is None:
            raise VfoaError(f"{run}: has several configurations; choose one with --config: {listed(meant)}")
        raise VfoaError(f"{run}: {wanted!r} is of {len(meant)} seeds; expected one of {listed(meant)}")
    if not meant:
        raise VfoaError(f"{run}: no configuration {wanted!r}; {did_you_mean(str(wanted), map(base_of, names))}")
    return meant[0]
