from __future__ import annotations

import pickle
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from mcap.writer import CompressionType, IndexType
from numpy.typing import NDArray

from harness.adapters.mcap.clip import McapClip, McapSettings
from harness.annotations.files import VERSION_LINE, read_annotations, write_annotations
from harness.annotations.timeline import format_seconds, timeline_of
from tests.disk import HEIGHT, WIDTH, picture, write_bytes, write_text
from tests.recordings import Camera, Family, Pixels, recorder, rectified_camera, write_pairs
from vfoa.errors import VfoaError

LEFT = rectified_camera(WIDTH, HEIGHT, fx=100.0, cx=31.5, cy=23.5)
RIGHT = rectified_camera(WIDTH, HEIGHT, fx=100.0, cx=30.0, cy=23.5, baseline_m=0.12)
START_NS = 1_700_000_000_000_000_007
STEP_NS = 40_000_000


def stamp(number: int) -> int:
    return START_NS + (number - 1) * STEP_NS


def pairs(
    numbers: range = range(1, 6),
) -> Iterator[tuple[int, NDArray[np.uint8], NDArray[np.uint8], Camera, Camera]]:
    for n in numbers:
        yield stamp(n), picture(n), picture(1000 + n), LEFT, RIGHT


def open_clip(path: Path, **settings: object) -> McapClip:
    return McapClip(McapSettings.model_validate({"recording": path.name, **settings}), path.parent)


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


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
def test_every_compression_is_read(tmp_path: Path, compression: CompressionType) -> None:
    clip = open_clip(write_pairs(tmp_path / "a.mcap", pairs(), compression=compression))
    assert np.array_equal(clip.frame(5).right, picture(1005))


@pytest.mark.parametrize("options", [{"index_types": IndexType.NONE, "use_statistics": False}, {"use_chunking": False}])
def test_neither_index_nor_chunks_are_needed(tmp_path: Path, options: dict[str, object]) -> None:
    clip = open_clip(write_pairs(tmp_path / "a.mcap", pairs(), "json", **options))
    assert (len(clip.frames), clip.notes) == (5, ())
    assert np.array_equal(clip.frame(2).left, picture(2))


@pytest.mark.parametrize("family", ["ros2", "protobuf", "json"])
def test_a_cut_file_gives_the_frames_before_the_cut_and_says_so(tmp_path: Path, family: Family) -> None:
    whole = write_pairs(tmp_path / "a.mcap", pairs(range(1, 31)), family, chunk_size=4 * WIDTH * HEIGHT)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[: int(whole.stat().st_size * 0.6)])
    clip = open_clip(cut)
    assert 15 <= len(clip.frames) <= 18
    for n in clip.frames:
        assert np.array_equal(clip.frame(n).left, picture(n))
    assert f"cut at byte {cut.stat().st_size}" in clip.notes[0]
    assert "lost" in clip.notes[0]
    assert f"({stamp(len(clip.frames) + 1) / 1e9:.3f} to" in clip.notes[1]


def rosbag2_metadata(folder: Path, files: list[str], counts: dict[str, int]) -> None:
    """The file that ``ros2 bag record`` writes beside its recordings, as version 5 of it is laid out."""
    topics = [
        {"topic_metadata": {"name": name, "type": "sensor_msgs/msg/Image", "serialization_format": "cdr"}}
        | {"message_count": count}
        for name, count in counts.items()
    ]
    noted = {"version": 5, "storage_identifier": "mcap", "relative_file_paths": files}
    noted |= {"message_count": sum(counts.values()), "topics_with_message_count": topics}
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": noted}))


def cut_at_60_percent(folder: Path, family: Family = "ros2", **options: object) -> Path:
    whole = write_pairs(folder / "a.mcap", pairs(range(1, 31)), family, **{"chunk_size": 4 * WIDTH * HEIGHT, **options})
    return write_bytes(folder / "cut.mcap", whole.read_bytes()[: int(whole.stat().st_size * 0.6)])


def test_a_cut_file_says_how_many_frames_are_lost_where_it_was_noted_beside_it(tmp_path: Path) -> None:
    cut = cut_at_60_percent(tmp_path)
    topics = {f"/stereo/{side}/image_raw": 30 for side in ("left", "right")}
    rosbag2_metadata(tmp_path, ["cut.mcap"], {**topics, "/stereo/left/camera_info": 30})
    clip = open_clip(cut)
    lost = 30 - len(clip.frames)
    assert 12 <= lost <= 15
    expected = {f"{topic}: {lost} of 30 images are lost (by metadata.yaml)" for topic in topics}
    assert expected <= set(clip.notes)
    assert not any("does not say" in note for note in clip.notes)


