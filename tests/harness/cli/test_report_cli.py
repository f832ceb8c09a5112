from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest
from typer.testing import CliRunner

from harness.cli import app
from harness.cli.terminal import ended_by_signals
from tests.disk import write_text
from tests.records import answers, write_clip, write_run
from vfoa.errors import VfoaError

MAIN = "from harness.cli import main; main()"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A finished run of one clip without labels, and without its recording."""
    manifest = tmp_path / "clip.toml"
    manifest.write_text('name = "clip"\nadapter = "studio"\nlicence = "MIT"\n[subjects.girl]\ncategory = "person"\n')
    run = tmp_path / "a run"
    entry = {"name": "clip", "manifest": str(manifest), "licence": "MIT", "notes": [], "frames": [1, 2], "rate_hz": 25}
    write_run(run, answers(["cup", None]), experiment="small", notes=[], clips=[entry], versions={})
    return run


def test_the_page_is_written_and_its_place_said(run: Path) -> None:
    said = CliRunner().invoke(app, ["report", str(run)], catch_exceptions=False)
    assert said.stdout == f"Page: {run / 'report.html'}\n"
    assert "Run small" in (run / "report.html").read_text(encoding="utf-8")


def test_a_page_from_disk_knows_no_server(run: Path) -> None:
    CliRunner().invoke(app, ["report", str(run)], catch_exceptions=False)
    assert '"recordings":null' in (run / "report.html").read_text(encoding="utf-8")


def test_options_of_the_server_alone_are_refused_without_it(run: Path) -> None:
    for options in (["--port", "80"], ["--no-open"]):
        with pytest.raises(VfoaError, match="--serve"):
            CliRunner().invoke(app, ["report", str(run), *options], catch_exceptions=False)


def test_a_frame_that_the_run_does_not_have_is_refused(run: Path) -> None:
    (run / "clip__one.rrd").touch()
    with pytest.raises(VfoaError, match=r"clip__one\.rrd: found no frame 9.*1 to 2"):
        CliRunner().invoke(app, ["view", str(run), "--frame", "9"], catch_exceptions=False)


def test_the_served_page_of_a_run_that_goes_on_has_what_is_complete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Reloaded, it has more, also recordings."""
    records = [record for clip in ("a", "b") for record in answers(["cup", None], clip=clip)]
    clips = [write_clip(tmp_path, clip, ["cup", "cup"]) for clip in ("a", "b")]
    directory = write_run(tmp_path / "run", records, clips=clips, notes=[], experiment="small")
    directory.write_manifest(directory.read_manifest().model_copy(update={"finished": None}))

    def complete(clip: str) -> None:
        write_text(directory.partial((clip, "one"), "csv"), "")
        (directory.path / f"{clip}__one.rrd").touch()

    served: dict[str, Any] = {}
    monkeypatch.setattr("harness.cli.serving.browse", lambda *given, **named: served.update(named, given=given))
    complete("a")
    said = CliRunner().invoke(app, ["report", str(directory.path), "--serve"], catch_exceptions=False)
    assert (said.exit_code, said.stderr.count("reload")) == (0, 1)
    recordings, _ = served["given"]
    assert [*recordings] == ["a__one"]
    assert "of 1 of 2 clips" in served["page"]("")
    complete("b")
    assert "of 2 of 2 clips" in served["page"]("")
    assert [*recordings] == ["a__one", "b__one"]
    directory.write_manifest(directory.read_manifest().model_copy(update={"finished": "now"}))
    assert "NOT FINISHED" not in served["page"]("")


REPORT = ("report", "--serve", "--no-open")
COMPARE = ("compare", "--serve", "--no-open", "--port", "0")
VIEW = ("view", "--web", "--frame", "2")


@pytest.fixture
def served(run: Path, request: pytest.FixtureRequest) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A process that serves the run to somebody who is logged in by SSH, and the address it says."""
    (run / "clip__one.rrd").write_bytes(b"cut")
    verb, *options = request.param
    command = [sys.executable, "-c", MAIN, verb, str(run), *options]
    env = {**os.environ, "SSH_CONNECTION": "192.0.2.1 50000 192.0.2.7 22"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "Serving until Ctrl-C:\n"
            yield process, process.stdout.readline().strip()
        finally:
            process.kill()


@pytest.mark.parametrize(
    ("served", "sign", "said"),
    [
        (REPORT, signal.SIGINT, "Run small"),
        (COMPARE, signal.SIGINT, "Comparison of runs"),
        (VIEW, signal.SIGTERM, "clip__one.rrd: incomplete or damaged recording"),
    ],
    indirect=["served"],
    ids=["report", "compare", "view"],
)
def test_it_serves_on_this_machine_until_it_is_told_to_end(
    served: tuple[subprocess.Popen[str], str], sign: signal.Signals, said: str
) -> None:
    process, address = served
    with httpx.Client(follow_redirects=True, trust_env=False) as browser:
        assert said in browser.get(address).text
    listening = [each.laddr for each in psutil.Process(process.pid).net_connections() if each.status == "LISTEN"]
    port = httpx.URL(address).port
    assert [(place.ip, place.port) for place in listening] == [("127.0.0.1", port)]
    assert psutil.Process(process.pid).children() == []
    process.send_signal(sign)
    _, told = process.communicate(timeout=30)
    assert (process.returncode, told.count("\n")) == (0, 1)
    assert told.endswith(f"ssh -N -L {port}:127.0.0.1:{port} 192.0.2.7\n")  # how to open it


def test_sigterm_ends_it_where_ctrl_c_is_ignored_as_in_the_background() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    ended = True
    try:
        with ended_by_signals():
            signal.raise_signal(signal.SIGTERM)
            ended = False
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended
