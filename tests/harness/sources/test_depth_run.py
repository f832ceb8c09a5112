"""bandage_2 as colour and depth, recorded by other libraries: added, checked and run like any clip."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.run.table_records import read_records
from harness.sources.recordings.clip import RecordingClip
from harness.sources.recordings.settings import RecordingSettings
from harness.sources.sintel import SintelClip, SintelSettings
from tests.command import vfoa
from tests.depth_recordings import (
    CODERS,
    FORMATS,
    DepthForm,
    Encoder,
    Format,
    Lens,
    Shot,
    write_take,
    write_video_take,
)
from tests.disk import write_text
from vfoa.geometry import depth_from_disparity

NUMBERS = (1, 2)
EXPERIMENT = """
[defaults]
segmentation = { model = "coco_panoptic", root = "${VFOA_DATA}/bandage_2_panoptic" }
heads.detector = "yunet"
head_pose.model = "none"
gaze.model = "none"

[[configuration]]
name = "depth"
stereo.matcher = "MATCHER"
"""


@pytest.fixture
def sintel(shared_data: Path, shared_models: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SintelClip:
    monkeypatch.setenv("VFOA_DATA", str(shared_data.resolve()))
    monkeypatch.setenv("VFOA_MODELS", str(shared_models.resolve()))
    monkeypatch.chdir(tmp_path)
    return SintelClip(SintelSettings.model_validate({"scene": "bandage_2"}), shared_data.resolve() / "sintel")


def shot(sintel: SintelClip, number: int) -> Shot:
    frame, truth = sintel.frame(number), sintel.truth(number).disparity
    assert truth is not None
    rig = frame.rig
    millimetres = np.rint(1000 * depth_from_disparity(truth.disparity_px, rig))
    depth = np.where(millimetres <= 65535, np.nan_to_num(millimetres), 0).astype(np.uint16)
    lens = Lens(width=rig.width_px, height=rig.height_px, fx=rig.fx_px, cx=rig.cx_px, cy=rig.cy_px)
    return Shot(stamp_ns=frame.time_ns + 10**18, colour=frame.left, depth_mm=depth, lens=lens)


def boxes(clip: str, matcher: str, work: Path) -> dict[tuple[int, str], np.ndarray]:
    """Centre and half size (2, 3) of each object's box, by frame and label."""
    name = f"{clip}_{matcher}"
    write_text(work / f"{name}.toml", EXPERIMENT.replace("MATCHER", matcher))
    plan = prepare(load_experiment(f"{name}.toml", clips=(clip,)), limit=len(NUMBERS))
    directory = run_plan(plan, work / name, workers=1, progress=lambda clip: None)
    found = {}
    for record in read_records(directory):
        for target in record.targets:
            assert target.box is not None
            found[record.frame, target.label] = np.array([target.box.center_m, target.box.half_size_m])
    return found


def assert_within_one_percent(
    found: dict[tuple[int, str], np.ndarray], expected: dict[tuple[int, str], np.ndarray]
) -> None:
    assert found.keys() == expected.keys()
    assert {label for _, label in found} == {"person", "bird"}
    for key, box in expected.items():
        size = np.linalg.norm(box[1])
        assert np.abs(found[key] - box).max() <= 0.01 * size, key


def test_boxes_are_those_of_the_truth_in_every_container_and_form(
    sintel: SintelClip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shots = [shot(sintel, number) for number in NUMBERS]
    expected = boxes("sintel_bandage_2", "truth", tmp_path)
    ways: list[tuple[Format, DepthForm]] = [*((kind, "raw") for kind in FORMATS), ("bag", "png")]
    for kind, form in ways:
        name = f"{kind}_{form}"
        path = write_take(tmp_path, kind, shots, form, name)
        code, said, _ = vfoa(monkeypatch, capsys, "clips", "add", str(path), "--name", name, "--subject", "girl")
        assert code == 0
        assert "measured" in said
        assert vfoa(monkeypatch, capsys, "clips", "check", name)[0] == 0
        assert_within_one_percent(boxes(name, "sensor", tmp_path), expected)


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("form", ["raw", "png"])
def test_measured_depth_is_the_true_one_to_a_millimetre(
    sintel: SintelClip, tmp_path: Path, kind: Format, form: DepthForm
) -> None:
    taken = shot(sintel, 1)
    path = write_take(tmp_path, kind, [taken], form)
    frame = RecordingClip(RecordingSettings(recording=path.name), tmp_path).frame(1)
    expected = np.where(taken.depth_mm > 0, taken.depth_mm / 1000, np.nan)
    np.testing.assert_allclose(frame.depth_m, expected, rtol=1e-6)


def test_the_same_frames_as_h264_pair_with_the_raw_ones(sintel: SintelClip, tmp_path: Path) -> None:
    shots = [shot(sintel, number) for number in range(1, 13)]
    lens = shots[0].lens
    coder, options = CODERS["h264"]
    packets = Encoder(coder, lens.width, lens.height, options, gop=5).packets([each.colour for each in shots])
    raw = write_take(tmp_path, "mcap", shots, name="raw")
    path = write_video_take(tmp_path / "video.mcap", "h264", packets, shots)
    pixels = RecordingClip(RecordingSettings(recording=raw.name), tmp_path)
    video = RecordingClip(RecordingSettings(recording=path.name), tmp_path)
    assert video.frames == pixels.frames
    in_turn = {number: video.frame(number) for number in video.frames}
    for number in video.frames:
        one, other = pixels.frame(number), in_turn[number]
        assert one.time_ns == other.time_ns
        assert np.array_equal(one.depth_m, other.depth_m, equal_nan=True)
        assert np.abs(one.left.astype(int) - other.left.astype(int)).mean() < 3
    for number in (9, 2, 12, 5, 6, 1):
        assert np.array_equal(video.frame(number).left, in_turn[number].left)
