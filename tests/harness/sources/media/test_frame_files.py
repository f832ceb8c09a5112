from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from harness.sources.media.frame_files import find_frames, number_names, printf_name
from tests.disk import write_text
from vfoa.errors import VfoaError


def _touch(root: Path, *names: str) -> Path:
    for name in names:
        write_text(root / name, "")
    return root


def test_numbers_sort_as_numbers_and_keep_their_gaps(tmp_path: Path) -> None:
    _touch(tmp_path, "left/f10.png", "left/f9.png", "left/f2.png", "left/readme.txt")
    assert list(find_frames(tmp_path, "left", "left")) == [2, 9, 10]


@pytest.mark.parametrize("pattern", ["left_*.png", "left_%04d.png", "left_%d.png"])
def test_globs_and_patterns_pick_their_files(tmp_path: Path, pattern: str) -> None:
    _touch(tmp_path, "left_0007.png", "left_0012.png", "right_0007.png")
    found = find_frames(tmp_path, pattern, "left")
    assert {number: path.name for number, path in found.items()} == {7: "left_0007.png", 12: "left_0012.png"}


def test_the_number_is_the_one_that_differs() -> None:
    names = ["cam2_000005_10.png", "cam2_000006_10.png"]
    assert number_names(names, "left") == {5: names[0], 6: names[1]}


def test_two_images_of_one_name_are_refused() -> None:
    with pytest.raises(VfoaError, match=r"left: 'a1\.png' occurs twice"):
        number_names(["a1.png", "a2.png", "a1.png"], "left")
    with pytest.raises(VfoaError, match="left: '' and '' do not share"):  # of a list of images, such as COCO's
        number_names(["", "1.png"], "left")


def test_a_single_file_without_a_number_is_frame_0(tmp_path: Path) -> None:
    assert list(find_frames(_touch(tmp_path, "left.png"), "left.png", "left")) == [0]


def test_a_number_beyond_63_bits_is_refused() -> None:
    for names in (["1" * 25 + ".png"], ["1.png", "9" * 25 + ".png"]):
        with pytest.raises(VfoaError, match="is too large"):
            number_names(names, "left")


def test_two_numbers_that_differ_are_ambiguous() -> None:
    with pytest.raises(VfoaError, match="left: 2 numbers differ"):
        number_names(["000005_10.png", "000006_11.png"], "left")


@pytest.mark.parametrize("names", [["a.png", "b.png"], ["f1.png", "f.png"], ["f1.png", "f1_2.png"]])
def test_names_without_a_shared_numbering_are_refused(names: list[str]) -> None:
    with pytest.raises(VfoaError, match="do not share one numbering"):
        number_names(["talk/000005.png", "dinner/000006.png"], "mine.json")  # of another film
    assert number_names(["IMG_5.JPG", "img_6.png"], "left") == {5: "IMG_5.JPG", 6: "img_6.png"}
    with pytest.raises(VfoaError, match="do not share one numbering"):
        number_names(names, "left")


@pytest.mark.parametrize("names", [["f1.png", "f01.png"], ["f1.png", "f1.jpg"]])
def test_one_frame_in_two_files_is_refused(tmp_path: Path, names: list[str]) -> None:
    _touch(tmp_path, *names, "f2.png")
    with pytest.raises(VfoaError, match="frame 1 occurs twice"):
        find_frames(tmp_path, "f*", "left")


@pytest.mark.parametrize("pattern", ["nothing", "*.jpg", "x_%04d.png", "", "%d_%d.png"])
def test_a_pattern_without_a_frame_is_named(tmp_path: Path, pattern: str) -> None:
    with pytest.raises(VfoaError, match=r"^clip\.toml: source\.left: "):
        find_frames(tmp_path, pattern, "clip.toml: source.left")


def test_a_pattern_gives_back_the_name_it_read() -> None:
    assert printf_name("left/%06d_a.png", 42) == "left/000042_a.png"
    assert printf_name("%d.npy", 7) == "7.npy"


