"""Layouts of public stereo sets and of people's folders: one command adds each, and the check passes.

The rows are those of the table in docs/sources.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from harness.clips.manifest import load_manifest
from tests.calibrations import write_opencv, write_yaml
from tests.disk import HEIGHT, WIDTH, write_image, write_text
from tests.harness.clips.adding import NUMBERS, images, refused, vfoa, views
from tests.recordings import recorder
from vfoa.errors import VfoaError

pytestmark = pytest.mark.usefixtures("work_here")

K_ROWS = "[[100, 0, 31.5],\n[0, 100, 23.5],\n[0, 0, 1]]\n"
K_LINE = "100 0 31.5 0 100 23.5 0 0 1\n"


@dataclass(frozen=True, kw_only=True)
class Layout:
    """A layout: a function that makes the folder, the options needed to add it, and the expected findings."""

    make: Callable[[Path], object]
    said: tuple[str, ...] = ()
    frames: int = 1
    cx_right_px: float = 31.5


def pair(root: Path, left: str, right: str, number: int = 1) -> None:
    for name, image in zip((left, right), views(number), strict=True):
        write_image(root / name, image)


def middlebury(root: Path) -> None:
    pair(root, "im0.png", "im1.png")
    write_text(
        root / "calib.txt",
        "cam0=[100 0 31.5; 0 100 23.5; 0 0 1]\ncam1=[100 0 33.5; 0 100 23.5; 0 0 1]\ndoffs=2\nbaseline=120\n"
        f"width={WIDTH}\nheight={HEIGHT}\nndisp=60\nisint=0\n",
    )


def middlebury_2006(root: Path) -> None:
    for number in range(7):
        write_image(root / f"view{number}.png", views(1)[number == 5])
    write_image(root / "disp1.png", views(1)[0])


def numbered(root: Path) -> None:
    images(root, "I1_{:06d}.png", "I2_{:06d}.png")


def euroc(root: Path) -> None:
    for number in (1, 2, 3):
        stamp = 1_403_636_579_763_555_584 + number * 50_000_000
        pair(root / "mav0", f"cam0/data/{stamp}.png", f"cam1/data/{stamp}.png", number)
    turned = np.array([[0.0, -1, 0, 0.02], [1, 0, 0, -0.06], [0, 0, 1, 0.01], [0, 0, 0, 1]])
    for side, column_m in enumerate((0.0, 0.12)):
        shifted = np.eye(4)
        shifted[0, 3] = column_m
        sensor = {
            "sensor_type": "camera",
            "T_BS": {"rows": 4, "cols": 4, "data": (turned @ shifted).ravel().tolist()},
            "rate_hz": 20,
            "resolution": [WIDTH, HEIGHT],
            "camera_model": "pinhole",
            "intrinsics": [100.0, 100.0, 31.5, 23.5],
            "distortion_model": "radial-tangential",
            "distortion_coefficients": [0.0, 0.0, 0.0, 0.0],
        }
        write_yaml(root / "mav0" / f"cam{side}" / "sensor.yaml", sensor)


def with_matrix(text: str) -> Callable[[Path], None]:
    def make(root: Path) -> None:
        images(root, "left/{}.png", "right/{}.png")
        write_text(root / "K.txt", text)

    return make


def unnamed(root: Path) -> None:
    images(root, "a/{}.png", "b/{}.png")


def middlebury_2021(root: Path) -> None:
    middlebury(root)
    for light in ("L0", "T0"):
        for exposure in (0, 1):
            pair(root / "ambient" / light, f"im0e{exposure}.png", f"im1e{exposure}.png")


def kitti_2015(root: Path) -> None:
    for scene in range(3):
        for place in (10, 11):
            pair(root, f"image_2/{scene:06d}_{place}.png", f"image_3/{scene:06d}_{place}.png", scene + 1)


def kitti_raw(root: Path) -> None:
    for number in range(3):
        pair(root, f"image_02/data/{number:010d}.png", f"image_03/data/{number:010d}.png", number + 1)
    for side in ("2", "3"):
        times = "".join(f"2011-09-26 13:02:2{5 + n}.10{side}389445\n" for n in range(3))
        write_text(root / f"image_0{side}" / "timestamps.txt", times)


def yarp(root: Path, late_s: float = 0.0) -> None:
    """Recordings of an iCub's cameras by yarpdatadumper: the right one begins a frame later, and counts from 0, too."""
    for side in (0, 1):
        folder, lines = root / ("left", "right")[side], list[str]()
        for place, number in enumerate(range(1 + side, 5)):
            stamp_s = 1384952354.273104 + number / 30 + side * late_s
            write_image(folder / f"{place:08d}.ppm", views(number - 1)[side])
            lines.append(f"{5331 + number} {stamp_s:.6f} {stamp_s + 0.002 * place:.6f} {place:08d}.ppm [rgb]\n")
        write_text(folder / "data.log", "".join(lines))
        write_text(folder / "info.log", "Type: Image;\nStamp: tx+rx;\n")


