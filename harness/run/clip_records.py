"""Records of one clip under one configuration, by frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.clips.manifest import ClipManifest
from harness.run.directory import RunDirectory
from harness.run.records import FrameRecord, renamed
from harness.run.results import read_results
from vfoa.errors import VfoaError, did_you_mean
from vfoa.types import PROBABILISTIC


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


def has_probabilities(configuration: Mapping[str, Any]) -> bool:
    """Whether the attention of a configuration in a run's manifest is a probability."""
    return configuration.get("attention", {}).get("method") in PROBABILISTIC


def says_nowhere(configuration: Mapping[str, Any]) -> bool:
    """Whether a configuration can answer "looks at nothing": with probabilities, or the nearest within a limit."""
    return has_probabilities(configuration) or configuration.get("attention", {}).get("limit_deg") is not None


def read_clip_records(run: Path, clip: ClipManifest | str, configuration: str | None) -> ClipRecords:
    """Read the records from a run's directory; ``configuration`` may be None if the run has only one for the clip.

    With the clip's manifest, renamed targets have their present names.

    Raises
    ------
    VfoaError
        If the run has no such clip or configuration, or several configurations and none was chosen.
    """
    directory = RunDirectory(run)
    manifest: Mapping[str, Any] = directory.read_manifest() if directory.manifest.is_file() else {}
    name, names_now = clip, dict[str, str]()
    if isinstance(clip, ClipManifest):
        clips = manifest.get("clips", [])
        then: dict[str, Any] = next((each.get("names", {}) for each in clips if each["name"] == clip.name), {})
        name, names_now = clip.name, clip.names_now(then.get("targets", {}))
    records = [renamed(each, names_now) for each in read_results(directory.results) if each.clip == name]
    if not records:
        raise VfoaError(f"{run}: the run has no frames of clip {name!r}")
    names = list(dict.fromkeys(each.configuration for each in records))
    chosen = _choose(names, configuration, run)
    by_frame = {each.frame: each for each in records if each.configuration == chosen}
    settings = manifest.get("configurations", {}).get(chosen, {})
    return ClipRecords(
        configuration=chosen,
        by_frame=by_frame,
        all=records,
        has_probabilities=has_probabilities(settings),
        says_nowhere=says_nowhere(settings),
    )


def _choose(names: list[str], wanted: str | None, run: Path) -> str:
    if wanted is None and len(names) == 1:
        return names[0]
    if wanted is None:
        raise VfoaError(f"{run}: has several configurations; choose one with --config: {', '.join(names)}")
    if wanted not in names:
        raise VfoaError(f"{run}: no configuration {wanted!r}; {did_you_mean(wanted, names)}")
    return wanted
