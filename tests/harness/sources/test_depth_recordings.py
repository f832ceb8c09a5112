"""Colour and measured depth in every container and form, against the pixels that were recorded."""

from __future__ import annotations

import os
import re
import sqlite3
import struct
import tracemalloc
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import cv2
import foxglove
import numpy as np
import pytest
from foxglove.channels import (
    CameraCalibrationChannel,
    FrameTransformChannel,
    FrameTransformsChannel,
    RawImageChannel,
)
from foxglove.messages import (
    CameraCalibration,
    FrameTransform,
    FrameTransforms,
    Quaternion,
    RawImage,
    Timestamp,
    Vector3,
)
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter
from scipy.spatial.transform import Rotation

from harness.sources.recordings import bags, containers
from harness.sources.recordings.clip import BagClip, McapClip, RecordingClip
from harness.sources.recordings.settings import RecordingSettings
from tests.adapter_contract import check_contract
from tests.depth_recordings import (
    COLOUR,
    DEPTH,
    FORMATS,
    INFO,
    DepthForm,
    Format,
    Lens,
    Messages,
    Shot,
    compressed_depth,
    messages,
    write_depth,
    write_take,
)
from tests.disk import moving_picture, write_text
from vfoa.errors import VfoaError
from vfoa.stereo import MATCHERS

START_NS, STEP_NS = 1_700_000_000_000_000_007, 33_333_333
WIDTH, HEIGHT = 64, 48
LENS = Lens(width=WIDTH, height=HEIGHT, fx=60.0, cx=31.5, cy=23.5)
COUNT = 4
ALL: tuple[Format, ...] = (*FORMATS, "db3 zstd file", "db3 zstd message")


def depth_mm(number: int) -> np.ndarray:
    """A slanted wall with a box before it and a border without depth; it moves with the number."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    depth = 2000 + 9 * columns + 3 * rows + 50 * number
    depth[10:30, 20:40] = 900 + 10 * number
    depth[:, :3] = 0
    return depth.astype(np.uint16)


def shot(number: int) -> Shot:
    stamp_ns = START_NS + (number - 1) * STEP_NS
    return Shot(stamp_ns=stamp_ns, colour=moving_picture(number), depth_mm=depth_mm(number), lens=LENS)


def open_clip(path: Path, **settings: object) -> RecordingClip:
    data = {"recording": path.name, **settings}
    return RecordingClip(RecordingSettings.model_validate(data), path.parent)


def in_metres(counts: np.ndarray) -> np.ndarray:
    return np.where(counts > 0, counts / 1000, np.nan)


def assert_recorded(clip: RecordingClip, numbers: Sequence[int]) -> None:
    """The clip's frames are the shots of these numbers: times, colour and depth."""
    assert len(clip.frames) == len(numbers)
    for frame, taken in zip(map(clip.frame, clip.frames), map(shot, numbers), strict=True):
        assert frame.time_ns == taken.stamp_ns
        assert np.array_equal(frame.left, taken.colour)
        np.testing.assert_allclose(frame.depth_m, in_metres(taken.depth_mm), rtol=1e-6)


@pytest.mark.parametrize("kind", ALL)
def test_colour_and_depth_are_those_recorded(tmp_path: Path, kind: Format) -> None:
    clip = open_clip(write_take(tmp_path, kind, map(shot, range(1, 7))))
    assert list(clip.frames) == [1, 2, 3, 4, 5, 6]
    assert clip.rate_hz == pytest.approx(30, abs=0.001)
    assert clip.notes == ()
    assert_recorded(clip, range(1, 7))
    frame = clip.frame(4)
    assert frame.right is None
    assert (frame.rig.fx_px, frame.rig.cx_px, frame.rig.cy_px) == (60.0, 31.5, 23.5)
    check_contract(clip)


@pytest.mark.parametrize("form", ["png", "rvl", "32FC1", "64FC1", "32FC1 png", "32FC1 rvl"])
@pytest.mark.parametrize("kind", FORMATS)
def test_every_form_of_depth_gives_the_same_metres(tmp_path: Path, kind: Format, form: DepthForm) -> None:
    frame = open_clip(write_take(tmp_path, kind, map(shot, (1, 2)), form)).frame(2)
    # the quantised form steps by z^2 / A, here at most 0.1 %
    np.testing.assert_allclose(frame.depth_m, in_metres(depth_mm(2)), rtol=1e-3 if form.startswith("32FC1 ") else 1e-6)


