"""Whole runs in which the segmenter runs on key frames only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from harness.pipeline.cache_store import Store
from harness.report.write import rescore
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.records import FrameRecord
from harness.run.results import read_results
from harness.run.runner import prepare, run_plan
from tests import graphs
from tests.disk import write_text
from vfoa.segmentation.yolo_seg import YoloSeg
from vfoa.types import Instances, StereoFrame

FRAMES = 8
KEYS = [None, 1, 1, None, 4, 4, None, 7]
LATE_KEYS = [None, 1, 1, 1, 1, 4, 4, 4]
EXPERIMENT = """
clips = ["studio_table"]
defaults.stereo = {{ matcher = "bm", min_depth_m = 0.8 }}
defaults.heads.detector = "truth"
defaults.head_pose.model = "simulated"
defaults.gaze.model = "none"
[[configuration]]
name = "network"
segmentation = {{ model = "yolo_seg", weights = "{yolo}", every = 3 }}
[[configuration]]
name = "late"
segmentation = {{ model = "yolo_seg", weights = "{yolo}", every = 3, delay = 2 }}
[[configuration]]
name = "truth"
segmentation = {{ model = "truth", every = 3 }}
[[configuration]]
name = "all"
segmentation.model = "truth"
"""


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("key_frames")
    dark = np.zeros((1, 116, 1), np.float32)  # a "person": what is dark in the middle of the picture
    dark[0, [0, 1, 2, 3, 4, 84]] = [[160], [160], [200], [200], [0.9], [-1]]
    weights = Path(graphs.yolo_seg(folder / "yolo.onnx", dark)).as_posix()
    return write_text(folder / "key_frames.toml", EXPERIMENT.format(yolo=weights))


@pytest.fixture
def segmented(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The frames that the network has segmented in this process."""
    asked: list[int] = []
    segment = YoloSeg.segment

    def counted(self: YoloSeg, frame: StereoFrame) -> Instances:
        asked.append(frame.index)
        return segment(self, frame)

    monkeypatch.setattr(YoloSeg, "segment", counted)
    return asked


def run(experiment: Path, folder: Path, workers: int = 1, *, cached: bool = True, threads: int = 1) -> RunDirectory:
    plan = prepare(load_experiment(str(experiment)), limit=FRAMES)
    store = Store(folder / "cache", 10**9) if cached else None
    return run_plan(plan, folder / f"run-{workers}", workers=workers, progress=len, cache=store, threads=threads)


def masks_from(directory: RunDirectory, configuration: str) -> list[int | None]:
    return [each.masks_from for each in read_results(directory.results) if each.configuration == configuration]


def unmeasured(directory: RunDirectory) -> list[FrameRecord]:
    """The records without the measures against the rendered ground truth, which may differ in their last digits."""
    return [replace(each, measures=None) for each in read_results(directory.results)]


def test_records_and_tables_say_which_masks_were_carried(
    experiment: Path, tmp_path: Path, segmented: list[int]
) -> None:
    directory = run(experiment, tmp_path, cached=False)
    assert masks_from(directory, "network") == masks_from(directory, "truth") == KEYS
    assert masks_from(directory, "late") == LATE_KEYS
    assert masks_from(directory, "all") == [None] * FRAMES
    assert sorted(segmented) == [1, 1, 4, 4, 7]
    notes = rescore(directory).notes
    assert any("network, truth" in note and "every = 3" in note and "up to 2 frames" in note for note in notes)
    assert any("late" in note and "delay = 2" in note and "up to 4 frames" in note for note in notes)


def test_records_say_how_old_the_masks_are(experiment: Path, tmp_path: Path) -> None:
    records = [each for each in read_results(run(experiment, tmp_path).results) if each.configuration == "late"]
    times_ns = {each.frame: each.time_ns for each in records}
    for record, key in zip(records, LATE_KEYS, strict=True):
        expected = None if key is None else 1e-9 * (record.time_ns - times_ns[key])
        assert record.masks_age_s == (None if expected is None else pytest.approx(expected))


@pytest.mark.parametrize(
    "again",
    [lambda run, *given: run(*given, workers=2), lambda run, *given: run(*given, cached=False, threads=3)],
    ids=["two workers", "threads"],
)
def test_neither_workers_nor_threads_change_anything(
    again: Callable[..., RunDirectory], experiment: Path, tmp_path: Path
) -> None:
    alone = run(experiment, tmp_path / "alone", cached=False)
    threads_before = cv2.getNumThreads()
    try:
        other = again(run, experiment, tmp_path / "other")
    finally:
        cv2.setNumThreads(threads_before)
    assert [each.masks_from for each in read_results(other.results)] == [*KEYS, *LATE_KEYS, *KEYS, *[None] * FRAMES]
    assert unmeasured(other) == unmeasured(alone)


def test_carried_masks_are_cached_as_found_ones_are(experiment: Path, tmp_path: Path, segmented: list[int]) -> None:
    first = run(experiment, tmp_path)
    segmented.clear()
    before = unmeasured(first)
    first.path.rename(tmp_path / "before")
    second = run(experiment, tmp_path)
    assert segmented == []
    assert unmeasured(second) == before
    rows = [each for each in second.read_manifest()["cache"] if each["slot"] == "segmentation"]
    assert [(row["reused"], row["computed"]) for row in rows] == [(FRAMES, 0)] * 2
