"""Colour and depth in files, in the layouts of data sets, against the arrays that were written."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from typer.testing import CliRunner

from harness.cli.clips import app
from harness.clips.add import add_clip
from harness.clips.manifest import load_manifest
from harness.sources.depth_folder import DepthFolderClip, DepthFolderSettings
from harness.sources.depth_layouts import find_depth_frames
from harness.sources.media.maps import read_depth_file
from tests.adapter_contract import check_contract
from tests.disk import HEIGHT, WIDTH, picture, write_image, write_text
from vfoa.errors import VfoaError

NUMBERS = (3, 4, 7)
CAMERA = {"fx_px": 100.0, "cx_px": 31.5, "cy_px": 23.5}
OPTIONS = ("--fx", "100", "--cx", "31.5", "--cy", "23.5")


def test_numbers_that_may_be_times_are_noted(tmp_path: Path) -> None:
    for n in (0, 33_333):
        write_image(tmp_path / "rgb" / f"{n}.png", picture(n))
        write_counts(tmp_path / "depth" / f"{n}.png", n)
    settings = DepthFolderSettings.model_validate({"colour": "rgb", "depth": "depth", "camera": CAMERA})
    (note,) = DepthFolderClip(settings, tmp_path).notes
    assert "numbers are 33333 apart (median)" in note
    assert DepthFolderClip(settings.model_copy(update={"stamps": "us"}), tmp_path).notes == ()


def test_frames_without_times_and_rate_are_those_of_a_film(tmp_path: Path) -> None:
    for n in (3, 5):
        write_image(tmp_path / "rgb" / f"{n}.png", picture(n))
        write_counts(tmp_path / "depth" / f"{n}.png", n)
    settings = DepthFolderSettings.model_validate({"colour": "rgb", "depth": "depth", "camera": CAMERA})
    clip = DepthFolderClip(settings, tmp_path)
    assert (clip.rate_hz, clip.time_ns(5) - clip.time_ns(3)) == (None, 80_000_000)
    assert ["25 numbers a second" in note for note in clip.notes] == [True]


def test_every_tenth_picture_of_a_camera_has_a_tenth_of_its_rate(tmp_path: Path) -> None:
    for n in (1000, 1010, 1020, 1040):
        write_image(tmp_path / "rgb" / f"{n}.png", picture(n))
        write_counts(tmp_path / "depth" / f"{n}.png", n)
    settings = {"colour": "rgb", "depth": "depth", "camera": CAMERA, "rate_hz": 30}
    clip = DepthFolderClip(DepthFolderSettings.model_validate(settings), tmp_path)
    assert (clip.time_ns(1010) - clip.time_ns(1000), clip.rate_hz) == (333_333_334, 3.0)


def metres(number: int) -> np.ndarray:
    """Depth in whole millimetres, with a corner without any."""
    depth = np.random.default_rng(number).integers(500, 4000, (HEIGHT, WIDTH)) / 1000
    depth[:5, :7] = np.nan
    return depth.astype(np.float32)


def counts(number: int, per_m: float) -> np.ndarray:
    return np.rint(np.nan_to_num(metres(number)) * per_m).astype(np.uint16)


def write_counts(path: Path, number: int, per_m: float = 1000.0) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), counts(number, per_m))


def write_npy(path: Path, number: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, metres(number))


def write_exr(path: Path, number: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    depth = np.where(np.isfinite(metres(number)), metres(number), np.float32(1e10))  # Blender's background
    with OpenEXR.File(header, {"Z": depth}) as file:
        file.write(str(path))


def png(root: Path) -> Path:
    for n in NUMBERS:
        write_image(root / "rgb" / f"{n:06d}.png", picture(n))
        write_counts(root / "depth" / f"{n:06d}.png", n)
    return root


def npy(root: Path) -> Path:
    for n in NUMBERS:
        write_image(root / "color" / f"{n}.png", picture(n))
        write_npy(root / "depth" / f"{n}.npy", n)
    return root


def exr(root: Path) -> Path:
    for n in NUMBERS:
        write_image(root / "images" / f"Image{n:04d}.png", picture(n))
        write_exr(root / "depth" / f"Depth{n:04d}.exr", n)
    return root


def seven_scenes(root: Path) -> Path:
    for n in NUMBERS:
        write_image(root / f"frame-{n:06d}.color.png", picture(n))
        write_counts(root / f"frame-{n:06d}.depth.png", n)
    return root


def open3d(root: Path) -> Path:
    png(root)
    matrix = [100.0, 0, 0, 0, 100.0, 0, 31.5, 23.5, 1]
    text = json.dumps({"width": WIDTH, "height": HEIGHT, "intrinsic_matrix": matrix})
    write_text(root / "camera_intrinsic.json", text)
    return root


def k_text(root: Path) -> Path:
    png(root)
    write_text(root / "K.txt", "100 0 31.5\n0 100 23.5\n0 0 1\n")
    return root


def opencv(root: Path) -> Path:
    png(root)
    lists = {"mtx": [[100.0, 0, 31.5], [0, 100.0, 23.5], [0, 0, 1]], "dist": [[0.0] * 5]}
    write_text(root / "calibration.json", json.dumps(lists))
    return root


def folder_for_each_frame(root: Path) -> Path:
    for n in NUMBERS:
        write_image(root / f"frame_{n:04d}" / "color.png", picture(n))
        write_counts(root / f"frame_{n:04d}" / "depth.png", n)
    return root


def other_names(root: Path) -> Path:
    """Two cameras, by their serial numbers, and names that say nothing; overlapping halves are no pair."""
    for n in NUMBERS:
        for serial in (111, 222):
            write_image(root / "a" / f"frame_{n}_cam{serial}.png", picture(n))
            write_counts(root / "b" / f"frame_{n}_cam{serial}.png", n)
    return root


def beside_pictures_of_depth(root: Path) -> Path:
    """As scripts of a RealSense save: all in one folder, with what they show of the depth."""
    for n in NUMBERS:
        write_image(root / f"color_{n}.png", picture(n))
        write_counts(root / f"depth_{n}.png", n)
        write_image(root / f"depth_colormap_{n}.png", picture(n))
    return root


TUM_KINDS = ("rgb", "depth")


def tum(root: Path) -> Path:
    """Two images without a partner; the lists' times differ by 12 ms."""
    for kind, offset, left_out in (("rgb", 0.0, 4), ("depth", 0.012, 2)):
        lines = ["# timestamp filename"]
        for place, n in enumerate((3, 4, 7, 9, 11)):
            name = f"{kind}/{1305031102.175304 + 0.0333 * place + offset:.6f}.png"
            write_image(root / name, picture(n)) if kind == "rgb" else write_counts(root / name, n, 5000.0)
            if place != left_out:
                lines.append(f"{1305031102.175304 + 0.0333 * place + offset:.6f} {name}")
        write_text(root / f"{kind}.txt", "\n".join(lines) + "\n")
    return root