PACKED: tuple[Format, ...] = ("bag bz2", "bag lz4", "db3 zstd file", "db3 zstd message")


@pytest.mark.parametrize("kind", PACKED)
def test_a_recording_is_not_unpacked_beyond_what_one_can_have(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: Format
) -> None:
    path = write_take(tmp_path, kind, map(shot, (1, 2)))
    assert open_clip(path).frame(2).time_ns == shot(2).stamp_ns
    for module in (containers, bags):
        monkeypatch.setattr(module, "MOST_BYTES", 5000)
        monkeypatch.setattr(module, "_MOST_COMPRESSION", 0)
    with pytest.raises(VfoaError, match=r"(claims|unpacks to) \d+ bytes.*5000"):
        open_clip(path)


@pytest.mark.parametrize("kind", ["db3", "db3 zstd message"])
def test_a_database_is_read_without_its_metadata(tmp_path: Path, kind: Format) -> None:
    path = write_take(tmp_path, kind, map(shot, (1, 2)))
    (path / "metadata.yaml").unlink()
    assert BagClip.recognise(path, {})
    assert_recorded(open_clip(path), (1, 2))
    (file,) = path.glob("*.db3")
    assert_recorded(open_clip(file.rename(tmp_path / "alone.db3")), (1, 2))


@pytest.mark.parametrize("compression", ["bz2", "lz4"])
def test_a_chunk_of_a_bag_is_not_unpacked_beyond_what_it_claims(tmp_path: Path, compression: str) -> None:
    with messages(tmp_path, f"bag {compression}") as (path, write):  # type: ignore[arg-type]
        write.camera(INFO, START_NS, LENS)
        write.image(COLOUR, START_NS, np.zeros((2048, 4096, 3), np.uint8), "rgb8")
    data = path.read_bytes()
    at = data.index(b"size=", data.index(b"compression=")) + 5
    path.write_bytes(data[:at] + struct.pack("<I", 1000) + data[at + 4 :])
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    with pytest.raises(VfoaError, match="1000 bytes"):
        open_clip(path)
    assert tracemalloc.get_traced_memory()[1] - before < 2**23
    tracemalloc.stop()


def test_containers_are_recognised_by_their_content(tmp_path: Path) -> None:
    found = {}
    for kind in ALL:
        path = write_take(tmp_path, kind, [shot(1)])
        found[kind] = [name for name, cls in (("mcap", McapClip), ("rosbag", BagClip)) if cls.recognise(path, {})]
    assert found == {kind: ["mcap" if kind == "mcap" else "rosbag"] for kind in ALL}


@pytest.mark.parametrize("count", ["2001-01-01", "1.5", "many"])
def test_a_count_of_messages_that_is_no_number_is_refused(tmp_path: Path, count: str) -> None:
    path = write_take(tmp_path, "db3", map(shot, (1, 2)))
    noted = (path / "metadata.yaml").read_text(encoding="utf-8")
    changed = re.sub(r"message_count: \d+(?=\n    topic_metadata)", f"message_count: {count}", noted)
    write_text(path / "metadata.yaml", changed)
    with pytest.raises(VfoaError, match=r"take_db3.*: its list of topics is damaged: found '/.* with .*"):
        open_clip(path)


def test_counts_and_offsets_differ_as_a_rule_and_are_told(tmp_path: Path) -> None:
    with messages(tmp_path, "mcap") as (path, write):
        write.camera(INFO, START_NS, LENS)
        for number in range(1, 8):
            stamp_ns = START_NS + number * STEP_NS
            if number != 3:
                write.image(COLOUR, stamp_ns, moving_picture(number), "rgb8")
            if number not in (5, 6):
                write.image(DEPTH, stamp_ns + 4_000_000, depth_mm(number), "16UC1")
    clip = open_clip(path)
    assert len(clip.frames) == 4
    assert [clip.frame(n).time_ns for n in clip.frames] == [START_NS + n * STEP_NS for n in (1, 2, 4, 7)]
    text = "\n".join(clip.notes)
    assert f"{COLOUR}: 2 of 6 images" in text
    assert f"{DEPTH}: 1 of 5 images" in text
    assert "4 ms apart" in text
    with pytest.raises(VfoaError, match="tolerance_ms"):
        open_clip(path, tolerance_ms=1)


FAMILIES = {
    "RealSense": ("/camera/camera/color/image_raw", "/camera/camera/aligned_depth_to_color/image_raw"),
    "Azure Kinect": ("/rgb/image_raw", "/depth_to_rgb/image_raw"),
    "OAK-D": ("/oak/rgb/image_raw", "/oak/stereo/image_raw"),
    "ZED": ("/zed/zed_node/rgb/image_rect_color", "/zed/zed_node/depth/depth_registered"),
    "OpenNI": ("/camera/rgb/image_raw", "/camera/depth_registered/image_raw"),
    "Orbbec": ("/camera/color/image_raw", "/camera/depth/image_raw"),
}


@pytest.mark.parametrize("family", FAMILIES)
def test_topics_of_cameras_are_found(tmp_path: Path, family: str) -> None:
    colour, depth = FAMILIES[family]
    other = shot(9)
    with messages(tmp_path, "mcap") as (path, write):
        for number in (1, 2):
            taken = shot(number)
            for topic in (colour, depth):
                write.camera(f"{topic.rpartition('/')[0]}/camera_info", taken.stamp_ns, LENS)
            write.image(colour, taken.stamp_ns, taken.colour, "rgb8")
            encoding = "32FC1" if family == "ZED" else "16UC1"
            pixels = in_metres(taken.depth_mm).astype(np.float32) if family == "ZED" else taken.depth_mm
            write.image(depth, taken.stamp_ns, pixels, encoding)
            # what the same drivers publish besides
            write.image("/camera/infra1/image_rect_raw", taken.stamp_ns, other.colour[..., 0].copy(), "mono8", "infra")
            for side in ("left", "right"):
                write.image(f"/camera/{side}_ir/image_raw", taken.stamp_ns, other.colour[..., 0].copy(), "mono8", "ir")
            write.image("/ir/image_raw", taken.stamp_ns, other.depth_mm, "mono16", "ir")
            write.image("/camera/camera/depth/image_rect_raw", taken.stamp_ns, other.depth_mm, "16UC1", "depth")
            write.image("/zed/confidence/confidence_map", taken.stamp_ns, np.ones((4, 4), np.float32), "32FC1")
    assert_recorded(open_clip(path), (1, 2))


# Depth of another camera

TURN = Rotation.from_euler("xyz", [2, -3, 5], degrees=True)
SHIFT = (0.05, -0.01, 0.02)
WIDE = Lens(width=100, height=80, fx=55.0, cx=49.5, cy=39.5)


def plane_depth(lens: Lens, normal: np.ndarray, distance_m: float) -> np.ndarray:
    """z (H, W) of the plane n . x = distance as a camera sees it."""
    v, u = np.mgrid[: lens.height, : lens.width]
    rays = np.stack([(u - lens.cx) / lens.fx, (v - lens.cy) / lens.fx, np.ones(u.shape)], axis=-1)
    return distance_m / (rays @ normal)


def write_unaligned(write: Messages, millimetres: np.ndarray) -> None:
    write.camera(INFO, START_NS, LENS, "colour")
    write.camera("/camera/depth/camera_info", START_NS, WIDE, "depth")
    write.image(COLOUR, START_NS, moving_picture(1), "rgb8", "colour")
    write.image("/camera/depth/image_rect_raw", START_NS, millimetres, "16UC1", "depth")


@pytest.mark.parametrize("how", ["tf", "reversed chain", "extrinsics"])
def test_depth_of_another_camera_is_registered(tmp_path: Path, how: str) -> None:
    """A plane in the depth camera's frame is the same plane, moved, in the colour camera's."""
    normal, distance = np.array([0.1, 0.05, 1.0]), 2.0
    millimetres = np.rint(1000 * plane_depth(WIDE, normal, distance)).astype(np.uint16)
    with messages(tmp_path, "db3") as (path, write):
        if how == "tf":
            write.transform("/tf_static", START_NS, "colour", "depth", SHIFT, TURN.as_quat())
        elif how == "reversed chain":
            write.transform("/tf_static", START_NS, "depth", "middle", (0, 0, 0), (0, 0, 0, 1))
            back = TURN.inv()
            write.transform("/tf_static", START_NS, "middle", "colour", -back.apply(SHIFT), back.as_quat())
        else:
            write.extrinsics("/camera/extrinsics/depth_to_color", START_NS, TURN.as_matrix(), SHIFT)
        write_unaligned(write, millimetres)
    expect_plane(open_clip(path), normal, distance)


