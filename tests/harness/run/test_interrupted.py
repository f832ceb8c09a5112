"""Interrupted runs, two runs in one directory, and images that change while a run is on."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Self

import cv2
import pytest

from harness.files import digests
from harness.files.io import take_lock
from harness.pipeline.cache_store import Store
from harness.pipeline.perception import SharedFrame
from harness.run import runner
from harness.run.directory import LOCK, locked
from harness.run.experiment import load_experiment
from harness.run.frame_sink import ClipContext, SinkContext
from harness.run.runner import prepare, run_plan
from harness.run.table_records import read_records
from tests.alley import write_matching
from tests.disk import write_text
from tests.records import tables_of
from vfoa.errors import VfoaError

FRAMES = 20
PAUSE_S = 0.5
"""Before each match: a run of all frames takes so long that it cannot end before it is interrupted."""


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two clips of the same images."""
    return write_matching(tmp_path_factory.mktemp("interrupted"), range(1, FRAMES + 1), "second")


Start = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def start(experiment: Path, tmp_path: Path) -> Iterator[Start]:
    """Start a run that pauses before each match, also in its workers: they import this script. No process is left."""
    started: list[subprocess.Popen[str]] = []

    def start(out: Path, workers: int) -> subprocess.Popen[str]:
        words = ["run", str(experiment), "--out", str(out), "--workers", str(workers)]
        code = (
            "import sys, time\n"
            "from harness.cli import main\n"
            "from vfoa.stereo.block_matching import SemiGlobalMatcher\n"
            "match = SemiGlobalMatcher.match\n"
            f"SemiGlobalMatcher.match = lambda self, frame: (time.sleep({PAUSE_S}), match(self, frame))[1]\n"
            f"sys.argv = ['vfoa', *{words!r}, '--no-cache', '--recording', 'none']\n"
            "if __name__ == '__main__': main()\n"
        )
        process = subprocess.Popen(
            [sys.executable, write_text(out.with_name(f"{out.name}.py"), code)],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            # a suite in the background ignores SIGINT, one under nohup SIGHUP, and so would all that it starts
            preexec_fn=lambda: [signal.signal(number, signal.SIG_DFL) for number in (signal.SIGINT, signal.SIGHUP)],
        )
        started.append(process)
        return process

    yield start
    for process in started:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")
@pytest.mark.parametrize(("name", "workers"), [("SIGINT", 2), ("SIGHUP", 1)])
def test_an_interrupted_run_says_what_is_kept_and_goes_on(
    name: str, workers: int, experiment: Path, start: Start, tmp_path: Path
) -> None:
    process = start(tmp_path / "out", workers)
    while process.poll() is None and not any(
        path.stat().st_size for path in (tmp_path / "out").glob("partial/*.csv.partial")
    ):
        time.sleep(0.01)
    os.killpg(process.pid, getattr(signal, name))
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert "clips are kept in" in said
    assert len(said.splitlines()) == 1
    kept = {path: path.read_bytes() for path in (tmp_path / "out").glob("answers/*/*")}
    again = run_plan(prepare(load_experiment(str(experiment))), tmp_path / "out", workers=1, progress=print)
    assert len(list(read_records(again))) == 2 * FRAMES
    assert {path: path.read_bytes() for path in kept} == kept


