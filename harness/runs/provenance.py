"""What a run depends on, written into its manifest: data, weights, versions, machine."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from harness.adapters import Clip
from harness.files import digest_files, file_digest
from harness.models.catalogue import locate_all
from harness.runs.experiment import Experiment
from harness.runs.stages import SLOTS, StageChoice

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
    """The sha256 of every weights file the experiment's stages name, by that name.

    Raises
    ------
    VfoaError
        If some are not here: which, and how they are fetched.
    """
    choices = [choice for one in experiment.configurations for choice in one.choices.values() if choice]
    found = locate_all(sorted({name for choice in choices for name in weights_of(choice)}))
    return {name: file_digest(path) for name, path in found.items()}


def signals_digests(experiment: Experiment, name: str, clip: Clip) -> list[str]:
    """The sha256 of what each distinct stage reads from files for the clip called ``name``, as the stages stand."""
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


def source_digest() -> str:
    """Sha256 of all source that can change a result: an edited program does not go on with an older one's run."""
    root = Path(__file__).parent.parent.parent
    files = [path.relative_to(root) for package in ("vfoa", "harness") for path in (root / package).rglob("*.py")]
    after_the_results = (Path("harness/cli"), Path("harness/report"))
    relevant = sorted(path for path in files if not any(path.is_relative_to(folder) for folder in after_the_results))
    return digest_files((path.as_posix(), root / path) for path in relevant)


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
    """The machine, in words that say nothing of its owner."""
    return {"system": platform.system(), "machine": platform.machine(), "cores": os.cpu_count()}


def weights_of(choice: StageChoice) -> Iterator[str]:
    """Names of the weights files that a stage opens.

    Those of its settings' keys ``weights`` and ``*_weights``, one name or several; or, where not all of them are opened
    under all settings, those of its settings' property ``used_weights``.
    """
    used = getattr(choice.settings, "used_weights", None)
    yield from _named(choice.settings.model_dump()) if used is None else used


def _named(settings: Mapping[str, Any]) -> Iterator[str]:
    for key, value in settings.items():
        if key == "weights" or key.endswith("_weights"):
            yield from [value] if isinstance(value, str) else (value or ())