@pytest.mark.parametrize("content", ["", "a: [", "rosbag2_bagfile_information: 3", "\0"])
def test_notes_of_another_recording_or_none_are_not_believed(tmp_path: Path, content: str) -> None:
    cut = cut_at_60_percent(tmp_path)
    rosbag2_metadata(tmp_path, ["cut.mcap", "cut_1.mcap"], {"/stereo/left/image_raw": 90})
    assert any("how many followed, a cut file does not say" in note for note in open_clip(cut).notes)
    (tmp_path / "metadata.yaml").write_text(content)
    assert any("how many followed, a cut file does not say" in note for note in open_clip(cut).notes)


def test_a_cut_outside_chunks_cannot_tell_either(tmp_path: Path) -> None:
    clip = open_clip(cut_at_60_percent(tmp_path, "json", use_chunking=False))
    assert 16 <= len(clip.frames) <= 18
    assert clip.notes[1] == "how many frames were lost, a cut file does not say"


INDEXES = {
    "indexed": {"chunk_size": 4 * WIDTH * HEIGHT},
    "statistics alone": {"chunk_size": 4 * WIDTH * HEIGHT, "index_types": IndexType.NONE},
    "nothing": {"chunk_size": 4 * WIDTH * HEIGHT, "index_types": IndexType.NONE, "use_statistics": False},
    "no chunks": {"use_chunking": False, "use_statistics": False},
}


@pytest.mark.parametrize("options", INDEXES.values(), ids=INDEXES)
def test_a_part_is_cut_out_by_time(tmp_path: Path, options: dict[str, object]) -> None:
    path = write_pairs(tmp_path / "a.mcap", pairs(range(1, 31)), "json", **options)
    clip = open_clip(path, start_s=0.4, end_s=0.8)  # 40 ms a frame: from 11 to before 21
    assert [clip.frame(n).time_ns for n in clip.frames] == [stamp(n) for n in range(11, 21)]
    assert list(clip.frames) == list(range(1, 11))
    assert np.array_equal(clip.frame(1).left, picture(11))
    assert clip.notes == ()
    assert len(open_clip(path, start_s=1.0).frames) == 5
    assert len(open_clip(path, end_s=0.2).frames) == 5
    assert open_clip(path, start_s=1.0).digest() != open_clip(path).digest()


def test_only_the_chunks_of_the_part_are_read(tmp_path: Path) -> None:
    """What stands before and behind it is overwritten: whoever reads it, fails or tells a loss."""
    path = write_pairs(
        tmp_path / "a.mcap",
        pairs(range(1, 31)),
        chunk_size=4 * WIDTH * HEIGHT,
        compression=CompressionType.NONE,
    )
    data = bytearray(path.read_bytes())
    for n in (1, 5, 16, 29):
        data[data.index(picture(n).tobytes()) + 1000] ^= 1
    path.write_bytes(data)
    assert len(open_clip(path).notes) > 0
    clip = open_clip(path, start_s=0.32, end_s=0.48)
    assert ([clip.frame(n).time_ns for n in clip.frames], clip.notes) == ([stamp(n) for n in range(9, 13)], ())


@pytest.mark.parametrize("options", INDEXES.values(), ids=INDEXES)
def test_a_calibration_that_was_sent_once_holds_for_a_later_part(tmp_path: Path, options: dict[str, object]) -> None:
    path = tmp_path / "a.mcap"
    later = rectified_camera(WIDTH, HEIGHT, fx=200.0, cx=31.5, cy=23.5)
    later_right = rectified_camera(WIDTH, HEIGHT, fx=200.0, cx=31.5, cy=23.5, baseline_m=0.12)
    with recorder(path, "json", **options) as record:
        for n in range(1, 31):
            for side, first, second in (("left", LEFT, later), ("right", RIGHT, later_right)):
                if n in (1, 10, 28):
                    record.camera(f"/{side}/camera_info", stamp(n), first if n == 1 else second)
                record.picture(f"/{side}/image", stamp(n), picture(n))
    assert open_clip(path, start_s=0.8, end_s=1.0).frame(1).rig.fx_px == 200.0
    assert open_clip(path, start_s=0.2, end_s=0.3).frame(1).rig.fx_px == 100.0