def test_what_macos_leaves_beside_each_file_is_no_frame(tmp_path: Path) -> None:
    _touch(tmp_path, *(f"left/{hidden}{n}.png" for hidden in ("", "._") for n in (1, 2)))
    for pattern in ("left", "left/*.png"):
        assert [path.name for path in find_frames(tmp_path, pattern, "left").values()] == ["1.png", "2.png"]


@pytest.mark.parametrize("name", ["pair[1].png", "pair%d.png", "p*r.png", "ü\n1.png"])
def test_a_file_s_own_name_is_that_file(tmp_path: Path, name: str) -> None:
    (found,) = find_frames(_touch(tmp_path, name, "pair1.png"), name, "both").values()
    assert found.name == name


def test_a_number_that_nothing_can_count_to_is_refused(tmp_path: Path) -> None:
    _touch(tmp_path, "f1.png", f"f{2**63}.png")
    with pytest.raises(VfoaError, match=rf"left: .*{2**63} "):
        find_frames(tmp_path, "f*.png", "left")


STAMPS_US = (1_718_000_000_123_456, 1_718_000_000_163_456)


@pytest.mark.parametrize(
    "pattern", ["{index:06d}_{us}", "{us}_{index}", "f{index:010d}-{us}000", "{index}_{s}.{us:09.0f}"]
)
def test_the_index_beside_a_stamp_is_the_frame_number(pattern: str) -> None:
    names = [
        pattern.format(index=number, us=us, s=us // 10**6) + ".png"
        for number, us in zip((9, 10), STAMPS_US, strict=True)
    ]
    assert number_names(names, "left") == {9: names[0], 10: names[1]}


@pytest.mark.parametrize(
    ("pattern", "numbers"),
    [
        ("%06d_*.png", (9, 10)),
        ("%d*.png", (9, 10)),
        ("*_%d.png", STAMPS_US),
        ("*%d.png", STAMPS_US),
        ("%06d_17*456.png", (9, 10)),
    ],
)
def test_a_pattern_may_have_wildcards_beside_the_number(tmp_path: Path, pattern: str, numbers: tuple[int, ...]) -> None:
    for number, stamp in zip((9, 10), STAMPS_US, strict=True):
        write_text(tmp_path / "left" / f"{number:06d}_{stamp}.png", "")
    assert tuple(find_frames(tmp_path, f"left/{pattern}", "left")) == numbers


def test_the_pattern_that_is_advised_matches(tmp_path: Path) -> None:
    _touch(tmp_path, "side/a1_20_x.png", "side/a2_30_x.png")
    for files in ("side", "side/*.png"):
        with pytest.raises(VfoaError, match="2 numbers differ") as error:
            find_frames(tmp_path, files, "left")
        advised = str(error.value).rpartition("such as ")[2]
        assert list(find_frames(tmp_path, advised, "left")) == [1, 2]


@pytest.mark.parametrize("pattern", ["{s}.{us:06d}", "{s}_{us:06d}000", "cam2_{s}.{us:06d}_left"])
def test_seconds_and_their_decimals_are_one_number(pattern: str) -> None:
    stamps = ((1_718_000_000, 900_000), (1_718_000_001, 100_000), (1_718_000_001, 500_000))
    names = [pattern.format(s=second, us=us) + ".png" for second, us in stamps]
    assert list(number_names(names, "left").values()) == names


@pytest.mark.parametrize(("second", "digits"), [(12, 6), (12, 9), *((1_718_000_000, digits) for digits in (3, 6, 9))])
def test_a_clip_within_one_second_has_its_times_too(second: int, digits: int) -> None:
    """A first try has few images; decimals alone would be the numbers of frames that are hours apart."""
    times = [second * 10**digits + round((0.1 + number / 30) * 10**digits) for number in range(6)]
    names = [f"left_{time // 10**digits}.{time % 10**digits:0{digits}d}.png" for time in times]
    assert list(number_names(names, "left")) == times


@pytest.mark.parametrize("mark", ["", ".", "_", "-"])
@pytest.mark.parametrize("digits", [3, 6, 9])
def test_a_clip_within_the_second_of_a_date_has_its_times_too(mark: str, digits: int) -> None:
    second = round(datetime(2023, 5, 1, 12, 30, 45, tzinfo=UTC).timestamp())
    parts = [round((0.1 + number / 30) * 10**digits) for number in range(6)]
    names = [f"left_20230501_123045{mark}{part:0{digits}d}.png" for part in parts]
    assert list(number_names(names, "left")) == [second * 10**digits + part for part in parts]


@pytest.mark.parametrize(
    "name",
    [
        *("1718000000.{number:03d}.png", "12.{number:06d}.png", "1718000000_{number:09d}.png"),
        *("2023-05-01_12-30-45_{number:03d}.png", "2023-05-01_12-30-45-{number:04d}.png"),
    ],
)
def test_frames_in_turn_beside_one_stamp_are_numbered(name: str) -> None:
    frames = (1, 2, 3, 5, 6)  # one is lost
    assert tuple(number_names([name.format(number=number) for number in frames], "left")) == frames


def test_milliseconds_and_their_decimals_are_nanoseconds() -> None:
    """As RealSense's rs-convert names images."""
    names = ["1568981563427.46240234375000.png", "1568981563460.79565429687500.png"]
    assert list(number_names(names, "left")) == [1568981563427462402, 1568981563460795654]


@pytest.mark.parametrize("stamps", [(1568981563427, 1568981563460), (1568981563, 1568981564)])
def test_the_number_of_a_camera_is_no_decimal_of_a_stamp(stamps: tuple[int, int]) -> None:
    assert tuple(number_names([f"{stamp}.cam0.png" for stamp in stamps], "left")) == stamps


@pytest.mark.parametrize("digits", [6, 9])
def test_a_simulation_s_seconds_and_their_decimals_are_one_number(digits: int) -> None:
    names = [f"left_{9.9 + number / 30:.{digits}f}.png" for number in range(6)]
    numbers = list(number_names(reversed(names), "left"))
    assert numbers == [round((9.9 + number / 30) * 10**digits) for number in range(6)]
    takes = [f"{take}.{number:0{digits}d}.png" for take in (1, 2) for number in range(3)]
    with pytest.raises(VfoaError, match="2 numbers differ"):
        number_names(takes, "left")


FRAMES_MS = (900, 940, 980, 1020, 60_000, 86_400_040)
"""Of a film over a second's, a minute's and midnight's end."""


@pytest.mark.parametrize(
    ("pattern", "digits"),
    [
        ("%Y-%m-%d_%H-%M-%S-", 3),
        ("%Y_%m_%d_%H_%M_%S_", 6),
        ("cam0_%Y%m%d_%H%M%S_", 3),
        ("%Y%m%d_%H%M%S", 6),
        ("%Y%m%d%H%M%S", 3),
        ("%Y-%m-%dT%H:%M:%S.", 9),
        ("Image__%Y-%m-%d__%H-%M-%S,", 2),
        ("%d%m%Y_%H%M%S_", 6),
        ("%m%d%Y%H%M%S", 3),
        ("cam0_%d-%m-%Y_%H-%M-%S-", 3),
    ],
)
def test_a_date_and_its_time_of_day_are_one_number(pattern: str, digits: int) -> None:
    start = datetime(2023, 12, 31, 23, 59, 58, tzinfo=UTC)
    times = [start + timedelta(milliseconds=ms) for ms in FRAMES_MS]
    names = [time.strftime(pattern) + f"{time.microsecond * 1000:09d}"[:digits] + "_left.png" for time in times]
    of_ms = {2: 1, 3: 1, 6: 10**3, 9: 10**6}[digits]
    since_1970 = [(round(start.timestamp()) * 1000 + ms) * of_ms for ms in FRAMES_MS]
    assert number_names(reversed(names), "left") == dict(zip(since_1970, names, strict=True))


def test_a_date_without_decimals_is_a_time_and_one_beside_an_index_is_not() -> None:
    seconds = ["20230501_123058", "20230501_123059", "20230501_123100"]
    assert np.diff(list(number_names([f"{name}.png" for name in seconds], "left"))).tolist() == [1000, 1000]
    names = [f"2023-05-01_12-30-{44 + number // 3}_{number:04d}.png" for number in range(9)]
    assert list(number_names(names, "left").values()) == names
    assert list(number_names(names, "left")) == list(range(9))


@pytest.mark.parametrize(
    "pattern", ["%d%m%Y_%H%M%S", "%m%d%Y_%H%M%S", "%d-%m-%Y-%H-%M-%S-0", "take_01_02_%Y%m%d_%H%M%S"]
)
@pytest.mark.parametrize("day", [30, 31])
def test_a_day_and_a_month_are_those_of_the_shorter_film(pattern: str, day: int) -> None:
    times = [datetime(2023, 1, day, 23, 59, second, tzinfo=UTC) for second in (11, 12)]
    times += [time + timedelta(minutes=1) for time in times]
    names = [f"{time.strftime(pattern)}.png" for time in times]
    assert list(number_names(names, "left")) == [round(time.timestamp()) * 1000 for time in times]


def test_a_day_that_may_be_a_month_comes_first() -> None:
    names = ["01052023_120000.png", "01052023_120001.png"]
    start = round(datetime(2023, 5, 1, 12, tzinfo=UTC).timestamp())
    assert list(number_names(names, "left")) == [start * 1000, (start + 1) * 1000]
    names = ["01052023_235959.png", "01062023_000000.png"]
    assert np.diff(list(number_names(names, "left"))).tolist() == [1000]


def test_a_number_that_counts_the_images_of_each_second_is_their_place_in_it() -> None:
    """As Motion names them (01-20230501123045-00.jpg); other programs begin with 1, and images may be missing."""
    start = round(datetime(2023, 5, 1, 12, 30, 45, tzinfo=UTC).timestamp())
    for begin in (0, 1):
        shown = [(second, place) for second in range(3) for place in range(10) if (second, place) != (1, 4)]
        names = [f"01-202305011230{45 + second}-{begin + place:02d}.jpg" for second, place in shown]
        assert [*number_names(names, "x")] == [1000 * (start + second) + 100 * place for second, place in shown]


def test_hundredths_of_a_fast_camera_are_decimals() -> None:
    start = round(datetime(2023, 5, 1, 12, 30, 45, tzinfo=UTC).timestamp())
    names = [f"20230501_1230{45 + tick // 100}_{tick % 100:02d}.png" for tick in range(80, 220)]
    assert [*number_names(names, "x")] == [1000 * start + 10 * tick for tick in range(80, 220)]


@pytest.mark.parametrize(
    "names",
    [
        ["20230501_123045_05", "20230501_123045_40", "20230501_123046_7"],
        ["20231301_123045_05", "20231301_123046_04"],
        ["2023-05-01_12-59-59-05_PM", "2023-05-01_01-00-00-04_PM"],
    ],
)
def test_what_is_no_certain_date_is_not_taken_for_one(names: list[str]) -> None:
    with pytest.raises(VfoaError, match="numbers differ"):
        number_names([f"{name}.png" for name in names], "left")


def test_decimals_of_several_lengths_are_not_taken_for_an_index() -> None:
    with pytest.raises(VfoaError, match="2 numbers differ"):
        number_names(["1718000000.9.png", "1718000001.15.png", "1718000002.2.png"], "left")


@pytest.mark.parametrize("names", [["take1_1", "take1_2", "take2_1"], ["12-40", "12-59", "13-05"]])
def test_no_pattern_is_advised_whose_numbers_do_not_count_the_frames(names: list[str]) -> None:
    with pytest.raises(VfoaError, match="2 numbers differ") as error:
        number_names([f"{name}.png" for name in names], "left")
    assert "%d" not in str(error.value)
