"""A run asks nobody on the network, and nothing that lies in the working directory is executed."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from harness.cli import main
from harness.record import viewer as rerun_viewer
from tests import graphs
from tests.disk import share_rendered_frames, write_text
from tests.repository import REPOSITORY

EXPERIMENT = """
clips = ["studio_table", "studio_talk"]
defaults.segmentation.model = "truth"
defaults.heads.detector = "truth"
defaults.head_pose.model = "none"
defaults.gaze = {{ model = "gaze360", weights = "{weights}" }}
defaults.stereo = {{ matcher = "bm", min_depth_m = 0.8 }}

[[configuration]]
name = "one"
"""
CONNECT = re.compile(r"(connect|sendto|sendmsg|sendmmsg|bind)\(\d+, .*AF_INET")
"""Lines of strace for a call that reaches for a network or opens a port."""

AUDIT = """
import sys
def told(event, arguments):
    if event in ("socket.connect", "socket.getaddrinfo"):
        print("NETWORK", event, arguments, file=sys.stderr, flush=True)
sys.addaudithook(told)
"""
MAIN = "import sys; from harness.cli import main; main()"


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """A user who has never run anything, with nothing said about usage statistics."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("ORT_", "XDG_", "VFOA_", "CI"))}
    (tmp_path / "home").mkdir()
    write_text(tmp_path / "site" / "sitecustomize.py", AUDIT)
    paths = {"HOME": str(tmp_path / "home"), "VFOA_CACHE": str(tmp_path / "cache")}
    return kept | paths | {"PYTHONPATH": os.pathsep.join([str(tmp_path / "site"), str(REPOSITORY)])}


def _traced(tmp_path: Path, *command: str) -> list[str]:
    return ["strace", "-f", "--seccomp-bpf", "-e", "trace=network", "-o", str(tmp_path / "trace"), *command]


def _reached(tmp_path: Path) -> list[str]:
    """The calls that were not about this machine."""
    calls = [line for line in (tmp_path / "trace").read_text().splitlines() if CONNECT.search(line)]
    return [call for call in calls if '"127.0.0.1"' not in call and '"::1"' not in call]


def test_a_run_with_a_network_opens_no_socket_and_leaves_no_device_id(
    tmp_path: Path, environment: dict[str, str]
) -> None:
    weights = Path(graphs.seven_levels(tmp_path / "levels.onnx")).as_posix()
    write_text(tmp_path / "small.toml", EXPERIMENT.format(weights=weights))
    share_rendered_frames(tmp_path / "cache")  # to render takes long; Open3D is imported all the same
    main = f"import harness.studio.raycast; {MAIN}"
    command = [sys.executable, "-c", main, "run", "small.toml", "--out", "out", "--limit", "1", "--workers", "2"]
    if shutil.which("strace"):
        command = _traced(tmp_path, *command)
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "NETWORK" not in done.stderr
    if shutil.which("strace"):
        assert _reached(tmp_path) == []
    left = [path.name for path in (tmp_path / "home").rglob("*") if path.is_file()]
    assert [name for name in left if "onnxruntime" in name or "deviceid" in name or "analytics" in name] == []


@pytest.mark.parametrize(("said", "found"), [(None, "1"), ("0", "0")])
def test_the_library_turns_usage_statistics_off_unless_its_user_said_otherwise(
    environment: dict[str, str], said: str | None, found: str
) -> None:
    if said is not None:
        environment["ORT_DISABLE_TELEMETRY"] = said
    code = "import vfoa, os, subprocess; subprocess.run(['env'], check=True)"
    command = [sys.executable, "-c", code]
    children = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
    assert f"ORT_DISABLE_TELEMETRY={found}\n" in children


def test_the_viewers_program_has_no_way_out(
    tmp_path: Path, environment: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "environ", environment | {"NO_PROXY": "*", "HTTPS_PROXY": "http://proxy.example:3128"})
    viewer = write_text(tmp_path / "viewer", "#!/bin/sh\nenv >&2\n")
    viewer.chmod(0o755)
    monkeypatch.setattr(rerun_viewer, "viewer_binary", lambda: viewer)
    with (tmp_path / "said").open("wb") as stderr, rerun_viewer.started([], stderr) as process:
        process.wait(timeout=60)
    said = dict(line.split("=", 1) for line in (tmp_path / "said").read_text().splitlines() if "=" in line)
    assert {said[name] for name in said if name.lower().endswith("_proxy")} == {"http://127.0.0.1:9"}
    assert "NO_PROXY" not in said
    assert Path(said["XDG_CONFIG_HOME"]) != Path(environment["HOME"]) / ".config"


@pytest.mark.skipif(shutil.which("strace") is None, reason="needs strace")
def test_the_viewer_looks_up_no_host(tmp_path: Path, environment: dict[str, str]) -> None:
    """Rerun's own server of the web viewer told a host of its maker at once that it was started."""
    code = "from harness.record.viewer import web_viewer_files; print(len(web_viewer_files()))"
    command = _traced(tmp_path, sys.executable, "-c", code)
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert int(done.stdout) > 3
    assert _reached(tmp_path) == []
    assert [path for path in (tmp_path / "home").rglob("*") if "rerun" in path.parts] == []


def test_no_child_of_the_program_takes_a_module_from_the_working_directory(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    monkeypatch.setattr(sys, "argv", ["vfoa", "--version"])
    with pytest.raises(SystemExit):
        main()
    assert os.environ["PYTHONSAFEPATH"] == "1"


def test_processes_are_started_in_one_way() -> None:
    """Elsewhere they would be started without what keeps the working directory out."""
    starting = {"get_context", "Popen", "fork", "spawnv", "startfile"}
    files = [*(REPOSITORY / "harness").rglob("*.py"), *(REPOSITORY / "vfoa").rglob("*.py")]
    texts = {file.name: text for file in files if any(name in (text := file.read_text("utf-8")) for name in starting)}
    calls = {name: {_called(node) for node in ast.walk(ast.parse(text))} & starting for name, text in texts.items()}
    assert [name for name in calls if "get_context" in calls[name]] == ["processes.py"]
    assert [name for name in calls if calls[name] - {"get_context"}] == ["viewer.py"]


def _called(node: ast.AST) -> str:
    called = node.func if isinstance(node, ast.Call) else None
    return called.attr if isinstance(called, ast.Attribute) else ""
