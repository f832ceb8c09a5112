"""A recording of bandage_2, made by the libraries' writers, against the files it was made from."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from harness.report.frames_csv import run_frames
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.sources.recordings.clip import McapClip
from harness.sources.recordings.settings import RecordingSettings
from harness.sources.sintel import SintelClip, SintelSettings
from tests.disk import labels_text, write_text
from tests.recordings import Camera, Family, Pixels, rectified_camera, write_pairs

NUMBERS = range(1, 4)

MANIFEST = """
name = "{name}"
adapter = "mcap"
root = "."

[source]
recording = "{name}.mcap"

[subjects.girl]
category = "person"

[targets.bird]
category = "bird"
"""

EXPERIMENT = """
[defaults]
stereo.min_depth_m = 0.45
stereo.matcher = "sgbm"
segmentation = { model = "coco_panoptic", root = "${VFOA_DATA}/bandage_2_panoptic" }
heads.detector = "yunet"
head_pose.model = "fsanet"
gaze.model = "adas_0002"

[grid]
"attention.cones_deg" = { narrow = [50], edge = [60], wide = [80] }
"""


@pytest.fixture
def sintel(shared_data: Path, monkeypatch: pytest.MonkeyPatch) -> SintelClip:
    monkeypatch.setenv("VFOA_DATA", str(shared_data.resolve()))
    return SintelClip(SintelSettings.model_validate({"scene": "bandage_2"}), shared_data.resolve() / "sintel")


def _pairs(
    clip: SintelClip, numbers: range = NUMBERS
) -> Iterator[tuple[int, NDArray[np.uint8], NDArray[np.uint8], Camera, Camera]]:
    for number in numbers:
        frame = clip.frame(number)
        rig = frame.rig
        left, right = (
            rectified_camera(rig.width_px, rig.height_px, rig.fx_px, rig.cx_px, rig.cy_px, baseline_m)
            for baseline_m in (0.0, rig.baseline_m)
        )
        yield frame.time_ns, frame.left, frame.right, left, right


@pytest.mark.parametrize("pixels", ["raw", "png"])
@pytest.mark.parametrize("family", ["ros2", "protobuf"])
def test_a_recording_of_real_frames_is_those_frames(
    sintel: SintelClip, tmp_path: Path, family: Family, pixels: Pixels
) -> None:
    write_pairs(tmp_path / "recorded.mcap", _pairs(sintel), family, pixels)
    clip = McapClip(RecordingSettings(recording="recorded.mcap"), tmp_path)
    assert clip.rate_hz == sintel.rate_hz
    assert list(clip.frames) == list(NUMBERS)
    for number in NUMBERS:
        expected, found = sintel.frame(number), clip.frame(number)
        assert np.array_equal(found.left, expected.left)
        assert np.array_equal(found.right, expected.right)
        assert (found.time_ns, found.rig.cx_px, found.rig.fx_px) == (
            expected.time_ns,
            expected.rig.cx_px,
            expected.rig.fx_px,
        )
        assert found.rig.baseline_m == pytest.approx(expected.rig.baseline_m, rel=1e-12)


@pytest.fixture
def work(tmp_path: Path, shared_models: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with an experiment in it."""
    monkeypatch.setenv("VFOA_MODELS", str(shared_models.resolve()))
    monkeypatch.chdir(tmp_path)
    write_text(tmp_path / "both.toml", EXPERIMENT)
    return tmp_path


def _add(work: Path, sintel: SintelClip, name: str, pixels: Pixels, numbers: range) -> None:
    """A recording as a clip of that name, labelled in all frames."""
    write_text(work / "datasets" / f"{name}.toml", MANIFEST.format(name=name))
    write_text(work / "annotations" / f"{name}.csv", labels_text(f"1,{len(numbers)},girl,bird,"))
    write_pairs(work / "datasets" / f"{name}.mcap", _pairs(sintel, numbers), "ros2", pixels)


def _run(work: Path, clips: tuple[str, ...], frames: range) -> list[dict[str, str]]:
    """The rows of every attention value of a run."""
    plan = prepare(load_experiment("both.toml", clips=clips), limit=len(frames))
    directory = run_plan(plan, work / "run", workers=1, progress=lambda clip: None)
    return list(csv.DictReader(run_frames(directory)))


def test_a_run_on_the_recording_gives_the_same_table(sintel: SintelClip, work: Path) -> None:
    _add(work, sintel, "png", "png", NUMBERS)
    clips = ("png", "sintel_bandage_2")
    rows: dict[str, list[dict[str, str]]] = {clip: [] for clip in clips}
    for row in _run(work, clips, NUMBERS):
        rows[row.pop("clip")].append(row)
    wide = [row for row in rows["png"] if row["configuration"] == "wide"]
    assert len(wide) == len(NUMBERS)
    assert all(float(row["total"]) > 0 for row in wide)  # zeros would be equal whatever was read
    assert rows["png"] == rows["sintel_bandage_2"]