def test_a_part_of_a_split_recording_spans_files(tmp_path: Path) -> None:
    for part in range(3):
        write_pairs(tmp_path / "day" / f"{part}.mcap", pairs(range(1 + 10 * part, 11 + 10 * part)))
    clip = McapClip(McapSettings(start_s=0.32, end_s=0.48), tmp_path / "day")
    assert [clip.frame(n).time_ns for n in clip.frames] == [stamp(n) for n in (9, 10, 11, 12)]


def test_a_part_that_is_none_is_one_line(tmp_path: Path) -> None:
    path = write_pairs(tmp_path / "a.mcap", pairs())
    with pytest.raises(VfoaError, match=r"a\.mcap: source\.start_s: found 9; the recording lasts 0\.160 s"):
        open_clip(path, start_s=9)
    with pytest.raises(VfoaError, match=r"a\.mcap: source\.start_s, source\.end_s: no images in that part"):
        open_clip(path, start_s=0.09, end_s=0.1)
    with pytest.raises(ValueError, match=r"found end_s 1; expected more than start_s, 2"):
        open_clip(path, start_s=2, end_s=1)


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
    assert clip.notes == (
        'left and right are joined by the time of recording (stamps = "log"), not by when they were taken',
    )


def test_unset_headers_are_said_with_the_way_out(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r'without time stamp; expected one, .* \(stamps = "log" in \[source\] joins'):
        open_clip(write_unset(tmp_path / "a.mcap"))


def test_what_a_lost_first_chunk_declared_is_found_in_the_summary(tmp_path: Path) -> None:
    path = write_pairs(
        tmp_path / "a.mcap", pairs(range(1, 11)), chunk_size=4 * WIDTH * HEIGHT, compression=CompressionType.NONE
    )
    data = bytearray(path.read_bytes())
    data[data.index(picture(1).tobytes()) + 1000] ^= 1
    path.write_bytes(data)
    clip = open_clip(path)
    assert 7 <= len(clip.frames) <= 9
    assert np.array_equal(clip.frame(len(clip.frames)).left, picture(10))


def test_zeros_after_a_crash_are_a_cut(tmp_path: Path) -> None:
    path = write_pairs(tmp_path / "a.mcap", pairs(range(1, 11)), chunk_size=4 * WIDTH * HEIGHT)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2] + bytes(len(whole)))
    clip = open_clip(path)
    assert 1 <= len(clip.frames) < 10
    assert [word for note in clip.notes for word in ("chunk at byte", "what follows is lost") if word in note] == [
        "chunk at byte",
        "what follows is lost",
    ]


def test_a_flipped_bit_is_found_by_checksum_and_costs_its_chunk_alone(tmp_path: Path) -> None:
    path = write_pairs(
        tmp_path / "a.mcap", pairs(range(1, 11)), chunk_size=4 * WIDTH * HEIGHT, compression=CompressionType.NONE
    )
    data = bytearray(path.read_bytes())
    data[data.index(picture(4).tobytes()) + 1000] ^= 1
    path.write_bytes(data)
    clip = open_clip(path)
    assert 7 <= len(clip.frames) <= 9
    kept = {clip.frame(n).time_ns for n in clip.frames}
    assert stamp(4) not in kept
    assert {stamp(1), stamp(10)} < kept
    assert "damaged (crc validation failed" in clip.notes[0]
    assert "of 40 messages of the file are lost" in clip.notes[0]


def test_a_damaged_compressed_chunk_is_told(tmp_path: Path) -> None:
    path = write_pairs(tmp_path / "a.mcap", pairs(range(1, 11)), chunk_size=4 * WIDTH * HEIGHT)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 255
    path.write_bytes(data)
    clip = open_clip(path)
    assert 7 <= len(clip.frames) <= 9
    assert "damaged" in clip.notes[0]


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
    clip = McapClip(McapSettings(), tmp_path / "split")
    assert list(clip.frames) == list(range(1, 9))
    assert [clip.frame(n).time_ns for n in clip.frames] == [stamp(n) for n in range(1, 9)]
    assert np.array_equal(clip.frame(7).left, picture(7))


