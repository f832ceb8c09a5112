"""Shell completion: clips, experiments, configurations of a run, annotators' clips and settings.

Completion never fails: if nothing can be read, nothing is proposed.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import typer


def clip_names(incomplete: str) -> list[str]:
    """Clips by name."""
    from harness.clips.manifest import clip_files

    return _matching(clip_files(), incomplete)


def experiment_and_clip_names(incomplete: str) -> list[str]:
    """Experiments, clips and families of clips by name."""
    from harness.clips.manifest import clip_files
    from harness.files.folders import names

    return _matching([*names("experiments"), *names("datasets"), *clip_files()], incomplete)


def preset_names(incomplete: str) -> list[str]:
    """Presets by name."""
    from harness.run.experiment import PRESETS

    return _matching(PRESETS, incomplete)


def setting_assignments(incomplete: str) -> list[str]:
    """Dotted keys, each with its equals sign."""
    from harness.stages.settings_reference import setting_keys

    return _matching([f"{key}=" for key in setting_keys()], incomplete)


def stage_names(incomplete: str) -> list[str]:
    """Stages and steps that have settings, each also with its choices (``stereo.sgbm``)."""
    from harness.stages.configuration import TABLES
    from harness.stages.settings_reference import choice_names

    return _matching([*TABLES, *choice_names()], incomplete)


def run_directories(incomplete: str) -> list[str]:
    """Runs in ``runs/`` and in the path typed so far."""
    places = {Path("runs"), Path(os.path.dirname(incomplete) or ".")}
    found = (manifest.parent.as_posix() for place in places for manifest in place.glob("*/manifest.json"))
    return _matching(found, incomplete)


def configuration_names(context: typer.Context, incomplete: str) -> list[str]:
    """The configurations of the run that the command names."""
    from harness.run.directory import RunDirectory
    from vfoa.errors import VfoaError

    # the parser stops at an option without a value, and leaves the arguments before it
    place = context.params.get("run") or next(iter(context.args), None)
    try:
        return _matching(RunDirectory(Path(str(place))).read_manifest()["configurations"], incomplete)
    except (VfoaError, OSError, KeyError):
        return []


def _matching(names: Iterable[str], incomplete: str) -> list[str]:
    return sorted({name for name in names if name.startswith(incomplete)})
