"""What a worker of a Dask cluster does with a job: it takes on the surroundings of the run, and checks itself first."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from harness.files.cache import VARIABLE as CACHE_VARIABLE
from harness.files.code_digest import code_digest
from harness.remote import forget_copies
from harness.run.executors.contract import Progress, StoppedError, compute_with
from vfoa.errors import VfoaError

TOPIC = "vfoa"
"""Topic of the events with which workers tell of their progress."""

COUNTS = "counts"
"""The key of the counts in an event, to which Dask adds keys of its own."""

PATIENCE_SECONDS = 30
TOLD_EVERY_SECONDS = 0.2

_stopped: set[str] = set()
"""In a worker: the runs whose jobs must stop."""


def note_stopped(run: str) -> None:
    """Let the jobs of a run stop after the current frame."""
    _stopped.add(run)


_OWN_CACHE, _OWN_FOLDER = os.environ.get(CACHE_VARIABLE), Path.cwd()
"""In a worker: the value of ``VFOA_CACHE`` and the folder that it was started with."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """The folder and the environment variables that paths and weights depend on."""

    folder: str = field(default_factory=lambda: str(Path.cwd()))
    variables: dict[str, str] = field(
        default_factory=lambda: {name: value for name, value in os.environ.items() if name.startswith("VFOA_")}
    )

    def enter(self) -> None:
        """Set the folder and the variables in this process, as far as this machine has them."""
        os.chdir(self.folder if Path(self.folder).is_dir() else _OWN_FOLDER)
        variables = self.variables | ({CACHE_VARIABLE: _OWN_CACHE} if _OWN_CACHE else {})
        for name in [name for name in os.environ if name.startswith("VFOA_") and name not in variables]:
            del os.environ[name]
        os.environ.update(variables)


_run = ""
"""In a worker: the run of the job before."""


def on_worker(
    here: Surroundings,
    code: tuple[tuple[str, ...], str],
    sees: Path | None,
    run: str,
    work: Callable[[Any, Progress], Any],
    job: Any,
) -> Any:
    """Return ``work(job, progress)``.

    Parameters
    ----------
    here
        The folder and the variables of the process that started the run.
    code
        Modules that decide the results, and the digest of their code there.
    sees
        A file of the run, which is on a shared disk.
    run
        A name for the run, the same for all of its jobs.

    Raises
    ------
    VfoaError
        If this worker has other code, does not see the file, or cannot read or write what it needs; the message names
        the worker.
    """
    from distributed import get_worker

    worker = get_worker()
    with _naming(worker.address):
        _prepare(here, code, sees, run)
        told = _Told(lambda words: worker.log_event(TOPIC, {COUNTS: words}))

        def progress(word: str) -> None:
            told.add(word)
            _check_goes_on(run)

        _check_goes_on(run)
        try:
            return work(job, progress)
        finally:
            told.send()


@contextmanager
def _naming(address: str) -> Iterator[None]:
    """Name the worker in an error of the block, such as that of a storage that only this worker cannot read."""
    try:
        yield
    except VfoaError as error:
        if type(error) is VfoaError:
            raise VfoaError(f"{address}: {error}") from None
        raise


def _prepare(here: Surroundings, code: tuple[tuple[str, ...], str], sees: Path | None, run: str) -> None:
    """Take on the surroundings of a run, and check that this worker can work for it; see :func:`on_worker`."""
    global _run
    here.enter()
    if run != _run:  # a clip may have changed since the last one
        forget_copies()
        _run = run
    compute_with(1)
    modules, digest = code
    if code_digest(modules) != digest:
        raise VfoaError("runs another version of vfoa; expected the same source as here")
    if sees is not None and not _appears(sees):
        raise VfoaError(f"sees no {sees}; expected the disk of the run's directory at the same path")


def _check_goes_on(run: str) -> None:
    if run in _stopped:
        raise StoppedError


def _appears(path: Path) -> bool:
    """Whether a file that was just written exists here: shared disks may show it after a delay."""
    deadline = time.monotonic() + PATIENCE_SECONDS
    while not path.exists():
        if time.monotonic() > deadline:
            return False
        time.sleep(TOLD_EVERY_SECONDS)
    return True


class _Told:
    """Counts progress words and sends them in batches: a message costs as much as a small frame."""

    def __init__(self, send: Callable[[dict[str, int]], object]) -> None:
        self._send, self._counts, self._sent_s = send, dict[str, int](), time.monotonic()

    def add(self, word: str) -> None:
        """Count a word."""
        self._counts[word] = self._counts.get(word, 0) + 1
        if time.monotonic() - self._sent_s >= TOLD_EVERY_SECONDS:
            self.send()

    def send(self) -> None:
        """Send the counts since the last call."""
        if self._counts:
            self._send(self._counts)
        self._counts, self._sent_s = {}, time.monotonic()
