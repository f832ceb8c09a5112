"""The fault plan is of every verb, and finds what is wrong; one fault that depends on no moment is tried on all."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.faults.files import snapshot, what_is_wrong
from tests.faults.plan import NO_BYTE, Cell, table
from tests.faults.verbs import READS, VERBS, Left, Writes, verbs
from tests.repository import REPOSITORY


def test_every_verb_is_in_the_plan_or_says_why_not() -> None:
    found = dict(verbs())
    assert set(VERBS) == set(found)
    for name, command in found.items():
        options = {parameter.name for parameter in command.params}
        if "out" in options:
            assert name not in READS, f"{name} has --out, so it writes"


@pytest.fixture(scope="module")
def without_a_byte() -> dict[str, str]:
    """What is said of each verb whose files take no byte, in processes forked from one that is no test's."""
    if sys.platform != "linux":
        pytest.skip("forks processes, and limits them as Linux does")
    done = subprocess.run(
        [sys.executable, "-m", "tests.faults.plan", "--fault", NO_BYTE],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        check=False,
    )
    cells = [json.loads(line) for line in done.stderr.splitlines() if line.startswith("[")]
    assert cells, done.stderr
    return {verb: said for verb, _, _, said in cells}


@pytest.mark.parametrize("verb", [name for name, each in VERBS.items() if isinstance(each, Writes)])
def test_a_verb_whose_files_take_no_byte_says_so_and_leaves_all_as_it_was(
    verb: str, without_a_byte: dict[str, str]
) -> None:
    assert without_a_byte[verb] == "held"


def test_what_a_fault_may_not_leave(tmp_path: Path) -> None:
    (tmp_path / "old.csv").write_text("a,b\n1,2\n")
    before = snapshot(tmp_path)
    after = {**before, "new.json": b"{}", "varies.csv": b"a,b\n1,2\n"}

    def wrong(name: str, text: str) -> str:
        (tmp_path / name).write_text(text)
        said = what_is_wrong(tmp_path, before, after, ["varies.csv"])
        (tmp_path / name).unlink()
        return said

    assert wrong("new.json", "{}") == ""
    assert wrong(".new.json.x1", "{") == ""
    assert wrong("new.json", "{") == "new.json: neither as it was nor as it is to be"
    assert wrong("varies.csv", "a,b\n3,4\n") == ""
    assert wrong("varies.csv", "a,b\n3\n") == "varies.csv: rows of different widths"
    assert wrong("other", "") == "other: made, and is no file of the verb's"
    (tmp_path / "old.csv").unlink()
    assert what_is_wrong(tmp_path, before, after, []) == "old.csv: gone"


def test_the_table_says_what_failed_and_what_is_left_out() -> None:
    cells = [
        Cell("run", "kill -9", ended=0),
        Cell("run", "full disk", skipped="no root"),
        Cell("score", "kill -9", wrong="cut"),
    ]
    text = table(cells, seed=7, seconds=60)
    assert "seed 7: 1 of 3 cells held, 1 failed, 1 were not tried" in text
    assert "| run | finished | – |" in text
    assert "- score, kill -9: cut (exit None)" in text
    assert "- full disk: not tried: no root" in text
    assert all(f"- {name}: {each.reason}" in text for name, each in VERBS.items() if isinstance(each, Left))