@pytest.mark.parametrize("are_together", [False, True])
def test_depth_is_registered_by_transforms_of_foxglove(tmp_path: Path, are_together: bool) -> None:
    normal, distance = np.array([0.1, 0.05, 1.0]), 2.0
    millimetres = np.rint(1000 * plane_depth(WIDE, normal, distance)).astype(np.uint16)
    write_foxglove_unaligned(tmp_path / "take.mcap", moving_picture(1), millimetres, are_together=are_together)
    expect_plane(open_clip(tmp_path / "take.mcap"), normal, distance)


def write_foxglove_unaligned(path: Path, colour: np.ndarray, depth_mm: np.ndarray, *, are_together: bool) -> None:
    """One frame by Foxglove's SDK, with the pose of the depth camera by a frame between."""
    context, head = foxglove.Context(), {"timestamp": Timestamp(*divmod(START_NS, 10**9))}
    quaternion = Quaternion(**dict(zip("xyzw", TURN.as_quat(), strict=True)))
    steps = [
        FrameTransform(
            **head, parent_frame_id=parent, child_frame_id=child, translation=Vector3(**shift), rotation=turn
        )
        for parent, child, shift, turn in (
            ("colour", "middle", dict(zip("xyz", SHIFT, strict=True)), quaternion),
            ("middle", "depth", {"x": 0.0, "y": 0.0, "z": 0.0}, Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)),
        )
    ]
    with foxglove.open_mcap(path, context=context):
        if are_together:
            FrameTransformsChannel("/tf", context=context).log(FrameTransforms(transforms=steps), log_time=START_NS)
        for number, step in enumerate([] if are_together else steps):
            FrameTransformChannel(f"/tf/{number}", context=context).log(step, log_time=START_NS)
        for name, lens, pixels, form in (("colour", LENS, colour, "rgb8"), ("depth", WIDE, depth_mm, "16UC1")):
            size = {"width": lens.width, "height": lens.height}
            k = [lens.fx, 0, lens.cx, 0, lens.fx, lens.cy, 0, 0, 1]
            info = CameraCalibration(**head, **size, frame_id=name, K=k, R=np.eye(3).ravel().tolist(), P=[0.0] * 12)
            CameraCalibrationChannel(f"/{name}/calibration", context=context).log(info, log_time=START_NS)
            raw = {"encoding": form, "step": pixels.nbytes // lens.height, "data": pixels.tobytes()}
            image = RawImage(**head, **size, **raw, frame_id=name)
            RawImageChannel(f"/{name}/image", context=context).log(image, log_time=START_NS)


def expect_plane(clip: RecordingClip, normal: np.ndarray, distance: float) -> None:
    """The depth of the first frame is that of a plane in the depth camera's frame."""
    assert any("not aligned" in note for note in clip.notes)
    found = clip.frame(1).depth_m
    assert found is not None
    turned = TURN.as_matrix() @ normal
    expected = plane_depth(LENS, turned, distance + turned @ SHIFT)
    known = np.isfinite(found)
    assert known.mean() > 0.95
    np.testing.assert_allclose(found[known], expected[known], rtol=0.01)


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize(
    "silent",
    [
        *(("/rear/left/image_raw", "/rear/right/image_raw"), ("/front/left/image_rect", "/front/right/image_rect")),
        *(("/front/left/old_info", "/front/right/old_info"), ("/front/depth/image_raw",)),
    ],
)
def test_topics_that_were_never_sent_are_in_nobodys_way(tmp_path: Path, kind: Format, silent: Sequence[str]) -> None:
    """A recorder lists each topic that it knows, as of a camera that was switched off."""
    with messages(tmp_path, kind) as (path, write):
        for topic in silent:
            write.advertise(topic, f"sensor_msgs/msg/{'CameraInfo' if topic.endswith('info') else 'Image'}")
        for side in ("left", "right"):
            write.camera(f"/front/{side}/camera_info", START_NS, LENS)
            write.image(f"/front/{side}/image_raw", START_NS, moving_picture(1), "rgb8")
    clip = open_clip(path, baseline_m=0.1)
    assert (list(clip.frames), clip.frame(1).rig.fx_px, clip.notes) == ([1], 60.0, ())


def test_unaligned_depth_without_extrinsics_says_what_is_missing(tmp_path: Path) -> None:
    with messages(tmp_path, "bag") as (path, write):
        write_unaligned(write, depth_mm(1))
    with pytest.raises(VfoaError, match=r"depth/image_rect_raw.*tf_static"):
        open_clip(path)


def test_a_distorted_camera_is_straightened_with_its_depth(tmp_path: Path) -> None:
    bent = Lens(width=WIDTH, height=HEIGHT, fx=60.0, cx=31.5, cy=23.5, d=(-0.2, 0.05, 0.001, 0.001, 0.0))
    taken = Shot(stamp_ns=START_NS, colour=moving_picture(1), depth_mm=np.full((48, 64), 1500, np.uint16), lens=bent)
    frame = open_clip(write_take(tmp_path, "bag", [taken])).frame(1)
    assert frame.depth_m is not None
    assert frame.depth_m[24, 32] == pytest.approx(1.5)
    assert not np.array_equal(frame.left, moving_picture(1))
    known = np.isfinite(frame.depth_m)
    assert np.array_equal(known, frame.left.any(axis=-1)) or known.mean() > 0.9


def test_numbers_stand_in_for_a_missing_calibration(tmp_path: Path) -> None:
    with messages(tmp_path, "bag") as (path, write):
        write.image(COLOUR, START_NS, moving_picture(1), "rgb8")
        write.image(DEPTH, START_NS, depth_mm(1), "16UC1")
    with pytest.raises(VfoaError, match="left_info"):
        open_clip(path)
    clip = open_clip(path, camera={"fx_px": 70.0, "cx_px": 30.0, "cy_px": 20.0}, depth_scale=500)
    frame = clip.frame(1)
    assert (frame.rig.fx_px, frame.rig.cx_px) == (70.0, 30.0)
    np.testing.assert_allclose(frame.depth_m, 2 * in_metres(depth_mm(1)), rtol=1e-6)


def test_a_pair_may_have_the_depth_of_its_left_camera(tmp_path: Path) -> None:
    with messages(tmp_path, "mcap") as (path, write):
        for number in (1, 2, 3):
            stamp_ns = START_NS + number * STEP_NS
            for side in ("left", "right"):
                image, frame = moving_picture(number), f"{side}_optical"
                write.image(f"/zed/{side}/image_rect_color", stamp_ns, image, "rgb8", frame)
            if number != 2:
                write.image("/zed/depth/depth_registered", stamp_ns, depth_mm(number), "16UC1", "left_optical")
    clip = open_clip(path, camera={"fx_px": 60.0, "cx_px": 31.5, "cy_px": 23.5, "baseline_m": 0.12})
    assert any("1 of 3 frames have no depth" in note for note in clip.notes)
    for number in (1, 2, 3):
        frame = clip.frame(number)
        assert frame.right is not None
        expected = in_metres(depth_mm(number)) if number != 2 else np.full((HEIGHT, WIDTH), np.nan)
        np.testing.assert_allclose(frame.depth_m, expected, rtol=1e-6)
        found = MATCHERS.load("sensor")(MATCHERS.load("sensor").Settings()).match(frame).disparity_px
        np.testing.assert_allclose(found, 60.0 * 0.12 / expected, rtol=1e-5)


def test_a_bag_whose_recorder_was_killed_says_what_mends_it(tmp_path: Path) -> None:
    path = write_take(tmp_path, "bag", map(shot, (1, 2)))
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * 0.8)])
    with pytest.raises(VfoaError, match=r"take\.bag.*reindex"):
        open_clip(path)


