from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from pathlib import Path

import pytest

from harness.processes import spawning
from harness.run.executors import InProcess, cores
from harness.run.executors.pool import _is_broken
from harness.run.runner import executor
from tests import tasks
from tests.repository import REPOSITORY


@pytest.mark.parametrize("workers", [1, 2])
def test_outcomes_come_in_the_order_of_the_jobs_with_one_thread_each(workers: int) -> None:
    told: list[str] = []
    with executor(workers) as chosen:
        outcomes = list(chosen.run(tasks.square, [3, 1, 2], told.append, _no_number))
    assert outcomes == [(9, 1), (1, 1), (4, 1)]
    assert sorted(told) == ["1", "2", "3"]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_bug_keeps_its_type_and_message(workers: int) -> None:
    with executor(workers) as chosen, pytest.raises(ZeroDivisionError, match="job 1"):
        list(chosen.run(tasks.fail, [1, 2], lambda word: None, _no_number))


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="needs Linux")
def test_the_cores_are_those_that_a_cluster_gave_to_the_job() -> None:
    first = min(os.sched_getaffinity(0))
    code = f"import os; os.sched_setaffinity(0, {{{first}}}); from harness.run.executors import cores; print(cores())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=REPOSITORY)
    assert done.stdout == "1\n"


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        ({}, 8),
        ({"cpu.max": "max 100000\n"}, 8),
        ({"cpu.max": "200000 100000\n"}, 2),
        ({"cpu.max": "250000 100000\n"}, 3),
        ({"cpu.max": "50000 100000\n"}, 1),
        ({"cpu.max": "6400000 100000\n"}, 8),
        ({"cpu/cpu.cfs_quota_us": "-1\n", "cpu/cpu.cfs_period_us": "100000\n"}, 8),
        ({"cpu/cpu.cfs_quota_us": "400000\n", "cpu/cpu.cfs_period_us": "100000\n"}, 4),
        ({"cpu/cpu.cfs_quota_us": "400000\n"}, 8),
    ],
)
def test_the_cores_are_those_that_a_container_was_given(
    files: dict[str, str], expected: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("harness.run.executors.CGROUP", tmp_path)
    monkeypatch.setattr("os.sched_getaffinity", lambda process: set(range(8)), raising=False)
    (tmp_path / "cpu").mkdir()
    for name, content in files.items():
        (tmp_path / name).write_text(content)
    assert cores() == expected


def test_one_worker_stays_in_this_process() -> None:
    with executor(1) as chosen:
        assert set(chosen.run(tasks.pid, [1, 2], lambda word: None, _no_number)) == {os.getpid()}


def test_the_processes_of_a_pool_go_on_from_one_run_to_the_next() -> None:
    with executor(2) as pool:
        first, second = (set(pool.run(tasks.pid, [1, 2, 3, 4], lambda word: None, _no_number)) for _ in range(2))
    assert os.getpid() not in first
    assert len(first | second) <= 2


def _no_number(number: int, why: str) -> int:
    raise AssertionError(why)


def test_an_outcome_comes_while_others_are_worked_on(tmp_path: Path) -> None:
    jobs = [tmp_path / name for name in "abc"]
    jobs[0].touch()
    found: list[str] = []
    with executor(2) as pool:
        for outcome in pool.run(tasks.wait_for, jobs, lambda word: None, _give_up):
            found.append(outcome)
            for job in jobs[: len(found) + 1]:
                job.touch()
    assert found == ["a", "b", "c"]


def _give_up(marker: Path, why: str) -> str:
    return f"{marker.name}: {why}"


def test_a_worker_that_dies_is_replaced_and_its_work_redone(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    jobs = [tmp_path / name for name in "abc"]
    jobs[1].write_text("this one never kills")
    jobs[2].write_text("nor does this one")
    with executor(2) as pool:
        outcomes = list(pool.run(tasks.die_once, jobs, lambda word: None, _give_up))
    assert outcomes == ["a done", "b done", "c done"]
    assert int(jobs[0].read_text()) != os.getpid()
    (warning,) = caplog.messages
    assert "SIGKILL" in warning
    assert "--workers" in warning


def test_a_job_that_kills_every_worker_is_given_up_alone(tmp_path: Path) -> None:
    with executor(2) as pool:
        outcomes = list(pool.run(tasks.die, [tmp_path / n for n in ("a", "deadly", "b")], lambda word: None, _give_up))
    before_advice = [each.partition(",")[0] for each in outcomes]
    assert before_advice == ["a", "deadly: its worker process died 3 times: killed by SIGKILL", "b"]


def test_workers_that_die_at_their_start_are_not_awaited_forever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As one that the system kills for memory before it has read what it is given: what the code imports is long."""
    monkeypatch.setattr("harness.run.executors.pool.IMPORTED", _imports_of(1000))
    python = tmp_path / "python"
    # not at once: Python 3.11 does not expect that a process dies while others are started
    dies = "sleep 1; exit 1"
    python.write_text(f'#!/bin/sh\ncase "$*" in *resource_tracker*) exec {sys.executable} "$@";; *) {dies};; esac\n')
    python.chmod(0o755)
    monkeypatch.setattr("multiprocessing.spawn._python_exe", os.fsencode(python))
    with executor(2) as pool:
        outcomes = list(pool.run(tasks.die, [tmp_path / "a", tmp_path / "b"], lambda word: None, _give_up))
    assert [each.partition(":")[0] for each in outcomes] == ["a", "b"]
    assert all("died 3 times: ended with exit code 1" in each for each in outcomes)


def test_a_pool_is_broken_from_the_death_of_a_process_on() -> None:
    with ProcessPoolExecutor(1, mp_context=spawning()) as processes:
        assert not _is_broken(processes)
        with pytest.raises(BrokenProcessPool):
            processes.submit(os._exit, 3).result()
        assert _is_broken(processes)


def _imports_of(modules: int) -> dict[tuple[str, str], tuple[str, ...]]:
    digests = (hashlib.sha256(str(module).encode()).hexdigest() for module in range(modules))
    return {(f"harness.module_{number}", digest): (f"vfoa.part_{number}",) for number, digest in enumerate(digests)}


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
        assert list(pool.run(tasks.die_once, jobs, lambda word: None, _give_up)) == ["a done", "b done"]
    assert not (tmp_path / "executed").exists()


def test_workers_do_not_run_the_script_that_started_them(tmp_path: Path) -> None:
    """So it needs no ``if __name__ == "__main__":``."""
    code = (
        f"with open({str(tmp_path / 'started')!r}, 'a') as file:\n"
        "    file.write('once')\n"
        "from harness.run.runner import executor\n"
        "from tests.tasks import square\n"
        "with executor(2) as pool:\n"
        "    print(list(pool.run(square, [3, 1, 2], lambda word: None, print)))\n"
    )
    script = tmp_path / "script.py"
    script.write_text(code)
    env = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    done = subprocess.run([sys.executable, script], env=env, capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr, done.returncode) == ("[(9, 1), (1, 1), (4, 1)]\n", "", 0)
    assert (tmp_path / "started").read_text() == "once"


def test_workers_that_do_not_answer_end_with_an_interrupted_run(tmp_path: Path) -> None:
    jobs = [tmp_path / "short", tmp_path / "long"]
    with suppress(KeyboardInterrupt), executor(2) as pool:
        next(pool.run(tasks.sleep, jobs, lambda word: None, _give_up))
        while not (jobs[1].exists() and jobs[1].read_text()):
            time.sleep(0.01)
        raise KeyboardInterrupt
    assert not _runs(int(jobs[1].read_text()))


def test_workers_do_not_outlive_a_run_that_was_killed(tmp_path: Path) -> None:
    code = (
        "from pathlib import Path; from harness.run.runner import executor\n"
        "from tests.tasks import linger\n"
        "with executor(2) as pool:\n"
        f"    list(pool.run(linger, [Path({str(tmp_path)!r})] * 2, print, print))\n"
    )
    script = tmp_path / "script.py"
    script.write_text(code)
    process = subprocess.Popen([sys.executable, script], env={**os.environ, "PYTHONPATH": str(REPOSITORY)})
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
