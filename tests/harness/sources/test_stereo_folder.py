from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from harness.clips.manifest import load_manifest
from harness.files.ascending import numbers_per_second
from harness.sources.stereo_folder import StereoFolderClip, StereoFolderSettings
from tests.disk import HEIGHT, WIDTH, picture, stereo_pair_folder, write_image, write_text
from vfoa.errors import VfoaError

CAMERA = {"fx_px": 50.0, "cx_px": 31.5, "cy_px": 23.5, "baseline_m": 0.1}
SETTINGS = StereoFolderSettings.model_validate({"left": "left", "right": "right", "camera": CAMERA})


def _projection(fx: float, cx: float, tx: float = 0.0) -> np.ndarray:
    return np.array([[fx, 0, cx, tx], [0, fx, 23.5, 0], [0, 0, 1, 0]], dtype=np.float64)


def _opencv(path: Path, **nodes: object) -> Path:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in nodes.items():
        storage.write(name, value)
    storage.release()
    return path


def test_pairs_are_joined_by_number_and_gaps_stay(tmp_path: Path) -> None:
    clip = StereoFolderClip(SETTINGS, stereo_pair_folder(tmp_path, (2, 9, 10)))
    assert list(clip.frames) == [2, 9, 10]
    frame = clip.frame(9)
    assert np.array_equal(frame.left, picture(9))
    assert np.array_equal(frame.right, picture(1009))
    assert (frame.index, frame.rig.fy_px, frame.rig.cx_right_px) == (9, 50.0, 31.5)


def test_images_of_a_camera_that_hung_upside_down_are_turned(tmp_path: Path) -> None:
    for side, seed in (("left", 1), ("right", 2)):
        (tmp_path / side).mkdir()
        image = Image.fromarray(picture(seed)[::-1, ::-1])
        exif = image.getexif()
        exif[0x0112] = 3
        image.save(tmp_path / side / "1.png", exif=exif)
    clip = StereoFolderClip(SETTINGS, tmp_path)
    assert np.array_equal(clip.frame(1).left, picture(1))
    assert np.array_equal(clip.frame(1).right, picture(2))
    assert [note for note in clip.notes if "180 degrees" in note and "EXIF" in note] == [*clip.notes]
    assert len(clip.notes) == 2


def test_numbers_that_may_be_times_are_noted(tmp_path: Path) -> None:
    """A simulation counts from 0, so its nanoseconds do not have the digits of today's."""
    root = stereo_pair_folder(tmp_path, (0, 33_333_333, 66_666_666))
    (note,) = StereoFolderClip(SETTINGS, root).notes
    assert "numbers are 3.33333e+07 apart (median)" in note
    for times in ({"stamps": "ns"}, {"rate_hz": 1e6}):
        assert StereoFolderClip(SETTINGS.model_copy(update=times), root).notes == ()


def test_images_without_times_and_rate_are_those_of_a_film(tmp_path: Path) -> None:
    """As frames without times are for the posterior: at a second each, every frame would be a look of its own."""
    clip = StereoFolderClip(SETTINGS, stereo_pair_folder(tmp_path))
    assert (clip.rate_hz, clip.time_ns(3) - clip.time_ns(1)) == (None, 80_000_000)
    (note,) = clip.notes
    assert "25 numbers a second" in note
    assert "rate_hz" in note
    (tmp_path / "one").mkdir()
    assert StereoFolderClip(SETTINGS, stereo_pair_folder(tmp_path / "one", (7,))).notes == ()


def test_the_rate_gives_the_times(tmp_path: Path) -> None:
    settings = SETTINGS.model_copy(update={"rate_hz": 25.0})
    clip = StereoFolderClip(settings, stereo_pair_folder(tmp_path))
    assert (clip.rate_hz, clip.frame(3).time_ns) == (25.0, 120_000_000)


def test_every_tenth_picture_of_a_camera_has_a_tenth_of_its_rate(tmp_path: Path) -> None:
    settings = SETTINGS.model_copy(update={"rate_hz": 30.0})
    clip = StereoFolderClip(settings, stereo_pair_folder(tmp_path, (1000, 1010, 1020, 1040)))
    assert (clip.time_ns(1010) - clip.time_ns(1000), clip.rate_hz) == (333_333_334, 3.0)
    assert numbers_per_second(clip.frames, clip.rate_hz) == 30.0


@pytest.mark.parametrize(("side", "other"), [("left", "right"), ("right", "left")])
def test_images_without_a_partner_are_left_out_and_said(tmp_path: Path, side: str, other: str) -> None:
    stereo_pair_folder(tmp_path)
    (tmp_path / side / "000002.png").unlink()
    clip = StereoFolderClip(SETTINGS, tmp_path)
    assert clip.frames == (1, 3)
    assert clip.notes[:-1] == (f"1 {other} image has no {side} one, left out: frame 2",)
    with pytest.raises(VfoaError, match="no frame 2; expected 1 to 3"):
        clip.frame(2)


def test_sides_that_are_numbered_from_other_numbers_are_noted(tmp_path: Path) -> None:
    stereo_pair_folder(tmp_path)
    for number in (3, 2, 1):
        (tmp_path / "right" / f"00000{number}.png").rename(tmp_path / "right" / f"00000{number + 1}.png")
    clip = StereoFolderClip(SETTINGS, tmp_path)
    assert clip.frames == (2, 3)
    assert "3 left images from 1 and 3 right ones from 2" in clip.notes[2]
    assert "right_offset = 1" in clip.notes[2]
    clip = StereoFolderClip(SETTINGS.model_copy(update={"right_offset": 1}), tmp_path)
    assert (clip.frames, len(clip.notes)) == ((1, 2, 3), 1)


