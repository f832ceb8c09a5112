"""Faults around a run, not in its files: no space, no permission to read, a file that vanishes during the run."""

from __future__ import annotations

import ctypes
import os
import resource
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from harness.sources.stereo_folder import StereoFolderClip
from tests.command import vfoa
from tests.harness.damage.table import RUN
from vfoa.types import StereoFrame


@pytest.mark.parametrize("room_bytes", [2_000, 5_000])
def test_a_full_disk_is_said_in_one_line_and_the_run_goes_on_when_there_is_room(
    room_bytes: int, project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """No file may grow beyond this, as on a disk that is full: first the manifest, then a table, which is open."""
    code = "import harness.cli; harness.cli.main()"
    done = subprocess.run(
        [sys.executable, "-c", code, *RUN, "--no-cache"],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (room_bytes, room_bytes)),
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
    )
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    assert "File too large" in done.stderr
    assert done.stderr.startswith("vfoa: out")
    assert not (project / "out" / "frr.csv").exists()
    assert vfoa(monkeypatch, capsys, *RUN)[::2] == (0, "")
    assert (project / "out" / "frr.csv").is_file()


def test_a_disk_that_is_full_while_recording_ends_the_run_in_one_line_and_it_goes_on_when_there_is_room(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded = [word for word in RUN if word not in ("--recording", "none")]
    asked = 0

    def full(path: Path) -> shutil._ntuple_diskusage:
        nonlocal asked
        asked += 1
        return shutil._ntuple_diskusage(10**9, 10**9, 0) if asked > 6 else usage(path)

    usage = shutil.disk_usage
    with monkeypatch.context() as patch:
        patch.setattr(shutil, "disk_usage", full)
        code, _, said = vfoa(monkeypatch, capsys, *recorded)
    assert code == 2, said
    assert said.count("\n") == 1, said
    assert "No space left on device" in said
    assert "the same command continues" in said
    assert not (project / "out" / "frr.csv").exists()
    assert vfoa(monkeypatch, capsys, *recorded)[::2] == (0, "")
    assert (project / "out" / "frr.csv").is_file()
    assert (project / "out" / "mine.rrd").is_file()


def _program(*words: str, cwd: str | bytes | None = None, closed: str = "") -> subprocess.CompletedProcess[bytes]:
    """Run vfoa in a shell, which can close stdout or stderr."""
    code = "import harness.cli; harness.cli.main()"
    command = " ".join(["exec", shlex.quote(sys.executable), "-c", shlex.quote(code), *words, closed])
    return subprocess.run(
        ["/bin/sh", "-c", command],
        capture_output=True,
        check=False,
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
    )


def test_a_program_without_stderr_works_and_refuses_as_always(project: Path) -> None:
    assert _program("score", "nowhere", closed="2>&-").returncode == 2
    done = _program(*RUN, closed="2>&-")
    assert done.returncode == 0
    assert b"FRR of each configuration" in done.stdout
    assert (project / "out" / "frr.csv").is_file()


def test_a_working_directory_whose_name_is_no_text_is_one_line(project: Path) -> None:
    folder = os.fsencode(project.parent) + b"/\xff"
    os.rename(os.fsencode(project), folder)
    done = _program(*RUN, cwd=folder)
    assert done.returncode in (0, 2), done.stderr
    assert done.stderr.count(b"\n") == (done.returncode == 2), done.stderr


def test_a_working_directory_that_was_removed_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "gone").mkdir()
    code = "import os, harness.cli; os.rmdir(os.getcwd()); harness.cli.main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "clips", "list"],
        cwd=tmp_path / "gone",
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr == "vfoa: the working directory no longer exists; change to another one\n"


