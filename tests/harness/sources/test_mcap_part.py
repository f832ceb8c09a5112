"""A part of a recording, by time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType

from harness.sources.recordings.clip import McapClip
from harness.sources.recordings.containers import window_of
from harness.sources.recordings.mcap_files import McapContainer
from harness.sources.recordings.settings import RecordingSettings
from tests.depth_recordings import Lens, messages
from tests.disk import HEIGHT, WIDTH, picture
from tests.harness.sources.numbered_recording import LEFT, RIGHT, open_clip, pairs, stamp
from tests.recordings import recorder, rectified_camera, write_pairs
from vfoa.errors import VfoaError

LENS = Lens(width=WIDTH, height=HEIGHT, fx=60.0, cx=31.5, cy=23.5)
INDEXES = {
    "indexed": {"chunk_size": 4 * WIDTH * HEIGHT},
    "statistics alone": {"chunk_size": 4 * WIDTH * HEIGHT, "index_types": IndexType.NONE},
    "no schemas at the end": {"chunk_size": 4 * WIDTH * HEIGHT, "repeat_schemas": False},
    "no channels at the end": {"chunk_size": 4 * WIDTH * HEIGHT, "repeat_channels": False},
    "index of chunks alone": {"chunk_size": 4 * WIDTH * HEIGHT, "index_types": IndexType.CHUNK},
    "nothing": {"chunk_size": 4 * WIDTH * HEIGHT, "index_types": IndexType.NONE, "use_statistics": False},
    "no chunks": {"use_chunking": False, "use_statistics": False},
}


@pytest.mark.parametrize("options", INDEXES.values(), ids=INDEXES)
def test_a_part_is_cut_out_by_time(tmp_path: Path, options: dict[str, object]) -> None:
    path = write_pairs(tmp_path / "a.mcap", pairs(range(1, 31)), "protobuf", **options)
    clip = open_clip(path, start_s=0.4, end_s=0.8)  # 40 ms a frame: from 11 to before 21
    assert [clip.frame(n).time_ns for n in clip.frames] == [stamp(n) for n in range(11, 21)]
    assert list(clip.frames) == list(range(1, 11))
    assert np.array_equal(clip.frame(1).left, picture(11))
    assert clip.notes == ()
    assert len(open_clip(path, start_s=1.0).frames) == 5
    assert len(open_clip(path, end_s=0.2).frames) == 5
    assert open_clip(path, start_s=1.0).digest() != open_clip(path).digest()


def test_only_the_chunks_of_the_part_are_read(tmp_path: Path) -> None:
    """Everything before and behind it is overwritten: code that reads it fails or reports a loss."""
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
    with recorder(path, "protobuf", **options) as record:
        for n in range(1, 31):
            for side, first, second in (("left", LEFT, later), ("right", RIGHT, later_right)):
                if n in (1, 10, 28):
                    record.camera(f"/{side}/camera_info", stamp(n), first if n == 1 else second)
                record.picture(f"/{side}/image", stamp(n), picture(n))
    assert open_clip(path, start_s=0.8, end_s=1.0).frame(1).rig.fx_px == 200.0
    assert open_clip(path, start_s=0.2, end_s=0.3).frame(1).rig.fx_px == 100.0


@pytest.mark.parametrize("options", INDEXES.values(), ids=INDEXES)
def test_a_calibration_that_changes_in_a_part_does_not_hold_before_it_changes(
    tmp_path: Path, options: dict[str, object]
) -> None:
    """The part begins in the chunk that has the second calibration; the first one is in an earlier chunk."""
    path = tmp_path / "a.mcap"
    chunks_of_three_frames = {"chunk_size": 16 * WIDTH * HEIGHT} if "chunk_size" in options else {}
    with recorder(path, "protobuf", **{**options, **chunks_of_three_frames}) as record:
        for n in range(1, 31):
            for side, baseline_m in (("left", 0.0), ("right", 0.12)):
                if n in (1, 20):
                    camera = rectified_camera(WIDTH, HEIGHT, 100.0 * (1 + (n == 20)), 31.5, 23.5, baseline_m)
                    record.camera(f"/{side}/camera_info", stamp(n), camera)
                record.picture(f"/{side}/image", stamp(n), picture(n))
    for first in range(16, 21):
        clip = open_clip(path, start_s=(first - 1) * 0.04, end_s=1.0)
        assert [clip.frame(n).rig.fx_px for n in clip.frames] == [100.0] * (20 - first) + [200.0] * 6


def test_static_transforms_of_several_nodes_hold_for_a_later_part(tmp_path: Path) -> None:
    """Each node sends its own at its start, so that they are in several chunks."""
    filler = np.zeros((1, 2**20 + 1), np.uint8)  # the writer begins a new chunk after 1 MiB
    millimetres = np.full((HEIGHT, WIDTH), 2000, np.uint16)
    steps = (("colour", "middle", 0.1), ("middle", "depth", 0.2), ("base", "colour", 0.0))
    with messages(tmp_path, "mcap") as (path, write):
        for n, (parent, child, x_m) in enumerate(steps, start=1):
            write.transform("/tf_static", stamp(n), parent, child, (x_m, 0, 0), (0, 0, 0, 1))
            write.image("/map", stamp(n), filler, "mono8")
        for n in range(4, 9):
            for name in ("color", "depth"):
                write.camera(f"/camera/{name}/camera_info", stamp(n), LENS)
            write.image("/camera/color/image_raw", stamp(n), picture(n), "rgb8", "colour")
            write.image("/camera/depth/image_raw", stamp(n), millimetres, "16UC1", "depth")
            write.image("/map", stamp(n), filler, "mono8")
    whole, part = (McapClip(RecordingSettings(start_s=start_s), path) for start_s in (None, 0.2))
    assert len(part.frames) == 3
    np.testing.assert_array_equal(part.frame(1).depth_m, whole.frame(3).depth_m)


def test_a_part_of_a_split_recording_spans_files(tmp_path: Path) -> None:
    for part in range(3):
        write_pairs(tmp_path / "day" / f"{part}.mcap", pairs(range(1 + 10 * part, 11 + 10 * part)))
    clip = McapClip(RecordingSettings(start_s=0.32, end_s=0.48), tmp_path / "day")
    assert [clip.frame(n).time_ns for n in clip.frames] == [stamp(n) for n in (9, 10, 11, 12)]


def test_a_window_is_exact_to_the_nanosecond_and_may_begin_with_the_last_message(tmp_path: Path) -> None:
    path = write_pairs(tmp_path / "a.mcap", pairs())
    span = McapContainer((path,)).span_ns()
    assert span is not None
    assert window_of(span, None, 0.2, "a") == range(stamp(1), stamp(6))
    assert window_of(span, 0.16, None, "a") == range(stamp(5), span[1] + 1)
    assert window_of(span, None, None, "a") is None
    assert [open_clip(path, start_s=0.16).frame(1).time_ns] == [stamp(5)]


@pytest.mark.parametrize("options", INDEXES.values(), ids=INDEXES)
def test_a_part_without_right_images_is_said_so_whatever_was_read(tmp_path: Path, options: dict[str, object]) -> None:
    path = tmp_path / "a.mcap"
    with recorder(path, "protobuf", **options) as record:
        for n in range(1, 31):
            for side, camera in (("left", LEFT), ("right", RIGHT)):
                record.camera(f"/{side}/camera_info", stamp(n), camera)
                if side == "left" or n < 10:
                    record.picture(f"/{side}/image", stamp(n), picture(n))
    with pytest.raises(VfoaError, match=r"no two stamps of /left/image .* and /right/image .*0 messages"):
        open_clip(path, start_s=0.6)


@pytest.mark.parametrize("options", INDEXES.values(), ids=INDEXES)
def test_types_of_topics_are_found_wherever_they_are_declared(tmp_path: Path, options: dict[str, object]) -> None:
    path = write_pairs(tmp_path / "a.mcap", pairs(), "protobuf", **options)
    assert sorted((topic, kind.name) for topic, kind in McapContainer((path,)).types()) == [
        ("/stereo/left/camera_info", "foxglove.CameraCalibration"),
        ("/stereo/left/image_raw", "foxglove.RawImage"),
        ("/stereo/right/camera_info", "foxglove.CameraCalibration"),
        ("/stereo/right/image_raw", "foxglove.RawImage"),
    ]


def test_a_part_of_nothing_is_one_line(tmp_path: Path) -> None:
    with recorder(tmp_path / "a.mcap"):
        pass
    with pytest.raises(VfoaError, match=r"a\.mcap: no messages"):
        open_clip(tmp_path / "a.mcap", start_s=1)


def test_a_part_that_is_none_is_one_line(tmp_path: Path) -> None:
    path = write_pairs(tmp_path / "a.mcap", pairs())
    with pytest.raises(VfoaError, match=r"source\.start_s: found 9; .*0\.160 s"):
        open_clip(path, start_s=9)
    with pytest.raises(VfoaError, match=r"source\.start_s, source\.end_s: "):
        open_clip(path, start_s=0.09, end_s=0.1)
    with pytest.raises(ValueError, match=r"found end_s 1.*start_s, 2"):
        open_clip(path, start_s=2, end_s=1)
