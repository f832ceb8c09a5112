"""The fault plan: every verb that writes x every fault, at seeded moments.

    python -m tests.faults.plan [--seed 1] [--only run] [--fault "kill -9"] [--out reports/faults.md]

A cell holds if, after the fault, no file is neither as it was nor as it is to be, nothing is a traceback, and the same
command then ends with the bytes of a run without a fault. Under "no byte" every file is as it was, and the command
says so: this fault needs no run without one, so the suite tries it on every verb.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random

from tests.faults import child, project
from tests.faults.files import Snapshot, left_over, snapshot, what_is_wrong
from tests.faults.verbs import VERBS, Left, Writes

NO_BYTE = "no byte"
FAULTS = (
    *("kill -9", "SIGINT", "SIGTERM", "full disk", "read-only"),
    *("small files", "few files", "little memory", "clock back", NO_BYTE),
)
_STAMPED = ".noted"
"""Ending of files that hold stamps only of files that have been left alone for some seconds."""
_ON_DISKS = ("full disk", "read-only")
_SIGNALS = {"kill -9": signal.SIGKILL, "SIGINT": signal.SIGINT, "SIGTERM": signal.SIGTERM}


@dataclass(frozen=True, slots=True)
class Cell:
    """A verb under a fault. ``wrong`` is empty where it holds; ``skipped`` says why it was not tried."""

    verb: str
    fault: str
    wrong: str = ""
    skipped: str = ""
    ended: int | None = None

    @property
    def mark(self) -> str:
        """The result as the table shows it."""
        if self.skipped or self.wrong:
            return "–" if self.skipped else "FAILED"
        return "finished" if self.ended == 0 else "held"


@dataclass(frozen=True, slots=True)
class Undisturbed:
    """A verb's effect without faults: the project before and after, the files that differ each time, the seconds."""

    before: Snapshot
    after: Snapshot
    varying: frozenset[str]
    seconds: float