@pytest.mark.parametrize(
    "words",
    [
        ("cache", "info"),
        ("run", "studio_table", "--limit", "1"),
        ("run", "studio_table", "--no-cache", "--workers", "1"),
        ("models", "fetch", "yunet"),
    ],
)
def test_a_user_without_a_home_is_told_what_to_set(words: tuple[str, ...], tmp_path: Path) -> None:
    """As in a container that runs with the number of a user whom its system does not know."""
    code = "import pwd, harness.cli; pwd.getpwuid = lambda user: {}[user]; harness.cli.main()"
    unset = ("HOME", "XDG_CACHE_HOME", "VFOA_CACHE", "VFOA_MODELS")
    env = {name: value for name, value in os.environ.items() if name not in unset}
    env["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
    command = [sys.executable, "-c", code, *words]
    done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "HOME" in done.stderr


def test_a_run_whose_directory_is_removed_meanwhile_is_one_line(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    read = StereoFolderClip.frame

    def frame(self: StereoFolderClip, number: int) -> StereoFrame:
        if number == 3:
            shutil.rmtree(project / "out", ignore_errors=True)
        return read(self, number)

    monkeypatch.setattr(StereoFolderClip, "frame", frame)
    code, _, said = vfoa(monkeypatch, capsys, *RUN, "--no-cache")
    assert code == 2, said
    assert said.count("\n") == 1, said
    assert "out" in said


def test_an_image_that_vanishes_in_mid_run_is_named_and_nothing_before_it_is_lost(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    read = StereoFolderClip.frame

    def frame(self: StereoFolderClip, number: int) -> StereoFrame:
        if number == 3:
            (project / "images" / "left" / "000003.png").unlink(missing_ok=True)
        return read(self, number)

    kept = (project / "images" / "left" / "000003.png").read_bytes()
    monkeypatch.setattr(StereoFolderClip, "frame", frame)
    code, _, said = vfoa(monkeypatch, capsys, *RUN, "--no-cache")
    assert code in (1, 2)
    assert "000003.png" in said
    assert said.count("\n") == 1
    monkeypatch.setattr(StereoFolderClip, "frame", read)
    (project / "images" / "left" / "000003.png").write_bytes(kept)
    assert vfoa(monkeypatch, capsys, *RUN, "--retry-failed")[::2] == (0, "")


class _Sets(ctypes.Structure):
    """Half of the capabilities of a thread, as ``capget`` of Linux gives them."""

    _fields_ = (("effective", ctypes.c_uint32), ("permitted", ctypes.c_uint32), ("inheritable", ctypes.c_uint32))


_CAPABILITIES_VERSION = 0x20080522
_OVER_FILES = 1 << 1 | 1 << 2
"""CAP_DAC_OVERRIDE and CAP_DAC_READ_SEARCH: root may read and write whatever the modes of files say."""


@contextmanager
def _modes_count() -> Iterator[None]:
    """Give up what root may do against the modes of files. Another user might not even enter this repository."""
    if os.geteuid() != 0:
        yield
        return
    if sys.platform != "linux":
        pytest.skip("root cannot give up a part of its rights here: run the tests as a user")
    libc = ctypes.CDLL(None, use_errno=True)
    header, sets = (ctypes.c_uint32 * 2)(_CAPABILITIES_VERSION, 0), (_Sets * 2)()
    assert libc.capget(header, sets) == 0, os.strerror(ctypes.get_errno())
    before = sets[0].effective
    sets[0].effective = before & ~_OVER_FILES
    assert libc.capset(header, sets) == 0, os.strerror(ctypes.get_errno())
    try:
        yield
    finally:
        sets[0].effective = before
        assert libc.capset(header, sets) == 0, os.strerror(ctypes.get_errno())


@pytest.fixture
def own_project(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy whose modes can be changed: those of ``project`` are links."""
    copied = shutil.copytree(whole, tmp_path / "project")
    monkeypatch.chdir(copied)
    return copied


@pytest.mark.parametrize(
    "path", ["images/left/000002.png", "images/stereo.yml", "annotations/mine.csv", "stage_outputs/heads.csv", "e.toml"]
)
def test_a_file_that_may_not_be_read_is_named(
    path: str, own_project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (own_project / path).chmod(0)
    with _modes_count():
        code, _, said = vfoa(monkeypatch, capsys, *RUN, "--no-cache")
    assert code == 2
    assert Path(path).name in said
    assert "Permission denied" in said
    assert said.count("\n") == 1


def test_an_output_that_may_not_be_written_is_named(
    own_project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    own_project.chmod(0o555)
    try:
        with _modes_count():
            code, _, said = vfoa(monkeypatch, capsys, *RUN, "--no-cache")
    finally:
        own_project.chmod(0o755)
    assert code == 2
    assert "out" in said
    assert "Permission denied" in said
    assert said.count("\n") == 1
    assert not (own_project / "out").exists()
