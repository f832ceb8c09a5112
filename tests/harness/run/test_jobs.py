"""How a plan becomes jobs, and which of them run at the same time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.pipeline.cache_store import Store
from harness.run.directory import Pair, RunDirectory, new_run_id
from harness.run.executors import GOES_ON
from harness.run.experiment import Experiment, load_experiment
from harness.run.jobs import LONGEST_STRETCH, run_jobs, stretches, warm_clip
from harness.run.loop import ClipJob, ClipResult, perceive_clip, run_clip
from harness.run.plan import prepare
from tests.disk import write_text
from tests.measured import EXPERIMENT, measured_tables
from tests.measured import MANIFEST as MEASURED
from tests.records import write_manifest
from vfoa.errors import VfoaError


@given(frames=st.lists(st.integers(), unique=True, max_size=600), workers=st.integers(2, 9))
def test_stretches_hold_every_frame_once_and_in_order_and_grow_no_longer(frames: list[int], workers: int) -> None:
    cut = list(stretches(frames, workers))
    assert [frame for stretch in cut for frame in stretch] == frames
    lengths = [len(stretch) for stretch in cut]
    assert lengths == sorted(lengths, reverse=True)
    assert max(lengths, default=0) <= LONGEST_STRETCH
    assert set(lengths[-workers:]) <= {1}


DEMO = ["bm-one", "bm-two", "bm-nearest", "sgbm-one", "sgbm-two", "sgbm-nearest"]
CLIP = "studio_table"
Lost = Callable[[ClipJob, str], ClipResult]


class DyingWorkers:
    """An executor whose workers die of every stretch, and of clips under some configurations.

    It notes what is perceived and what is run at the same time: configurations by job.
    """

    workers, threads = 2, 1

    def __init__(self, *deadly: str) -> None:
        self.deadly = deadly
        self.perceived: list[list[list[str]]] = []
        self.run_together: list[list[list[str]]] = []

    def run(self, work: object, jobs: Sequence[ClipJob], progress: object, lost: Lost) -> Iterator[ClipResult]:
        names = [[configuration.name for configuration in job.configurations] for job in jobs]
        if work is perceive_clip:
            self.perceived.append(names)
        elif work is run_clip:
            self.run_together.append(names)
        for job, of_job in zip(jobs, names, strict=True):
            dies = work is warm_clip or {*of_job} & {*self.deadly}
            yield lost(job, "died") if dies else ClipResult(failures={})


def _run(
    executor: Any, folder: Path, experiment: Experiment | None = None, told: Callable[[str], None] = len
) -> dict[Pair, VfoaError]:
    plan = prepare(experiment or load_experiment("demo", clips=(CLIP,)), limit=None if experiment else 2)
    directory = RunDirectory(folder / "run")
    write_manifest(directory, {"run_id": new_run_id()})
    store = Store(folder / "cache", 10**9)
    return run_jobs(plan, directory, cache=store, executor=executor, progress=told).failures


def test_a_clip_that_kills_workers_is_perceived_under_each_configuration_by_itself(tmp_path: Path) -> None:
    executor = DyingWorkers("bm-two")
    failures = _run(executor, tmp_path)
    assert {pair: str(error) for pair, error in failures.items()} == {(CLIP, "bm-two"): "died"}
    assert executor.perceived == [[[name] for name in DEMO]]
    assert executor.run_together == [[[name for name in DEMO if name != "bm-two"]]]


def test_a_clip_that_kills_workers_under_every_configuration_is_left_out(tmp_path: Path) -> None:
    executor = DyingWorkers(*DEMO)
    assert [name for _, name in _run(executor, tmp_path)] == DEMO
    assert executor.run_together == [[]]


class Working:
    """Workers in this process, which note the jobs that they are given at the same time."""

    threads = 1

    def __init__(self, workers: int = 2) -> None:
        self.workers = workers
        self.given: list[tuple[str, list[list[str]]]] = []

    def run(self, work: Any, jobs: Sequence[ClipJob], progress: Any, lost: Lost) -> Iterator[ClipResult]:
        names = [[configuration.name for configuration in job.configurations] for job in jobs]
        self.given.append((work.__name__, names))
        for job in jobs:
            yield work(job, progress)


def test_workers_attend_to_some_configurations_each_when_a_clip_is_perceived(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dealt = [DEMO[0::2], DEMO[1::2]]
    first = Working()
    assert _run(first, tmp_path / "first") == {}
    assert first.given == [("warm_clip", [DEMO, DEMO]), ("run_clip", dealt)]
    (tmp_path / "first" / "cache").rename(tmp_path / "cache")
    again = Working()
    monkeypatch.setattr("harness.run.loop._perception", _perceives_nothing)
    (tmp_path / "second").mkdir()
    (tmp_path / "second" / "cache").symlink_to(tmp_path / "cache")
    assert _run(again, tmp_path / "second") == {}
    assert again.given == [("warm_clip", []), ("run_clip", dealt)]


def _perceives_nothing(*_: object) -> None:
    raise AssertionError("the clip is perceived again")


@pytest.fixture
def talk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Experiment:
    """A clip of measurements under three configurations, of which one reads other tables than the others."""
    measured_tables(tmp_path / "data" / "talk")
    write_text(tmp_path / "datasets" / "talk.toml", MEASURED)
    monkeypatch.chdir(tmp_path)
    one = '[[configuration]]\nname = "one"\nattention.cones_cm = [10]\n'
    return load_experiment(str(write_text(tmp_path / "talk.toml", EXPERIMENT + one)))


@pytest.mark.parametrize(
    ("workers", "given"),
    [
        (1, [("run_clip", [["cones", "forward", "one"]])]),
        (2, [("perceive_clip", [["cones", "forward", "one"]]), ("run_clip", [["cones", "one"], ["forward"]])]),
        (4, [("perceive_clip", [["cones", "forward", "one"]]), ("run_clip", [["cones"], ["forward"], ["one"]])]),
    ],
)
def test_workers_share_a_clip_without_images_and_tell_each_frame_once(
    talk: Experiment, workers: int, given: list[tuple[str, list[list[str]]]], tmp_path: Path
) -> None:
    executor, told = Working(workers), list[str]()
    assert _run(executor, tmp_path, talk, told.append) == {}
    assert executor.given == given
    assert [word for word in told if word != GOES_ON] == ["talk"] * 12
    # frames are told when they are attended to: perceiving them takes no time
    assert told[:12] == [GOES_ON] * 12
    last = len(told) - told[::-1].index("talk")
    assert last > len(told) - 12


def test_what_is_not_attended_to_is_told_at_the_end(
    talk: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        raise VfoaError("no such method")

    monkeypatch.setattr("harness.run.attend.open_method", fails)
    told: list[str] = []
    assert len(_run(Working(1), tmp_path, talk, told.append)) == 3
    assert [word for word in told if word != GOES_ON] == ["talk"] * 12
