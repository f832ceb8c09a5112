"""A recording of bandage_2, made by the libraries' writers, against the files it was made from."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from harness.adapters.mcap.clip import McapClip, McapSettings
from harness.adapters.sintel import SintelClip, SintelSettings
from harness.conduct import conduct, prepare
from harness.experiment import load_experiment
from harness.rescore import rescore
from tests.disk import write_text
from tests.recordings import Camera, Family, Pixels, rectified_camera, write_pairs

NUMBERS = range(1, 4)

MANIFEST = """
name = "recorded"
adapter = "mcap"
root = "."

[source]
recording = "recorded.mcap"

[subjects.girl]
category = "person"

[targets.bird]
category = "bird"
"""

EXPERIMENT = """
clips = ["recorded", "sintel_bandage_2"]

[defaults]
stereo.min_depth_m = 0.45
stereo.matcher = "sgbm"
segmentation = { model = "coco_panoptic", root = "${VFOA_DATA}/bandage_2_panoptic" }
heads.detector = "yunet"
head_pose.model = "fsanet"
gaze.model = "adas_0002"

[[configuration]]
name = "sgbm-90deg"
attention.cones_deg = [90]
"""


@pytest.fixture
def sintel(shared_data: Path, monkeypatch: pytest.MonkeyPatch) -> SintelClip:
    monkeypatch.setenv("VFOA_DATA", str(shared_data.resolve()))
    return SintelClip(SintelSettings.model_validate({"scene": "bandage_2"}), shared_data.resolve() / "sintel")


def _pairs(clip: SintelClip) -> Iterator[tuple[int, NDArray[np.uint8], NDArray[np.uint8], Camera, Camera]]:
    for number in NUMBERS:
        frame = clip.frame(number)
        rig = frame.rig
        left, right = (
            rectified_camera(rig.width_px, rig.height_px, rig.fx_px, rig.cx_px, rig.cy_px, baseline_m)
            for baseline_m in (0.0, rig.baseline_m)
        )
        yield frame.time_ns, frame.left, frame.right, left, right


@pytest.mark.parametrize("pixels", ["raw", "png"])
@pytest.mark.parametrize("family", ["ros2", "protobuf", "json"])
def test_a_recording_of_real_frames_is_those_frames(
    sintel: SintelClip, tmp_path: Path, family: Family, pixels: Pixels
) -> None:
    write_pairs(tmp_path / "recorded.mcap", _pairs(sintel), family, pixels)
    clip = McapClip(McapSettings(recording="recorded.mcap"), tmp_path)
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


@pytest.mark.parametrize("pixels", ["raw", "png"])
def test_a_run_on_the_recording_gives_the_same_table(
    sintel: SintelClip, shared_models: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pixels: Pixels
) -> None:
    monkeypatch.setenv("VFOA_MODELS", str(shared_models.resolve()))
    monkeypatch.chdir(tmp_path)
    labels = "# vfoa annotations 1\nfirst_frame,last_frame,subject,target,note\n"
    write_text(tmp_path / "datasets" / "recorded.toml", MANIFEST)
    write_text(tmp_path / "annotations" / "recorded.csv", f"{labels}{NUMBERS[0]},{NUMBERS[-1]},girl,bird,\n")
    write_text(tmp_path / "both.toml", EXPERIMENT)
    write_pairs(tmp_path / "datasets" / "recorded.mcap", _pairs(sintel), "ros2", pixels)

    plan = prepare(load_experiment("both.toml"), limit=len(NUMBERS), recording=None)
    directory = conduct(plan, tmp_path / "run", workers=1, progress=lambda clip: None)
    rescore(directory)

    with (directory.path / "frames.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    of_clip = {
        clip: [{key: value for key, value in row.items() if key != "clip"} for row in rows if row["clip"] == clip]
        for clip in ("recorded", "sintel_bandage_2")
    }
    assert len(of_clip["recorded"]) == len(NUMBERS)
    assert all(float(row["total"]) > 0 for row in of_clip["recorded"])  # zeros would be equal whatever was read
    assert of_clip["recorded"] == of_clip["sintel_bandage_2"]
