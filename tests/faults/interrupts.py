"""Interrupts and kills at random instants of a run: ``python -m tests.faults.interrupts --times 500``.

Every run gets one signal, as a terminal, a closed terminal, a batch system or a full memory sends it; half of them
while recordings are being closed. A trial holds if all processes end within 5 s without a traceback, and if the run,
continued after some interrupts, writes the tables and the recordings of a run without any. Tracebacks of Python's own
start, before it imports anything of this program, are not counted. ``--cluster`` does so on a Dask cluster of two
workers, which outlive the runs.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from random import Random

from scripts.measure.many_clips import local_cluster
from tests.alley import write_matching
from tests.recorded import values_of
from tests.repository import REPOSITORY

LONGEST_S = 5.0
FRAMES = range(1, 9)
TABLES = ("frr.csv", "comparisons.csv")
IN_A_ROW = 8
"""Interrupts of one run before it is left to end."""
CLOSING_S = 0.5
"""Signals that are sent while recordings are being closed come within so many seconds of the first closed file."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One signal: what was sent, when (s after the start), how the run ended, and after how many seconds."""

    workers: int
    sent: str
    at_s: float
    code: int | None
    took_s: float
    wrong: str


class Runs:
    """Runs of one experiment."""

    def __init__(self, folder: Path, scheduler: str | None) -> None:
        self._folder, self._experiment = folder, write_matching(folder, FRAMES, "second")
        self._places = {workers: ("--workers", str(workers)) for workers in (1, 2, 4)}
        if scheduler is not None:
            self._places[2] = ("--scheduler", scheduler)
        self.seconds: dict[int, float] = {}
        self._expected = self._written(self._finish(1))
        for workers in (2, 4):
            self._finish(workers)

    def start(self, out: Path, workers: int, rng: Random) -> subprocess.Popen[bytes]:
        """Start a run in a process group of its own."""
        cache = rng.choice([["--no-cache"], ["--cache", str(self._folder / f"cache{rng.random()}")]])
        words = ["run", str(self._experiment), "--out", str(out), *self._places[workers]]
        return subprocess.Popen(
            [Path(sys.executable).with_name("vfoa"), *words, *cache],
            env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
            stdout=subprocess.DEVNULL,
            stderr=(self._folder / "said").open("wb"),
            start_new_session=True,
            preexec_fn=_expect_signals,
        )

    def interrupt(self, out: Path, workers: int, rng: Random) -> Trial:
        """Start or continue a run, and interrupt it at a random instant."""
        name, to_all = rng.choice([("SIGINT", True), ("SIGHUP", True), ("SIGTERM", False), ("SIGKILL", True)])
        began_s = time.monotonic()
        process = self.start(out, workers, rng)
        if rng.random() < 0.5:
            time.sleep(rng.uniform(0, self.seconds[workers]))
        else:
            while process.poll() is None and not any(out.glob("*.whole.partial")):
                time.sleep(0.002)
            time.sleep(rng.uniform(0, CLOSING_S))
        sent_s = time.monotonic()
        if process.poll() is None:
            (os.killpg if to_all else os.kill)(process.pid, getattr(signal, name))
        code, left = wait_for_all(process, sent_s + 12 * LONGEST_S)
        took_s = time.monotonic() - sent_s
        said = (self._folder / "said").read_text()
        wrong = f"still there: {left}" if left else ""
        if took_s > LONGEST_S:
            wrong = wrong or f"too long: {said}"
        said = "".join(line for line in said.splitlines(keepends=True) if "took over the lock" not in line)
        is_started = not said or "harness" in said or "vfoa:" in said
        if is_started and (len(said.splitlines()) > 1 or code not in (0, 130, -getattr(signal, name))):
            wrong = wrong or f"exit {code}: {said}"
        return Trial(workers, name, round(sent_s - began_s, 3), code, round(took_s, 2), wrong)

    def what_differs(self, out: Path, workers: int) -> str:
        """Let an interrupted run end; return the tables and recordings that are not as they should be."""
        found = self._written(self._finish(workers, out))
        return ", ".join(name for name in found | self._expected if found.get(name) != self._expected.get(name))

    def _finish(self, workers: int, out: Path | None = None) -> Path:
        begun = time.monotonic()
        process = self.start(out or self._folder / f"whole-{workers}", workers, Random(workers))
        process.wait(timeout=600)
        self.seconds.setdefault(workers, time.monotonic() - begun)
        if process.returncode:
            raise SystemExit(f"exit {process.returncode}: {(self._folder / 'said').read_text()}")
        return out or self._folder / f"whole-{workers}"

    def _written(self, out: Path) -> dict[str, object]:
        """The bytes of tables, and the values of recordings; partial files are not expected."""
        tables = {name: (out / name).read_bytes() for name in TABLES if (out / name).is_file()}
        tables |= {path.relative_to(out).as_posix(): path.read_bytes() for path in out.glob("*/**/*.parquet")}
        return {**tables, **{path.name: values_of(path) for path in out.glob("*.rrd")}} | dict.fromkeys(
            path.name for path in out.glob("*.rrd.*")
        )