def rs_convert(root: Path) -> None:
    """A recording of a RealSense as rs-convert -p writes it: ms with decimals, depth as a coloured picture."""
    for number in range(1, 4):
        stamp = f"{1568981563427.46240234375 + 33.25 * number:.14f}.png"
        pair(root, f"a_Infrared 1_{stamp}", f"a_Infrared 2_{stamp}", number)
        pair(root, f"a_Color_{stamp}", f"a_Depth_{stamp}", number)
        write_text(root / f"a_Color_metadata_{stamp[:-4]}.txt", "Stream: Color\n")


LAYOUTS = {
    "Middlebury 2021": Layout(make=middlebury_2021, cx_right_px=33.5),
    "KITTI 2015": Layout(make=kitti_2015, said=NUMBERS, frames=3),
    "KITTI raw": Layout(make=kitti_raw, said=NUMBERS, frames=3),
    "Middlebury 2014, 2021": Layout(make=middlebury, cx_right_px=33.5),
    "Middlebury 2005, 2006": Layout(make=middlebury_2006, said=NUMBERS),
    "Middlebury 2003": Layout(make=lambda root: pair(root, "im2.ppm", "im6.ppm"), said=NUMBERS),
    "aloeL aloeR": Layout(make=lambda root: pair(root, "aloeL.png", "aloeR.png"), said=NUMBERS),
    "I1_ I2_": Layout(make=numbered, said=NUMBERS, frames=3),
    "EuRoC": Layout(make=euroc, frames=3),
    "YARP": Layout(make=yarp, said=NUMBERS, frames=3),
    "rs-convert": Layout(make=rs_convert, said=NUMBERS, frames=3),
    "rs_bag2image": Layout(
        make=lambda root: images(root, "Infrared 1/{:06d}.png", "Infrared 2/{:06d}.png"), said=NUMBERS, frames=3
    ),
    "K.txt with a baseline": Layout(make=with_matrix(K_LINE + "0.12\n"), frames=3),
    "K.txt in three lines": Layout(make=with_matrix(K_ROWS + "baseline: 0.12\n"), frames=3),
    "K.txt without a baseline": Layout(make=with_matrix(K_LINE), said=("--baseline", "0.12"), frames=3),
    "any names": Layout(make=unnamed, said=("--set", "left=a", "--set", "right=b", *NUMBERS), frames=3),
}


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_one_command_adds_it(tmp_path: Path, layout: Layout) -> None:
    layout.make(tmp_path / "data")
    added = vfoa("add", tmp_path / "data", *layout.said, "--name", "mine")
    assert (added["adapter"], added["frames"]) == ("stereo_folder", layout.frames)
    (checked,) = vfoa("check", "mine")
    assert checked["problems"] == []
    frame = load_manifest("mine").open().frame(added["first_frame"])
    assert (frame.rig.baseline_m, frame.rig.fx_px) == pytest.approx((0.12, 100.0))
    assert frame.rig.cx_right_px == pytest.approx(layout.cx_right_px)
    for seen, written in zip((frame.left, frame.right), views(1), strict=True):
        np.testing.assert_array_equal(seen, written)


