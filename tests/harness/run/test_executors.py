from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from harness.bench.many_clips import local_cluster
from harness.run.executors import InProcess
from harness.run.jobs import executor
from vfoa.errors import VfoaError


def _square(number: int, progress: Callable[[str], None]) -> tuple[int, int]:
    import cv2

    progress(str(number))
    return number**2, cv2.getNumThreads()


def _fail(number: int, progress: Callable[[str], None]) -> int:
    raise ZeroDivisionError(f"job {number}")


@pytest.mark.parametrize("workers", [1, 2])
def test_outcomes_come_in_the_order_of_the_jobs_with_one_thread_each(workers: int) -> None:
    told: list[str] = []
    with executor(workers) as chosen:
        outcomes = list(chosen.run(_square, [3, 1, 2], told.append, _no_number))
    assert outcomes == [(9, 1), (1, 1), (4, 1)]
    assert sorted(told) == ["1", "2", "3"]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_bug_keeps_its_type_and_message(workers: int) -> None:
    with executor(workers) as chosen, pytest.raises(ZeroDivisionError, match="job 1"):
        list(chosen.run(_fail, [1, 2], lambda word: None, _no_number))


def _pid(number: int, progress: Callable[[str], None]) -> int:
    return os.getpid()


def test_one_worker_stays_in_this_process() -> None:
    with executor(1) as chosen:
        assert set(chosen.run(_pid, [1, 2], lambda word: None, _no_number)) == {os.getpid()}


def test_the_processes_of_a_pool_go_on_from_one_run_to_the_next() -> None:
    with executor(2) as pool:
        first, second = (set(pool.run(_pid, [1, 2, 3, 4], lambda word: None, _no_number)) for _ in range(2))
    assert os.getpid() not in first
    assert len(first | second) <= 2


def _no_number(number: int, why: str) -> int:
    raise AssertionError(why)


def _wait_for(marker: Path, progress: Callable[[str], None]) -> str:
    deadline = time.monotonic() + 60
    while not marker.exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    return marker.name if marker.exists() else "waited in vain"


def test_an_outcome_comes_while_others_are_worked_on(tmp_path: Path) -> None:
    jobs = [tmp_path / name for name in "abc"]
    jobs[0].touch()
    found: list[str] = []
    with executor(2) as pool:
        for outcome in pool.run(_wait_for, jobs, lambda word: None, _give_up):
            found.append(outcome)
            for job in jobs[: len(found) + 1]:
                job.touch()
    assert found == ["a", "b", "c"]


def _die_once(marker: Path, progress: Callable[[str], None]) -> str:
    """Takes its worker along, unless another worker did so before."""
    progress(marker.name)
    if not marker.exists():
        marker.write_text(str(os.getpid()))
        os.kill(os.getpid(), signal.SIGKILL)
    return f"{marker.name} done"


def _die(marker: Path, progress: Callable[[str], None]) -> str:
    if marker.name == "deadly":
        os.kill(os.getpid(), signal.SIGKILL)
    return marker.name


def _give_up(marker: Path, why: str) -> str:
    return f"{marker.name}: {why}"


def test_a_worker_that_dies_is_replaced_and_its_work_redone(tmp_path: Path) -> None:
    jobs = [tmp_path / name for name in "abc"]
    jobs[1].write_text("this one never kills")
    jobs[2].write_text("nor does this one")
    with executor(2) as pool:
        outcomes = list(pool.run(_die_once, jobs, lambda word: None, _give_up))
    assert outcomes == ["a done", "b done", "c done"]
    assert int(jobs[0].read_text()) != os.getpid()


def test_a_job_that_kills_every_worker_is_given_up_alone(tmp_path: Path) -> None:
    with executor(2) as pool:
        outcomes = list(pool.run(_die, [tmp_path / n for n in ("a", "deadly", "b")], lambda word: None, _give_up))
    assert outcomes == ["a", "deadly: its worker process died 3 times over", "b"]