@pytest.mark.parametrize("share", [0.02, 0.2, 0.8])
def test_a_database_that_is_cut_off_says_what_to_do(tmp_path: Path, share: float) -> None:
    path = write_take(tmp_path, "db3", map(shot, (1, 2, 3)))
    (file,) = path.glob("*.db3")
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    for given in (path, file):
        with pytest.raises(VfoaError, match=r"take.*malformed; it is cut off, .*-wal .*: copy it again"):
            open_clip(given)


@pytest.mark.parametrize(
    ("content", "said"),
    [(b"", "starts with b''"), (bytes(4096), r"starts with b'\\x00.*b'SQLite format 3': copy it again")],
)
def test_a_database_without_content_is_not_taken_for_another_format(tmp_path: Path, content: bytes, said: str) -> None:
    file = tmp_path / "take.db3"
    file.write_bytes(content)
    with pytest.raises(VfoaError, match=rf"take\.db3: not a database of ROS 2: it {said}"):
        open_clip(file)


def test_a_database_without_its_log_says_what_is_missing(tmp_path: Path) -> None:
    """A recorder writes to ``-wal`` first: without this file, the last messages, or all, are not there."""
    path = write_take(tmp_path, "db3", map(shot, (1, 2, 3)))
    (file,) = path.glob("*.db3")
    with closing(sqlite3.connect(file)) as database:
        database.execute("delete from messages where timestamp > ?", (shot(2).stamp_ns,))
        database.commit()
    clip = open_clip(path)
    assert len(clip.frames) == 2
    assert any(f"{COLOUR}: 2 of the 3 messages" in note and "-wal" in note for note in clip.notes), clip.notes
    with closing(sqlite3.connect(file)) as database:
        for table in ("messages", "topics", "schema", "metadata", "message_definitions"):
            database.execute(f"drop table if exists {table}")
        database.commit()
    with pytest.raises(VfoaError, match=r"take.*missing tables; .*FILE-wal"):
        open_clip(path)