@pytest.mark.parametrize(
    ("suffix", "written_as"),
    [(".jp2", ".jp2"), (".avif", ".avif"), (".jfif", ".jpg"), (".jpe", ".jpg"), (".pnm", ".ppm"), (".webp", ".webp")],
)
def test_images_of_any_format_that_opencv_reads_are_found(tmp_path: Path, suffix: str, written_as: str) -> None:
    for side, image in zip(("left", "right"), views(1), strict=True):
        write_image(tmp_path / f"1{written_as}", image).rename(write_text(tmp_path / "data" / side / f"1{suffix}", ""))
    vfoa("add", tmp_path / "data", "--name", "mine", *NUMBERS)
    frame = load_manifest("mine").open().frame(1)
    for seen, written in zip((frame.left, frame.right), views(1), strict=True):
        assert np.corrcoef(seen.mean(axis=2).ravel(), written.mean(axis=2).ravel())[0, 1] > 0.9


def test_kitti_has_the_times_of_its_file(tmp_path: Path) -> None:
    kitti_raw(tmp_path / "data")
    vfoa("add", tmp_path / "data", "--name", "mine", *NUMBERS)
    clip = load_manifest("mine").open()
    assert [clip.time_ns(n) - 1_317_042_145_102_389_445 for n in clip.frames] == [0, 10**9, 2 * 10**9]
    digest = clip.digest()
    times = tmp_path / "data" / "image_02" / "timestamps.txt"
    write_text(times, times.read_text().replace(":27.", ":28."))
    assert load_manifest("mine").open().digest() != digest
    for text, said in ((":28.1\n", "expected 3, one for each image"), ("x\n", "timestamps.txt:1: found 'x'")):
        write_text(times, times.read_text().partition("\n")[0] + "\n" if "28" in text else text)
        with pytest.raises(VfoaError, match=said):
            load_manifest("mine").open()


@pytest.mark.parametrize(("step", "seconds"), [(3, [0, 3, 6]), (33_333, None)])
def test_ten_digits_are_seconds_if_they_are_few_apart(tmp_path: Path, step: int, seconds: list[int] | None) -> None:
    """int(time.time()), or microseconds of a camera's own clock."""
    for number in (1, 2, 3):
        stamp = 1_718_000_000 + step * number
        pair(tmp_path / "data", f"left_{stamp}.png", f"right_{stamp}.png", number)
    vfoa("add", tmp_path / "data", "--name", "mine", *NUMBERS)
    clip = load_manifest("mine").open()
    times_ns = [clip.time_ns(number) for number in clip.frames]
    if seconds is not None:
        assert [(time_ns - times_ns[0]) / 1e9 for time_ns in times_ns] == seconds
    assert any("stamps" in note for note in clip.notes) == (seconds is None)


@pytest.mark.parametrize(
    ("left", "right", "frames"),
    [
        ("frame_{:04d}/left.png", "frame_{:04d}/right.png", 3),
        ("{}/L.png", "{}/R.png", 3),
        ("take/pair{}/img_left.png", "take/pair{}/img_right.png", 3),
        ("session_{}/left_1.png", "session_{}/right_1.png", 3),
    ],
)
def test_each_frame_may_have_a_folder(tmp_path: Path, left: str, right: str, frames: int) -> None:
    images(tmp_path / "data", left, right)
    vfoa("add", tmp_path / "data", "--name", "mine", *NUMBERS)
    clip = load_manifest("mine").open_images()
    assert len(clip.frames) == frames
    assert np.array_equal(clip.frame(2).left, views(2)[0])


def test_folders_of_several_frames_or_with_calibrations_are_clips_of_their_own(tmp_path: Path) -> None:
    for number in (1, 2):
        images(tmp_path / "sessions" / f"s{number}", "left_{}.png", "right_{}.png")
        middlebury(tmp_path / "scenes" / f"chess{number}")
    for name in ("sessions", "scenes"):
        assert "a clip of each folder" in refused(tmp_path / name, *NUMBERS)


TENTHS = (0, 1, 5)
"""The times of three images in s after the first one, times 10."""


