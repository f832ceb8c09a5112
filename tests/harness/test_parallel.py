"""Whole runs by several workers: tables to the last byte as by one, and whoever dies on the way."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from harness.cache.store import Store
from harness.conduct import conduct, prepare
from harness.experiment import load_experiment
from harness.rescore import rescore
from harness.run_directory import RunDirectory
from tests import graphs
from tests.disk import write_text

FRAMES = 8
TABLES = ("results.jsonl", "frr.csv", "frames.csv", "compared.csv", "frr.tex")

# one clip, so that workers have to share it; stages that are cached and that are not, a window over frames, tracks
EXPERIMENT = """
clips = ["studio_talk"]
defaults.stereo.min_depth_m = 0.8
defaults.segmentation.model = "truth"
defaults.heads.detector = "person_mask"
defaults.head_pose.model = "none"
defaults.gaze = {{ model = "gaze360", weights = "{weights}", stride = 1 }}
[[configuration]]
name = "bm"
stereo.matcher = "bm"
[[configuration]]
name = "sgbm"
stereo.matcher = "sgbm"
[[configuration]]
name = "true-gaze"
stereo.matcher = "bm"
heads.detector = "truth"
gaze.model = "truth"
"""


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("parallel")
    weights = Path(graphs.seven_levels(folder / "levels.onnx")).as_posix()
    return write_text(folder / "parallel.toml", EXPERIMENT.format(weights=weights))


def _run(
    experiment: Path, folder: Path, workers: int, *, cached: bool = True, told: Callable[[str], None] = len, **how: str
) -> RunDirectory:
    plan = prepare(load_experiment(str(experiment)), limit=FRAMES, recording=None)
    store = Store(folder / "cache", 10**9) if cached else None
    directory = conduct(plan, folder / "run", workers=workers, progress=told, cache=store, **how)
    rescore(directory)
    return directory


@pytest.fixture(scope="module")
def alone(experiment: Path, tmp_path_factory: pytest.TempPathFactory) -> RunDirectory:
    return _run(experiment, tmp_path_factory.mktemp("alone"), 1, cached=False)


def _same(one: RunDirectory, other: RunDirectory) -> bool:
    return all((one.path / name).read_bytes() == (other.path / name).read_bytes() for name in TABLES)


@pytest.mark.parametrize("workers", [2, 4])
def test_workers_share_a_clip_and_change_nothing(
    workers: int, experiment: Path, alone: RunDirectory, tmp_path: Path
) -> None:
    told: list[str] = []
    shared = _run(experiment, tmp_path, workers, told=told.append)
    assert _same(shared, alone)
    assert told == ["studio_talk"] * FRAMES
    stereo = [row for row in shared.read_manifest()["cache"] if row["slot"] == "stereo"]
    assert [(row["stage"], row["reused"], row["computed"]) for row in stereo] == [
        ("bm", 0, FRAMES),
        ("sgbm", 0, FRAMES),
    ]


def _killer(pids: Callable[[], list[int]]) -> Callable[[str], None]:
    """Kills one of the workers when the first frame is done."""
    killed: list[int] = []

    def told(_clip: str) -> None:
        if not killed:
            killed.append(pids()[0])
            os.kill(killed[0], signal.SIGKILL)

    return told


def test_a_worker_of_the_pool_that_is_killed_changes_nothing(
    experiment: Path, alone: RunDirectory, tmp_path: Path
) -> None:
    children = lambda: [child.pid for child in multiprocessing.active_children() if child.pid]  # noqa: E731
    assert _same(_run(experiment, tmp_path, 2, told=_killer(children)), alone)


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """The address of a scheduler with two workers, each a process with one thread."""
    distributed = pytest.importorskip("distributed")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None, "silence_logs": 50}
    with distributed.LocalCluster(**options) as cluster:
        yield cluster.scheduler_address


def test_a_cluster_changes_nothing(experiment: Path, alone: RunDirectory, tmp_path: Path, scheduler: str) -> None:
    assert _same(_run(experiment, tmp_path, 1, scheduler=scheduler), alone)


def test_a_worker_of_a_cluster_that_is_killed_changes_nothing(
    experiment: Path, alone: RunDirectory, tmp_path: Path, scheduler: str
) -> None:
    import distributed

    with distributed.Client(scheduler, set_as_default=False) as client:
        pids = list(client.run(os.getpid).values())
    assert _same(_run(experiment, tmp_path, 1, scheduler=scheduler, told=_killer(lambda: pids)), alone)
