from __future__ import annotations

import shutil
import struct
from pathlib import Path

import numpy as np
import pytest

from harness.clips.add import add_clip
from harness.pipeline.ground_truth import OracleSettings, TruthMatcher, TruthSegmenter
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.sources.sintel import SintelClip, SintelSettings
from tests.disk import HEIGHT, WIDTH, picture, sintel_disparity, sintel_scene, write_bytes, write_image
from vfoa.errors import VfoaError
from vfoa.geometry import depth_from_disparity

SETTINGS = SintelSettings.model_validate({"scene": "alley"})


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return sintel_scene(tmp_path)


def test_frames_come_with_the_film_s_numbers_and_their_own_camera(root: Path) -> None:
    clip = SintelClip(SETTINGS, root)
    assert list(clip.frames) == [1, 2, 3]
    frame = clip.frame(2)
    assert frame.index == 2
    assert frame.rig.fx_px == 102.0
    assert (frame.rig.cx_px, frame.rig.cx_right_px, frame.rig.baseline_m) == (31.5, 31.5, 0.10)
    assert np.array_equal(frame.left, picture(2))
    assert np.array_equal(frame.right, picture(1002))
    assert clip.frame(3).time_ns - frame.time_ns == pytest.approx(1e9 / 24, abs=1)


def test_nothing_is_true_where_nothing_is_there(root: Path) -> None:
    clip = SintelClip(SETTINGS, root)
    truth = clip.truth(1)
    assert (truth.disparity, truth.instances) == (None, None)


def test_true_disparity_is_decoded_to_a_sixty_fourth(root: Path) -> None:
    expected = np.random.default_rng(0).uniform(0.1, 1000, (HEIGHT, WIDTH))
    write_image(root / "training/disparities/alley/frame_0001.png", sintel_disparity(expected))
    truth = SintelClip(SETTINGS, root).truth(1)
    assert truth.disparity is not None
    np.testing.assert_allclose(truth.disparity.disparity_px, expected, atol=1 / 128 + 1e-4)


def test_the_cap_and_zero_are_unknown(root: Path) -> None:
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[0, 0] = (255, 255, 0)
    image[0, 1] = (2, 0, 0)
    write_image(root / "training/disparities/alley/frame_0001.png", image)
    truth = SintelClip(SETTINGS, root).truth(1)
    assert truth.disparity is not None
    assert np.isnan(truth.disparity.disparity_px[0, 0])
    assert truth.disparity.disparity_px[0, 1] == 8.0
    assert np.isnan(truth.disparity.disparity_px[1:]).all()


def test_segments_keep_one_id_over_the_scene(root: Path) -> None:
    near, far = np.zeros((2, HEIGHT, WIDTH, 3), np.uint8)
    near[:4], near[4:8] = (0, 0, 7), (1, 0, 0)
    far[:2] = (1, 0, 0)
    write_image(root / "training/segmentation/alley/frame_0001.png", near)
    write_image(root / "training/segmentation/alley/frame_0002.png", far)
    clip = SintelClip(SETTINGS, root)
    first, second = clip.truth(1).instances, clip.truth(2).instances
    assert first is not None
    assert second is not None
    big = int(first.ids[4, 0])
    assert [instance.id for instance in first.instances] == [big, 7]
    assert np.array_equal(first.mask(7), near[..., 2] == 7)
    assert [instance.id for instance in second.instances] == [big]


def test_the_digest_follows_the_contents_and_not_the_path(root: Path, tmp_path: Path) -> None:
    before = SintelClip(SETTINGS, root).digest()
    moved = tmp_path / "moved"
    shutil.copytree(root / "training", moved / "training")
    assert SintelClip(SETTINGS, moved).digest() == before
    digests = {before}
    for changed in ("clean_right/alley/frame_0003", "segmentation/alley/frame_0002", "disparities/alley/frame_0001"):
        write_image(moved / f"training/{changed}.png", picture(7))
        digests.add(SintelClip(SETTINGS, moved).digest())
    assert len(digests) == 4


@pytest.mark.parametrize("kind", ["clean_right", "camdata_left"])
def test_a_missing_part_is_found_when_the_clip_is_opened(root: Path, kind: str) -> None:
    suffix = "cam" if kind == "camdata_left" else "png"
    missing = root / "training" / kind / "alley" / f"frame_0002.{suffix}"
    missing.unlink()
    with pytest.raises(VfoaError) as error:
        SintelClip(SETTINGS, root)
    holder = "the depth set, which holds the cameras," if suffix == "cam" else "the stereo set"
    assert str(error.value) == (
        f"{missing}: no such file; expected {holder} of MPI Sintel (vfoa clips fetch sintel) (1 of 3 are missing)"
    )


