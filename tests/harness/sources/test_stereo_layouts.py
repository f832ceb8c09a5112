"""Every layout that a stereo clip can have on disk: written, found, and read back frame for frame."""

from __future__ import annotations

import pickle
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from harness.sources.media.frame_files import pair_names
from harness.sources.stereo_folder import StereoFolderClip, StereoFolderSettings
from harness.sources.stereo_layouts import FoundLayout, find_layouts, recognise_stereo
from tests.disk import write_bytes, write_image, write_text, write_video
from vfoa.errors import VfoaError
from vfoa.types import Image

CAMERA = {"fx_px": 50.0, "cx_px": 31.5, "cy_px": 23.5, "baseline_m": 0.1}
WIDTH, HEIGHT = 128, 96
FRAMES = (2, 9, 10)


def _pair(number: int) -> tuple[Image, Image]:
    """Two views of a wall of blobs, six pixels apart."""
    noise = np.random.default_rng(number).integers(0, 256, (HEIGHT, WIDTH + 6, 3), dtype=np.uint8)
    wall = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 3), None, 0, 255, cv2.NORM_MINMAX)
    return wall[:, :WIDTH], wall[:, 6:]


def _write_pairs(root: Path, left: str, right: str, frames: tuple[int, ...] = FRAMES) -> Path:
    for number in frames:
        for name, image in zip((left, right), _pair(number), strict=True):
            write_image(root / name.format(number), image)
    return root


def _open(found: FoundLayout, **changes: Any) -> StereoFolderClip:
    settings = {**found.source, "camera": CAMERA, **changes}
    return StereoFolderClip(StereoFolderSettings.model_validate(settings), found.root)


def _assert_same_frames(clip: StereoFolderClip, frames: tuple[int, ...], numbers: tuple[int, ...] = FRAMES) -> None:
    assert clip.frames == frames
    for frame, number in zip(frames, numbers, strict=True):
        read = clip.frame(frame)
        for seen, written in zip((read.left, read.right), _pair(number), strict=True):
            assert np.array_equal(seen, written)


@pytest.mark.parametrize(
    ("left", "right", "source"),
    [
        ("left/{:04d}.png", "right/{:04d}.png", ("left", "right")),
        ("a/Left/f{}.png", "a/Right/f{}.png", ("a/Left", "a/Right")),
        ("image_2/{:06d}.png", "image_3/{:06d}.png", ("image_2", "image_3")),
        ("mav0/cam0/data/{}.png", "mav0/cam1/data/{}.png", ("mav0/cam0/data", "mav0/cam1/data")),
        ("left_{}.png", "right_{}.png", ("left_*.png", "right_*.png")),
        ("x/{:05d}L.png", "x/{:05d}R.png", ("x/*L.png", "x/*R.png")),
        ("f{}_l.png", "f{}_r.png", ("f*_l.png", "f*_r.png")),
        ("cam0_{}.png", "cam1_{}.png", ("cam0_*.png", "cam1_*.png")),
        ("{}_image_0.png", "{}_image_1.png", ("*_image_0.png", "*_image_1.png")),
        ("cam1-{}.png", "cam2-{}.png", ("cam1-*.png", "cam2-*.png")),
        ("take[1] ü/left{}.png", "take[1] ü/right{}.png", ("take[[]1] ü/left*.png", "take[[]1] ü/right*.png")),
    ],
)
def test_sides_in_names_are_found_and_read(tmp_path: Path, left: str, right: str, source: tuple[str, str]) -> None:
    (found,) = find_layouts(_write_pairs(tmp_path, left, right))
    assert found.source == {"layout": "images", "left": source[0], "right": source[1]}
    assert (found.views.frames, found.size_px) == ((2, 9, 10), (WIDTH, HEIGHT))
    _assert_same_frames(_open(found), FRAMES)


@pytest.mark.parametrize(("unit", "second"), [("ns", 10**9), ("us", 10**6), ("ms", 10**3)])
def test_stamps_in_names_are_times(tmp_path: Path, unit: str, second: int) -> None:
    frames = tuple(1_700_000_000 * second + number * second // 20 for number in (0, 1, 2, 4))
    (found,) = find_layouts(_write_pairs(tmp_path, "left/{}.png", "right/{}.png", frames))
    assert (found.source["stamps"], found.views.rate_hz, found.views.frames[0]) == (unit, 20.0, frames[0])
    clip = _open(found)
    assert clip.rate_hz == 20.0
    assert [clip.time_ns(frame) - clip.time_ns(frames[0]) for frame in frames] == [0, 50_000_000, 10**8, 2 * 10**8]
    assert clip.frame(frames[1]).time_ns == 1_700_000_000_050_000_000


def test_decimals_of_seconds_are_times(tmp_path: Path) -> None:
    names = [f"{1_700_000_000 + tenths // 10}.{tenths % 10}00000" for tenths in (8, 9, 10, 11)]
    for number, name in enumerate(names):
        _write_pairs(tmp_path, name.join(("left/", ".png")), name.join(("right/", ".png")), (number,))
    (found,) = find_layouts(tmp_path)
    assert (found.source["stamps"], found.views.rate_hz) == ("us", 10.0)
    assert found.views.frames == tuple(int(name.replace(".", "")) for name in names)


def test_stamps_of_which_few_are_equal_ask_for_a_tolerance(tmp_path: Path) -> None:
    stamps = [1_700_000_000_000 + 40 * number for number in range(6)]
    for number, stamp in enumerate(stamps):
        _write_pairs(tmp_path, f"left/{stamp}.png", f"right/{stamp + number % 3}.png", (number,))
    with pytest.raises(VfoaError, match=r"2 of 6 pairs have equal stamps, the others are up to 2 ms apart"):
        find_layouts(tmp_path)
    named = {"left": "left", "right": "right", "stamps": "ms"}
    for tolerance_ms, frames in ((0, stamps[::3]), (2, stamps)):
        (reading,) = recognise_stereo(tmp_path, {**named, "tolerance_ms": tolerance_ms})
        assert f"{len(frames)} pairs" in reading.layout


def test_sides_whose_names_have_two_numbers_say_so(tmp_path: Path) -> None:
    for number, name in enumerate(("take1_01", "take1_02", "take2_01")):
        _write_pairs(tmp_path, f"left/{name}.png", f"right/{name}.png", (number,))
    with pytest.raises(VfoaError, match="2 numbers differ between 'take1_01"):
        recognise_stereo(tmp_path, {})


def test_images_without_a_partner_are_counted(tmp_path: Path) -> None:
    _write_pairs(tmp_path, "l_{}.png", "r_{}.png", (1, 2, 3, 4))
    for name in ("l_1.png", "r_2.png", "r_3.png"):
        (tmp_path / name).unlink()
    (found,) = find_layouts(tmp_path)
    assert len(found.views.frames) == 1
    assert "1 pair of 128 x 96" in str(found)
    assert [note.split(",")[0] for note in found.views.notes] == [
        "2 left images have no right one",
        "1 right image has no left one",
    ]


def test_several_pairs_of_cameras_are_all_named(tmp_path: Path) -> None:
    _write_pairs(tmp_path, "image_0/{}.png", "image_1/{}.png")
    _write_pairs(tmp_path, "image_2/{}.png", "image_3/{}.png", (1, 2, 3, 4))
    assert [(each.source["left"], len(each.views.frames)) for each in find_layouts(tmp_path)] == [
        ("image_2", 4),
        ("image_0", 3),
    ]


PACKED = [("side_by_side", np.hstack), ("top_bottom", np.vstack)]


@pytest.mark.parametrize(("packing", "stack"), PACKED)
def test_images_that_hold_both_views(tmp_path: Path, packing: str, stack: Any) -> None:
    for number in FRAMES:
        write_image(tmp_path / "both" / f"{number}.png", stack(_pair(number)))
    (found,) = find_layouts(tmp_path)
    assert found.source == {"layout": f"images_{packing}", "both": "both"}
    assert (len(found.views.frames), found.size_px) == (3, (WIDTH, HEIGHT))
    _assert_same_frames(_open(found), FRAMES)


@pytest.mark.parametrize(("packing", "stack"), PACKED)
def test_a_video_that_holds_both_views(tmp_path: Path, packing: str, stack: Any) -> None:
    path = write_video(tmp_path / "talk.mkv", [stack(_pair(number)) for number in FRAMES], rate_hz=10.0)
    for where in (tmp_path, path):
        (found,) = find_layouts(where)
        assert found.source == {"layout": f"video_{packing}", "both": "talk.mkv"}
        assert (len(found.views.frames), found.size_px, found.views.rate_hz) == (3, (WIDTH, HEIGHT), 10.0)
    clip = _open(found)
    assert (clip.rate_hz, clip.frame(2).time_ns) == (10.0, 200_000_000)
    assert _open(found, rate_hz=5.0).frame(2).time_ns == 400_000_000
    _assert_like(clip)


def test_the_preview_of_a_calibration_is_no_frame(tmp_path: Path) -> None:
    write_image(tmp_path / "stereo.png", np.hstack(_pair(1)))
    assert [each.source["both"] for each in find_layouts(tmp_path)] == ["."]
    write_text(tmp_path / "stereo.yml", "")
    assert find_layouts(tmp_path) == ()


def test_images_with_a_file_of_their_own_beside_each_are_frames(tmp_path: Path) -> None:
    for image in _write_pairs(tmp_path, "left/{}.png", "right/{}.png").rglob("*.png"):
        write_text(image.with_suffix(".yml"), "exposure: 3")
    (found,) = find_layouts(tmp_path)
    assert found.source == {"layout": "images", "left": "left", "right": "right"}


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [("a.mp4", b"", "not a readable video"), ("a.png", b"\x89PNG\r\n\x1a\n", "truncated PNG")],
)
def test_a_file_that_cannot_be_read_is_said_to_be_so(tmp_path: Path, name: str, content: bytes, said: str) -> None:
    with pytest.raises(VfoaError, match=rf"{name}: {said}"):
        find_layouts(write_bytes(tmp_path / name, content))


def test_videos_that_cannot_be_read_hide_no_images(tmp_path: Path) -> None:
    for side in ("left", "right"):
        write_bytes(tmp_path / f"{side}.mp4", b"")
    with pytest.raises(VfoaError, match=r"left\.mp4: not a readable video"):
        find_layouts(tmp_path)
    (found,) = find_layouts(_write_pairs(tmp_path, "left/{}.png", "right/{}.png"))
    assert found.source["left"] == "left"


def test_two_videos(tmp_path: Path) -> None:
    for side in (0, 1):
        images = [_pair(number)[side] for number in (*FRAMES, 11, 12)]
        write_video(tmp_path / f"{('left', 'right')[side]}.mkv", images[: 5 - 2 * side])
    (found,) = find_layouts(tmp_path)
    assert found.source == {"layout": "videos", "left": "left.mkv", "right": "right.mkv"}
    clip = _open(found)
    assert clip.notes == ("2 left images have no right one, left out: frame 3, 4",)
    _assert_like(clip)


def test_two_videos_of_which_one_lost_a_frame(tmp_path: Path) -> None:
    """The mean rate hides it: one frame of 200."""
    images = [np.full((16, 16, 3), number, np.uint8) for number in range(200)]
    for side in ("left", "right"):
        write_video(tmp_path / f"{side}.mkv", images, "MJPG")
    (whole,) = find_layouts(tmp_path)
    assert _open(whole).notes == ()
    _drop_frame(tmp_path / "right.mkv", 120)
    (found,) = find_layouts(tmp_path)
    assert (
        "right.mkv: from frame 120 on not in step with left.mkv, by up to 40 ms; frames are paired by their places; "
        "tolerance_ms = in [source] pairs them by times" in _open(found).notes
    )
    settings = {"layout": "videos", "left": "left.mkv", "right": "right.mkv", "right_offset": -20, "camera": CAMERA}
    later = StereoFolderClip(StereoFolderSettings.model_validate(settings), tmp_path)
    assert [note[:28] for note in later.notes if "step" in note] == ["right.mkv: from frame 140 on"]


def test_two_videos_whose_times_jitter_are_out_of_step_only_from_the_lost_frame_on(tmp_path: Path) -> None:
    """AVI has exact times, Matroska those of its ms."""
    images = [np.full((16, 16, 3), number, np.uint8) for number in range(200)]
    write_video(tmp_path / "left.avi", images, "MJPG", rate_hz=30.0)
    write_video(tmp_path / "right.mkv", images, "MJPG", rate_hz=30.0)
    _drop_frame(tmp_path / "right.mkv", 120)
    settings = {"layout": "videos", "left": "left.avi", "right": "right.mkv", "camera": CAMERA}
    clip = StereoFolderClip(StereoFolderSettings.model_validate(settings), tmp_path)
    (note,) = (note for note in clip.notes if "step" in note)
    assert note.startswith("right.mkv: from frame 120 on")


@pytest.mark.parametrize("offset", [0, 2, -2])
def test_two_videos_are_paired_by_their_times_if_a_tolerance_is_given(tmp_path: Path, offset: int) -> None:
    """Of the right one, 4 of 20 frames are lost, which is another rate; it was started ``offset`` frames earlier."""
    lost = {4, 5, 11, 17}
    for side, earlier in (("left", 0), ("right", offset)):
        images = [np.full((16, 16, 3), 60 + 8 * (number - earlier), np.uint8) for number in range(20)]
        write_video(tmp_path / f"{side}.mkv", images, "MJPG")
    for already, number in enumerate(sorted(lost, reverse=True)):
        _drop_frame(tmp_path / "right.mkv", number, 20 - already)
    with pytest.raises(VfoaError, match="expected the same rate, or left, right and tolerance_ms ="):
        find_layouts(tmp_path)
    settings = {"layout": "videos", "left": "left.mkv", "right": "right.mkv", "right_offset": offset, "camera": CAMERA}
    clip = StereoFolderClip(StereoFolderSettings.model_validate({**settings, "tolerance_ms": 5}), tmp_path)
    assert set(clip.frames) == {number - offset for number in range(20) if number not in lost} & set(range(20))
    assert clip.rate_hz == 25.0
    for number in reversed(clip.frames):
        frame = clip.frame(number)
        assert frame.time_ns == number * 40_000_000
        assert frame.right is not None
        assert np.abs(frame.left.astype(int) - frame.right).max() <= 2
    assert not any("in step" in note for note in clip.notes)
    narrower = StereoFolderClip(StereoFolderSettings.model_validate({**settings, "tolerance_ms": 4}), tmp_path)
    assert narrower.digest() != clip.digest()


def test_two_videos_of_which_one_is_twice_as_fast(tmp_path: Path) -> None:
    for side, step in (("left", 1), ("right", 2)):
        images = [np.full((16, 16, 3), 60 + 8 * number, np.uint8) for number in range(0, 20, step)]
        write_video(tmp_path / f"{side}.mkv", images, "MJPG", rate_hz=50 / step)
    settings = {"layout": "videos", "left": "left.mkv", "right": "right.mkv", "tolerance_ms": 5, "camera": CAMERA}
    clip = pickle.loads(pickle.dumps(StereoFolderClip(StereoFolderSettings.model_validate(settings), tmp_path)))
    assert clip.frames == tuple(range(0, 20, 2))
    assert np.abs(clip.frame(4).left.astype(int) - clip.frame(4).right).max() <= 2
    assert (clip.rate_hz, clip.time_ns(4)) == (25.0, 80_000_000)


@pytest.mark.parametrize("offset", [2, -3])
def test_two_videos_that_were_not_started_together(tmp_path: Path, offset: int) -> None:
    """A frame of the left one is read with the frame of the right one that was taken at the same time."""
    for side, first, count in ((0, 0, 10), (1, -offset, 9)):
        write_video(tmp_path / f"{side}.mkv", [_flat(number) for number in range(first, first + count)])
    settings = {"layout": "videos", "left": "0.mkv", "right": "1.mkv", "right_offset": offset, "camera": CAMERA}
    clip = StereoFolderClip(StereoFolderSettings.model_validate(settings), tmp_path)
    _expect_views_of_one_time(clip, offset)
    assert clip.films == {"0.mkv": 0.04 * max(0, -offset)}
    assert not any("in step" in note for note in clip.notes)
    together = StereoFolderClip(StereoFolderSettings.model_validate({**settings, "right_offset": 0}), tmp_path)
    assert clip.digest() != together.digest()
    assert not np.array_equal(together.frame(3).left, together.frame(3).right)  # type: ignore[arg-type]


def _expect_views_of_one_time(clip: StereoFolderClip, offset: int) -> None:
    """Of ten left views at 25 Hz, and of nine right ones that begin so many frames earlier."""
    assert clip.frames == tuple(range(max(0, -offset), min(10, 9 - offset)))
    for number in clip.frames:
        frame = clip.frame(number)
        assert frame.right is not None
        assert np.array_equal(frame.left, frame.right)
        assert frame.time_ns == number * 40_000_000


def _flat(number: int) -> np.ndarray:
    return np.full((16, 16, 3), 40 + 12 * number, np.uint8)