def test_a_database_of_another_name_than_noted_says_how_to_note_it(tmp_path: Path) -> None:
    path = write_take(tmp_path, "db3", map(shot, (1, 2)))
    (file,) = path.glob("*.db3")
    file.rename(file.with_name("mine.db3"))
    with pytest.raises(VfoaError, match=r"take.*missing: .*; copy them .*ros2 bag reindex"):
        open_clip(path)


def test_a_bag_that_is_refused_is_closed(tmp_path: Path) -> None:
    path = write_take(tmp_path, "bag", [shot(1)])
    path.write_bytes(path.read_bytes().replace(b"size=", b"mize="))  # rosbags itself does not read this field
    before = os.listdir("/proc/self/fd")
    with pytest.raises(VfoaError, match=r"take\.bag.*'size'") as error:
        bags.open_reader(path)
    assert len(os.listdir("/proc/self/fd")) == len(before), error.value


def test_a_pair_in_gray_of_16_bits_is_not_its_own_depth(tmp_path: Path) -> None:
    with messages(tmp_path, "mcap") as (path, write):
        for side in ("left", "right"):
            gray = moving_picture(1)[..., 0].astype(np.uint16) << 8
            write.image(f"/{side}/image", START_NS, gray, "16UC1", f"{side}_optical")
    clip = open_clip(path, camera={"fx_px": 60.0, "cx_px": 31.5, "cy_px": 23.5, "baseline_m": 0.12})
    assert clip.notes == ()
    assert clip.frame(1).depth_m is None
    assert np.array_equal(clip.frame(1).left, np.repeat(moving_picture(1)[..., :1], 3, axis=2))


def test_depth_in_jpeg_says_what_to_record(tmp_path: Path) -> None:
    with messages(tmp_path, "mcap") as (path, write):
        write.image(COLOUR, START_NS, moving_picture(1), "rgb8")
        write.compressed(f"{DEPTH}/compressed", START_NS, "16UC1; jpeg compressed ", b"\xff\xd8")
    with pytest.raises(VfoaError, match=rf"JPEG has lost the depth of {DEPTH}/compressed: record the raw topic"):
        open_clip(path)