class Workshop:
    """A place for the project, always at the same path, so that outputs can be compared byte by byte."""

    def __init__(self, folder: Path, address: str) -> None:
        self.place, self._template = folder / "place" / "project", folder / "template"
        self._address = address
        self._known: dict[str, Undisturbed] = {}
        self.place.mkdir(parents=True)
        self._is_mounted = False

    def prepare(self) -> None:
        """Make the template: the project with a finished run, and labels as ELAN has them."""
        project.write_project(self.place)
        made = (
            ("run", "talk.toml", "--out", "run", "--workers", "1"),
            ("labels", "export", "talk", "theirs.eaf", "--format", "elan"),
            ("labels", "import", "theirs.eaf", "--format", "elan", "--clip", "talk", "--annotator", "dan"),
        )
        for words in made:
            ended = self.run(Writes(words))
            if ended.code != 0:
                raise SystemExit(f"vfoa {' '.join(words)}: exit {ended.code}: {ended.said}")
        shutil.copytree(self.place, self._template)

    def renew(self) -> None:
        """The project as it is before a verb."""
        for each in self.place.iterdir():
            shutil.rmtree(each) if each.is_dir() else each.unlink()
        shutil.copytree(self._template, self.place, dirs_exist_ok=True)

    def run(self, verb: Writes, **more: object) -> child.Ended:
        """Run a verb in the place."""
        variables = {"VFOA_CACHE": str(self.place / "cache"), "XDG_CACHE_HOME": str(self.place / "cache")}
        variables["VFOA_FAULTS_SITE"] = self._address
        return child.run_verb(verb, self.place, variables=variables, **more)  # type: ignore[arg-type]

    def undisturbed(self, name: str, verb: Writes) -> Undisturbed:
        """A verb without a fault, twice: what differs then differs each time."""
        if name not in self._known:
            made, seconds = [], 0.0
            for _ in range(2):
                self.renew()
                before = snapshot(self.place)
                ended = self.run(verb)
                if ended.code != 0:
                    raise SystemExit(f"{name}: exit {ended.code} without a fault: {ended.said}")
                made.append(snapshot(self.place))
                seconds = ended.seconds
            varying = frozenset(
                path
                for path in made[1]
                if made[0].get(path) != made[1][path]
                or (path.endswith(_STAMPED) and path.endswith(verb.varies))  # whether it differs depends on the load
            )
            if unexpected := [path for path in varying if not path.endswith(verb.varies) or not verb.varies]:
                raise SystemExit(f"{name}: differs from run to run: {', '.join(unexpected)}")
            self._known[name] = Undisturbed(before, made[1], varying, seconds)
        return self._known[name]

    def try_cell(self, name: str, fault: str, rng: Random) -> Cell:
        """One cell of the table."""
        verb = VERBS[name]
        assert isinstance(verb, Writes)
        if fault == NO_BYTE:
            return self._without_a_byte(name, verb)
        whole = self.undisturbed(name, verb)
        try:
            if fault in _ON_DISKS and not self._is_mounted:
                _mount("-t", "tmpfs", "-o", _ROOMY, "tmpfs", str(self.place))
                self._is_mounted = True
            self.renew()
            ended = self._under(fault, verb, whole, rng)
        except PermissionError as error:
            return Cell(name, fault, skipped=f"needs the right to mount a file system: {error}")
        growing = {*whole.varying, *verb.grows}
        wrong = self._said_wrongly(fault, ended) or what_is_wrong(self.place, whole.before, whole.after, growing)
        if wrong:
            return Cell(name, fault, wrong=wrong, ended=ended.code)
        again = self.run(verb)
        found = snapshot(self.place)
        if again.code != 0 and found != whole.after:
            line = (again.said.strip().splitlines() or [""])[-1]
            return Cell(name, fault, wrong=f"again: exit {again.code}: {line}", ended=ended.code)
        different = [
            path for path, data in whole.after.items() if path not in whole.varying and found.get(path) != data
        ]
        different += [path for path in left_over(found) if path not in whole.after]
        wrong = f"again: other bytes: {', '.join(sorted(different)[:3])}" if different else ""
        return Cell(name, fault, wrong=wrong, ended=ended.code)

    def _without_a_byte(self, name: str, verb: Writes) -> Cell:
        """A verb whose files take no byte from the start."""
        self.renew()
        before = snapshot(self.place)
        ended = self.run(verb, before=partial(child.small_files, 0))
        wrong = self._said_wrongly(NO_BYTE, ended) or what_is_wrong(self.place, before, before, ())
        if ended.code == 0 and not verb.only_removes:
            wrong = wrong or "nothing could be written, and nothing was said"
        return Cell(name, NO_BYTE, wrong=wrong, ended=ended.code)

    def _under(self, fault: str, verb: Writes, whole: Undisturbed, rng: Random) -> child.Ended:
        if fault in _SIGNALS:
            return self.run(verb, kill=(_SIGNALS[fault], rng.uniform(0, 1.1 * whole.seconds)))
        if fault in _ON_DISKS:
            written = sum(len(data) for path, data in whole.after.items() if whole.before.get(path) != data)
            room = None if fault == "read-only" else rng.randrange(written + 1)
            with self._mounted(room):
                return self.run(verb)
        laid: dict[str, Callable[[], None]] = {
            "small files": partial(child.small_files, rng.randrange(100_000)),
            "few files": partial(child.few_files, rng.randrange(4)),
            "little memory": partial(child.little_memory, 1 << rng.randrange(12, 26)),
            "clock back": child.clock_back,
        }
        return self.run(verb, before=laid[fault])

    @contextmanager
    def _mounted(self, room_bytes: int | None) -> Iterator[None]:
        """The project's file system with so much room; None: as much as it likes, but read-only."""
        used = shutil.disk_usage(self.place).used
        _mount("-o", "remount,ro" if room_bytes is None else f"remount,size={used + room_bytes}", str(self.place))
        try:
            yield
        finally:
            _mount("-o", f"remount,rw,{_ROOMY}", str(self.place))

    def _said_wrongly(self, fault: str, ended: child.Ended) -> str:
        """Why what a verb said is not what it should have; empty where it is right."""
        if "Traceback (most recent call last)" in ended.said:
            return f"a traceback: {ended.said.strip().splitlines()[-1]}"
        if ended.code == -999:
            return ended.said
        if ended.code < 0 and fault not in (*_SIGNALS, "little memory"):
            return f"ended by signal {-ended.code}"
        if ended.code > 0 and not ended.said.strip() and (fault, ended.code) != ("SIGINT", 130):
            return f"exit {ended.code} without a word"
        return ""


