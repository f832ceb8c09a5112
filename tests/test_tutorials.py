"""The tutorials, executed as written: the commands of each page in order, after ``make demo``, with what they print.

A new page in docs/tutorials needs no code here: a block with a title is written as that file, a block below ``<!-- not
executed: REASON -->`` is left out. Runs of the demo are short (:data:`SHORT`, :data:`CLIPS`), so numbers are not
compared, but the words and the number of cells around them.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import time
from contextlib import redirect_stderr, redirect_stdout, suppress
from io import StringIO
from pathlib import Path

import pytest

from harness.studio.store import cache_folder
from tests.command import run_in
from tests.disk import write_text
from tests.pages import parts, shape, steps
from tests.repository import REPOSITORY

OWN_TEST = ("label-fit-run", "own-recording", "real-person")
"""Pages that need genuine data: tests/harness/score/test_fit_logit.py, test_own_recording.py, test_real_person.py."""
PAGES = sorted(page for page in (REPOSITORY / "docs" / "tutorials").glob("*.md") if page.stem not in OWN_TEST)
SHORT = ("--limit", "3", "--workers", "1")
CLIPS = 'clips = ["demo_crowd", "demo_1"]'
"""Two of the demo's ten clips: one that pages name, and one that is drawn by chance."""
CONFIGURATIONS = ("bm-one", "bm-two", "bm-nearest", "sgbm-one", "sgbm-two", "sgbm-nearest")
SERVING = ("--serve", "--web", "annotate")


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A folder in which ``make demo`` has run, and what it printed at 80 columns."""
    folder = tmp_path_factory.mktemp("tutorial")
    rendered = cache_folder("any").parent  # rendering takes longer than the runs: frames of other tests are used
    rendered.mkdir(parents=True, exist_ok=True)
    (folder / "cache").mkdir()
    (folder / "cache" / "studio").symlink_to(rendered)
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
    assert "Best of 6: " in demo[1]
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
        if file:
            write_text(tmp_path / file[0], file[1])


def _vfoa(words: list[str], folder: Path, cache: Path, columns: int = 100) -> str:
    """What the program prints on both streams."""
    runs_demo = words[0] == "demo" or words[:2] == ["run", "demo"]
    command = [*words, *(SHORT if runs_demo and "--limit" not in words else ())]
    variables = {"VFOA_CACHE": str(cache), "COLUMNS": str(columns)}
    if any(word in SERVING for word in words):
        return _served(command, folder, variables)
    said = StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(said), redirect_stderr(said):
        for name, value in variables.items():
            patch.setenv(name, value)
        patch.delenv("DISPLAY", raising=False)
        run_in(folder, *command)
    return said.getvalue()


def _served(command: list[str], folder: Path, variables: dict[str, str]) -> str:
    """What a server prints until it takes connections, and after it is told to end."""
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY), **variables}
    environment.pop("DISPLAY", None)
    program, said = [sys.executable, "-m", "harness.cli", *command], ""
    with subprocess.Popen(
        program, cwd=folder, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            said += line
            if address := re.search(r"http://127\.0\.0\.1:(\d+)", line):
                _wait_for_server(int(address[1]))
                process.send_signal(signal.SIGINT)
    assert process.returncode == 0, said
    return said


def _wait_for_server(port: int) -> None:
    """Return when the server takes connections: it prints its address before."""
    until = time.monotonic() + 30
    while time.monotonic() < until:
        with suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1) as connection:
            connection.sendall(b"GET / HTTP/1.0\r\n\r\n")
            if connection.recv(1):
                return
        time.sleep(0.1)