def test_depth_of_another_camera_than_the_pairs_is_left_out_and_said(tmp_path: Path) -> None:
    with messages(tmp_path, "mcap") as (path, write):
        for number in (1, 2):
            taken = shot(number)
            for side in ("left", "right"):
                write.image(f"/cam/{side}/image_rect", taken.stamp_ns, taken.colour, "rgb8", f"{side}_optical")
            write.image("/cam/color/image_raw", taken.stamp_ns, taken.colour, "rgb8", "color")
            write.image("/cam/aligned_depth_to_color/image_raw", taken.stamp_ns, taken.depth_mm, "16UC1", "color")
    numbers = {"fx_px": 60.0, "cx_px": 31.5, "cy_px": 23.5}
    pair = open_clip(path, camera=numbers | {"baseline_m": 0.1})
    assert pair.frame(1).depth_m is None
    assert pair.frame(1).rig.baseline_m == 0.1
    assert any("aligned_depth_to_color" in note and "depth =" in note for note in pair.notes)
    clip = open_clip(path, depth="/cam/aligned_depth_to_color/image_raw", camera=numbers)
    assert clip.frame(1).right is None
    np.testing.assert_allclose(clip.frame(1).depth_m, in_metres(depth_mm(1)), rtol=1e-6)


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("raw", [1, COUNT])
def test_images_of_two_types_on_one_topic_are_those_of_the_type_with_the_most(
    tmp_path: Path, kind: Format, raw: int
) -> None:
    """A topic that another node also published, compressed; of equally many, the raw ones count."""
    shots = [shot(number) for number in range(1, COUNT + 1)]
    with messages(tmp_path, kind) as (path, write):
        for number, each in enumerate(shots):
            write.camera(INFO, each.stamp_ns, each.lens)
            write_depth(write, each, "raw")
            done, png = cv2.imencode(".png", each.colour[:, :, ::-1] // 2)
            assert done
            write.compressed(COLOUR, each.stamp_ns, "png", png.tobytes())
            if number < raw:
                write.image(COLOUR, each.stamp_ns, each.colour, "rgb8")
    clip = open_clip(path)
    assert len(clip.frames) == COUNT
    for number, each in zip(clip.frames, shots, strict=True):
        assert np.array_equal(clip.frame(number).left, each.colour if raw == COUNT else each.colour // 2)
    less, more = ("CompressedImage", "Image") if raw == COUNT else ("Image", "CompressedImage")
    (note,) = (note for note in clip.notes if "messages of sensor_msgs/msg" in note)
    assert re.search(rf"{COLOUR}: {raw} .*/{less} .*, {COUNT} .*/{more} ", note)


@pytest.mark.parametrize("kind", FORMATS)
def test_other_messages_on_the_topic_of_the_images_are_passed_over(tmp_path: Path, kind: Format) -> None:
    with messages(tmp_path, kind) as (path, write):
        for each in map(shot, range(1, COUNT + 1)):
            write.write(COLOUR, "std_msgs/msg/String", each.stamp_ns, data="exposure 12 ms")
            write.camera(COLOUR, each.stamp_ns, each.lens)  # a name that a driver's settings repeated
            write.image(COLOUR, each.stamp_ns, each.colour, "rgb8")
            write_depth(write, each, "raw")
    clip = open_clip(path, left_info=COLOUR)
    assert clip.notes == ()
    assert_recorded(clip, range(1, COUNT + 1))


def test_two_schemas_of_one_type_on_one_topic_are_one_topic(tmp_path: Path) -> None:
    """What two recorders wrote, joined: the definitions differ in a comment, or one of them is empty."""
    (whole,) = write_take(tmp_path, "mcap", map(shot, range(1, COUNT + 1))).glob("*.mcap")
    joined = tmp_path / "joined.mcap"
    with whole.open("rb") as source, joined.open("wb") as target:
        writer = McapWriter(target)
        writer.start()
        channels: dict[tuple[str, int], int] = {}
        for number, (schema, channel, message) in enumerate(make_reader(source).iter_messages()):
            assert schema is not None
            key = channel.topic, number // 3 % 3
            if key not in channels:
                text = (schema.data, b"# of another recorder\n" + schema.data, b"")[key[1]]
                channels[key] = writer.register_channel(
                    channel.topic, channel.message_encoding, writer.register_schema(schema.name, schema.encoding, text)
                )
            writer.add_message(channels[key], message.log_time, message.data, message.publish_time)
        writer.finish()
    assert len({number for (topic, number) in channels if topic == COLOUR}) > 1
    clip = open_clip(joined)
    assert clip.notes == ()
    assert_recorded(clip, range(1, COUNT + 1))


@pytest.mark.parametrize("unset", [{"colour"}, {"depth"}, {"colour", "depth"}])
def test_colour_and_depth_without_time_stamps_are_named(unset: set[str], tmp_path: Path) -> None:
    with messages(tmp_path, "mcap") as (path, write):
        for number in (1, 2):
            log_ns = START_NS + number * STEP_NS
            head_ns = {role: 0 if role in unset else log_ns for role in ("colour", "depth")}
            write.camera("/camera/color/camera_info", log_ns, LENS)
            write.image("/camera/color/image_raw", head_ns["colour"], moving_picture(number), "rgb8", log_ns=log_ns)
            write.image("/camera/depth/image_raw", head_ns["depth"], depth_mm(number), "16UC1", log_ns=log_ns)
    with pytest.raises(VfoaError, match=r'image_raw: 2 images without time stamp; expected .*stamps = "log"'):
        open_clip(path)
    found = open_clip(path, stamps="log").frame(2).depth_m
    np.testing.assert_allclose(found, in_metres(depth_mm(2)), rtol=1e-6)


@pytest.mark.parametrize("frame", ["", "depth"])
def test_depth_that_is_aligned_without_saying_so_is_taken_as_told(frame: str, tmp_path: Path) -> None:
    """Of a script that aligns depth and gives it a name and a frame of its own, or none."""
    with messages(tmp_path, "mcap") as (path, write):
        write.image("/cam_rgb/raw", START_NS, moving_picture(1), "rgb8", frame="" if not frame else "colour")
        write.image("/cam_depth/raw", START_NS, depth_mm(1), "16UC1", frame=frame)
    camera = {"fx_px": 60, "cx_px": 31.5, "cy_px": 23.5}
    with pytest.raises(VfoaError, match=r"/cam_depth/raw .* is not aligned with /cam_rgb/raw .*aligned = true"):
        open_clip(path, camera=camera)
    clip = open_clip(path, camera=camera, aligned=True)
    assert clip.notes == ()
    np.testing.assert_allclose(clip.frame(1).depth_m, in_metres(depth_mm(1)), rtol=1e-6)
    assert clip.frame(1).rig.fx_px == 60


def test_depth_may_be_said_to_be_unaligned(tmp_path: Path) -> None:
    normal, distance = np.array([0.1, 0.05, 1.0]), 2.0
    millimetres = np.rint(1000 * plane_depth(WIDE, normal, distance)).astype(np.uint16)
    with messages(tmp_path, "mcap") as (path, write):
        write.transform("/tf_static", START_NS, "colour", "depth", SHIFT, TURN.as_quat())
        write.camera("/camera/color/camera_info", START_NS, LENS, frame="colour")
        write.image("/camera/color/image_raw", START_NS, moving_picture(1), "rgb8", frame="colour")
        write.camera("/camera/depth_registered/camera_info", START_NS, WIDE, frame="depth")
        write.image("/camera/depth_registered/image_raw", START_NS, millimetres, "16UC1", frame="depth")
    expect_plane(open_clip(path, aligned=False), normal, distance)


@pytest.mark.parametrize("encoding", ["16uc1", "Z16", "z16", "MONO16"])
def test_encodings_of_depth_are_read_as_scripts_spell_them(encoding: str, tmp_path: Path) -> None:
    with messages(tmp_path, "mcap") as (path, write):
        write.camera(INFO, START_NS, LENS)
        write.image(COLOUR, START_NS, moving_picture(1), "RGB")
        write.image(DEPTH, START_NS, depth_mm(1), encoding)
    frame = open_clip(path).frame(1)
    assert np.array_equal(frame.left, moving_picture(1))
    np.testing.assert_allclose(frame.depth_m, in_metres(depth_mm(1)), rtol=1e-6)


@pytest.mark.parametrize("encoding", ["32FC1", "32fc1"])
def test_quantised_depth_is_known_by_its_encoding(encoding: str, tmp_path: Path) -> None:
    form, data = compressed_depth(depth_mm(1), "32FC1 png")
    with messages(tmp_path, "mcap") as (path, write):
        write.camera(INFO, START_NS, LENS)
        write.image(COLOUR, START_NS, moving_picture(1), "rgb8")
        write.compressed(f"{DEPTH}/compressedDepth", START_NS, form.replace("32FC1", encoding), data)
    np.testing.assert_allclose(open_clip(path).frame(1).depth_m, in_metres(depth_mm(1)), rtol=0.01)


@pytest.mark.parametrize("form", ["16UC1; compressedDepth", "16UC1; compressedDepth png"])
def test_compressed_depth_without_a_header_is_read(form: str, tmp_path: Path) -> None:
    done, coded = cv2.imencode(".png", depth_mm(1))
    assert done
    with messages(tmp_path, "mcap") as (path, write):
        write.camera(INFO, START_NS, LENS)
        write.image(COLOUR, START_NS, moving_picture(1), "rgb8")
        write.compressed(f"{DEPTH}/compressedDepth", START_NS, form, coded.tobytes())
    np.testing.assert_allclose(open_clip(path).frame(1).depth_m, in_metres(depth_mm(1)), rtol=1e-6)


def test_depth_in_another_encoding_is_named(tmp_path: Path) -> None:
    with messages(tmp_path, "mcap") as (path, write):
        write.image(COLOUR, START_NS, moving_picture(1), "rgb8")
        write.image("/camera/depth/image_raw", START_NS, depth_mm(1), "u16")
    with pytest.raises(VfoaError, match=r"no depth is read of /camera/depth/image_raw in 'u16': expected 16UC1, "):
        open_clip(path)
