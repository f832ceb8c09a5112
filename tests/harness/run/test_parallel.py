"""Whole runs by several workers: tables to the last byte as by one, and whoever dies on the way."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import cv2
import pytest

from harness.pipeline.cache_store import Store
from harness.report.sinks import recordings
from harness.report.write import rescore
from harness.run.directory import RunDirectory
from harness.run.executors.cluster import Cluster, connect
from harness.run.experiment import load_experiment
from harness.run.loop import run_clip
from harness.run.runner import executor, prepare, run_plan
from harness.run.table_records import read_records
from scripts.measure.many_clips import local_cluster
from tests import tasks
from tests.alley import write_experiment
from tests.records import tables_of
from vfoa.errors import VfoaError
from vfoa.stereo.block_matching import SemiGlobalMatcher

FRAMES = 8
TABLES = ("frr.csv", "comparisons.csv", "frr.tex")

# one clip, so that workers have to share it; stages that are cached and that are not, a window over frames, tracks
EXPERIMENT = """\
defaults.stereo.min_depth_m = 1.0
[[configuration]]
name = "bm"
stereo.matcher = "bm"
[[configuration]]
name = "sgbm"
stereo.matcher = "sgbm"
[[configuration]]
name = "wider"
stereo.matcher = "bm"
gaze.stride = 2
"""


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_experiment(tmp_path_factory.mktemp("parallel"), range(1, FRAMES + 1), EXPERIMENT)


def _run(
    experiment: Path, folder: Path, workers: int, *, cached: bool = True, told: Callable[[str], None] = len, **how: Any
) -> RunDirectory:
    plan = prepare(load_experiment(str(experiment)), limit=FRAMES)
    store = Store(folder / "cache", 10**9) if cached else None
    directory = run_plan(plan, folder / "run", workers=workers, progress=told, cache=store, **how)
    rescore(directory)
    return directory


@pytest.fixture(scope="module")
def alone(experiment: Path, tmp_path_factory: pytest.TempPathFactory) -> RunDirectory:
    return _run(experiment, tmp_path_factory.mktemp("alone"), 1, cached=False)


def _same(one: RunDirectory, other: RunDirectory) -> bool:
    same = ((one.path / name).read_bytes() == (other.path / name).read_bytes() for name in TABLES)
    return all(same) and tables_of(one) == tables_of(other)


def test_workers_share_a_clip_and_change_nothing(experiment: Path, alone: RunDirectory, tmp_path: Path) -> None:
    """More of them than configurations; of two, below, one is killed."""
    told: list[str] = []
    shared = _run(experiment, tmp_path, 4, told=told.append)
    assert all(record.subjects and record.subjects[0].gaze for record in read_records(shared))
    assert _same(shared, alone)
    assert told == ["alley"] * FRAMES
    stereo = [row for row in shared.read_manifest().cache if row["slot"] == "stereo"]
    assert [(row["stage"], row["reused"], row["computed"]) for row in stereo] == [
        ("bm", 0, FRAMES),
        ("sgbm", 0, FRAMES),
    ]


def test_a_cache_that_cannot_be_written_is_said_once_by_all_workers_together(
    experiment: Path,
    alone: RunDirectory,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    capfd: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "cache").write_text("")
    assert _same(_run(experiment, tmp_path, 2), alone)
    assert [record.message.partition(":")[0] for record in caplog.records] == [str(tmp_path / "cache")]
    assert capfd.readouterr().err == ""  # what workers log


@pytest.mark.parametrize("cached", [False, True])
def test_threads_that_read_and_perceive_ahead_change_nothing(
    cached: bool, experiment: Path, alone: RunDirectory, tmp_path: Path
) -> None:
    threads_before, running, told = cv2.getNumThreads(), set(threading.enumerate()), list[str]()
    try:
        assert _same(_run(experiment, tmp_path, 1, cached=cached, told=told.append, threads=3), alone)
    finally:
        cv2.setNumThreads(threads_before)
    assert told == ["alley"] * FRAMES
    assert set(threading.enumerate()) <= running


def test_a_frame_that_cannot_be_read_ends_a_run_with_threads_at_the_same_frame(
    experiment: Path, tmp_path: Path
) -> None:
    text = experiment.read_text()
    copies = shutil.copytree(experiment.parent, tmp_path / "copies")
    for path in (copies / "alley.toml", copies / "datasets" / "alley.toml"):
        path.write_text(path.read_text().replace(experiment.parent.as_posix(), copies.as_posix()))
    assert text != (copies / "alley.toml").read_text()
    next((copies / "data").rglob("clean_left/alley/frame_0006.png")).write_bytes(b"not a picture")
    failed = []
    for threads in (1, 3):
        with pytest.raises(VfoaError) as error:
            _run(copies / "alley.toml", tmp_path / str(threads), 1, cached=False, threads=threads)
        left = (tmp_path / str(threads) / "run" / "partial").glob("*.csv.partial")
        rows = {path.name: [row.rpartition(",")[0] for row in path.read_text().splitlines()] for path in left}
        failed.append((str(error.value), rows))
    assert failed[0] == failed[1]
    assert "frame_0006.png" in failed[0][0]


def _killer(pids: Callable[[], list[int]], killed: list[int]) -> Callable[[str], None]:
    """Kills one of the workers when the first frame is done."""

    def told(_clip: str) -> None:
        if not killed:
            killed.append(pids()[0])
            os.kill(killed[0], signal.SIGKILL)

    return told


def test_a_worker_of_the_pool_that_is_killed_changes_nothing(
    experiment: Path, alone: RunDirectory, tmp_path: Path
) -> None:
    killed: list[int] = []
    children = lambda: [child.pid for child in multiprocessing.active_children() if child.pid]  # noqa: E731
    assert _same(_run(experiment, tmp_path, 2, told=_killer(children, killed)), alone)
    assert killed


class _Deadly:
    """Two workers of whom nobody survives frame 3 under ``sgbm``."""

    workers, threads = 2, 1

    def run(self, work: Any, jobs: Any, progress: Any, lost: Any) -> Iterator[Any]:
        for job in jobs:
            deadly = 3 in job.frames and any(configuration.name == "sgbm" for configuration in job.configurations)
            yield lost(job, "died") if deadly else work(job, progress)


def test_what_kills_workers_is_never_done_by_the_run_itself_and_ends_no_other_configuration(
    experiment: Path, alone: RunDirectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("harness.run.runner.executor", lambda *_, **__: nullcontext(_Deadly()))
    matched: list[int] = []
    match = SemiGlobalMatcher.match
    monkeypatch.setattr(
        SemiGlobalMatcher, "match", lambda self, frame: (matched.append(frame.index), match(self, frame))[1]
    )
    run = _run(experiment, tmp_path, 2)
    assert 3 not in matched
    failed = {(each.configuration, each.error) for each in run.read_manifest().failed}
    assert failed == {("sgbm", "died")}
    expected = [record for record in read_records(alone) if record.configuration != "sgbm"]
    assert len(expected) == 2 * FRAMES
    assert list(read_records(run)) == expected


class _Watched:
    """Two workers in this process; ``dealt`` are the configurations of the jobs that they were given together."""

    workers, threads = 2, 1

    def __init__(self) -> None:
        self.dealt: list[list[list[str]]] = []

    def run(self, work: Any, jobs: Any, progress: Any, lost: Any) -> Iterator[Any]:
        if work is run_clip:
            self.dealt.append([[configuration.name for configuration in job.configurations] for job in jobs])
        for job in jobs:
            yield work(job, progress)


def test_one_process_at_a_time_writes_the_recordings_of_a_clip_also_when_nothing_is_left_to_perceive(
    experiment: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    watched = _Watched()
    monkeypatch.setattr("harness.run.runner.executor", lambda *_, **__: nullcontext(watched))
    loaded, store = load_experiment(str(experiment)), Store(tmp_path / "cache", 10**9)
    for name in ("perceived", "cached"):
        plan = prepare(loaded, sinks=(recordings(loaded.configurations),), limit=3)
        directory = run_plan(plan, tmp_path / name, workers=2, progress=len, cache=store)
        assert not directory.read_manifest().failed
        written = {path.name for path in directory.path.glob("*.rrd*")}
        assert {"alley.rrd", "alley__bm.rrd", "alley__sgbm.rrd", "alley__wider.rrd"} <= written
        assert not [each for each in written if "partial" in each]
    assert watched.dealt == [[["bm", "wider"], ["sgbm"]], [["bm", "sgbm", "wider"]]]


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """The address of a scheduler with two workers, each a process with one thread."""
    with local_cluster(2) as address:
        yield address


def _lost(job: object, why: str) -> str:
    return why


def test_a_cluster_does_the_work_in_order_and_tells_of_it(scheduler: str) -> None:
    told: list[str] = []
    with executor(1, scheduler) as cluster:
        assert cluster.workers == 2
        assert list(cluster.run(tasks.square, [3, 1, 2], told.append, _lost)) == [(9, 1), (1, 1), (4, 1)]
        deadline = time.monotonic() + 10
        while len(told) < 3 and time.monotonic() < deadline:
            time.sleep(0.01)
    assert sorted(told) == ["1", "2", "3"]


def test_a_worker_of_a_cluster_that_dies_is_replaced(scheduler: str, tmp_path: Path) -> None:
    jobs = [tmp_path / name for name in "ab"]
    jobs[1].touch()
    with executor(1, scheduler) as cluster:
        assert list(cluster.run(tasks.die_once, jobs, lambda word: None, _lost)) == ["a done", "b done"]


def test_an_error_of_a_worker_names_the_worker(scheduler: str) -> None:
    with executor(1, scheduler) as cluster:  # noqa: SIM117
        with pytest.raises(VfoaError, match=r"^tcp://[0-9.:]+: s3://bucket: "):
            list(cluster.run(tasks.refuse, [1], lambda word: None, _lost))


@pytest.mark.parametrize("holds", [False, True])
def test_an_interrupted_run_leaves_no_job_behind_on_a_cluster(scheduler: str, tmp_path: Path, holds: bool) -> None:
    jobs = [tmp_path / name for name in ("short", "a", "b", "queued", "queued too")]
    with executor(1, scheduler) as cluster:
        outcomes = cluster.run(tasks.endless, jobs, lambda word: None, _lost)
        assert next(outcomes) == "done"
        deadline = time.monotonic() + 120
        while not any(job.exists() for job in jobs) and time.monotonic() < deadline:
            time.sleep(0.01)
        if not holds:
            outcomes.close()  # as an interrupt in the iterator does
    begun = [job for job in jobs if job.exists()]  # an interrupt's traceback holds the iterator
    assert 1 <= len(begun) <= 2
    assert {job.read_text() for job in begun} == {"stopped"}
    outcomes.close()
    with executor(1, scheduler) as cluster:
        assert list(cluster.run(tasks.square, [3], lambda word: None, _lost)) == [(9, 1)]


def test_a_scheduler_that_is_not_there_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("harness.run.executors.cluster.PATIENCE_SECONDS", 0.5)
    with pytest.raises(VfoaError, match=r"--scheduler tcp://127\.0\.0\.1:9: "):  # noqa: SIM117
        with executor(1, "tcp://127.0.0.1:9"):
            pass


@pytest.mark.parametrize("address", ["http://127.0.0.1:8787", "127.0.0.1:8786", "tcp://127.0.0.1"])
def test_no_client_is_made_for_what_is_no_address_of_a_scheduler(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A dashboard's address, for one: a client that knows no such scheme waits a minute when it is dropped."""
    pytest.importorskip("distributed")
    monkeypatch.setattr("distributed.Client", pytest.fail)
    with pytest.raises(VfoaError, match=f"--scheduler {address}: "), executor(1, address):
        pass