LAYOUTS: dict[str, tuple[Callable[[Path], Path], tuple[str, ...]]] = {
    "rgb and depth in PNG": (png, OPTIONS),
    "color and depth in npy": (npy, OPTIONS),
    "images and depth in EXR": (exr, OPTIONS),
    "7-Scenes names": (seven_scenes, OPTIONS),
    "with Open3D's intrinsics": (open3d, ()),
    "with K.txt": (k_text, ()),
    "with OpenCV's matrix": (opencv, ()),
    "a folder for each frame": (folder_for_each_frame, OPTIONS),
    "other names": (
        other_names,
        (*OPTIONS, "--set", "colour=a/frame_%d_cam222.png", "--set", "depth=b/frame_%d_cam222.png"),
    ),
    "beside pictures of depth": (beside_pictures_of_depth, OPTIONS),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_one_command_adds_a_layout(layout: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make, options = LAYOUTS[layout]
    path = make(tmp_path / "take")
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["add", str(path), "--name", "mine", *options], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    manifest = load_manifest("mine")
    assert manifest.adapter == "depth_folder"
    clip = manifest.open()
    assert tuple(clip.frames) == NUMBERS
    for n in NUMBERS:
        frame = clip.frame(n)
        assert frame.right is None
        np.testing.assert_allclose(frame.depth_m, metres(n), rtol=1e-6)
        assert (frame.rig.fx_px, frame.rig.cx_px, frame.rig.cy_px) == (100.0, 31.5, 23.5)
        assert np.array_equal(frame.left, picture(n))
    check_contract(clip)
    assert CliRunner().invoke(app, ["check", "mine"], catch_exceptions=False).exit_code == 0


@pytest.mark.parametrize("colour", ["rgb", "color"])
@pytest.mark.parametrize("depth_first", [False, True])  # ICL-NUIM writes depth first
def test_a_list_of_associations_is_read_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, depth_first: bool, colour: str
) -> None:
    path = tum(tmp_path / "rgbd_dataset_freiburg1_xyz")
    (path / "rgb").rename(path / colour)
    rows = [[line for line in (path / f"{kind}.txt").read_text().splitlines() if "#" not in line] for kind in TUM_KINDS]
    pairs = [(rows[0][place], rows[1][other]) for place, other in ((0, 0), (1, 1), (3, 2))]
    lines = (" ".join(pair[::-1] if depth_first else pair) + "\n" for pair in pairs)
    write_text(path / "associations.txt", "".join(lines).replace(" rgb/", f" {colour}/"))
    for kind in TUM_KINDS:
        (path / f"{kind}.txt").unlink()
    monkeypatch.chdir(tmp_path)
    add_clip(path, name="tum")
    clip = load_manifest("tum").open()
    for number, n in ((1, 3), (2, 4), (3, 9)):
        frame = clip.frame(number)
        assert np.array_equal(frame.left, picture(n))
        np.testing.assert_allclose(frame.depth_m, metres(n), atol=1.1e-4)


def test_a_line_of_associations_is_a_frame_whatever_its_times(tmp_path: Path) -> None:
    """Depth of 15 Hz beside colour of 30 Hz, whose clock is 30 ms behind: by time, each would have the one before."""
    lines = []
    for number in range(6):
        write_image(tmp_path / "rgb" / f"{number}.png", picture(number))
        write_counts(tmp_path / "depth" / f"{number // 2}.png", number // 2, 5000.0)
        colour_s, depth_s = 100 + number / 30, 100.03 + number // 2 / 15
        lines.append(f"{colour_s:.6f} rgb/{number}.png {depth_s:.6f} depth/{number // 2}.png\n")
    write_text(tmp_path / "associations.txt", "".join(lines))
    settings = {"colour": "associations.txt", "depth": "associations.txt", "depth_scale": 5000, "camera": CAMERA}
    clip = DepthFolderClip(DepthFolderSettings.model_validate(settings), tmp_path)
    assert (clip.frames, clip.notes) == (tuple(range(1, 7)), ())
    for number in clip.frames:
        frame = clip.frame(number)
        assert np.array_equal(frame.left, picture(number - 1))
        np.testing.assert_allclose(frame.depth_m, metres((number - 1) // 2), atol=1.1e-4)
        assert frame.time_ns == pytest.approx((100 + (number - 1) / 30) * 1e9, abs=1000)


@pytest.mark.parametrize("first", [0, 1])
def test_lists_with_numbers_of_frames_have_no_times(tmp_path: Path, first: int) -> None:
    """ICL-NUIM's: as seconds, its 30 images of a second would be a second apart."""
    lines = []
    for number in range(first, first + 3):
        write_image(tmp_path / "rgb" / f"{number}.png", picture(number))
        write_counts(tmp_path / "depth" / f"{number}.png", number, 5000.0)
        lines.append(f"{number} depth/{number}.png {number} rgb/{number}.png\n")
    write_text(tmp_path / "associations.txt", "".join(lines))
    settings = {"colour": "associations.txt", "depth": "associations.txt", "depth_scale": 5000, "camera": CAMERA}
    clip = DepthFolderClip(DepthFolderSettings.model_validate(settings), tmp_path)
    assert (clip.frames, clip.rate_hz) == ((first, first + 1, first + 2), None)
    assert clip.time_ns(first + 2) - clip.time_ns(first) == 80_000_000
    assert ["25 numbers a second" in note for note in clip.notes] == [True]
    given = DepthFolderClip(DepthFolderSettings.model_validate({**settings, "rate_hz": 30}), tmp_path)
    assert (given.rate_hz, given.time_ns(first + 1)) == (30.0, round((first + 1) * 1e9 / 30))
    assert np.array_equal(clip.frame(first + 1).left, picture(first + 1))
    check_contract(clip)
    write_text(tmp_path / "associations.txt", "".join(lines).replace(" ", ".0 ").replace("png.0", "png"))
    assert DepthFolderClip(DepthFolderSettings.model_validate(settings), tmp_path).rate_hz == 1.0


def test_tum_is_joined_by_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tum(tmp_path / "rgbd_dataset_freiburg1_xyz")
    monkeypatch.chdir(tmp_path)
    add_clip(path, name="tum")
    add_clip(path, name="named", source={"colour": "rgb.txt", "depth": "depth.txt"})
    assert load_manifest("named").source == load_manifest("tum").source
    clip = load_manifest("tum").open()
    assert tuple(clip.frames) == (1, 2, 3)
    assert clip.time_ns(2) == 1305031102208604000
    for number, n in ((1, 3), (2, 4), (3, 9)):
        frame = clip.frame(number)
        assert np.array_equal(frame.left, picture(n))
        np.testing.assert_allclose(frame.depth_m, metres(n), atol=1.1e-4)
        assert (frame.rig.fx_px, frame.rig.cy_px) == (517.3, 255.3)
    assert clip.notes == (
        "rgb.txt: 1 of 4 images have no partner within 20 ms (tolerance_ms)",
        "depth.txt: 1 of 4 images have no partner within 20 ms (tolerance_ms)",
    )
    check_contract(clip)


def test_lists_as_those_of_tum_have_the_unit_that_the_camera_s_file_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Recorders of other cameras write TUM's lists, and mostly millimetres."""
    camera = {"fx": 100.0, "fy": 100.0, "cx": 31.5, "cy": 23.5, "width": WIDTH, "height": HEIGHT}
    monkeypatch.chdir(tmp_path)
    for name, said, factor in (("tum", {}, 1), ("own", {"depth_scale": 0.001}, 5)):
        write_text(tum(tmp_path / "takes" / name) / "intrinsics.json", json.dumps(camera | said))
        add_clip(tmp_path / "takes" / name)
        frame = load_manifest(name).open_images().frame(1)
        np.testing.assert_allclose(frame.depth_m, factor * metres(3), atol=1e-3)


@pytest.mark.parametrize(
    ("pattern", "stamps"),
    [("{:.6f}", "us"), ("{:.3f}", "ms"), ("{0:.0f}123456789", "ns")],
)
def test_names_that_are_times_are_joined_by_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pattern: str, stamps: str
) -> None:
    for place, n in enumerate(NUMBERS):
        time_s = 1718000000.9 + place
        write_image(tmp_path / "take" / "rgb" / f"{pattern.format(time_s)}.png", picture(n))
        write_counts(tmp_path / "take" / "depth" / f"{pattern.format(time_s + 0.004)}.png", n)
    write_counts(tmp_path / "take" / "depth" / f"{pattern.format(1718000009.0)}.png", 9)
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["add", "take", *OPTIONS], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    manifest = load_manifest("take")
    clip = manifest.open_images()
    assert (manifest.source["stamps"], clip.rate_hz, len(clip.frames)) == (stamps, 1.0, len(NUMBERS))
    tick_ns = {"ns": 1, "us": 10**3, "ms": 10**6}[stamps]
    for number, n in zip(clip.frames, NUMBERS, strict=True):
        assert clip.time_ns(number) == number * tick_ns
        np.testing.assert_allclose(clip.frame(number).depth_m, metres(n), rtol=1e-6)
    assert clip.notes == ("depth/*.png: 1 of 4 images have no partner within 20 ms (tolerance_ms)",)
    check_contract(clip)


@pytest.mark.parametrize(
    ("place", "text"),
    [
        ("timestamps.txt", "1718000000.0\n1718000000.1\n1718000000.5\n"),
        ("rgb/timestamps.csv", "frame,timestamp_ms\n3,0\n4,100\n7,500\n"),
    ],
)
def test_times_in_a_file_are_those_of_the_colour_images(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str, text: str
) -> None:
    path = write_text(png(tmp_path / "take") / place, text)
    (tmp_path / "take" / "depth" / "000004.png").unlink()
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["add", "take", *OPTIONS], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    clip = load_manifest("take").open()
    assert (tuple(clip.frames), clip.time_ns(7) - clip.time_ns(3), clip.rate_hz) == ((3, 7), 500_000_000, 2.0)
    check_contract(clip)
    write_text(path, text[: text.rstrip().rindex("\n") + 1])
    with pytest.raises(VfoaError, match="found 2 times; expected 3"):
        CliRunner().invoke(app, ["add", "take", "--name", "wrong", *OPTIONS], catch_exceptions=False)
    assert CliRunner().invoke(app, ["add", "take", "--name", "rate", *OPTIONS, "--set", "rate_hz=30"]).exit_code == 0
    assert load_manifest("rate").open().time_ns(3) == 100_000_000


def test_a_given_tolerance_counts_where_names_are_times(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for n in range(3):
        write_image(tmp_path / "take" / "rgb" / f"{1718000000000 + 200 * n}.png", picture(n))
        write_counts(tmp_path / "take" / "depth" / f"{1718000000050 + 200 * n}.png", n)
    monkeypatch.chdir(tmp_path)
    arguments = ["add", "take", *OPTIONS, "--set", "tolerance_ms=60"]
    for more in ([], ["--name", "named", "--set", "colour=rgb", "--set", "depth=depth"]):
        done = CliRunner().invoke(app, [*arguments, *more], catch_exceptions=False)
        assert done.exit_code == 0, done.output
    for name in ("take", "named"):
        assert len(load_manifest(name).open().frames) == 3


def test_times_beside_the_numbers_of_frames_are_theirs(tmp_path: Path) -> None:
    """As Orbbec's example saves images; the stamps of both cameras differ."""
    for place, n in enumerate((8, 9, 10)):
        write_image(tmp_path / "rgb" / f"color_64x48_{n}_{1718000000000 + 100 * place}.png", picture(n))
        write_counts(tmp_path / "depth" / f"depth_64x48_{n}_{1718000000040 + 100 * place}.png", n)
    settings = {"colour": "rgb", "depth": "depth", "camera": CAMERA}
    clip = DepthFolderClip(DepthFolderSettings.model_validate(settings), tmp_path)
    assert (tuple(clip.frames), clip.rate_hz, clip.time_ns(9)) == ((8, 9, 10), 10.0, 1718000000100 * 10**6)
    assert clip.notes == ()
    slow = DepthFolderClip(DepthFolderSettings.model_validate(settings | {"rate_hz": 30}), tmp_path)
    assert slow.time_ns(9) == 300_000_000


@pytest.mark.parametrize("side", ["colour", "depth"])
def test_a_film_of_one_side_says_how_to_make_images(side: str) -> None:
    with pytest.raises(ValueError, match=rf"{side}: found the film 'rgb\.mp4'.*ffmpeg -i rgb\.mp4 .*-start_number 0"):
        DepthFolderSettings.model_validate({"colour": "rgb", "depth": "depth", "camera": CAMERA, side: "rgb.mp4"})


def test_stamps_have_no_rate_beside_them() -> None:
    settings = {"colour": "rgb", "depth": "depth", "camera": CAMERA, "stamps": "us", "rate_hz": 30}
    with pytest.raises(ValueError, match=r"stamps: .*rate_hz"):
        DepthFolderSettings.model_validate(settings)


def test_without_a_calibration_it_says_what_to_give(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"^[^\n]*--fx --cx --cy[^\n]*$"):
        add_clip(png(tmp_path / "take"))


def test_a_calibration_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    path = write_text(png(tmp_path / "take") / "intrinsics.json", '{"fx": 100}')
    with pytest.raises(VfoaError, match=rf"{path}: found no fy"):
        add_clip(tmp_path / "take")


def test_colour_and_depth_that_are_numbered_from_other_numbers_are_noted(tmp_path: Path) -> None:
    for number in range(4):
        write_image(tmp_path / "rgb" / f"{number + 1:04d}.png", picture(number))  # as ffmpeg numbers them
        write_image(tmp_path / "depth" / f"{number:04d}.png", np.full(picture(number).shape[:2], 900, np.uint16))
    frames = find_depth_frames(tmp_path, "rgb/*.png", "depth/*.png", 20)
    assert [*frames.colours] == [1, 2, 3]
    assert "4 images from 1, depth/*.png 4 from 0" in frames.notes[2]


@pytest.mark.parametrize(
    ("shape", "kind", "says"),
    [
        ((20, 30), np.uint16, "30 x 20"),
        ((HEIGHT, WIDTH), np.uint8, "16 bits"),
        ((HEIGHT, WIDTH, 3), np.uint16, "channel"),
    ],
)
def test_what_is_no_aligned_depth_is_refused(tmp_path: Path, shape: tuple[int, ...], kind: type, says: str) -> None:
    root = png(tmp_path / "take")
    assert cv2.imwrite(str(root / "depth" / "000003.png"), np.full(shape, 99, kind))
    settings = DepthFolderSettings.model_validate({"colour": "rgb", "depth": "depth", "camera": CAMERA})
    with pytest.raises(VfoaError, match=says):
        DepthFolderClip(settings, root).frame(3)


@pytest.mark.parametrize("suffix", ["npy", "exr", "png", "tif", "pgm"])
def test_whole_numbers_are_millimetres_in_every_file(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    if suffix == "npy":
        np.save(path, counts(3, 1000.0))
    elif suffix == "exr":
        with OpenEXR.File({}, {"Z": counts(3, 1000.0).astype(np.uint32)}) as file:
            file.write(str(path))
    else:
        write_counts(path, 3)
    np.testing.assert_allclose(read_depth_file(path, None), metres(3), rtol=1e-6)


def test_depth_in_another_unit_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = png(tmp_path / "take")
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["add", str(path), "--name", "mine", *OPTIONS, "--set", "depth_scale=500"])
    assert done.exit_code == 0, done.output
    np.testing.assert_allclose(load_manifest("mine").open_images().frame(3).depth_m, 2 * metres(3), rtol=1e-6)


def test_depth_is_in_the_unit_that_the_camera_s_file_says(tmp_path: Path) -> None:
    """A RealSense D405 counts tenths of a millimetre; what is floating point is in metres all the same."""
    camera = {"fx": 100.0, "fy": 100.0, "ppx": 31.5, "ppy": 23.5, "depth_scale": 9.999999747378752e-05}
    for root, write in ((tmp_path / "counts", png), (tmp_path / "metres", npy)):
        write_text(write(root) / "camera_params.json", json.dumps(camera))
    for n in NUMBERS:
        write_counts(tmp_path / "counts" / "depth" / f"{n:06d}.png", n, 10_000.0)
    settings = {"colour": "rgb", "depth": "depth", "calibration": "camera_params.json"}
    clip = DepthFolderClip(DepthFolderSettings.model_validate(settings), tmp_path / "counts")
    np.testing.assert_allclose(clip.frame(3).depth_m, metres(3), rtol=1e-6)
    assert "10000 per metre, as camera_params.json says" in clip.notes[-1]
    pair = {"color": camera, "depth": {**camera, "fx": 90.0}, "depth_scale_m": 0.0001}
    write_text(tmp_path / "counts" / "both.json", json.dumps(pair))
    both = DepthFolderClip(DepthFolderSettings.model_validate(settings | {"calibration": "both.json"}), clip._folder)
    assert ["of color, depth the images' camera is color" in note for note in both.notes[-2:]] == [True, False]
    assert both.frame(3).rig == clip.frame(3).rig
    np.testing.assert_allclose(both.frame(3).depth_m, metres(3), rtol=1e-6)
    check_contract(clip)
    given = DepthFolderClip(DepthFolderSettings.model_validate({**settings, "depth_scale": 5000}), tmp_path / "counts")
    np.testing.assert_allclose(given.frame(3).depth_m, 2 * metres(3), rtol=1e-6)
    settings |= {"colour": "color", "depth": "depth/*.npy"}
    floats = DepthFolderClip(DepthFolderSettings.model_validate(settings), tmp_path / "metres")
    np.testing.assert_allclose(floats.frame(3).depth_m, metres(3), rtol=1e-6)