def test_a_run_that_is_interrupted_after_its_last_frame_says_what_is_kept_too(
    experiment: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    plan, said = prepare(load_experiment(str(experiment)), limit=1), list[str]()
    with monkeypatch.context() as patch:
        patch.setattr(runner, "join_timings", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run_plan(plan, tmp_path, workers=1, progress=print, tell=said.append)
    assert [f"clips are kept in {tmp_path}" in line for line in said] == [True]
    assert len(list(read_records(run_plan(plan, tmp_path, workers=1, progress=print)))) == 2


def test_a_directory_is_kept_to_one_run(tmp_path: Path) -> None:
    said: list[str] = []
    with locked(tmp_path, said.append), pytest.raises(VfoaError, match=rf"process {os.getpid()} on .* runs here"):
        locked(tmp_path, said.append).__enter__()
    assert (tmp_path / LOCK).read_bytes() == b""
    assert said == []


def test_the_lock_of_a_process_that_has_ended_is_taken_over_and_said(tmp_path: Path) -> None:
    (tmp_path / LOCK).write_text("process 1234 on elsewhere")
    said: list[str] = []
    with locked(tmp_path, said.append):
        pass
    assert said == [f"{tmp_path}: took over the lock of process 1234 on elsewhere, which has ended"]


def test_a_full_disk_is_told_with_the_file_of_the_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", full)
        with pytest.raises(OSError, match="No space left") as error, locked(tmp_path, print):
            pass
    assert error.value.filename == str(tmp_path / LOCK)
    with locked(tmp_path, pytest.fail):  # nothing of it is left
        pass


def test_a_lock_that_is_released_as_it_is_asked_for_is_not_taken_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / LOCK).write_text("process 1234 on elsewhere")

    def take(file: IO[str]) -> bool:
        (tmp_path / LOCK).write_bytes(b"")
        return take_lock(file)

    monkeypatch.setattr("harness.run.directory.take_lock", take)
    said: list[str] = []
    with locked(tmp_path, said.append):
        pass
    assert said == []


@dataclass(frozen=True)
class Exchange:
    """A sink that calls a function after each frame that is perceived, with its number."""

    change: Callable[[int], None]

    def described(self) -> Mapping[str, Any]:
        return {}

    def open(self, context: SinkContext) -> None:
        """Answers are not exchanged."""

    def open_scenes(self, context: ClipContext) -> Self:
        return self

    def is_whole(self, context: ClipContext) -> bool:
        return True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None: ...

    def write(self, frame: SharedFrame) -> None:
        self.change(frame.index)


def _invert(path: Path) -> None:
    image = cv2.imread(str(path))
    assert image is not None
    cv2.imwrite(str(path), 255 - image)


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """An experiment on a clip of three frames, in the folder ``tmp_path``."""
    return write_matching(tmp_path, range(1, 4))


def _third_image(folder: Path) -> Path:
    return next(path for path in sorted(folder.rglob("frame_0003.png")) if "left" in path.as_posix())


def _left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Set the clock to a time when what was just written counts as left alone."""
    true = time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: true() + 10**10)


@pytest.mark.parametrize("left_alone", [True, False])
def test_images_that_change_while_a_run_is_on_end_it_and_do_not_reach_the_cache(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, left_alone: bool
) -> None:
    if left_alone:
        _left_alone(monkeypatch)
    store = Store(tmp_path / "cache", 10**9)
    plan = prepare(
        load_experiment(str(small)),
        sinks=[Exchange(lambda frame: _invert(_third_image(tmp_path)) if frame == 2 else None)],
    )
    with pytest.raises(VfoaError, match="changed during the run"):
        run_plan(plan, tmp_path / "out", workers=1, progress=lambda clip: None, cache=store)
    assert {path.name.partition("-")[0] for path in store.stages.rglob("*.bin")} == {"000001", "000002"}
    assert not (tmp_path / "out" / "answers").exists()


def _files_put_back(folder: Path) -> Callable[[int], None]:
    image = _third_image(folder)
    return lambda frame: _invert(image) if frame in (2, 3) else None


def _link_switched_back(folder: Path) -> Callable[[int], None]:
    shutil.copytree(folder / "data", folder / "other")
    _invert(_third_image(folder / "other"))
    (folder / "data").rename(folder / "real")
    (folder / "data").symlink_to("real")

    def switch(frame: int) -> None:
        if frame in (2, 3):
            (folder / "data").unlink()
            (folder / "data").symlink_to("other" if frame == 2 else "real")

    return switch


@pytest.mark.parametrize("exchange", [_files_put_back, _link_switched_back])
def test_images_that_are_exchanged_and_put_back_end_the_run_and_reach_neither_tables_nor_cache(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exchange: Callable[[Path], Callable[[int], None]]
) -> None:
    _left_alone(monkeypatch)
    experiment, store = load_experiment(str(small)), Store(tmp_path / "cache", 10**9)
    expected = tables_of(run_plan(prepare(experiment), tmp_path / "whole", workers=1, progress=print))
    change = exchange(tmp_path)
    plan = prepare(experiment, sinks=[Exchange(change)])
    with pytest.raises(VfoaError, match="changed during the run"):
        run_plan(plan, tmp_path / "out", workers=1, progress=print, cache=store)
    assert not (tmp_path / "out" / "answers").exists()
    change(3)
    again = run_plan(prepare(experiment), tmp_path / "again", workers=1, progress=print, cache=store)
    assert tables_of(again) == expected


def test_images_that_are_only_touched_do_not_end_a_run(small: Path, tmp_path: Path) -> None:
    image = _third_image(tmp_path)
    touching = Exchange(lambda frame: image.write_bytes(image.read_bytes()) and None)
    directory = run_plan(
        prepare(load_experiment(str(small)), sinks=[touching]), tmp_path / "out", workers=1, progress=print
    )
    assert len(list(read_records(directory))) == 3


def _run_once(small: Path, out: Path, monkeypatch: pytest.MonkeyPatch, *, frames: int = 3) -> list[str]:
    """Run as a process of its own does, up to this many frames; return the names of the files that were digested."""
    monkeypatch.setattr(digests, "KNOWN", {})
    monkeypatch.setattr(runner, "KNOWN", digests.KNOWN)
    read: list[str] = []
    true = digests.file_digest
    done: list[str] = []

    def progress(clip: str) -> None:
        done.append(clip)
        if len(done) > frames:
            raise RuntimeError("killed")

    with monkeypatch.context() as patched:
        patched.setattr(digests, "file_digest", lambda path: read.append(path.name) or true(path))
        run_plan(prepare(load_experiment(str(small))), out, workers=1, progress=progress)
    return read


def test_a_run_that_continues_reads_no_input_only_to_digest_it(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _left_alone(monkeypatch)
    with pytest.raises(RuntimeError, match="killed"):
        _run_once(small, tmp_path / "out", monkeypatch, frames=1)
    assert [name for name in _run_once(small, tmp_path / "out", monkeypatch) if name.endswith(".png")] == []
    assert not (tmp_path / "out" / "partial").exists()


def test_a_run_does_not_continue_with_an_image_of_the_same_size_and_time_but_other_content(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _left_alone(monkeypatch)
    with pytest.raises(RuntimeError, match="killed"):
        _run_once(small, tmp_path / "out", monkeypatch, frames=1)
    image = _third_image(tmp_path)
    before, content = image.stat(), image.read_bytes()
    image.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    os.utime(image, ns=(before.st_atime_ns, before.st_mtime_ns))
    with pytest.raises(VfoaError, match="sha256 of alley"):
        _run_once(small, tmp_path / "out", monkeypatch)