def test_the_address_of_a_scheduler_is_checked_for_a_finished_run_too(experiment: Path, alone: RunDirectory) -> None:
    said: list[str] = []
    _run(experiment, alone.path.parent, 1, cached=False, scheduler="tcp://127.0.0.1:9", tell=said.append)
    assert [line for line in said if "tcp://127.0.0.1:9" in line and str(alone.path) in line] == said
    with pytest.raises(VfoaError, match="--scheduler 127"):
        _run(experiment, alone.path.parent, 1, cached=False, scheduler="127.0.0.1:9")


def test_a_cluster_changes_nothing(experiment: Path, alone: RunDirectory, tmp_path: Path, scheduler: str) -> None:
    assert _same(_run(experiment, tmp_path, 1, scheduler=scheduler), alone)


def test_a_worker_of_a_cluster_that_is_killed_changes_nothing(
    experiment: Path, alone: RunDirectory, tmp_path: Path, scheduler: str
) -> None:
    import distributed

    with distributed.Client(scheduler, set_as_default=False) as client:
        pids = list(client.run(os.getpid).values())
    killed: list[int] = []
    assert _same(_run(experiment, tmp_path, 1, scheduler=scheduler, told=_killer(lambda: pids, killed)), alone)
    assert killed


def test_a_worker_with_other_code_refuses_the_job(scheduler: str) -> None:
    modules = ("harness.run.loop",)
    with connect(scheduler) as client:
        same = Cluster(client, modules)
        assert list(same.run(tasks.pid, ["a"], lambda word: None, _lost))
        other = Cluster(client, modules)
        other._code = modules, "the digest of other code"
        with pytest.raises(VfoaError, match=r"tcp://.*: runs another version of vfoa"):
            list(other.run(tasks.pid, ["a"], lambda word: None, _lost))


def test_what_is_no_address_is_refused_at_once() -> None:
    with pytest.raises(VfoaError, match=r"--scheduler localhost: .*address"):
        connect("localhost").__enter__()


def test_a_scheduler_that_dies_is_one_line(caplog: pytest.LogCaptureFixture) -> None:
    def slow(job: str, progress: Callable[[str], None]) -> str:
        time.sleep(60)
        return job

    code = (
        "import time, distributed\n"
        "how = {'processes': False, 'protocol': 'tcp://', 'host': '127.0.0.1', 'dashboard_address': None}\n"
        "print(distributed.LocalCluster(1, threads_per_worker=1, **how).scheduler_address, flush=True)\n"
        "time.sleep(600)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            with connect(process.stdout.readline().strip()) as client:
                outcomes = Cluster(client).run(slow, ["a"], lambda word: None, _lost)
                threading.Timer(1.0, process.kill).start()
                with pytest.raises(VfoaError, match="the scheduler is gone"):
                    next(outcomes)
            assert not [record for record in caplog.records if record.name == "distributed.client"]
        finally:
            process.kill()
