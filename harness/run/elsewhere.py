"""Jobs on a machine that cannot read the run's directory, which is on object storage."""

from __future__ import annotations

import platform
import shutil
import tempfile
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from harness.cache_folder import cache_root
from harness.files import is_file
from harness.remote import Remote
from harness.run.clip_job import ClipJob, ClipOutcome
from harness.run.directory import RunDirectory
from harness.run.executors.contract import Progress, StoppedError
from harness.run.loop import run_clip
from harness.run.remote_checkpoint import RemoteCheckpoint
from vfoa.errors import VfoaError

LEFT_SECONDS = 86_400.0
"""Age in seconds of the last change in a folder from which on it counts as left by a killed worker."""


def run_elsewhere(address: str, job: ClipJob, progress: Progress) -> ClipOutcome:
    """Run a job in a folder of this machine, then copy its files to the run's directory at ``address``.

    From time to time, and when the run is interrupted, the job's checkpoint is published there.

    Raises
    ------
    VfoaError
        If the run is not at the address as this machine sees it, or the files cannot be written there.
    """
    _check_same_storage(address)
    folder = cache_root() / "jobs"
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    _remove_left(folder)
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        here = replace(job, directory=RunDirectory(Path(scratch)))
        checkpoint = RemoteCheckpoint(address, here)
        checkpoint.fetch()

        def told(clip: str) -> None:
            progress(clip)
            checkpoint.publish_if_due()

        try:
            outcome = run_clip(here, told)
        except StoppedError:
            with suppress(VfoaError):  # then only the time since the last publication is lost
                checkpoint.publish()
            raise
        files = [path for path in Path(scratch).rglob("*") if is_file(path) and not path.name.startswith(".")]
        written = sorted(files, key=lambda path: (path.suffix == ".jsonl", path))  # these say "finished"
        names = [path.relative_to(scratch).as_posix() for path in written]
        Remote(address).upload(names, Path(scratch))
        checkpoint.remove()
    return outcome


def _check_same_storage(address: str) -> None:
    """Check that the address is the run's, and not one of the same name on another server.

    Raises
    ------
    VfoaError
        If the run's manifest is not there.
    """
    name = RunDirectory(Path()).manifest.name
    if not Remote(address).has(name):
        raise VfoaError(
            f"{address}: no {name} of the run, as seen by the worker on {platform.node()}; expected the storage of the "
            "machine that started the run: give the worker the same AWS_ENDPOINT_URL and keys"
        )


def _remove_left(folder: Path) -> None:
    for left in folder.iterdir():
        newest = max((path.stat().st_mtime for path in (left, *left.rglob("*")) if path.exists()), default=0.0)
        if time.time() - newest > LEFT_SECONDS:
            shutil.rmtree(left, ignore_errors=True)