def test_a_worker_does_not_run_what_lies_in_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file called as a module of the standard library must not be executed."""
    (tmp_path / "signal.py").write_text(f"open({str(tmp_path / 'executed')!r}, 'w').close()\nraise SystemExit(9)\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    jobs = [tmp_path / "a", tmp_path / "b"]
    for job in jobs:
        job.write_text("does not kill")
    with executor(2) as pool:
        assert list(pool.run(_die_once, jobs, lambda word: None, _give_up)) == ["a done", "b done"]
    assert not (tmp_path / "executed").exists()


def _sleep(marker: Path, progress: Callable[[str], None]) -> None:
    if marker.name != "short":
        marker.write_text(str(os.getpid()))
        time.sleep(600)


def test_workers_that_do_not_answer_end_with_an_interrupted_run(tmp_path: Path) -> None:
    jobs = [tmp_path / "short", tmp_path / "long"]
    with suppress(KeyboardInterrupt), executor(2) as pool:
        next(pool.run(_sleep, jobs, lambda word: None, _give_up))
        while not (jobs[1].exists() and jobs[1].read_text()):
            time.sleep(0.01)
        raise KeyboardInterrupt
    assert not _runs(int(jobs[1].read_text()))


def _linger(folder: Path, progress: Callable[[str], None]) -> None:
    (folder / str(os.getpid())).touch()
    time.sleep(600)


def test_workers_do_not_outlive_a_run_that_was_killed(tmp_path: Path) -> None:
    code = (
        "from pathlib import Path; from harness.run.jobs import executor\n"
        "from test_executors import _linger\n"
        "if __name__ == '__main__':\n"
        "    with executor(2) as pool:\n"
        f"        list(pool.run(_linger, [Path({str(tmp_path)!r})] * 2, print, print))\n"
    )
    script = tmp_path / "script.py"
    script.write_text(code)
    folders = os.pathsep.join([str(Path(__file__).parent), str(Path(__file__).parents[3])])
    process = subprocess.Popen([sys.executable, script], env={**os.environ, "PYTHONPATH": folders})
    workers: list[int] = []
    while len(workers) < 2 and process.poll() is None:
        time.sleep(0.05)
        workers = [int(path.name) for path in tmp_path.iterdir() if path.name.isdigit()]
    process.kill()
    process.wait()
    deadline = time.monotonic() + 30
    while any(_runs(worker) for worker in workers) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert len(workers) == 2
    assert not any(_runs(worker) for worker in workers)


def _runs(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_one_worker_needs_no_pool() -> None:
    with executor(1) as chosen:
        assert isinstance(chosen, InProcess)


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """The address of a scheduler with two workers, each a process with one thread."""
    with local_cluster(2) as address:
        yield address


def test_a_cluster_does_the_work_in_order_and_tells_of_it(scheduler: str) -> None:
    told: list[str] = []
    with executor(1, scheduler) as cluster:
        assert cluster.workers == 2
        assert list(cluster.run(_square, [3, 1, 2], told.append, _give_up)) == [(9, 1), (1, 1), (4, 1)]
        deadline = time.monotonic() + 10
        while len(told) < 3 and time.monotonic() < deadline:
            time.sleep(0.01)
    assert sorted(told) == ["1", "2", "3"]


def test_a_worker_of_a_cluster_that_dies_is_replaced(scheduler: str, tmp_path: Path) -> None:
    jobs = [tmp_path / name for name in "ab"]
    jobs[1].touch()
    with executor(1, scheduler) as cluster:
        assert list(cluster.run(_die_once, jobs, lambda word: None, _give_up)) == ["a done", "b done"]


def _refuse(number: int, progress: Callable[[str], None]) -> tuple[int, int]:
    raise VfoaError("s3://bucket: cannot be read")


def test_an_error_of_a_worker_names_the_worker(scheduler: str) -> None:
    with executor(1, scheduler) as cluster:  # noqa: SIM117
        with pytest.raises(VfoaError, match=r"^tcp://[0-9.:]+: s3://bucket: cannot be read$"):
            list(cluster.run(_refuse, [1], lambda word: None, _no_number))


def _endless(marker: Path, progress: Callable[[str], None]) -> str:
    """Goes on until it is stopped, and says so; a job called "short" is done at once."""
    if marker.name == "short":
        return "done"
    marker.write_text("begun")
    try:
        while True:
            progress(marker.name)
            time.sleep(0.01)
    finally:
        marker.write_text("stopped")


def test_an_interrupted_run_leaves_no_job_behind_on_a_cluster(scheduler: str, tmp_path: Path) -> None:
    jobs = [tmp_path / name for name in ("short", "a", "b", "queued", "queued too")]
    with executor(1, scheduler) as cluster:
        outcomes = cluster.run(_endless, jobs, lambda word: None, _give_up)
        assert next(outcomes) == "done"
        deadline = time.monotonic() + 120
        while not any(job.exists() for job in jobs) and time.monotonic() < deadline:
            time.sleep(0.01)
        outcomes.close()  # as an interrupt does
        begun = [job for job in jobs if job.exists()]
        assert 1 <= len(begun) <= 2
        assert {job.read_text() for job in begun} == {"stopped"}
        assert list(cluster.run(_square, [3], lambda word: None, _give_up)) == [(9, 1)]


def test_a_scheduler_that_is_not_there_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("harness.run.executors.cluster.PATIENCE_SECONDS", 0.5)
    with pytest.raises(VfoaError, match=r"--scheduler tcp://127\.0\.0\.1:9: expected a Dask scheduler"):  # noqa: SIM117
        with executor(1, "tcp://127.0.0.1:9"):
            pass
