"""Whether two runs have the same results: ``python -m tests.same_run BEFORE AFTER``.

BEFORE and AFTER are directories of runs, or folders that hold several of them, as ``python -m tests.same_run --make
FOLDER`` makes. Tables must be equal in every byte, recordings in every value. Make BEFORE with the code before a change
and AFTER with the code after it; each run takes the stage cache of ``VFOA_CACHE``, so that the second is fast.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from tests.recorded import values_of

TABLES = ("frr.csv", "comparisons.csv", "measures.csv", "objects.csv", "oracle_ablation.csv")

RUNS = {
    "demo": ("demo", "--limit", "6"),
    "people": ("people", "--clip", "kitchen_p09", "--clip", "office_p06", "--limit", "150", "--recording", "light"),
    "conversation": ("conversation",),
    "bandage_2": ("bandage_2", "--limit", "6"),
    "oracle": ("demo", "--clip", "studio_table", "--oracle", "--limit", "3"),
}
"""Arguments of ``vfoa run`` by the name of the run's directory. Some need clips in ``VFOA_DATA`` or weights."""


def differences(before: Path, after: Path) -> Iterator[str]:
    """Yield a line for each file in which two runs differ.

    Parameters
    ----------
    before, after
        Directories of finished runs. A file that only one of them has is a difference.
    """
    for name in sorted({*TABLES, *_recordings(before), *_recordings(after)}):
        first, second = before / name, after / name
        if first.is_file() != second.is_file():
            yield f"{name}: only in {before if first.is_file() else after}"
        elif first.is_file() and (found := _differing(first, second)):
            yield f"{name}: {found}"


def _recordings(run: Path) -> set[str]:
    return {path.name for path in run.glob("*.rrd")}


def _differing(first: Path, second: Path) -> str:
    """The first difference of two files; "" if they are equal."""
    if first.suffix != ".rrd":
        lines = [path.read_bytes().splitlines(keepends=True) for path in (first, second)]
        if lines[0] == lines[1]:
            return ""
        equal = [one == other for one, other in zip(*lines, strict=False)]
        return f"line {equal.index(False) + 1 if False in equal else len(equal) + 1} differs"
    one, other = values_of(first), values_of(second)
    keys = [key for key in one.keys() | other.keys() if key not in one or key not in other or one[key] != other[key]]
    if not keys:
        return ""
    entity, component, frame = min(keys, key=lambda key: (key[2] is not None, key[2] or 0, *key[:2]))
    where = "static" if frame is None else f"frame {frame}"
    return f"{len(keys)} of {len(one.keys() | other.keys())} values differ, such as {component} of {entity}, {where}"


def compare(before: Path, after: Path) -> list[str]:
    """Return the differences of two runs, or of every two runs of the same name in two folders, as lines of text."""
    if (before / "manifest.json").is_file():
        return [f"{after}: {line}" for line in differences(before, after)]
    ours, theirs = _runs(before), _runs(after)
    if not ours | theirs:
        return [f"{before}: expected a run or a folder of runs, found none"]
    alone = [f"{name}: not a run in both folders" for name in sorted(ours ^ theirs)]
    return alone + [line for name in sorted(ours & theirs) for line in compare(before / name, after / name)]


def _runs(folder: Path) -> set[str]:
    return {path.parent.name for path in folder.glob("*/manifest.json")}


def make(folder: Path, names: Sequence[str]) -> dict[str, str]:
    """Make runs by name; return the messages of those that could not be made, such as for missing data."""
    failed = {}
    for name in names:
        words = ["vfoa", "run", *RUNS[name], "--out", str(folder / name)]
        code = f"import sys; sys.argv = {words!r}\nfrom harness.cli import main; main()"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        if done.returncode:
            failed[name] = done.stderr.strip()
    return failed


def main() -> None:
    """Compare or make runs. Exits with 1 if runs differ, or none could be made."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="*", type=Path, metavar="BEFORE AFTER", help="two runs, or two folders of runs")
    parser.add_argument("--make", type=Path, metavar="FOLDER", help="make the runs to compare in this folder")
    parser.add_argument("--only", action="append", choices=RUNS, help="make only this run; may be repeated")
    chosen = parser.parse_args()
    if chosen.make is None and len(chosen.runs) != 2:
        parser.error("expected BEFORE and AFTER, or --make FOLDER")
    if chosen.make is None:
        lines = compare(*chosen.runs)
        code = int(bool(lines))
    else:
        names = chosen.only or list(RUNS)
        failed = make(chosen.make, names)
        lines = [f"{name}: left out: {why}" for name, why in failed.items()]
        code = int(len(failed) == len(names))
    print("\n".join(lines or ["the same" if chosen.make is None else "all made"]))  # noqa: T201
    sys.exit(code)


if __name__ == "__main__":
    main()