@pytest.mark.parametrize(
    ("place", "lines"),
    [
        ("times.txt", [f"{tenths / 10:.6e}" for tenths in TENTHS]),  # KITTI's odometry
        ("timestamps.txt", ["# time", *(f"{1_718_000_000 + tenths / 10}" for tenths in TENTHS)]),
        ("left/timestamps.txt", [f"{1_718_000_000_123_456_789 + tenths * 10**8}" for tenths in TENTHS]),
        ("timestamps.txt", [f"{1_718_000_000_123 + tenths * 100}" for tenths in TENTHS]),
        ("timestamps.csv", ["frame,timestamp", *(f"{tenths},{1_718_000_000 + tenths / 10}" for tenths in TENTHS)]),
        ("left/timestamps.csv", ["Time Stamp (ms),file", *(f"{tenths * 100},a.png" for tenths in TENTHS)]),
        ("times.csv", [f"2026-11-28T09:00:00.{tenths}" for tenths in TENTHS]),
        ("timestamps.csv", ["timestamp", *(f"2026-11-28 09:00:00.{tenths}" for tenths in TENTHS)]),
        ("times.txt", [f"{number} 2026-11-28 09:00:00.{tenths}" for number, tenths in enumerate(TENTHS)]),
        ("times.csv", [f"2026-11-28 09:00:00.{tenths}+05:30,left/{tenths}.jpg" for tenths in TENTHS]),
        ("times.csv", [f'"left view/{tenths}.jpg","{1_718_000_000 + tenths / 10}"' for tenths in TENTHS]),
        ("times.txt", [f"{number:06d} {tenths / 10:.6f}" for number, tenths in enumerate(TENTHS)]),
        ("times.txt", [f"{1_718_000_000_123_456_789 + tenths * 10**8}, left/{tenths}.jpg" for tenths in TENTHS]),
        ("times.csv", [f"{number},{1_718_000_000 + tenths / 10}" for number, tenths in enumerate(TENTHS, start=7)]),
        ("times.txt", [f"2026-11-28T09:00:00.{tenths}+05:30" for tenths in TENTHS]),
        ("times.txt", [f"2026-11-28 09:00:00,{tenths}00" for tenths in TENTHS]),  # Python's logging
        ("timestamps.txt", [f"{1_718_000_000 + tenths / 10:.18e}" for tenths in TENTHS]),  # np.savetxt
        ("timestamps.txt", [f"{1_718_000_000_000.25 + tenths * 100}" for tenths in TENTHS]),  # a RealSense's ms
        ("left_timestamps.csv", ["id,exposure_time_us,ts_us", *(f"1,8000,{tenths}00000" for tenths in TENTHS)]),
        ("timestamps.csv", ["left_timestamp,right_timestamp", *(f"{tenths / 10},9.9" for tenths in TENTHS)]),
        ("timestamps.csv", ["t_wall_s,t_rgb_dev_ms,t_depth_dev_ms", *(f"0,{tenths * 100},0" for tenths in TENTHS)]),
        ("timestamps.csv", ["timestamp_rgb_ms,timestamp_host_ms", *(f"{tenths * 100},0" for tenths in TENTHS)]),
    ],
)
@pytest.mark.parametrize("names", [("left/{}.png", "right/{}.png"), ("left_{}.png", "right_{}.png")])
def test_a_line_of_time_for_each_image(tmp_path: Path, names: tuple[str, str], place: str, lines: list[str]) -> None:
    images(tmp_path / "data", *names)
    if "/" in place and "/" not in names[0]:
        place = place.rpartition("/")[2]
    write_text(tmp_path / "data" / place, "\n".join(lines) + "\n")
    vfoa("add", tmp_path / "data", "--name", "mine", *NUMBERS)
    clip = load_manifest("mine").open()
    times_ns = [clip.time_ns(number) for number in clip.frames]
    assert [time_ns - times_ns[0] for time_ns in times_ns] == pytest.approx([n * 10**8 for n in TENTHS], abs=1000)


def test_an_index_and_a_time_in_each_name(tmp_path: Path) -> None:
    """The stamps of both cameras differ, and have no unit in common with the index."""
    for number, tenths in enumerate(TENTHS, start=1):
        for late_ms, (side, view) in enumerate(zip(("left", "right"), views(number), strict=True)):
            stamp_ms = 1_718_000_000_000 + 100 * tenths + late_ms
            write_image(tmp_path / "data" / side / f"{number:06d}_{stamp_ms}.png", view)
    vfoa("add", tmp_path / "data", "--name", "mine", *NUMBERS)
    clip = load_manifest("mine").open()
    assert tuple(clip.frames) == (1, 2, 3)
    assert [clip.time_ns(n) - 1_718_000_000 * 10**9 for n in clip.frames] == [tenths * 10**8 for tenths in TENTHS]