@pytest.mark.parametrize("offset", [2, -3])
def test_numbered_images_of_cameras_that_were_not_started_together(tmp_path: Path, offset: int) -> None:
    for side, first, count in ((0, 0, 10), (1, -offset, 9)):
        for number in range(count):
            write_image(tmp_path / f"{side}" / f"{number:04d}.png", _flat(first + number))
    settings = {"left": "0", "right": "1", "right_offset": offset, "rate_hz": 25, "camera": CAMERA}
    clip = StereoFolderClip(StereoFolderSettings.model_validate(settings), tmp_path)
    _expect_views_of_one_time(clip, offset)


def test_images_whose_cameras_count_from_other_numbers_are_recognised_by_their_offset(tmp_path: Path) -> None:
    for side, first in (("a", 0), ("b", 100)):
        for number in range(6):
            write_image(tmp_path / side / f"{first + number:04d}.png", _flat(number))
    (reading,) = recognise_stereo(tmp_path, {"left": "a", "right": "b", "right_offset": 100})
    assert reading.source == {"layout": "images", "left": "a", "right": "b", "right_offset": 100}
    assert "6 pairs" in reading.layout


@pytest.mark.parametrize(
    "files", [{"left": "a", "right": "b", "stamps": "ns"}, {"layout": "images_top_bottom", "both": "a"}]
)
def test_an_offset_of_stamped_or_packed_views_is_refused(files: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match="right_offset"):
        StereoFolderSettings.model_validate({**files, "right_offset": 1, "camera": CAMERA})


def test_an_offset_without_common_frames_is_refused(tmp_path: Path) -> None:
    for side in (0, 1):
        write_video(tmp_path / f"{side}.mkv", [_flat(1)] * 3)
    settings = {"layout": "videos", "left": "0.mkv", "right": "1.mkv", "right_offset": 5, "camera": CAMERA}
    with pytest.raises(VfoaError, match="on both sides"):
        StereoFolderClip(StereoFolderSettings.model_validate(settings), tmp_path)


def _drop_frame(video: Path, number: int, of: int = 200) -> None:
    """Make a frame of a Matroska file a void element of the same length."""
    data = bytearray(video.read_bytes())
    blocks = [match.start() for match in re.finditer(rb"\xa3[\x40-\xff].{0,7}?\x81..\x80", data, re.DOTALL)]
    assert len(blocks) == of
    data[blocks[number]] = 0xEC
    video.write_bytes(data)


def _assert_like(clip: StereoFolderClip) -> None:
    """FFV1 keeps colours to a few levels: it stores them as luma and chroma."""
    assert clip.frames == (0, 1, 2)
    for frame, number in enumerate(FRAMES):
        read = clip.frame(frame)
        for seen, written in zip((read.left, read.right), _pair(number), strict=True):
            assert np.abs(seen.astype(int) - written).mean() < 8


def test_single_images_and_text_are_no_stereo_clip(tmp_path: Path, shared_data: Path) -> None:
    write_text(tmp_path / "notes_left.txt", "")
    assert find_layouts(tmp_path) == ()
    assert find_layouts(shared_data / "sintel" / "training" / "clean_left" / "bandage_2") == ()
    with pytest.raises(VfoaError, match="gone: no such file or folder"):
        find_layouts(tmp_path / "gone")


def test_real_pictures_are_found(shared_data: Path) -> None:
    boards, street = find_layouts(shared_data / "chessboard"), find_layouts(shared_data / "kitti_pair")
    assert [str(board) for board in boards] == ["images: 13 pairs of 640 x 480 (left 'left*.jpg', right 'right*.jpg')"]
    assert [each.source["right"] for each in street] == ["right.png"]


def test_sides_may_differ_in_case() -> None:
    """A tutorial of OpenCV saves stereoLeft/imageL0.png and stereoright/imageR0.png."""
    assert pair_names(["a/stereoLeft", "a/stereoright"], numbered=False) == (("a/stereoLeft", "a/stereoright"),)
    both = ["xLeft", "xright", "xRight"]
    assert pair_names(both, numbered=False) == (("xLeft", "xRight"),)