def _expect_signals() -> None:
    """Undo what a job in the background inherits: it ignores Ctrl-C, and under nohup a closed terminal."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def wait_for_all(process: subprocess.Popen[bytes], until_s: float) -> tuple[int | None, list[str]]:
    """Wait for a process and all of its group; kill what is left, and return its exit code and what was left."""
    left: list[str] = []
    while time.monotonic() < until_s:
        left = _group(process.pid)
        if process.poll() is not None and not left:
            return process.returncode, []
        time.sleep(0.02)
    if shutil.which("py-spy"):
        for each in left:
            subprocess.run(["py-spy", "dump", "--pid", each.split()[0]], check=False)
    os.killpg(process.pid, signal.SIGKILL)
    return process.wait(), left


def _group(number: int) -> list[str]:
    """The processes of a group that have not ended, each with its command."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            state, _, group = place.joinpath("stat").read_text().rpartition(")")[2].split()[:3]
            if int(group) == number and state != "Z":
                found.append(f"{place.name} {place.joinpath('cmdline').read_text().replace(chr(0), ' ')[:150]}")
        except OSError:
            continue
    return found


@contextmanager
def load(processes: int) -> Iterator[None]:
    """Keep this many processors busy."""
    busy = [multiprocessing.Process(target=_count, daemon=True) for _ in range(processes)]
    for each in busy:
        each.start()
    try:
        yield
    finally:
        for each in busy:
            each.kill()
            each.join()


def _count() -> None:
    while True:
        pass


def main(words: Sequence[str] | None = None) -> int:
    """Interrupt runs; 1 if a trial did not hold."""
    options = argparse.ArgumentParser(prog="python -m tests.faults.interrupts")
    options.add_argument("--times", type=int, default=500)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--workers", type=int, nargs="+", default=[1, 2, 4])
    options.add_argument("--load", type=int, default=0, help="Processes that keep processors busy.")
    options.add_argument("--cluster", action="store_true", help="Runs with 2 workers go to a Dask cluster.")
    given = options.parse_args(words)
    rng, trials, differing = Random(given.seed), [], []
    cluster = local_cluster(2) if given.cluster else nullcontext()
    with tempfile.TemporaryDirectory() as folder, load(given.load), cluster as scheduler:
        runs = Runs(Path(folder), scheduler)
        while len(trials) < given.times:
            out, workers = Path(folder) / f"out-{len(trials)}", rng.choice(given.workers)
            for _ in range(IN_A_ROW):
                trials.append(runs.interrupt(out, workers, rng))
                print(json.dumps([getattr(trials[-1], name) for name in Trial.__slots__]), file=sys.stderr, flush=True)  # noqa: T201
                if trials[-1].code == 0:
                    break
            if found := runs.what_differs(out, workers):
                differing.append(f"{out.name}: {found}")
            shutil.rmtree(out)
    wrong = [trial for trial in trials if trial.wrong]
    for workers in given.workers:
        took_s = sorted(trial.took_s for trial in trials if trial.workers == workers) or [0.0]
        middle_s, worst_s = took_s[len(took_s) // 2], took_s[-1]
        print(f"{workers} workers: {len(took_s)} interrupts, median {middle_s} s, worst {worst_s} s")  # noqa: T201
    print(f"{len(wrong)} of {len(trials)} did not hold; tables that differ: {differing or 'none'}")  # noqa: T201
    return int(bool(wrong or differing))


if __name__ == "__main__":
    raise SystemExit(main())
