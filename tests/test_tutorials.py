"""The tutorials, executed as written: the commands of each page in order, after ``make demo``, with what they print.

A new page in docs/tutorials needs no code here: a block with a title is written as that file, a block below ``<!-- not
executed: REASON -->`` is left out. Runs of the demo are short (:data:`SHORT`, :data:`CLIPS`), so their numbers are
not compared, but the words and the number of cells around them.
"""

from __future__ import annotations

import re
import shlex
import shutil
import threading
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import httpx
import pytest

from harness.server.local_server import LocalServer
from tests.command import run_in
from tests.disk import share_rendered_frames, write_text
from tests.pages import parts, rates, shape, steps
from tests.repository import REPOSITORY

OWN_TEST = ("label-fit-run", "own-recording", "real-person")
"""Pages that need genuine data: tests/harness/score/test_fit_logit.py, test_own_recording.py, test_real_person.py."""
PAGES = sorted(page for page in (REPOSITORY / "docs" / "tutorials").glob("*.md") if page.stem not in OWN_TEST)
SHORT = ("--limit", "3", "--workers", "1")
CLIPS = 'clips = ["demo_crowd", "demo_1"]'
"""Two of the demo's ten clips: one that pages name, and one that is drawn by chance."""
CONFIGURATIONS = ("bm-one", "bm-two", "bm-nearest", "sgbm-one", "sgbm-two", "sgbm-nearest")


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A folder in which ``make demo`` has run, and what it printed at 80 columns."""
    folder = tmp_path_factory.mktemp("tutorial")
    share_rendered_frames(folder / "cache")  # rendering takes longer than the runs
    shipped = (REPOSITORY / "harness" / "experiments" / "demo.toml").read_text(encoding="utf-8")
    write_text(
        folder / "experiments" / "demo.toml", re.sub(r"(?s)^clips = \[.*?\]", CLIPS, shipped, flags=re.MULTILINE)
    )
    return folder, _vfoa(["demo"], folder, folder / "cache", columns=80)


def test_the_demo_prints_one_screen_that_ends_with_the_next_commands(demo: tuple[Path, str]) -> None:
    lines = demo[1].splitlines()
    assert len(lines) <= 30
    assert max(map(len, lines)) <= 80
    assert [f" {name} " for name in CONFIGURATIONS if demo[1].count(f" {name} ") != 1] == []
    assert "Best of 6" in demo[1]
    assert lines[-2:] == [
        "Report (all tables: frr.md): runs/demo/report.html",
        "Scrub a failure: vfoa view runs/demo --failures",
    ]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_tutorial_does_what_it_says(page: Path, demo: tuple[Path, str], tmp_path: Path) -> None:
    folder, printed = demo
    for part in ("runs", "experiments"):
        shutil.copytree(folder / part, tmp_path / part)
    for part, file in parts(page.read_text(encoding="utf-8")):
        for command, expected in steps(part):
            if command == "make demo":
                said = printed
            else:
                words = shlex.split(command)
                assert words[0] == "vfoa", f"{page.name}: {command}"
                said = _vfoa(words[1:], tmp_path, folder / "cache")
            if expected.strip():
                assert shape(said.replace(f"{tmp_path}/", "")) == shape(expected), f"{page.name}: {command}\n{said}"
                if "demo" not in command:
                    assert rates(said) == pytest.approx(rates(expected), abs=0.01), f"{page.name}: {command}\n{said}"
        if file:
            write_text(tmp_path / file[0], file[1])


def _vfoa(words: list[str], folder: Path, cache: Path, columns: int = 100) -> str:
    """What the program prints on both streams."""
    runs_demo = words[0] == "demo" or words[:2] == ["run", "demo"]
    command = [*words, *(SHORT if runs_demo and "--limit" not in words else ())]
    variables = {"VFOA_CACHE": str(cache), "COLUMNS": str(columns)}
    said = StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(said), redirect_stderr(said):
        for name, value in variables.items():
            patch.setenv(name, value)
        patch.delenv("DISPLAY", raising=False)
        patch.setattr(LocalServer, "run", _serve_once)
        run_in(folder, *command)
    return said.getvalue()


SERVE = LocalServer.run


def _serve_once(server: LocalServer) -> None:
    """Serve until the page has answered, and end."""
    answers: list[int] = []

    def ask() -> None:
        try:
            answers.append(httpx.get(server.address, follow_redirects=True, trust_env=False).status_code)
        finally:
            server.stop()

    asking = threading.Thread(target=ask)
    asking.start()
    SERVE(server)
    asking.join()
    assert answers == [200]
