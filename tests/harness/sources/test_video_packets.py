"""Videos whose packets are messages, against the images they were coded from."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.sources.recordings import video
from harness.sources.recordings.clip import RecordingClip
from harness.sources.recordings.settings import RecordingSettings
from tests.adapter_contract import check_contract
from tests.depth_recordings import CODERS, Encoder, Format, Lens, Shot, messages, write_video_take
from tests.disk import moving_picture
from vfoa.errors import VfoaError

START_NS, STEP_NS = 1_700_000_000_000_000_007, 40_000_000
WIDTH, HEIGHT, COUNT = 128, 96, 25
IMAGES = [moving_picture(number, WIDTH, HEIGHT) for number in range(1, COUNT + 1)]
DEPTH_MM = np.full((HEIGHT, WIDTH), 1500, np.uint16)
LENS = Lens(width=WIDTH, height=HEIGHT, fx=100.0, cx=63.5, cy=47.5)
Packets = list[tuple[int, bytes, bool]]


def stamp(number: int) -> int:
    return START_NS + number * STEP_NS


def coded(name: str) -> Packets:
    coder, options = CODERS[name]
    return Encoder(coder, WIDTH, HEIGHT, options).packets(IMAGES)


def write_sdk(path: Path, name: str, packets: Packets) -> Path:
    """Colour as a video and depth, by Foxglove's SDK in protobuf."""
    shots = [
        Shot(stamp_ns=stamp(number), colour=IMAGES[number], depth_mm=DEPTH_MM, lens=LENS) for number in range(COUNT)
    ]
    return write_video_take(path, name, packets, shots)


def open_clip(path: Path, **settings: object) -> RecordingClip:
    data = {"recording": path.name, **settings}
    return RecordingClip(RecordingSettings.model_validate(data), path.parent)


def read_in_turn(path: Path) -> list[np.ndarray]:
    clip = open_clip(path)
    return [clip.frame(number).left for number in clip.frames]


def assert_is(found: np.ndarray, number: int) -> None:
    """The image of this number, and of no other one."""
    errors = [float(np.abs(found.astype(int) - image.astype(int)).mean()) for image in IMAGES]
    assert int(np.argmin(errors)) == number
    assert errors[number] < 3


@pytest.mark.parametrize("name", CODERS)
def test_every_codec_gives_each_frame_in_any_order(tmp_path: Path, name: str) -> None:
    clip = open_clip(write_sdk(tmp_path / "a.mcap", name, coded(name)))
    assert list(clip.frames) == list(range(1, COUNT + 1))
    assert clip.notes == ()
    for number in [*clip.frames, 25, 3, 14, 13, 1, 24, 11, 12]:
        frame = clip.frame(number)
        assert frame.time_ns == stamp(number - 1)
        assert_is(frame.left, number - 1)
        assert frame.depth_m is not None
        assert frame.depth_m[5, 5] == pytest.approx(1.5)
        assert frame.rig.fx_px == LENS.fx


