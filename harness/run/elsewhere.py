"""Jobs on a machine that cannot read the run's directory, which is on object storage."""

from __future__ import annotations

import shutil
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from harness.cache_folder import cache_root
from harness.files import is_file
from harness.remote import Remote
from harness.run.clip_job import ClipJob, ClipOutcome
from harness.run.directory import RunDirectory
from harness.run.executors.contract import Progress
from harness.run.loop import run_clip

LEFT_SECONDS = 86_400.0
"""Age in seconds of the last change in a folder from which on it counts as left by a killed worker."""


def run_elsewhere(address: str, job: ClipJob, progress: Progress) -> ClipOutcome:
    """Run a job in a folder of this machine, then copy its files to the run's directory at ``address``.

    Raises
    ------
    VfoaError
        If they cannot be written there.
    """
    folder = cache_root() / "jobs"
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    _remove_left(folder)
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        outcome = run_clip(replace(job, directory=RunDirectory(Path(scratch))), progress)
        files = [path for path in Path(scratch).rglob("*") if is_file(path) and not path.name.startswith(".")]
        written = sorted(files, key=lambda path: (path.suffix == ".jsonl", path))  # these say "finished"
        names = [path.relative_to(scratch).as_posix() for path in written]
        Remote(address).upload(names, Path(scratch))
    return outcome


def _remove_left(folder: Path) -> None:
    for left in folder.iterdir():
        newest = max((path.stat().st_mtime for path in (left, *left.rglob("*")) if path.exists()), default=0.0)
        if time.time() - newest > LEFT_SECONDS:
            shutil.rmtree(left, ignore_errors=True)
