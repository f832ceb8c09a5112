"""Whole runs in which the segmenter runs on key frames only."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest

from harness.pipeline.cache_store import Store
from harness.report.write import rescore
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.run.table_records import read_records
from tests import graphs
from tests.disk import write_text
from tests.experiments import BLOCKS, experiment_of
from vfoa.segmentation.yolo_seg import YoloSeg
from vfoa.types import Instances, StereoFrame

FRAMES = 8
KEYS = [None, 1, 1, None, 4, 4, None, 7]
STAGES = {**BLOCKS, "gaze.model": "none"}


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("key_frames")
    dark = np.zeros((1, 116, 1), np.float32)  # a "person": what is dark in the middle of the picture
    dark[0, [0, 1, 2, 3, 4, 84]] = [[160], [160], [200], [200], [0.9], [-1]]
    weights = Path(graphs.yolo_seg(folder / "yolo.onnx", dark)).as_posix()
    configurations = {
        "network": {"segmentation.model": "yolo_seg", "segmentation.weights": weights, "segmentation.every": 3},
        "truth": {"segmentation.every": 3},
        "all": {},
    }
    return write_text(folder / "key_frames.toml", experiment_of(["studio_table"], configurations, STAGES))


@contextmanager
def segmented() -> Iterator[list[int]]:
    """The frames that the network segments in this process."""
    asked: list[int] = []
    segment = YoloSeg.segment

    def counted(self: YoloSeg, frame: StereoFrame) -> Instances:
        asked.append(frame.index)
        return segment(self, frame)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(YoloSeg, "segment", counted)
        yield asked


def run(experiment: Path, folder: Path, workers: int = 1, *, cached: bool = True, threads: int = 1) -> RunDirectory:
    plan = prepare(load_experiment(str(experiment)), limit=FRAMES)
    store = Store(folder / "cache", 10**9) if cached else None
    return run_plan(plan, folder / f"run-{workers}", workers=workers, progress=len, cache=store, threads=threads)


def masks_from(directory: RunDirectory, configuration: str) -> list[int | None]:
    return [each.masks_from for each in read_records(directory) if each.configuration == configuration]


@pytest.fixture(scope="module")
def alone(experiment: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[RunDirectory, list[int]]:
    """A run by one worker without a cache, and what the network has segmented."""
    with segmented() as asked:
        return run(experiment, tmp_path_factory.mktemp("alone"), cached=False), asked


def test_records_and_tables_say_which_masks_were_carried(alone: tuple[RunDirectory, list[int]]) -> None:
    directory, asked = alone
    assert masks_from(directory, "network") == masks_from(directory, "truth") == KEYS
    assert masks_from(directory, "all") == [None] * FRAMES
    assert sorted(asked) == [1, 4, 7]
    notes = [note.text for note in rescore(directory).notes]
    assert any("network, truth" in note and "every = 3" in note and "up to 2 frames" in note for note in notes)


def test_records_say_how_old_the_masks_are(alone: tuple[RunDirectory, list[int]]) -> None:
    records = [each for each in read_records(alone[0]) if each.configuration == "network"]
    times_ns = {each.frame: each.time_ns for each in records}
    for record, key in zip(records, KEYS, strict=True):
        expected = None if key is None else 1e-9 * (record.time_ns - times_ns[key])
        assert record.masks_age_s == (None if expected is None else pytest.approx(expected))


def test_threads_change_nothing(experiment: Path, alone: tuple[RunDirectory, list[int]], tmp_path: Path) -> None:
    threads_before = cv2.getNumThreads()
    try:
        other = run(experiment, tmp_path, cached=False, threads=3)
    finally:
        cv2.setNumThreads(threads_before)
    assert [*read_records(other)] == [*read_records(alone[0])]


def test_workers_change_nothing_and_carried_masks_are_cached_as_found_ones_are(
    experiment: Path, alone: tuple[RunDirectory, list[int]], tmp_path: Path
) -> None:
    assert [*read_records(run(experiment, tmp_path, 2))] == [*read_records(alone[0])]
    shutil.rmtree(tmp_path / "cache" / "stages" / "scene")
    with segmented() as asked:
        second = run(experiment, tmp_path)
    assert asked == []
    assert [*read_records(second)] == [*read_records(alone[0])]
    rows = [each for each in second.read_manifest().cache if each["slot"] == "segmentation"]
    assert [(row["reused"], row["computed"]) for row in rows] == [(FRAMES, 0)]
