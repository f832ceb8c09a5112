"""MCAP recordings: every family of messages, cameras, calibrations and stamps."""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType
from numpy.typing import NDArray

from harness.labels.files import VERSION_LINE, read_annotations, write_annotations
from harness.labels.labels import format_seconds, timeline_of
from harness.sources.recordings.clip import McapClip
from harness.sources.recordings.settings import RecordingSettings
from tests.calibrations import write_opencv
from tests.disk import HEIGHT, WIDTH, picture, write_text
from tests.harness.sources.numbered_recording import LEFT, RIGHT, STEP_NS, open_clip, pairs, stamp
from tests.recordings import Camera, Family, Pixels, recorder, rectified_camera, write_pairs
from vfoa.errors import VfoaError


@pytest.mark.parametrize("pixels", ["raw", "png"])
@pytest.mark.parametrize("family", ["ros2", "protobuf", "json"])
def test_every_family_gives_back_what_was_recorded(tmp_path: Path, family: Family, pixels: Pixels) -> None:
    clip = open_clip(write_pairs(tmp_path / "a.mcap", pairs(), family, pixels))
    assert list(clip.frames) == [1, 2, 3, 4, 5]
    assert clip.rate_hz == 25.0
    assert clip.notes == ()
    for n in (4, 1, 5):
        frame = clip.frame(n)
        assert frame.time_ns == stamp(n)
        assert np.array_equal(frame.left, picture(n))
        assert np.array_equal(frame.right, picture(1000 + n))
        rig = frame.rig
        assert (rig.fx_px, rig.cx_px, rig.cx_right_px, rig.cy_px) == (100.0, 31.5, 30.0, 23.5)
        assert rig.baseline_m == pytest.approx(0.12)


def test_labels_may_be_written_by_stamp(tmp_path: Path) -> None:
    clip = open_clip(write_pairs(tmp_path / "a.mcap", pairs()))
    change = format_seconds(stamp(3))
    rows = f"1700000000.0,{change},girl,bird,\n{change},1700000009,girl,none,\n"
    path = write_text(tmp_path / "a.csv", f"{VERSION_LINE}\nstart_s,end_s,subject,target,note\n{rows}")
    labels = read_annotations(path, timeline=timeline_of(clip), subjects=["girl"], targets=["bird"])
    assert [label.target for _, _, label in labels.labelled(clip.frames)] == ["bird"] * 2 + ["none"] * 3
    write_annotations(tmp_path / "b.csv", labels)
    assert (tmp_path / "b.csv").read_text() == path.read_text().replace("1700000000.0,", "1700000000,")


def test_jpeg_is_close(tmp_path: Path) -> None:
    smooth = cv2.GaussianBlur(picture(3), (0, 0), 6)
    clip = open_clip(
        write_pairs(tmp_path / "a.mcap", [(stamp(1), smooth, smooth, LEFT, RIGHT)], pixels="jpeg"),
    )
    assert np.abs(clip.frame(1).left.astype(int) - smooth).mean() < 2