@pytest.mark.parametrize(
    "line",
    [
        *("0 1718000000.1\n2 1718000000.2\n4 1718000000.3", "1718000000.0\n1718000000.0\n1718000001.0"),
        *("33", "2026-13-45 00:00:00"),
        *("100.5\n133.8\n167.1", "1234567890\n1234601223\n1234634556", "123456789012.5"),  # ms or us since the start
    ],
)
def test_times_that_cannot_be_read_say_how_to_go_without(tmp_path: Path, line: str) -> None:
    images(tmp_path / "data", "left/{}.png", "right/{}.png")
    write_text(tmp_path / "data" / "timestamps.txt", f"{line}\n")
    said = refused(tmp_path / "data", *NUMBERS)
    assert "timestamps.txt" in said
    assert "--set left=left --set right=right reads the images without it" in said


@pytest.mark.parametrize(
    ("left", "right", "is_rectified"),
    [
        ("rectified_left/{}.png", "rectified_right/{}.png", True),
        ("left_rect_{}.png", "right_rect_{}.png", True),
        ("imageRectifiedL{}.png", "imageRectifiedR{}.png", True),
        ("non_rectified_left/{}.png", "non_rectified_right/{}.png", False),
        ("unrectified/left/{}.png", "unrectified/right/{}.png", False),
        ("rectangle_left/{}.png", "rectangle_right/{}.png", False),
        ("left/{}.png", "right/{}.png", False),
    ],
)
def test_images_that_are_called_rectified_are_not_rectified_again(
    tmp_path: Path, left: str, right: str, *, is_rectified: bool
) -> None:
    """The calibration is of the raw images, and turns the right camera."""
    images(tmp_path / "data", left, right)
    k, turned = np.array([[100, 0, 31.5], [0, 100, 23.5], [0, 0, 1.0]]), Rotation.from_euler("x", 3, degrees=True)
    nodes = {"K1": k, "D1": np.zeros((1, 5)), "K2": k, "D2": np.zeros((1, 5)), "R": turned.as_matrix()}
    write_opencv(tmp_path / "data" / "stereo.yml", {**nodes, "T": np.array([[-0.12], [0], [0]])}, (WIDTH, HEIGHT))
    vfoa("add", tmp_path / "data", "--name", "mine")
    right_view = load_manifest("mine").open_images().frame(1).right
    assert right_view is not None
    assert np.array_equal(right_view, views(1)[1]) == is_rectified
    vfoa("add", tmp_path / "data", "--name", "other", "--set", f"rectified={str(not is_rectified).lower()}")
    other = load_manifest("other").open_images().frame(1).right
    assert other is not None
    assert np.array_equal(other, views(1)[1]) != is_rectified


@pytest.mark.parametrize(
    "table",
    ["frame_index,wall_time_s,unix_time_s\n0,0.1,1718000000.1\n", "frame,timestamp_ms\n1,x\n", "", "a,time\n1\n"],
)
def test_tables_of_times_that_cannot_be_read_say_how_to_go_without(tmp_path: Path, table: str) -> None:
    images(tmp_path / "data", "left/{}.png", "right/{}.png")
    write_text(tmp_path / "data" / "timestamps.csv", table)
    assert "--set left=left --set right=right reads the images without it" in refused(tmp_path / "data", *NUMBERS)


def test_a_pointer_of_git_lfs_says_so(tmp_path: Path) -> None:
    for side in ("left", "right"):
        text = "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n"
        write_text(tmp_path / "data" / side / "1.png", text)
    assert "a pointer of Git LFS" in refused(tmp_path / "data", *NUMBERS)


def test_depth_maps_alone_are_no_pair_side_by_side(tmp_path: Path) -> None:
    ramp = np.tile(np.linspace(500, 5000, 2 * HEIGHT).astype(np.uint16)[:, None], (1, 2 * WIDTH))
    ramp[::7] += 900
    for n in range(3):
        write_image(tmp_path / "planar" / f"{n}.png", ramp)
        write_image(tmp_path / "depth_8_bit" / f"{n}.png", np.dstack([ramp >> 5] * 3).astype(np.uint8))
    for folder in ("planar", "depth_8_bit"):
        assert "side" not in refused(tmp_path / folder, *NUMBERS).partition(";")[0]