def test_images_without_a_partner_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with recorder(path) as record:
        record.camera("/left/camera_info", stamp(1), LEFT)
        record.camera("/right/camera_info", stamp(1), RIGHT)
        for n in range(1, 11):
            record.picture("/left/image", stamp(n), picture(n))
            if n not in (3, 7):
                late_ns = 30_000_000 if n == 9 else 500_000
                record.picture("/right/image", stamp(n) + late_ns, picture(1000 + n))
    clip = open_clip(path, tolerance_ms=1)
    assert [clip.frame(n).time_ns for n in clip.frames] == [stamp(n) for n in (1, 2, 4, 5, 6, 8, 10)]
    assert np.array_equal(clip.frame(7).right, picture(1010))
    assert clip.notes == (
        "/left/image: 3 of 10 images have no partner within 1 ms",
        "/right/image: 1 of 8 images have no partner within 1 ms",
    )
    with pytest.raises(VfoaError, match=r"no two stamps of /left/image .* are within 0\.1 ms"):
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


def test_the_calibration_may_be_a_file(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with recorder(path) as record:
        record.picture("/left/image", stamp(1), picture(1))
        record.picture("/right/image", stamp(1), picture(2))
    rows = {"P2": "100 0 31.5 0 0 100 23.5 0 0 0 1 0", "P3": "100 0 31.5 -25 0 100 23.5 0 0 0 1 0"}
    (tmp_path / "calib.txt").write_text("".join(f"{key}: {row}\n" for key, row in rows.items()))
    assert open_clip(path, calibration="calib.txt").frame(1).rig.baseline_m == pytest.approx(0.25)
    with pytest.raises(VfoaError, match="no single calibration topic belongs to /left/image"):
        open_clip(path)


def test_many_cameras_are_listed_with_type_count_and_rate(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with recorder(path) as record:
        for n in range(1, 4):
            for camera in ("front", "rear"):
                for side, calibration in (("left", LEFT), ("right", RIGHT)):
                    record.picture(f"/{camera}/{side}/image", stamp(n), picture(n))
                    record.camera(f"/{camera}/{side}/camera_info", stamp(n), calibration)
    with pytest.raises(VfoaError, match=r"2 pairs.*/rear/left/image \(sensor_msgs/msg/Image, 3 messages, 25\.0 Hz\)"):
        open_clip(path)
    assert len(open_clip(path, left="/rear/left/image").frames) == 3
    with pytest.raises(VfoaError, match="no right topic '/rear/image'; found /front/left/image"):
        open_clip(path, left="/rear/left/image", right="/rear/image")


def test_a_recording_without_cameras_names_what_it_has(shared_data: Path) -> None:
    with pytest.raises(VfoaError) as caught:
        open_clip(shared_data / "mcap" / "no_image_topics.mcap")
    message = str(caught.value)
    assert "no image topics" in message
    assert "\n" not in message
    for topic, count in (("/odom", 2639), ("/tf", 5422), ("/tf_static", 1), ("/amcl_pose", 135)):
        assert f"{topic} (" in message
        assert f"{count} messages" in message


@pytest.mark.parametrize(("content", "said"), [(b"", "not MCAP"), (b"PK\x03\x04 and so on", "not MCAP")])
def test_another_file_is_refused(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / "a.mcap").write_bytes(content)
    with pytest.raises(VfoaError, match=said):
        open_clip(tmp_path / "a.mcap")
    with pytest.raises(VfoaError, match="no such file or folder"):
        open_clip(tmp_path / "b.mcap")


def test_an_image_without_a_stamp_is_refused(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match="without time stamp"):
        open_clip(write_pairs(tmp_path / "a.mcap", [(0, picture(1), picture(2), LEFT, RIGHT)]))


def test_a_binned_calibration_is_refused(tmp_path: Path) -> None:
    with recorder(tmp_path / "a.mcap") as record:
        for side, camera in (("left", LEFT), ("right", RIGHT)):
            record.camera(f"/{side}/camera_info", stamp(1), camera, binning=2)
            record.picture(f"/{side}/image", stamp(1), picture(1))
    with pytest.raises(VfoaError, match=r"/left/camera_info: binning \(2, 2\)"):
        open_clip(tmp_path / "a.mcap").frame(1)