def test_a_sequence_is_no_pair_of_cameras() -> None:
    assert pair_names([f"image_{n}.png" for n in range(20)], numbered=True) == ()
    assert pair_names(["cam1_view2.png", "bright.png", "upright_1.png"], numbered=True) == ()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"layout": "images", "both": "x"}, r"found both.*layout 'images'"),
        ({"layout": "video_side_by_side", "left": "x"}, "found left; expected both for the layout"),
        ({"left": "x"}, "found left; expected left and right"),
        ({"layout": "sbs", "both": "x"}, "video_top_bottom"),
        ({"layout": "video_top_bottom", "both": "x", "stamps": "ms"}, "stamps: found 'ms'; expected none"),
    ],
)
def test_the_keys_fit_the_layout(settings: dict[str, str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        StereoFolderSettings.model_validate({**settings, "camera": CAMERA})


def test_what_cannot_be_halved_or_joined_is_one_line(tmp_path: Path) -> None:
    write_image(tmp_path / "1.png", np.zeros((9, 7, 3), np.uint8))
    settings = {"layout": "images_side_by_side", "both": "1.png", "camera": CAMERA}
    with pytest.raises(VfoaError, match=r"1\.png: found a width of 7 pixels"):
        StereoFolderClip(StereoFolderSettings.model_validate(settings), tmp_path).frame(1)
    write_video(tmp_path / "l.mkv", [_pair(1)[0]], rate_hz=30)
    write_video(tmp_path / "r.mkv", [_pair(1)[1]], rate_hz=25)
    settings = {"layout": "videos", "left": "l.mkv", "right": "r.mkv", "camera": CAMERA}
    with pytest.raises(VfoaError, match=r"r\.mkv: 25 .*l\.mkv has 30"):
        StereoFolderClip(StereoFolderSettings.model_validate(settings), tmp_path)


def _packed(name: str, folder: Path, black: int, stack: Any = np.hstack) -> Path:
    """A film that holds both views, after black frames, or a folder of such images."""
    pairs = [0 * stack(_pair(2))] * black + [stack(_pair(number)) for number in FRAMES]
    if name.endswith(".avi"):
        write_video(folder / name, pairs)
    else:
        for number, image in enumerate(pairs):
            write_image(folder / name / f"{number}.png", image)
    return folder / name


@pytest.mark.parametrize(
    ("name", "layout", "stack"),
    [
        ("v.avi", "video_side_by_side", np.hstack),
        ("v.avi", "video_top_bottom", np.vstack),
        ("frames", "images_side_by_side", np.hstack),
    ],
)
@pytest.mark.parametrize("given", ["nothing", "the layout", "the layout, its folder"])
def test_two_views_are_found_after_black_frames(tmp_path: Path, name: str, layout: str, stack: Any, given: str) -> None:
    path = _packed(name, tmp_path / "a", 3, stack)
    settings = {} if given == "nothing" else {"layout": layout}
    readings = recognise_stereo(path.parent if given.endswith("folder") else path, settings)
    assert [reading.source["layout"] for reading in readings] == [layout]
    (reading,) = readings
    clip = StereoFolderClip(StereoFolderSettings.model_validate({**reading.source, "camera": CAMERA}), reading.root)
    assert len(clip.frames) == 6
    left, _ = _pair(FRAMES[0])
    assert np.abs(clip.frame(clip.frames[3]).left.astype(int) - left).mean() < 8


def test_the_layout_is_enough_where_the_halves_are_not_alike(tmp_path: Path) -> None:
    write_video(tmp_path / "v.avi", [np.zeros((HEIGHT, 2 * WIDTH, 3), np.uint8)] * 4)
    with pytest.raises(VfoaError, match=r"v\.avi: .*layout=video_side_by_side"):
        recognise_stereo(tmp_path / "v.avi", {})
    (reading,) = recognise_stereo(tmp_path / "v.avi", {"layout": "video_side_by_side"})
    assert reading.source == {"layout": "video_side_by_side", "both": "v.avi"}
    with pytest.raises(VfoaError, match=r"images_side_by_side' .*'v\.avi'.*'video_"):
        recognise_stereo(tmp_path / "v.avi", {"layout": "images_side_by_side"})


def test_images_with_an_index_and_a_stamp_are_pairs_by_their_index(tmp_path: Path) -> None:
    for number in FRAMES:
        for side, image, late_us in zip(("left", "right"), _pair(number), (0, 130), strict=True):
            write_image(
                tmp_path / side / f"{number:06d}_{1_718_000_000_000_000 + number * 40_000 + late_us}.png", image
            )
    (found,) = find_layouts(tmp_path)
    _assert_same_frames(_open(found), FRAMES)
