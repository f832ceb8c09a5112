"""A verb in a process of its own, forked from one that has imported everything: it takes no time to start.

A fault is laid on the child before the verb begins (limits, a clock) or comes at a moment (signals).
"""

from __future__ import annotations

import contextlib
import fcntl
import importlib
import os
import pkgutil
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2

import harness
from harness.pipeline import weights
from tests.faults.project import MODEL_SHA256
from tests.faults.verbs import Writes

DAY_SECONDS = 86_400.0
MOST_SAID = 1 << 20
"""Bytes that a verb can say before it waits."""
LONGEST_SECONDS = 600.0
"""A verb that takes longer hangs."""
_SLOW_TO_IMPORT = ("harness.studio", "harness.pipeline.export", "harness.bench", "harness.run.executors.cluster")


@dataclass(frozen=True, slots=True)
class Ended:
    """The end of a verb: its exit code (negative: the signal), its messages, and its duration."""

    code: int
    said: str
    seconds: float


def import_everything() -> None:
    """Import what verbs import late, so that a child has it; no threads, which a child would not have."""
    cv2.setNumThreads(1)  # a child that gives up a pool of threads waits for them for ever
    for each in pkgutil.walk_packages(harness.__path__, "harness."):
        if not each.name.startswith(_SLOW_TO_IMPORT):
            with contextlib.suppress(ImportError):
                importlib.import_module(each.name)
    import pandas  # noqa: F401
    import scipy.stats  # noqa: F401


def run_verb(
    verb: Writes,
    folder: Path,
    *,
    before: Callable[[], None] = lambda: None,
    kill: tuple[int, float] | None = None,
    variables: Mapping[str, str] | None = None,
) -> Ended:
    """Run a verb's example in ``folder``. What it says goes into a pipe, which no limit of files cuts.

    ``before`` is called in the child; ``kill`` is a signal for its process group, and after how many seconds.
    """
    reader, writer = os.pipe()
    fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, MOST_SAID)
    begun = time.monotonic()
    process = os.fork()
    if process == 0:
        _be_the_verb(verb, folder, writer, before, variables or {})
    os.close(writer)
    status = _wait(process, begun + (kill[1] if kill else LONGEST_SECONDS))
    if status is None and kill:
        _send(process, kill[0])
        status = _wait(process, time.monotonic() + LONGEST_SECONDS)
    os.set_blocking(reader, False)
    with open(reader, "rb") as file:
        said = (file.read() or b"").decode(errors="replace")
    if status is None:
        _send(process, signal.SIGKILL)
        os.waitpid(process, 0)
        return Ended(code=-999, said=f"still there after {LONGEST_SECONDS:g} s", seconds=LONGEST_SECONDS)
    code = os.waitstatus_to_exitcode(status)
    return Ended(code=code, said=said, seconds=time.monotonic() - begun)


def _send(process: int, number: int) -> None:
    """To the whole group of a verb, or to the verb alone before it has one."""
    try:
        os.killpg(process, number)
    except ProcessLookupError:
        os.kill(process, number)


def _wait(process: int, until: float) -> int | None:
    while time.monotonic() < until:
        found, status = os.waitpid(process, os.WNOHANG)
        if found:
            return status
        time.sleep(0.002)
    return None


def _be_the_verb(
    verb: Writes, folder: Path, said: int, before: Callable[[], None], variables: Mapping[str, str]
) -> None:
    code = 70
    try:
        os.setsid()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        os.dup2(said, 1)
        os.dup2(said, 2)
        os.close(said)
        sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", closefd=False)
        os.chdir(folder)
        os.environ.update(variables)
        code = _called(verb, before)
    except KeyboardInterrupt:  # it met this process before or after the command
        code = 128 + signal.SIGINT
    except BaseException:
        with contextlib.suppress(BaseException):
            traceback.print_exc()
    finally:
        with contextlib.suppress(BaseException):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _called(verb: Writes, before: Callable[[], None]) -> int:
    from harness.cli import main, one_line_errors

    sys.argv = ["vfoa", *verb.words]
    if site := os.environ.get("VFOA_FAULTS_SITE"):
        _offer_a_model(site)
    before()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        if verb.call is None:
            main()
        else:
            with one_line_errors():
                verb.call()
        code = 0
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else int(error.code is not None)
    return code


def _offer_a_model(address: str) -> None:
    """A catalogue of one model, on a site of this machine."""
    entry = weights.CatalogueEntry(
        file="mine.onnx", task="a test", licence="CC0-1.0", home=address, address=address, sha256=MODEL_SHA256
    )
    weights.catalogue = lambda: {"mine": entry}  # type: ignore[assignment]


# Faults that are laid on the child


def small_files(most_bytes: int) -> None:
    """No file of more than ``most_bytes``, as under a quota."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, most_bytes))


def few_files(spare: int) -> None:
    """No more open files than now and ``spare``."""
    opened = len(os.listdir("/proc/self/fd")) - 1
    resource.setrlimit(resource.RLIMIT_NOFILE, (opened + spare, opened + spare))


def little_memory(spare_bytes: int) -> None:
    """No more address space than now and ``spare_bytes``."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + spare_bytes
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def clock_back() -> None:
    """A clock that is a day behind: all files seem to come from tomorrow."""
    now, now_ns = time.time, time.time_ns
    time.time = lambda: now() - DAY_SECONDS
    time.time_ns = lambda: now_ns() - int(DAY_SECONDS * 1e9)