@pytest.mark.parametrize("name", CODERS)
def test_a_packet_of_too_many_pixels_is_not_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    clip = open_clip(write_sdk(tmp_path / "a.mcap", name, coded(name)))
    monkeypatch.setattr(video, "MOST_PIXELS", WIDTH * HEIGHT // 2)
    monkeypatch.setattr(video, "DECODING", {"max_pixels": str(WIDTH * HEIGHT // 2)})
    with pytest.raises(VfoaError, match=r"frame 1: [^\n]*packet 1 .*6144 pixels"):
        clip.frame(1)


def test_packets_are_cropped_as_they_say(tmp_path: Path) -> None:
    packets = Encoder("libx264", WIDTH, HEIGHT, {"crf": "12", "bf": "0", "x264-params": "crop-rect=8,6,4,2"})
    with messages(tmp_path, "mcap") as (path, write):
        lens = Lens(width=WIDTH - 12, height=HEIGHT - 8, fx=100.0, cx=55.5, cy=41.5)
        write.camera("/rgb/camera_info", START_NS, lens)
        for number, data, _ in packets.packets(IMAGES):
            write.image("/depth_to_rgb/image_raw", stamp(number), DEPTH_MM[:-8, :-12], "16UC1")
            write.compressed("/rgb/image_raw/compressed", stamp(number), "h264", data)
    found = open_clip(path).frame(3).left
    assert np.abs(found.astype(int) - IMAGES[2][6:-2, 8:-4]).mean() < 3


@pytest.mark.parametrize("kind", ["bag", "db3"])
def test_a_video_goes_on_in_the_next_part_of_a_bag(tmp_path: Path, kind: Format) -> None:
    """Recorders begin a new part between two key frames; a killed one leaves no list of them."""
    packets, split = coded("h264"), tmp_path / "split"
    split.mkdir()
    for part in range(11):
        numbers = range(2 * part, 2 * part + 2)
        with messages(tmp_path, kind, f"part{part}") as (path, write):
            write.camera("/rgb/camera_info", stamp(numbers[0]), LENS)
            for number in numbers:
                write.image("/depth_to_rgb/image_raw", stamp(number), DEPTH_MM, "16UC1")
                write.compressed("/rgb/image_raw/compressed", stamp(number), "h264", packets[number][1])
        file = path if path.is_file() else next(path.glob("*.db3"))
        file.rename(split / f"take_{part}{file.suffix}")
    for number, image in enumerate(read_in_turn(split)):
        assert_is(image, number)


def test_a_seek_gives_the_very_pixels_of_reading_in_turn(tmp_path: Path) -> None:
    path = write_sdk(tmp_path / "a.mcap", "h264", coded("h264"))
    in_turn = read_in_turn(path)
    clip = open_clip(path)
    for number in np.random.default_rng(0).permutation(COUNT).tolist():
        assert np.array_equal(clip.frame(number + 1).left, in_turn[number])
    check_contract(pickle.loads(pickle.dumps(clip)))


@pytest.mark.parametrize("options", ["keyint=4", "keyint=6:bframes=2"])
def test_a_seek_into_a_refresh_part_by_part_gives_the_very_pixels_of_reading_in_turn(
    tmp_path: Path, options: str
) -> None:
    """A decoder that begins with a refresh gives no frame before its end."""
    packets = Encoder("libx264", WIDTH, HEIGHT, {"crf": "12", "x264-params": f"intra-refresh=1:{options}"})
    path = write_sdk(tmp_path / "a.mcap", "h264", packets.packets(IMAGES))
    for number, image in enumerate(read_in_turn(path)):
        assert_is(image, number)
        assert np.array_equal(open_clip(path).frame(number + 1).left, image)


@pytest.mark.parametrize(("encoding", "between"), [("libx264", 3), ("h264;yuv420p;bgr8", 8)])
def test_packets_of_ffmpeg_transport_with_reordered_frames(tmp_path: Path, encoding: str, between: int) -> None:
    """B frames come after the frames they lie between: stamps, not the order of packets, number the frames."""
    options = {"preset": "medium", "crf": "12", "bf": str(between), "b_strategy": "0"}
    packets = Encoder("libx264", WIDTH, HEIGHT, options).packets(IMAGES)
    assert [number for number, _, _ in packets] != sorted(number for number, _, _ in packets)
    with messages(tmp_path, "db3") as (path, write):
        write.camera("/rgb/camera_info", START_NS, LENS)
        for order, (number, data, is_key) in enumerate(packets):
            write.image("/depth_to_rgb/image_raw", stamp(order), DEPTH_MM, "16UC1")
            taken_ns, sent_ns = stamp(number), stamp(order + 5)
            write.packet("/rgb/image_raw/ffmpeg", taken_ns, encoding, data, is_key=is_key, log_ns=sent_ns)
    clip = open_clip(path, stamps="header")
    assert not any("set back" in note or "gap" in note for note in clip.notes)
    for number in [*clip.frames, 20, 2, 9]:
        assert_is(clip.frame(number).left, number - 1)


def write_compressed(folder: Path, container: Format, form: str, packets: Packets) -> Path:
    """Packets of a video as compressed images of ROS, one frame each 40 ms, and depth."""
    with messages(folder, container) as (path, write):
        write.camera("/rgb/camera_info", START_NS, LENS)
        for number, data, _ in packets:
            write.image("/depth_to_rgb/image_raw", stamp(number), DEPTH_MM, "16UC1")
            write.compressed("/rgb/image_raw/compressed", stamp(number), form, data)
    return path


@pytest.mark.parametrize(
    ("container", "codec", "form"),
    [
        ("mcap", "h264", "h264"),
        ("db3", "h264", "bgr8; h264 compressed"),
        ("bag", "h265", "H265"),
        ("mcap", "vp9", "vp9"),
    ],
)
def test_packets_in_compressed_images_are_a_video(tmp_path: Path, container: Format, codec: str, form: str) -> None:
    path = write_compressed(tmp_path, container, form, coded(codec))
    clip = open_clip(path)
    assert list(clip.frames) == list(range(1, COUNT + 1))
    for number in [*clip.frames, 25, 3, 14, 13]:
        frame = clip.frame(number)
        assert frame.time_ns == stamp(number - 1)
        assert_is(frame.left, number - 1)
    part = open_clip(path, start_s=0.56)
    assert len(part.frames) == COUNT - 14
    for number in (1, 4, 2):  # of which the key frame lies before the window
        assert_is(part.frame(number).left, 13 + number)


def test_a_window_begins_between_key_frames(tmp_path: Path) -> None:
    path = write_sdk(tmp_path / "a.mcap", "h264", coded("h264"))
    clip = open_clip(path, start_s=0.56)
    assert len(clip.frames) == COUNT - 14
    assert_is(clip.frame(1).left, 14)


def test_a_video_that_begins_without_a_key_frame_says_from_where_it_can_be_read(tmp_path: Path) -> None:
    path = write_sdk(tmp_path / "a.mcap", "h264", coded("h264")[4:])
    clip = open_clip(path)
    with pytest.raises(VfoaError, match=r"/rgb/video[^\n]*key frame[^\n]*start_s"):
        clip.frame(1)
    assert_is(clip.frame(8).left, 11)


@pytest.mark.parametrize("damage", [lambda data: b"", lambda data: bytes(len(data)), lambda data: data[:7]])
def test_a_damaged_packet_costs_its_frames_and_no_others(tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    packets = coded("h264")
    number, data, is_key = packets[12]
    packets[12] = number, damage(data), is_key
    clip = open_clip(write_sdk(tmp_path / "a.mcap", "h264", packets))
    with pytest.raises(VfoaError, match=r"^[^\n]*frame 13: [^\n]*packet 13[^\n]*$"):
        clip.frame(13)
    assert_is(clip.frame(9).left, 8)
    assert_is(clip.frame(22).left, 21)


@pytest.mark.parametrize(("lost", "doubtful"), [(3, 6), (12, 7), (9, 0), (24, 0)])
def test_images_after_a_lost_packet_are_counted(tmp_path: Path, lost: int, doubtful: int) -> None:
    """The decoder of H.264 guesses them up to the next key frame, of which there is one in ten."""
    packets = coded("h264")
    clip = open_clip(write_sdk(tmp_path / "a.mcap", "h264", packets[:lost] + packets[lost + 1 :]))
    wrong = [
        number
        for number in clip.frames
        if np.abs(clip.frame(number).left.astype(int) - IMAGES[(clip.time_ns(number) - START_NS) // STEP_NS]).mean() > 3
    ]
    assert len(wrong) == doubtful
    assert [note.startswith(f"/rgb/video: {doubtful} of 24 images ") for note in clip.notes] == [True] * (doubtful > 0)


def test_only_images_of_the_part_are_counted_after_a_lost_packet(tmp_path: Path) -> None:
    packets = coded("h264")
    path = write_sdk(tmp_path / "a.mcap", "h264", packets[:12] + packets[13:])
    notes = [open_clip(path, start_s=start_s, end_s=0.72).notes for start_s in (0.64, 0.68)]
    assert [[note.split(" images")[0] for note in each] for each in notes] == [
        ["/rgb/video: 2 of 2"],
        ["/rgb/video: 1 of 1"],
    ]
    assert open_clip(path, start_s=0.8).notes == ()