def test_images_of_another_size_than_the_first_are_refused_with_a_given_camera(tmp_path: Path) -> None:
    with recorder(tmp_path / "a.mcap") as record:
        for n in (1, 2):
            for side in ("left", "right"):
                record.picture(f"/{side}/image", stamp(n), picture(n, WIDTH // n, HEIGHT // n))
    camera = {"fx_px": 100, "cx_px": 31.5, "cy_px": 23.5, "baseline_m": 0.1}
    clip = open_clip(tmp_path / "a.mcap", camera=camera)
    for number in (2, 1, 2):
        if number == 1:
            assert clip.frame(number).left.shape == (HEIGHT, WIDTH, 3)
            continue
        with pytest.raises(VfoaError, match=r"frame 2: found an image of 32 x 24 pixels; expected 64 x 48, as in"):
            clip.frame(number)


@pytest.mark.parametrize(
    ("image", "info"),
    [
        ("/stereo/{}", "/stereo/{}/camera_info"),
        ("/stereo/{}_image", "/stereo/{}_camera_info"),
        ("/rig/image_{}/compressed", "/rig/camera_info_{}"),
        ("/rig/{}/image_raw", "/rig/{}_info"),
        ("/{}_image", "/{}_camera_info"),
    ],
)
def test_the_calibration_of_an_image_is_found_by_its_words(tmp_path: Path, image: str, info: str) -> None:
    with recorder(tmp_path / "a.mcap") as record:
        for side, camera in (("left", LEFT), ("right", RIGHT)):
            record.camera(info.format(side), stamp(1), camera)
            record.picture(image.format(side), stamp(1), picture(1))
    rig = open_clip(tmp_path / "a.mcap").frame(1).rig
    assert (rig.cx_px, rig.cx_right_px) == (31.5, 30.0)


@pytest.mark.parametrize(("image", "fx"), [("image_rect", 90.0), ("image_raw", 100.0)])
def test_the_calibration_of_rectified_images_may_be_beside_that_of_raw_ones(
    tmp_path: Path, image: str, fx: float
) -> None:
    with recorder(tmp_path / "a.mcap") as record:
        for side, baseline_m in (("left", 0.0), ("right", 0.12)):
            for info, fx_px in (("camera_info", 100.0), ("camera_info_rect", 90.0)):
                camera = rectified_camera(WIDTH, HEIGHT, fx_px, 31.5, 23.5, baseline_m)
                record.camera(f"/hawk/{side}/{info}", stamp(1), camera)
            record.picture(f"/hawk/{side}/{image}", stamp(1), picture(1))
    assert open_clip(tmp_path / "a.mcap").frame(1).rig.fx_px == fx


@pytest.mark.parametrize(
    ("sent_ms", "used"), [([-3, 37, 77], [1, 2, 3]), ([3, 43, 83], [1, 2, 3]), ([0, 62, 63], [1, 1, 3])]
)
def test_a_zooming_camera_has_the_calibration_that_is_sent_with_the_image(
    tmp_path: Path, sent_ms: list[int], used: list[int]
) -> None:
    """Some drivers stamp it some ms after the image; one that is not sent with an image holds from then on."""
    with recorder(tmp_path / "a.mcap") as record:
        for n, at_ms in enumerate(sent_ms, start=1):
            for side, baseline_m in (("left", 0.0), ("right", 0.12)):
                camera = rectified_camera(WIDTH, HEIGHT, 100.0 * n, 31.5, 23.5, baseline_m)
                record.camera(f"/{side}/camera_info", stamp(1) + at_ms * 1_000_000, camera)
                record.picture(f"/{side}/image", stamp(n), picture(n))
    clip = open_clip(tmp_path / "a.mcap")
    assert [clip.frame(n).rig.fx_px for n in clip.frames] == [100.0 * n for n in used]


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
def test_every_compression_is_read(tmp_path: Path, compression: CompressionType) -> None:
    clip = open_clip(write_pairs(tmp_path / "a.mcap", pairs(), compression=compression))
    assert np.array_equal(clip.frame(5).right, picture(1005))


@pytest.mark.parametrize("options", [{"index_types": IndexType.NONE, "use_statistics": False}, {"use_chunking": False}])
def test_neither_index_nor_chunks_are_needed(tmp_path: Path, options: dict[str, object]) -> None:
    clip = open_clip(write_pairs(tmp_path / "a.mcap", pairs(), "protobuf", **options))
    assert (len(clip.frames), clip.notes) == (5, ())
    assert np.array_equal(clip.frame(2).left, picture(2))


def write_unset(path: Path, header_ns: int = 0) -> Path:
    """A recording whose headers all hold one time, logged at 25 Hz."""
    with recorder(path) as record:
        for n in range(1, 6):
            for side, camera, seed in (("left", LEFT, n), ("right", RIGHT, 1000 + n)):
                record.camera(f"/{side}/camera_info", header_ns, camera, log_ns=stamp(n))
                record.picture(f"/{side}/image", header_ns, picture(seed), log_ns=stamp(n))
    return path


@pytest.mark.parametrize("header_ns", [0, 5])
def test_stamps_of_the_log_join_what_headers_cannot(tmp_path: Path, header_ns: int) -> None:
    path = write_unset(tmp_path / "a.mcap", header_ns)
    clip = open_clip(path, stamps="log")
    assert [clip.frame(n).time_ns for n in clip.frames] == [stamp(n) for n in range(1, 6)]
    assert np.array_equal(clip.frame(4).right, picture(1004))
    assert clip.rate_hz == 25.0
    assert clip.notes == ('images are joined by the time of recording (stamps = "log"), not by when they were taken',)


def test_unset_headers_are_said_with_the_way_out(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r'time stamp.*\(stamps = "log" in'):
        open_clip(write_unset(tmp_path / "a.mcap"))


def test_images_of_other_topics_need_no_stamps(tmp_path: Path) -> None:
    with recorder(tmp_path / "a.mcap") as record:
        for n in (1, 2):
            for side, camera in (("left", LEFT), ("right", RIGHT)):
                record.camera(f"/{side}/camera_info", stamp(n), camera)
                record.picture(f"/{side}/image", stamp(n), picture(n))
            record.picture("/detector/debug_image", 0, picture(n), log_ns=stamp(n))
    clip = open_clip(tmp_path / "a.mcap")
    assert [clip.time_ns(n) for n in clip.frames] == [stamp(1), stamp(2)]
    assert clip.notes == ()


@pytest.mark.parametrize(
    ("stamps", "kept", "lost"),
    [
        ([0, STEP_NS, 2 * STEP_NS], [0, STEP_NS, 2 * STEP_NS], 0),  # a simulation
        ([0, stamp(1), stamp(2)], [stamp(1), stamp(2)], 1),  # a node that had no clock yet
        ([0, 0, STEP_NS], [STEP_NS], 2),
    ],
)
def test_the_first_stamp_of_a_simulation_is_0(tmp_path: Path, stamps: list[int], kept: list[int], lost: int) -> None:
    with recorder(tmp_path / "a.mcap") as record:
        for n, stamp_ns in enumerate(stamps, start=1):
            for side, camera in (("left", LEFT), ("right", RIGHT)):
                record.camera(f"/{side}/camera_info", stamp_ns, camera, log_ns=stamp(n))
                record.picture(f"/{side}/image", stamp_ns, picture(n), log_ns=stamp(n))
    clip = open_clip(tmp_path / "a.mcap")
    assert [clip.time_ns(n) for n in clip.frames] == kept
    assert np.array_equal(clip.frame(1).left, picture(lost + 1))
    losses = [f"/{side}/image: {lost} of 3 images have no time stamp and are left out" for side in ("left", "right")]
    assert list(clip.notes) == (losses if lost else [])


def test_a_recording_may_be_logged_from_0_on(tmp_path: Path) -> None:
    with recorder(tmp_path / "a.mcap") as record:
        for side, camera in (("left", LEFT), ("right", RIGHT)):
            record.camera(f"/{side}/camera_info", 0, camera)
            record.picture(f"/{side}/image", 0, picture(1))
    clip = open_clip(tmp_path / "a.mcap", stamps="log")
    assert [clip.time_ns(n) for n in clip.frames] == [0]


def written_in_order(path: Path, written: Sequence[tuple[int, int]]) -> Path:
    """A recording of pictures with these numbers of (the stamp, the log time), in this order of writing."""
    with recorder(path) as record:
        for number, (stamped, logged) in enumerate(written, start=1):
            for side, camera in (("left", LEFT), ("right", RIGHT)):
                record.camera(f"/{side}/camera_info", stamp(stamped), camera, log_ns=stamp(logged))
                record.picture(f"/{side}/image", stamp(stamped), picture(number), log_ns=stamp(logged))
    return path


def test_a_clock_that_was_set_back_while_recording_is_noted(tmp_path: Path) -> None:
    """Frames of two times are mixed by their stamps; the log has the order in which they were taken."""
    set_back = [*((n, n) for n in range(1, 11)), *((n - 5, n) for n in range(11, 21))]
    path = written_in_order(tmp_path / "a.mcap", set_back)
    (note,) = (note for note in open_clip(path).notes if "set back" in note)
    assert note.startswith("/left/image: 4 messages ")
    assert "by up to 0.16 s" in note
    clip = open_clip(path, stamps="log")
    assert [clip.frame(n).time_ns for n in clip.frames] == [stamp(n) for n in range(1, 21)]
    assert not any("set back" in note for note in clip.notes)


def test_images_that_a_recorder_wrote_in_another_order_are_sorted_without_a_note(tmp_path: Path) -> None:
    order = [4, 1, 2, 3, 6, 5, 9, 7, 8]
    clip = open_clip(written_in_order(tmp_path / "a.mcap", [(n, n) for n in order]))
    assert [clip.frame(n).time_ns for n in clip.frames] == [stamp(n) for n in range(1, 10)]
    assert np.array_equal(clip.frame(1).left, picture(2))
    assert clip.notes == ()


def test_an_attachment_and_metadata_change_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with recorder(path) as record:
        for n in (1, 2):
            record.writer.add_attachment(stamp(n), stamp(n), "log.txt", "text/plain", b"x" * 100_000)
            record.writer.add_metadata("weather", {"sun": "yes"})
            for side, camera in (("left", LEFT), ("right", RIGHT)):
                record.camera(f"/{side}/camera_info", stamp(n), camera)
                record.picture(f"/{side}/image", stamp(n), picture(n))
    clip = open_clip(path)
    assert (list(clip.frames), clip.notes) == ([1, 2], ())


def test_a_folder_of_files_is_one_recording(tmp_path: Path) -> None:
    for part, numbers in ((0, range(1, 4)), (2, range(4, 6)), (10, range(6, 9))):
        write_pairs(tmp_path / "split" / f"day_{part}.mcap", pairs(numbers))
    clip = McapClip(RecordingSettings(), tmp_path / "split")
    assert list(clip.frames) == list(range(1, 9))
    assert [clip.frame(n).time_ns for n in clip.frames] == [stamp(n) for n in range(1, 9)]
    assert np.array_equal(clip.frame(7).left, picture(7))


@pytest.mark.parametrize(
    ("first", "said"),
    [(6, None), (255, None), (256, r"10 s lie between them"), (1, "both are of the same time")],
)
def test_recordings_of_their_own_in_a_folder_are_told(tmp_path: Path, first: int, said: str | None) -> None:
    """The parts of a recording follow each other: files of different times, or of the same, may be several clips."""
    for name, numbers in (("anna.mcap", range(1, 6)), ("ben.mcap", range(first, first + 5))):
        write_pairs(tmp_path / "day" / name, pairs(numbers))
    notes = [note for note in McapClip(RecordingSettings(), tmp_path / "day").notes if "separate recordings" in note]
    assert [note.startswith(f"anna.mcap, ben.mcap: {said}") for note in notes] == ([] if said is None else [True])
    (recognised,) = McapClip.recognise(tmp_path / "day", {})
    assert recognised.layout == "an MCAP recording in 2 files"


def test_what_macos_leaves_beside_a_recording_is_none(tmp_path: Path) -> None:
    write_pairs(tmp_path / "day.mcap", pairs())
    (tmp_path / "._day.mcap").write_bytes(b"\0\5\26\7")
    assert len(McapClip.recognise(tmp_path, {})) == 1
    assert len(McapClip(RecordingSettings(), tmp_path).frames) == 5


def test_images_without_a_partner_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with recorder(path) as record:
        record.camera("/left/camera_info", stamp(1), LEFT)
        record.camera("/right/camera_info", stamp(1), RIGHT)
        for n in range(1, 11):
            record.picture("/left/image", stamp(n), picture(n))
            if n not in (3, 7):
                late_ns = 15_000_000 if n == 9 else 500_000
                record.picture("/right/image", stamp(n) + late_ns, picture(1000 + n))
    clip = open_clip(path, tolerance_ms=1)
    assert [clip.frame(n).time_ns for n in clip.frames] == [stamp(n) for n in (1, 2, 4, 5, 6, 8, 10)]
    assert np.array_equal(clip.frame(7).right, picture(1010))
    assert clip.notes == (
        "/left/image: 3 of 10 images have no partner within 1 ms",
        "/right/image: 1 of 8 images have no partner within 1 ms",
        "1 more pair is 15 ms apart, which tolerance_ms = in [source] would allow",
    )
    assert len(open_clip(path, tolerance_ms=15).frames) == 8
    with pytest.raises(VfoaError, match=r"/left/image .*0\.1 ms"):
        open_clip(path, tolerance_ms=0.1)


def test_a_clip_travels_to_another_process(tmp_path: Path) -> None:
    clip = open_clip(write_pairs(tmp_path / "a.mcap", pairs()))
    clip.frame(1)
    again = pickle.loads(pickle.dumps(clip))
    assert np.array_equal(again.frame(3).left, picture(3))
    assert again.digest() == clip.digest()


def test_the_digest_is_of_content_not_of_place(tmp_path: Path) -> None:
    one, other = (write_pairs(tmp_path / name, pairs()) for name in ("x/a.mcap", "y/b.mcap"))
    assert open_clip(one).digest() == open_clip(other).digest()
    assert open_clip(one).digest() != open_clip(one, tolerance_ms=1).digest()
    changed = write_pairs(tmp_path / "z" / "a.mcap", pairs(range(2, 7)))
    assert open_clip(one).digest() != open_clip(changed).digest()


def test_a_camera_that_changes_is_followed(tmp_path: Path) -> None:
    def zooming() -> Iterator[tuple[int, NDArray[np.uint8], NDArray[np.uint8], Camera, Camera]]:
        for n in range(1, 4):
            left, right = (rectified_camera(WIDTH, HEIGHT, 100.0 + n, 31.5, 23.5, b) for b in (0.0, 0.1))
            yield stamp(n), picture(n), picture(n), left, right

    clip = open_clip(write_pairs(tmp_path / "a.mcap", zooming()))
    assert [clip.frame(n).rig.fx_px for n in (3, 1, 2)] == [103.0, 101.0, 102.0]
    assert clip.frame(2).rig.baseline_m == pytest.approx(0.1)


def test_images_with_distortion_are_rectified_unless_they_are_already(tmp_path: Path) -> None:
    bent = {"d": (-0.2, 0.05, 0.001, 0.001, 0.0)}
    left, right = (Camera(width=WIDTH, height=HEIGHT, k=c.k, p=c.p, **bent) for c in (LEFT, RIGHT))
    path = write_pairs(tmp_path / "a.mcap", [(stamp(1), picture(1), picture(2), left, right)])
    k = np.array(left.k).reshape(3, 3)
    expected = cv2.undistort(picture(1), k, np.array(bent["d"]))
    found = open_clip(path).frame(1).left
    assert np.abs(found.astype(int) - expected).mean() < 1
    assert not np.array_equal(found, picture(1))
    assert np.array_equal(open_clip(path, rectified=True).frame(1).left, picture(1))


@pytest.mark.parametrize(
    ("name", "is_rectified"),
    [
        *(("image_rect", True), ("image_rect_color", True), ("rect/image", True), ("rectified/image_raw", True)),
        *(("image_raw", False), ("rectilinear/image", False), ("direct/image", False)),
    ],
)
def test_images_that_are_called_rectified_are_not_rectified_again(
    tmp_path: Path, name: str, is_rectified: bool
) -> None:
    """By ROS's convention the calibration beside them has the distortion of the raw images."""
    with recorder(tmp_path / "a.mcap") as record:
        for side, camera in (("left", LEFT), ("right", RIGHT)):
            record.camera(f"/{side}/camera_info", stamp(1), replace(camera, d=(-0.2, 0.05, 0.001, 0.001, 0.0)))
            record.picture(f"/{side}/{name}", stamp(1), picture(1))
    frame = open_clip(tmp_path / "a.mcap").frame(1)
    assert np.array_equal(frame.left, picture(1)) == is_rectified
    assert frame.rig.baseline_m == pytest.approx(0.12)


def test_the_calibration_may_be_a_file(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with recorder(path) as record:
        record.picture("/left/image", stamp(1), picture(1))
        record.picture("/right/image", stamp(1), picture(2))
    rows = {"P2": "100 0 31.5 0 0 100 23.5 0 0 0 1 0", "P3": "100 0 31.5 -25 0 100 23.5 0 0 0 1 0"}
    (tmp_path / "calib.txt").write_text("".join(f"{key}: {row}\n" for key, row in rows.items()))
    assert open_clip(path, calibration="calib.txt").frame(1).rig.baseline_m == pytest.approx(0.25)
    with pytest.raises(VfoaError, match=r"calibration .*/left/image"):
        open_clip(path)


def test_a_file_may_say_what_rectified_the_images(tmp_path: Path) -> None:
    """All that stereoRectify was given and gave; with ``rectified`` it is not done again."""
    path = tmp_path / "a.mcap"
    with recorder(path) as record:
        record.picture("/left/image", stamp(1), picture(1))
        record.picture("/right/image", stamp(1), picture(2))
    k, d, size = np.array(LEFT.k).reshape(3, 3), np.array([-0.2, 0.05, 0, 0]), (WIDTH, HEIGHT)
    turn, shift = cv2.Rodrigues(np.array([0.01, 0.02, 0]))[0], np.array([[-0.25], [0.0], [0.0]])
    found = dict(zip(("R1", "R2", "P1", "P2"), cv2.stereoRectify(k, d, k, d, size, turn, shift), strict=False))
    write_opencv(tmp_path / "c.yml", {"K1": k, "D1": d, "K2": k, "D2": d, "R": turn, "T": shift, **found}, size)
    frame = open_clip(path, calibration="c.yml", rectified=True).frame(1)
    assert np.array_equal(frame.left, picture(1))
    assert frame.rig.baseline_m == pytest.approx(0.25)
    assert not np.array_equal(open_clip(path, calibration="c.yml").frame(1).left, picture(1))


def test_calibrations_that_were_exchanged_are_named(tmp_path: Path) -> None:
    path = write_pairs(tmp_path / "a.mcap", [(stamp(1), picture(1), picture(2), RIGHT, LEFT)])
    said = r"/stereo/left/camera_info and /stereo/right/camera_info: the baseline is -0\.12 m .*--baseline METRES"
    with pytest.raises(VfoaError, match=said):
        open_clip(path).frame(1)


def test_a_file_that_changed_since_it_was_opened_is_one_line(tmp_path: Path) -> None:
    path = write_pairs(tmp_path / "a.mcap", pairs())
    clip = open_clip(path)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(VfoaError, match=r"a\.mcap: frame 5: .*byte \d+ "):
        clip.frame(5)


def test_many_cameras_are_listed_with_type_and_count(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with recorder(path) as record:
        for n in range(1, 4):
            for camera in ("front", "rear"):
                for side, calibration in (("left", LEFT), ("right", RIGHT)):
                    record.picture(f"/{camera}/{side}/image", stamp(n), picture(n))
                    record.camera(f"/{camera}/{side}/camera_info", stamp(n), calibration)
    with pytest.raises(VfoaError, match=r"2 pairs.*/rear/left/image .*3 messages"):
        open_clip(path)
    assert len(open_clip(path, left="/rear/left/image").frames) == 3
    with pytest.raises(VfoaError, match=r"right .*'/rear/image'; .*/front/left"):
        open_clip(path, left="/rear/left/image", right="/rear/image")


def test_depth_of_two_depth_cameras_is_not_taken_for_their_images(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    depth = np.full((HEIGHT, WIDTH), 1500, "<u2")
    with recorder(path) as record:
        for n in (1, 2):
            for side, camera in (("left", LEFT), ("right", RIGHT)):
                record.camera(f"/{side}/rgb/camera_info", stamp(n), camera)
                record.picture(f"/{side}/rgb/image_raw", stamp(n), picture(n))
                record.raw(f"/{side}/depth/image_raw", stamp(n), WIDTH, HEIGHT, "16UC1", 2 * WIDTH, depth.tobytes())
    clip = open_clip(path)
    assert np.array_equal(clip.frame(2).right, picture(2))
    assert len(clip.notes) == 1  # that depth was recorded


def test_a_recording_without_cameras_names_what_it_has(shared_data: Path) -> None:
    with pytest.raises(VfoaError) as caught:
        open_clip(shared_data / "mcap" / "no_image_topics.mcap")
    message = str(caught.value)
    assert "no image topics" in message
    assert "\n" not in message
    for topic, count in (("/odom", 2639), ("/tf", 5422), ("/tf_static", 1), ("/amcl_pose", 135)):
        assert f"{topic} (" in message
        assert f"{count} message" in message


@pytest.mark.parametrize(("content", "said"), [(b"", "not MCAP"), (b"PK\x03\x04 and so on", "not MCAP")])
def test_another_file_is_refused(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / "a.mcap").write_bytes(content)
    with pytest.raises(VfoaError, match=said):
        open_clip(tmp_path / "a.mcap")
    with pytest.raises(VfoaError, match="no such file or folder"):
        open_clip(tmp_path / "b.mcap")


def test_a_folder_without_a_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / "day").mkdir()
    with pytest.raises(VfoaError, match=r"day: no \.mcap, \.bag or \.db3"):
        McapClip(RecordingSettings(), tmp_path / "day")


def test_a_channel_without_a_schema_is_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with recorder(path, "protobuf") as record:
        log = record.writer.register_channel("/log", "json", 0)
        for n in (1, 2):
            record.writer.add_message(log, stamp(n), b"{}", stamp(n))
            for side, camera in (("left", LEFT), ("right", RIGHT)):
                record.camera(f"/{side}/camera_info", stamp(n), camera)
                record.picture(f"/{side}/image", stamp(n), picture(n))
    assert list(open_clip(path).frames) == [1, 2]


def test_a_calibration_may_have_no_stamp(tmp_path: Path) -> None:
    """One that is sent once, by a node that does not know when."""
    path = tmp_path / "a.mcap"
    with recorder(path) as record:
        for side, camera in (("left", LEFT), ("right", RIGHT)):
            record.camera(f"/{side}/camera_info", 0, camera, log_ns=stamp(1))
            record.picture(f"/{side}/image", stamp(1), picture(1))
    assert open_clip(path).frame(1).rig.fx_px == 100.0


def test_a_calibration_with_other_numbers_of_entries_is_refused(tmp_path: Path) -> None:
    short = replace(LEFT, k=LEFT.k[:8], p=LEFT.p[:11])
    path = write_pairs(tmp_path / "a.mcap", [(stamp(1), picture(1), picture(2), short, RIGHT)], "protobuf")
    with pytest.raises(VfoaError, match="K: found 8 numbers; expected 9"):
        open_clip(path).frame(1)


def test_a_message_that_is_not_what_its_channel_says_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with recorder(path, "protobuf") as record:
        for side, camera in (("left", LEFT), ("right", RIGHT)):
            record.camera(f"/{side}/camera_info", stamp(1), camera)
            record.picture(f"/{side}/image", stamp(1), picture(1))
        record.writer.add_message(1, stamp(2), b"\x0f no message", stamp(2))
    with pytest.raises(VfoaError, match=r"/left/camera_info: .*CameraCalibration"):
        open_clip(path)


def test_an_image_without_a_stamp_is_refused(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match="without time stamp"):
        open_clip(write_pairs(tmp_path / "a.mcap", [(0, picture(1), picture(2), LEFT, RIGHT)]))


def test_a_frame_that_was_recorded_twice_is_one_frame(tmp_path: Path) -> None:
    recorded = write_pairs(tmp_path / "take" / "day.mcap", pairs(range(1, 4)))
    (tmp_path / "take" / "day (copy).mcap").write_bytes(recorded.read_bytes())
    clip = McapClip(RecordingSettings(), tmp_path / "take")
    assert [clip.time_ns(n) for n in clip.frames] == [stamp(n) for n in range(1, 4)]
    assert np.array_equal(clip.frame(3).right, picture(1003))
    assert clip.notes[0] == "3 of 6 pairs have the stamp of the one before, left out (a copy, or a clock that stopped)"


def test_stamps_that_jump_back_are_put_in_order(tmp_path: Path) -> None:
    clip = open_clip(write_pairs(tmp_path / "a.mcap", [*pairs(range(4, 6)), *pairs(range(1, 4))]))
    assert [clip.time_ns(n) for n in clip.frames] == [stamp(n) for n in range(1, 6)]
    assert np.array_equal(clip.frame(2).left, picture(2))


def test_files_of_any_name_are_put_in_natural_order(tmp_path: Path) -> None:
    for name, numbers in (("we[i]rd ü\n10.mcap", range(3, 5)), ("we[i]rd ü\n9²2.mcap", range(1, 3))):
        write_pairs(tmp_path / "split" / name, pairs(numbers))
    clip = McapClip(RecordingSettings(), tmp_path / "split")
    assert np.array_equal(clip.frame(4).left, picture(4))


@pytest.mark.parametrize(
    ("binning", "region", "size", "expected"),
    [  # fx, cx, cx right, cy: the middle of the first of merged pixels is half a pixel further right
        (2, (0, 0, 0, 0), (32, 24), (50.0, 15.5, 14.75, 11.5)),
        (1, (0, 0, WIDTH, HEIGHT), (WIDTH, HEIGHT), (100.0, 31.5, 30.0, 23.5)),
        (0, (10, 4, 40, 30), (40, 30), (100.0, 21.5, 20.0, 19.5)),
        (2, (10, 4, 40, 30), (20, 15), (50.0, 10.5, 9.75, 9.5)),
    ],
)
def test_the_camera_of_a_part_of_the_sensor_or_of_merged_pixels(
    tmp_path: Path,
    binning: int,
    region: tuple[int, int, int, int],
    size: tuple[int, int],
    expected: tuple[float, float, float, float],
) -> None:
    with recorder(tmp_path / "a.mcap") as record:
        for side, camera in (("left", LEFT), ("right", RIGHT)):
            record.camera(f"/{side}/camera_info", stamp(1), camera, binning, region)
            record.picture(f"/{side}/image", stamp(1), picture(1, *size))
    rig = open_clip(tmp_path / "a.mcap").frame(1).rig
    assert (rig.width_px, rig.height_px) == size
    assert (rig.fx_px, rig.cx_px, rig.cx_right_px, rig.cy_px) == pytest.approx(expected)
    assert rig.baseline_m == pytest.approx(0.12)


@pytest.mark.parametrize(("binning", "region"), [(2, (10, 4, 60, 30)), (1, (0, HEIGHT, 0, 0)), (2, (0, 0, 1, 1))])
def test_a_region_that_is_not_on_the_sensor_is_refused(
    tmp_path: Path, binning: int, region: tuple[int, int, int, int]
) -> None:
    with recorder(tmp_path / "a.mcap") as record:
        for side, camera in (("left", LEFT), ("right", RIGHT)):
            record.camera(f"/{side}/camera_info", stamp(1), camera, binning, region)
            record.picture(f"/{side}/image", stamp(1), picture(1))
    with pytest.raises(
        VfoaError, match=rf"/left/camera_info: roi: found .* binning {binning}; expected a part of the "
    ):
        open_clip(tmp_path / "a.mcap").frame(1)


def test_images_of_the_whole_sensor_with_a_binned_calibration_are_refused(tmp_path: Path) -> None:
    with recorder(tmp_path / "a.mcap") as record:
        for side, camera in (("left", LEFT), ("right", RIGHT)):
            record.camera(f"/{side}/camera_info", stamp(1), camera, binning=2)
            record.picture(f"/{side}/image", stamp(1), picture(1))
    with pytest.raises(VfoaError, match=r"left image of 64 x 48 pixels; expected 32 x 24"):
        open_clip(tmp_path / "a.mcap").frame(1)


@pytest.mark.parametrize("name", ["fisheye", "kannala_brandt"])
def test_fisheye_lenses_have_three_names(tmp_path: Path, name: str) -> None:
    images = []
    for model in ("equidistant", name):
        cameras = (replace(camera, model=model, d=(0.1, 0.0, 0.0, 0.0)) for camera in (LEFT, RIGHT))
        path = write_pairs(tmp_path / f"{model}.mcap", [(stamp(1), picture(1), picture(2), *cameras)])
        images.append(open_clip(path).frame(1).left)
    assert np.array_equal(*images)
    assert not np.array_equal(images[0], picture(1))


@pytest.mark.parametrize("zeros", [0, 5, 6])
def test_a_lens_without_distortion_may_have_any_model(tmp_path: Path, zeros: int) -> None:
    """As simulators write it."""
    cameras = (replace(camera, model="pinhole", d=(0.0,) * zeros) for camera in (LEFT, RIGHT))
    path = write_pairs(tmp_path / "a.mcap", [(stamp(1), picture(1), picture(2), *cameras)])
    assert np.array_equal(open_clip(path).frame(1).left, picture(1))
    cameras = (replace(camera, model="pinhole", d=(0.1,) * 5) for camera in (LEFT, RIGHT))
    path = write_pairs(path, [(stamp(1), picture(1), picture(2), *cameras)])
    with pytest.raises(VfoaError, match="distortion model 'pinhole'"):
        open_clip(path).frame(1)


@pytest.mark.parametrize(("packing", "axis"), [("side_by_side", 1), ("top_bottom", 0)])
def test_a_topic_may_have_both_views(tmp_path: Path, packing: str, axis: int) -> None:
    """As cheap stereo cameras on USB and the ZED's driver send them."""
    views = {number: (picture(number), picture(1000 + number)) for number in (1, 2, 3)}
    path = tmp_path / "a.mcap"
    with recorder(path, "ros2") as write:
        for number, both in views.items():
            write.picture("/usb_cam/image_raw", stamp(number), np.concatenate(both, axis=axis), "raw")
        write.camera("/usb_cam/left/camera_info", stamp(1), LEFT)
        write.camera("/usb_cam/right/camera_info", stamp(1), RIGHT)
    given = {"both": "/usb_cam/image_raw", "packing": packing}
    infos = {f"{side}_info": f"/usb_cam/{side}/camera_info" for side in ("left", "right")}
    numbers = {"camera": {"fx_px": 100.0, "cx_px": 31.5, "cy_px": 23.5, "baseline_m": 0.12}}
    for calibrated in (infos, numbers):
        clip = open_clip(path, **given, **calibrated)
        assert list(clip.frames) == [1, 2, 3]
        assert clip.rate_hz == 25.0
        frame = clip.frame(2)
        assert np.array_equal(frame.left, views[2][0])
        assert np.array_equal(frame.right, views[2][1])
        assert frame.rig.baseline_m == pytest.approx(0.12)
    with pytest.raises(VfoaError, match=r"both views; expected left_info"):
        open_clip(path, **given)
    with pytest.raises(VfoaError, match=r"--set both=/TOPIC"):
        open_clip(path, **numbers)
    with pytest.raises(VfoaError, match=r"no both topic '/usb_cam/image'"):
        open_clip(path, both="/usb_cam/image", **numbers)


@pytest.mark.parametrize("per_unit_ns", [1000, 1_000_000])
@pytest.mark.parametrize(("wrong", "right"), [("header", "log"), ("log", "header")])
def test_times_in_another_unit_are_refused(wrong: str, right: str, per_unit_ns: int, tmp_path: Path) -> None:
    with recorder(tmp_path / "a.mcap") as record:
        for n in (1, 2, 3):
            times = {right: stamp(n), wrong: stamp(n) // per_unit_ns}
            for side, camera in (("left", LEFT), ("right", RIGHT)):
                record.camera(f"/{side}/camera_info", times["header"], camera, log_ns=times["log"])
                record.picture(f"/{side}/image", times["header"], picture(n), log_ns=times["log"])
    with pytest.raises(VfoaError, match=rf'/left/image: found 2500.*images per second.*stamps = "{right}"'):
        open_clip(tmp_path / "a.mcap", stamps=wrong)
    assert open_clip(tmp_path / "a.mcap", stamps=right).rate_hz == 25.0


def test_a_pair_is_not_said_to_be_aligned(tmp_path: Path) -> None:
    path = write_pairs(tmp_path / "a.mcap", pairs(range(1, 2)))
    with pytest.raises(VfoaError, match=r"source\.aligned: found True; expected none"):
        open_clip(path, aligned=True)


@pytest.mark.parametrize("is_packed", [False, True])
def test_frames_of_stamps_in_whole_seconds_are_counted(is_packed: bool, tmp_path: Path) -> None:
    """Of a script without nanoseconds: those of the log keep all of them."""
    with recorder(tmp_path / "a.mcap") as record:
        for n in range(1, 7):
            whole_ns = stamp(1) // 10**9 * 10**9
            for topic in ["/both"] if is_packed else ["/left", "/right"]:
                record.picture(topic, whole_ns, picture(n), log_ns=stamp(n))
    given = {"camera": {"fx_px": 100, "cx_px": 15.5, "cy_px": 23.5, "baseline_m": 0.1}}
    given |= {"both": "/both"} if is_packed else {}
    clip = open_clip(tmp_path / "a.mcap", **given)
    assert len(clip.frames) == 1
    what = "images" if is_packed else "pairs"
    assert any(note.startswith(f"5 of 6 {what} have the stamp of") and 'stamps = "log"' in note for note in clip.notes)
    assert len(open_clip(tmp_path / "a.mcap", stamps="log", **given).frames) == 6