def test_euroc_keeps_its_nanoseconds(tmp_path: Path) -> None:
    euroc(tmp_path / "data")
    vfoa("add", tmp_path / "data", "--name", "mine", "--subject", "ann")
    clip = load_manifest("mine").open()
    assert clip.rate_hz == 20.0
    assert clip.time_ns(clip.frames[0]) == 1_403_636_579_813_555_584
    assert vfoa("check", "mine")[0]["problems"] == []


@pytest.mark.parametrize("sides", [("left/{}.png", "right/{}.png"), ("{}_left.png", "{}_right.png")])
def test_dates_with_times_of_day_are_the_frames_times(tmp_path: Path, sides: tuple[str, str]) -> None:
    dates = ("2026-11-28_08-59-59-950", "2026-11-28_09-00-00-000", "2026-11-28_09-00-00-050")
    for number, date in enumerate(dates, start=1):
        pair(tmp_path / "data", *(side.format(date) for side in sides), number)
    assert vfoa("add", tmp_path / "data", "--name", "mine", *NUMBERS)["frames"] == 3
    clip = load_manifest("mine").open()
    nine = np.datetime64("2026-11-28T09:00:00", "ns").astype(int)
    assert [clip.time_ns(number) for number in clip.frames] == [nine - 50_000_000, nine, nine + 50_000_000]
    assert clip.rate_hz == 20.0
    np.testing.assert_array_equal(clip.frame(clip.frames[2]).left, views(3)[0])


def test_names_that_are_given_win_over_those_that_are_seen(tmp_path: Path) -> None:
    pair(tmp_path / "data", "aloeL.png", "aloeR.png")
    vfoa("add", tmp_path / "data", *NUMBERS, "--set", "left=aloeR.png", "--set", "right=aloeL.png", "--name", "turned")
    vfoa("add", tmp_path / "data", *NUMBERS, "--set", "swap=true", "--name", "swapped")
    for name in ("turned", "swapped"):
        frame = load_manifest(name).open().frame(0)
        np.testing.assert_array_equal(frame.left, views(1)[1])
        np.testing.assert_array_equal(frame.right, views(1)[0])
    told = ("--adapter", "stereo_folder", "--set", "left=aloeL.png", "--set", "right=aloeR.png")
    assert vfoa("add", tmp_path / "data", *NUMBERS, *told, "--name", "told")["frames"] == 1


def test_a_sequence_is_no_pair_of_middlebury(tmp_path: Path) -> None:
    for number in range(12):
        write_image(tmp_path / "data" / f"view{number}.png", views(number)[0])
    said = refused(tmp_path / "data", *NUMBERS)
    assert "12 images (view0.png" in said
    assert "--set left=FILES --set right=FILES" in said
    assert "left = and right = in [source]" in said


def test_a_matrix_without_a_baseline_says_how_to_give_it(tmp_path: Path) -> None:
    with_matrix(K_LINE)(tmp_path / "data")
    said = refused(tmp_path / "data")
    assert "K.txt: a camera matrix without a baseline" in said
    assert "--baseline METRES (baseline_m in [source])" in said


def test_a_baseline_stands_in_place_of_the_file_s(tmp_path: Path) -> None:
    middlebury(tmp_path / "data")
    vfoa("add", tmp_path / "data", "--baseline", "0.2", "--name", "mine")
    assert vfoa("check", "mine")[0]["baseline_m"] == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("cam0=[1 0 0; 0 1 0; 0 0 1]\n", "calib.txt: no cam1"),
        ("cam0=[1 0; 0 0 1]\ncam1=[1 0 0; 0 1 0; 0 0 1]\n", "cam0: found '[1 0; 0 0 1]'"),
        ("1 2 3 4 5 6 7 8 9\n0.1\n", "expected a camera matrix [fx 0 cx; 0 fy cy; 0 0 1]"),
        (K_LINE + "0.12\n3\n", "found 11 values"),
        (K_LINE + "-0.12\n", "the baseline is -0.12"),
        ("P2: 1 2 3\n", "found '1 2 3'; expected 12"),
        ("hello\n", "no line P2: or P_rect_02:"),
    ],
)
def test_a_wrong_text_is_one_line(tmp_path: Path, text: str, said: str) -> None:
    pair(tmp_path / "data", "left.png", "right.png")
    write_text(tmp_path / "calib.txt", text)
    assert said in refused(tmp_path / "data", "--calibration", tmp_path / "calib.txt")