_ROOMY = "size=256m"


def _mount(*words: str) -> None:
    if os.geteuid() != 0 or sys.platform != "linux":
        raise PermissionError("not root on Linux")
    done = subprocess.run(["mount", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise PermissionError(done.stderr.strip())


def table(cells: Sequence[Cell], seed: int, seconds: float) -> str:
    """Verb x fault in Markdown, what did not hold, and what was not tried."""
    marks = {(cell.verb, cell.fault): cell.mark for cell in cells}
    names, faults = (list(dict.fromkeys(getattr(cell, key) for cell in cells)) for key in ("verb", "fault"))
    failed, skipped = ([cell for cell in cells if getattr(cell, key)] for key in ("wrong", "skipped"))
    lines = [
        "# Fault plan",
        "",
        f"`make faults`, seed {seed}: {len(cells) - len(failed) - len(skipped)} of {len(cells)} cells held, "
        f"{len(failed)} failed, {len(skipped)} were not tried; {seconds / 60:.1f} minutes.",
        "",
        "A cell holds if after the fault every file is as it was or as it is to be, nothing was said as a traceback,",
        "and the same command then ends with the bytes of a run without a fault. *finished*: it holds, and the verb",
        "finished in spite of the fault, or before it came.",
        "",
        f"| verb | {' | '.join(faults)} |",
        f"|---|{'---|' * len(faults)}",
        *(f"| {name} | {' | '.join(marks.get((name, fault), '') for fault in faults)} |" for name in names),
        "",
        *(f"- {each.verb}, {each.fault}: {each.wrong} (exit {each.ended})" for each in failed),
        *(
            f"- {fault}: not tried: {why}"
            for fault, why in dict.fromkeys((each.fault, each.skipped) for each in skipped)
        ),
        "",
        "Not in the plan:",
        "",
        *(f"- {name}: {each.reason}" for name, each in VERBS.items() if isinstance(each, Left)),
    ]
    return "\n".join(lines).rstrip() + "\n"


@contextmanager
def workshop() -> Iterator[Workshop]:
    """A prepared workshop in a temporary folder, with a site that has a model."""
    from tests.web import serve

    folder = Path(tempfile.mkdtemp()).resolve()  # no object that a child, which ends as well, would clean up
    try:
        with serve() as site:
            site.files["/mine.onnx"] = project.MODEL
            found = Workshop(folder, site.url("/mine.onnx"))
            found.prepare()
            yield found
    finally:
        subprocess.run(["umount", "-l", str(folder / "place" / "project")], capture_output=True, check=False)
        shutil.rmtree(folder)


def main(words: Sequence[str] | None = None) -> int:
    """Run the plan; 1 where a cell did not hold."""
    options = argparse.ArgumentParser(prog="python -m tests.faults.plan")
    options.add_argument("--seed", type=int, default=int(os.environ.get("SEED", "1")))
    options.add_argument("--only", action="append", default=[], choices=[*VERBS])
    options.add_argument("--fault", action="append", default=[], choices=FAULTS)
    options.add_argument("--minutes", type=float, default=15.0, help="Begin no cell later.")
    options.add_argument("--out", type=Path)
    given = options.parse_args(words)
    child.import_everything()
    begun, cells = time.monotonic(), []
    with workshop() as place:
        for name, verb in VERBS.items():
            for fault in given.fault or FAULTS:
                if isinstance(verb, Left) or (given.only and name not in given.only):
                    continue
                if time.monotonic() - begun > 60 * given.minutes:
                    cells.append(Cell(name, fault, skipped=f"{given.minutes:g} minutes were over"))
                    continue
                cells.append(place.try_cell(name, fault, Random(f"{given.seed}/{name}/{fault}/0")))
                said = cells[-1].wrong or cells[-1].skipped or "held"
                print(json.dumps([name, fault, cells[-1].ended, said]), file=sys.stderr, flush=True)  # noqa: T201
    text = table(cells, given.seed, time.monotonic() - begun)
    print(text)  # noqa: T201
    if given.out:
        given.out.write_text(text, encoding="utf-8")
    return int(any(cell.wrong for cell in cells))


if __name__ == "__main__":
    raise SystemExit(main())
