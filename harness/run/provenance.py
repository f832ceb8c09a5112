"""Everything that a run depends on, written into its manifest: data, weights, versions, machine."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from harness.files.digests import file_digest
from harness.run.experiment import Experiment
from harness.sources import Clip, MeasuredClip
from harness.stages.slots import SLOTS
from harness.stages.weights.readiness import locate_weights

_PACKAGES = (
    "vfoa",
    "filterpy",
    "mcap",
    "numpy",
    "onnxruntime",
    "open3d",
    "open3d-cpu",
    "opencv-contrib-python-headless",
    "pandas",
    "rerun-sdk",
    "scipy",
)


def weights_digests(experiment: Experiment) -> dict[str, str]:
    """The sha256 of every weights file that the experiment's stages name, by that name.

    Raises
    ------
    VfoaError
        If some are missing: which, how to fetch them, and what would do instead.
    """
    found = locate_weights(choice for one in experiment.configurations for choice in one.choices.values() if choice)
    return {name: file_digest(path) for name, path in found.items()}


def output_digests(experiment: Experiment, name: str, clip: Clip | MeasuredClip) -> list[str]:
    """The sha256 of the files that each distinct stage reads for the clip ``name``, in the order of the stages."""
    if isinstance(clip, MeasuredClip):
        return []
    choices = [choice for one in experiment.configurations for choice in one.for_clip(name).choices.values() if choice]
    distinct = {f"{choice.slot} {choice.plain()}": choice for choice in choices}
    digests = (SLOTS[choice.slot].files_digest(choice, clip) for choice in distinct.values())
    return [digest for digest in digests if digest is not None]


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that can change a result."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def deciding_modules(clips: Iterable[Clip | MeasuredClip], experiment: Experiment) -> tuple[str, ...]:
    """The modules that decide the results of a run, with all that they import: the loop, the stages, the adapters."""
    choices = [choice for one in experiment.configurations for choice in one.choices.values() if choice]
    stages = {SLOTS[choice.slot].stage_class(choice.name).__module__ for choice in choices}
    return tuple(sorted({"harness.run.loop", *stages, *(type(clip).__module__ for clip in clips)}))


def source_commit() -> str | None:
    """The git commit of this source tree, with ``-dirty`` if it was changed; None outside a checkout."""
    root = Path(__file__).parent.parent.parent
    if not (root / ".git").exists():
        return None
    try:
        commit = subprocess.run(
            ["git", "describe", "--always", "--abbrev=40", "--dirty", "--exclude=*"],
            cwd=root,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return commit.stdout.strip()


def host() -> dict[str, Any]:
    """The machine, without anything that identifies its owner."""
    return {"system": platform.system(), "machine": platform.machine(), "cores": os.cpu_count()}