def test_a_clip_says_that_its_calibration_is_scaled(tmp_path: Path) -> None:
    images(tmp_path, "left/{}.png", "right/{}.png")
    nodes = {f"P{n}": np.array([[100, 0, 63.5, x], [0, 100, 47.5, 0], [0, 0, 1, 0]]) for n, x in ((1, 0.0), (2, -12.0))}
    write_opencv(tmp_path / "stereo.yml", nodes, (2 * WIDTH, 2 * HEIGHT))
    added = vfoa("add", tmp_path, "--name", "mine", "--set", "rate_hz=25")
    note = f"the calibration of {2 * WIDTH} x {2 * HEIGHT} pixels is scaled to the images' {WIDTH} x {HEIGHT}"
    assert added["notes"] == [note]
    clip = load_manifest("mine").open()
    assert clip.frame(1).rig.fx_px == pytest.approx(50.0)
    assert clip.frame(1).rig.cx_px == pytest.approx((63.5 + 0.5) / 2 - 0.5)


@pytest.mark.parametrize(("left", "right"), [("/cam0/image", "/cam1/image"), ("/d455/infra1/raw", "/d455/infra2/raw")])
def test_topics_whose_names_are_numbered_are_a_pair(tmp_path: Path, left: str, right: str) -> None:
    with recorder(tmp_path / "a.mcap") as record:
        for number in (1, 2, 3):
            for topic, image in zip((left, right), views(number), strict=True):
                record.picture(topic, number * 40_000_000, image, "raw")
    added = vfoa("add", tmp_path / "a.mcap", *NUMBERS, "--name", "mine")
    assert added["frames"] == 3
    np.testing.assert_array_equal(load_manifest("mine").open().frame(1).left, views(1)[0])


def test_an_offset_between_the_cameras_names_the_tolerance(tmp_path: Path) -> None:
    for number in (1, 2, 3, 4):
        stamp = 1_403_636_579_763_555_584 + number * 50_000_000
        left, right = views(number)
        write_image(tmp_path / "data" / "cam0" / f"{stamp}.png", left)
        if number != 3:  # the right camera lost one
            write_image(tmp_path / "data" / "cam1" / f"{stamp + 3_000_000}.png", right)
    said = refused(tmp_path / "data", *NUMBERS)
    assert "the nearest stamps are 3 ms apart (median): set tolerance_ms in [source]" in said
    told = said.partition("(--set ")[2].removesuffix(")").replace("MS", "5").split(" --set ")
    added = vfoa(
        "add", tmp_path / "data", *NUMBERS, *(word for each in told for word in ("--set", each)), "--name", "a"
    )
    assert added["frames"] == 3
    clip = load_manifest("a").open()
    assert [(frame - clip.frames[0]) // 50_000_000 for frame in clip.frames] == [0, 1, 3]
    for frame, number in zip(clip.frames, (1, 2, 4), strict=True):
        np.testing.assert_array_equal(clip.frame(frame).right, views(number)[1])


def test_yarp_s_images_are_paired_by_the_times_of_their_logs_not_by_their_numbers(tmp_path: Path) -> None:
    yarp(tmp_path / "data", late_s=0.004)
    said = refused(tmp_path / "data", *NUMBERS)
    assert "the nearest stamps are 4 ms apart (median): set tolerance_ms in [source]" in said
    told = said.partition("(--set ")[2].removesuffix(")").replace("MS", "5").split(" --set ")
    words = (word for each in told for word in ("--set", each))
    assert vfoa("add", tmp_path / "data", *NUMBERS, *words, "--name", "a")["frames"] == 3
    clip = load_manifest("a").open()
    assert clip.rate_hz == pytest.approx(30, abs=0.01)
    assert clip.time_ns(clip.frames[0]) == clip.frames[0]
    for frame, number in zip(clip.frames, (1, 2, 3), strict=True):
        for seen, written in zip((clip.frame(frame).left, clip.frame(frame).right), views(number), strict=True):
            np.testing.assert_array_equal(seen, written)
    assert clip.notes == ("1 left image has no right one, left out: frame 1384952354306437000",)