def test_sides_without_a_common_number_are_one_line(tmp_path: Path) -> None:
    write_image(tmp_path / "left" / "1.png", picture(1))
    write_image(tmp_path / "right" / "2.png", picture(2))
    with pytest.raises(VfoaError, match=r"both sides: left .*1\.png, right"):
        StereoFolderClip(SETTINGS, tmp_path)


def test_other_sizes_wrong_folders_and_numbers_are_one_line(tmp_path: Path) -> None:
    stereo_pair_folder(tmp_path)
    write_image(tmp_path / "right" / "000001.png", picture(0, WIDTH + 2, HEIGHT))
    clip = StereoFolderClip(SETTINGS, tmp_path)
    with pytest.raises(VfoaError, match=r"right/000001\.png: .*66 x 48 .* 64 x 48"):
        clip.frame(1)
    with pytest.raises(VfoaError, match="no frame 7; expected 1 to 3"):
        clip.frame(7)
    with pytest.raises(VfoaError, match=r"source\.left: 'lef' matches no file"):
        StereoFolderClip(SETTINGS.model_copy(update={"left": "lef"}), tmp_path)
    with pytest.raises(VfoaError, match="gone: no such folder"):
        StereoFolderClip(SETTINGS, tmp_path / "gone")


@pytest.mark.parametrize("first_read", [1, 3])
def test_images_of_another_size_than_the_first_are_refused(tmp_path: Path, first_read: int) -> None:
    stereo_pair_folder(tmp_path)
    for side in ("left", "right"):
        write_image(tmp_path / side / "000003.png", picture(0, WIDTH // 2, HEIGHT // 2))
    clip = StereoFolderClip(SETTINGS, tmp_path)
    with suppress(VfoaError):
        clip.frame(first_read)
    assert clip.frame(2).left.shape == (HEIGHT, WIDTH, 3)
    with pytest.raises(VfoaError, match=r"left/000003\.png: found an image of 32 x 24 pixels; expected 64 x 48, as in"):
        clip.frame(3)


def test_other_frames_are_read_if_the_first_one_is_damaged(tmp_path: Path) -> None:
    stereo_pair_folder(tmp_path)
    (tmp_path / "left" / "000001.png").write_bytes(b"")
    clip = StereoFolderClip(SETTINGS, tmp_path)
    assert clip.frame(2).left.shape == (HEIGHT, WIDTH, 3)
    with pytest.raises(VfoaError, match=r"000001\.png: the file is empty"):
        clip.frame(1)


def test_times_beyond_64_bits_and_a_camera_of_true_are_one_line(tmp_path: Path) -> None:
    for number in (1_700_000_000_000_000_000, 1_700_000_000_100_000_000):
        for side in ("left", "right"):
            write_image(tmp_path / side / f"{number}.png", picture(0, WIDTH, HEIGHT))
    head = 'name = "clip"\nadapter = "stereo_folder"\nroot = "."\n[source]\nleft = "left"\nright = "right"\n'
    camera = "[source.camera]\nfx_px = {}\ncx_px = 3\ncy_px = 2\nbaseline_m = 0.1\n"
    with pytest.raises(VfoaError, match=r'clip\.toml: frame 17000.* stamps = "ns"'):
        load_manifest(write_text(tmp_path / "clip.toml", f"{head}rate_hz = 10\n{camera.format(9)}")).open()
    with pytest.raises(VfoaError, match="fx_px: expected a number, found true"):
        load_manifest(write_text(tmp_path / "clip.toml", head + camera.format("true"))).open()


def test_the_digest_depends_on_images_calibration_and_rate(tmp_path: Path) -> None:
    stereo_pair_folder(tmp_path)
    wider = SETTINGS.model_copy(update={"camera": SETTINGS.camera.model_copy(update={"baseline_m": 0.2})})  # type: ignore[union-attr]
    faster = SETTINGS.model_copy(update={"rate_hz": 10.0})
    digests = [StereoFolderClip(each, tmp_path).digest() for each in (SETTINGS, SETTINGS, wider, faster)]
    write_image(tmp_path / "left" / "000003.png", picture(8))
    digests.append(StereoFolderClip(SETTINGS, tmp_path).digest())
    assert digests[0] == digests[1]
    assert len(set(digests)) == 4


@pytest.mark.parametrize("both", [{}, {"calibration": "c.txt", "camera": CAMERA}])
def test_exactly_one_calibration_is_asked_for(both: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="expected either calibration"):
        StereoFolderSettings.model_validate({"left": "l", "right": "r", **both})


def test_a_missing_calibration_is_named(tmp_path: Path) -> None:
    stereo_pair_folder(tmp_path)
    settings = StereoFolderSettings(left="left", right="right", calibration="gone.yml")
    with pytest.raises(VfoaError, match=r"gone\.yml: no such file"):
        StereoFolderClip(settings, tmp_path)


def test_a_calibration_without_a_name_is_one_line(tmp_path: Path) -> None:
    stereo_pair_folder(tmp_path)
    with pytest.raises(VfoaError, match=rf"{tmp_path}: .*directory"):
        StereoFolderClip(StereoFolderSettings(left="left", right="right", calibration=""), tmp_path)


def test_a_calibration_of_another_aspect_is_refused(tmp_path: Path) -> None:
    stereo_pair_folder(tmp_path)
    nodes = {"P1": _projection(50, 30), "P2": _projection(50, 30, -5.0)}
    _opencv(tmp_path / "c.yml", image_width=128, image_height=90, **nodes)
    clip = StereoFolderClip(StereoFolderSettings(left="left", right="right", calibration="c.yml"), tmp_path)
    with pytest.raises(VfoaError, match=r"000001\.png: images of 64 x 48 pixels .* 128 x 90,"):
        clip.frame(1)