def test_a_part_that_a_stage_asks_for_is_named(root: Path) -> None:
    clip = SintelClip(SETTINGS, root)
    frame = clip.frame(2)
    with pytest.raises(VfoaError) as error:
        TruthSegmenter(OracleSettings(), clip).segment(frame)
    path = root / "training/segmentation/alley/frame_0002.png"
    assert str(error.value) == (
        'SintelClip, frame 2: the clip has no true instances; needed by segmentation.model = "truth" '
        f"({path}: no such file; expected the segmentation set of MPI Sintel (vfoa clips fetch sintel))"
    )
    with pytest.raises(VfoaError, match=r"disparities/alley/frame_0002\.png: "):
        TruthMatcher(OracleSettings(), clip).match(frame)
    write_image(path, np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    again = SintelClip(SETTINGS, root)
    assert TruthSegmenter(OracleSettings(), again).segment(frame).instances == ()


def test_a_run_that_needs_a_missing_part_names_it(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    add_clip(root)
    plan = prepare(load_experiment("demo", clips=("sintel_alley",)), limit=1)
    with pytest.raises(VfoaError, match=r"frame_0001\.png: no such file.*MPI"):
        run_plan(plan, tmp_path / "run", workers=1, progress=lambda clip: None)


def test_wrong_places_are_one_line(root: Path) -> None:
    with pytest.raises(VfoaError, match=r"nowhere/training: no such folder"):
        SintelClip(SETTINGS, root / "nowhere")
    with pytest.raises(VfoaError, match=r"final_left: no such folder"):
        SintelClip(SintelSettings.model_validate({"scene": "alley", "pass": "final"}), root)
    with pytest.raises(VfoaError, match=r"no scene 'ally'; did you mean 'alley'"):
        SintelClip(SintelSettings.model_validate({"scene": "ally"}), root)
    with pytest.raises(VfoaError, match="no frame 4; expected 1 to 3"):
        SintelClip(SETTINGS, root).frame(4)


@pytest.mark.parametrize("name", ["frame_1.png", "frame_00001.png", "frame_0001 (copy).png", "._frame_0001.png"])
def test_a_file_that_is_not_called_as_a_frame_is_none(root: Path, name: str) -> None:
    write_image(root / "training/clean_left/alley" / name, picture(1))
    assert SintelClip(SintelSettings(scene="alley"), root).frames == (1, 2, 3)


@pytest.mark.parametrize("kind", ["disparities", "segmentation"])
def test_a_truth_of_another_size_is_one_line(root: Path, kind: str) -> None:
    path = write_image(root / f"training/{kind}/alley/frame_0001.png", np.zeros((1, WIDTH, 3), np.uint8))
    clip = SintelClip(SintelSettings(scene="alley"), root)
    with pytest.raises(VfoaError, match=rf"{path}: found a map of 64 x 1 pixels.*64 x 48"):
        clip.truth(1)


def test_a_right_image_of_another_size_is_one_line(root: Path) -> None:
    write_image(root / "training/clean_right/alley/frame_0001.png", picture(0, WIDTH, HEIGHT - 1))
    with pytest.raises(VfoaError, match=r"frame_0001\.png: .*64 x 47 .* 64 x 48"):
        SintelClip(SETTINGS, root).frame(1)


@pytest.mark.parametrize("data", [b"", b"x" * 172, struct.pack("<f", 202021.25) + bytes(168)])
def test_a_damaged_camera_is_one_line(root: Path, data: bytes) -> None:
    write_bytes(root / "training/camdata_left/alley/frame_0001.cam", data)
    with pytest.raises(VfoaError, match=r"frame_0001\.cam: "):
        SintelClip(SETTINGS, root).frame(1)


def test_bandage_2_agrees_with_its_own_depth(shared_data: Path) -> None:
    clip = SintelClip(SintelSettings.model_validate({"scene": "bandage_2"}), shared_data / "sintel")
    assert list(clip.frames) == list(range(1, 51))
    for number in (1, 25, 50):
        frame, truth = clip.frame(number), clip.truth(number)
        path = shared_data / f"sintel/training/depth/bandage_2/frame_{number:04d}.dpt"
        depth = np.fromfile(path, "<f4", offset=12).reshape(frame.left.shape[:2])
        assert (frame.rig.fx_px, frame.rig.cx_px, frame.rig.cy_px) == (896.0, 511.5, 217.5)
        assert truth.disparity is not None
        near = np.isfinite(truth.disparity.disparity_px) & (depth < 50)
        found = depth_from_disparity(truth.disparity.disparity_px[near], frame.rig)
        quantum = depth[near] ** 2 / (frame.rig.fx_px * frame.rig.baseline_m) / 64
        assert near.mean() > 0.5
        assert (np.abs(found - depth[near]) <= quantum).all()
