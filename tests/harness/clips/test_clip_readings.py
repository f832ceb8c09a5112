"""If a path can be read in several ways, or its calibration is in doubt, `vfoa clips add` asks."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.sources.recordings.clip import McapClip
from harness.sources.recordings.settings import RecordingSettings
from tests.calibrations import RIG, SIZE, opencv_nodes, write_kalibr, write_opencv, write_ros, write_zed
from tests.disk import HEIGHT, WIDTH, picture, sintel_scene, write_image, write_text
from tests.harness.clips.adding import (
    LEFT,
    NUMBERS,
    RIGHT,
    final_scene,
    images,
    kitti,
    opencv_file,
    opencv_sample,
    refused,
    vfoa,
    views,
)
from tests.recordings import recorder

pytestmark = pytest.mark.usefixtures("work_here")

CALIBRATIONS: dict[str, Callable[[Path], object]] = {
    "opencv": lambda root: write_opencv(root / "stereo.xml", opencv_nodes(RIG), SIZE),
    "opencv sample": opencv_sample,
    "ros": lambda root: write_ros(root / "calibration", RIG),
    "kalibr": lambda root: write_kalibr(root / "camchain.yaml", RIG),
    "zed": lambda root: write_zed(root / "SN123.conf", RIG),
}


def test_several_scenes_and_passes_are_listed_with_the_options_that_decide(tmp_path: Path) -> None:
    final_scene(tmp_path)
    sintel_scene(tmp_path, "market")
    message = refused(tmp_path)
    assert message == (
        f"{tmp_path}: it can be read in 3 ways; expected --set scene=(alley | market) and --set pass=(clean | final)"
    )
    assert "--set scene=(alley | market)" in refused(tmp_path, "--set", "scene=aley")
    vfoa("add", tmp_path, "--set", "scene=market")


def test_several_pairs_of_topics_are_listed(tmp_path: Path) -> None:
    path = tmp_path / "two.mcap"
    with recorder(path) as record:
        for rig in ("front", "rear"):
            for side, camera in (("left", LEFT), ("right", RIGHT)):
                record.camera(f"/{rig}/{side}/camera_info", 10**9, camera)
                record.picture(f"/{rig}/{side}/image", 10**9, picture(1))
    message = refused(path)
    assert "2 pairs of image topics" in message
    assert "/front/left/image (sensor_msgs/msg/Image, 1 message)" in message
    assert message.endswith("(here as --set KEY=VALUE)")
    vfoa("add", path, "--set", "left=/rear/left/image", "--set", "right=/rear/right/image")


def test_pictures_of_depth_are_named_and_hide_no_pair(tmp_path: Path) -> None:
    for number in (1, 2):
        write_image(tmp_path / "rgb" / f"{number}.png", picture(number))
        write_image(tmp_path / "depth" / f"{number}.png", picture(number)[..., 0])
    assert re.search(r"depth/1\.png: found uint8 .*16 bits", refused(tmp_path))
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        for number in (1, 2):
            write_image(tmp_path / side / f"{number}.png", picture(number))
    assert vfoa("add", tmp_path, *NUMBERS)["adapter"] == "stereo_folder"


OF_A_ZED = [
    *("/zed/{side}/image_rect_gray", "/zed/{side}/image_rect_color"),
    *("/zed/{side}_raw/image_raw_gray", "/zed/{side}_raw/image_raw_color"),
]
OF_A_LATER_ZED = [f"/zed/{{side}}/{colour}/{kind}/image" for colour in ("color", "gray") for kind in ("raw", "rect")]


@pytest.mark.parametrize(
    ("topics", "expected"),
    [
        (["/{side}/image_raw", "/{side}/image_raw/compressed"], "/left/image_raw"),
        (["/{side}/image_raw", "/{side}/image_rect", "/{side}/image_rect/compressed"], "/left/image_rect"),
        ([*OF_A_ZED, *(f"{topic}/compressed" for topic in OF_A_ZED)], "/zed/left/image_rect_color"),
        (OF_A_LATER_ZED, "/zed/left/color/rect/image"),
    ],
)
def test_of_what_a_driver_publishes_of_a_rig_the_best_is_read(tmp_path: Path, topics: list[str], expected: str) -> None:
    """As ``ros2 bag record -a`` keeps it: every transport, raw and rectified, in colour and gray."""
    path = tmp_path / "all.mcap"
    with recorder(path) as record:
        for side, camera in (("left", LEFT), ("right", RIGHT)):
            for topic in (topic.format(side=side) for topic in topics):
                record.camera(f"{topic.removesuffix('/compressed').rpartition('/')[0]}/camera_info", 10**9, camera)
                record.picture(topic, 10**9, picture(1), "png" if topic.endswith("compressed") else "raw")
    clip = McapClip(RecordingSettings(recording="all.mcap"), tmp_path)
    assert clip._streams.left.name == expected
    assert clip._streams.right is not None
    assert clip._streams.right.name == expected.replace("left", "right")
    others = {name.format(side="left").removesuffix("/compressed") for name in topics} - {expected}
    assert set(re.findall("/[^ ,;]+", " ".join(clip.notes))) == ({expected, *others} if others else set())
    named = McapClip(RecordingSettings(recording="all.mcap", left=topics[0].format(side="left")), tmp_path)
    assert named._streams.left.name == topics[0].format(side="left")


def test_a_topic_that_was_recorded_for_a_moment_only_is_not_preferred(tmp_path: Path) -> None:
    path = tmp_path / "all.mcap"
    with recorder(path) as record:
        for stamp_ns in range(10**9, 10**10, 10**9):
            for side, camera in (("left", LEFT), ("right", RIGHT)):
                record.camera(f"/{side}/camera_info", stamp_ns, camera)
                record.picture(f"/{side}/image_raw", stamp_ns, picture(1))
                if stamp_ns == 10**9:
                    record.picture(f"/{side}/image_rect", stamp_ns, picture(1))
    clip = McapClip(RecordingSettings(recording="all.mcap"), tmp_path)
    assert (clip._streams.left.name, len(clip.frames)) == ("/left/image_raw", 9)


def test_a_robot_whose_name_begins_like_infrared_has_colour(tmp_path: Path) -> None:
    path, depth = tmp_path / "irobot.mcap", np.full((HEIGHT, WIDTH), 1500, np.uint16)
    with recorder(path) as record:
        record.camera("/irobot/rgb/camera_info", 10**9, LEFT)
        record.picture("/irobot/rgb/image_raw", 10**9, picture(1))
        record.picture("/irobot/ir/image_raw", 10**9, picture(1))
        record.raw("/irobot/depth_registered/image_raw", 10**9, WIDTH, HEIGHT, "16UC1", 2 * WIDTH, depth.tobytes())
        record.camera("/irobot/depth_registered/camera_info", 10**9, LEFT)
    assert McapClip(RecordingSettings(recording=path.name), tmp_path)._streams.left.name == "/irobot/rgb/image_raw"


@pytest.mark.parametrize("has_depth", [False, True])
def test_an_infrared_pair_gives_way_to_colour_with_aligned_depth(tmp_path: Path, has_depth: bool) -> None:
    path, depth = tmp_path / "realsense.mcap", np.full((HEIGHT, WIDTH), 1500, np.uint16)
    with recorder(path) as record:
        for side, camera in (("infra1", LEFT), ("infra2", RIGHT), ("color", LEFT)):
            record.camera(f"/camera/{side}/camera_info", 10**9, camera)
            record.picture(f"/camera/{side}/image_rect_raw", 10**9, picture(1))
        if has_depth:
            topic = "/camera/aligned_depth_to_color/image_raw"
            record.raw(topic, 10**9, WIDTH, HEIGHT, "16UC1", 2 * WIDTH, depth.tobytes())
            record.camera(f"{topic.rpartition('/')[0]}/camera_info", 10**9, LEFT)
    clip = McapClip(RecordingSettings(recording=path.name), tmp_path)
    read = "/camera/color/image_rect_raw" if has_depth else "/camera/infra1/image_rect_raw"
    assert (clip._streams.left.name, clip._streams.right is None) == (read, has_depth)
    assert [("infra1" in note) for note in clip.notes] == [True] * has_depth
    infra = {side: f"/camera/infra{number}/image_rect_raw" for side, number in (("left", 1), ("right", 2))}
    pair = McapClip(RecordingSettings(recording=path.name, **infra), tmp_path)
    assert pair._streams.right is not None


@pytest.mark.parametrize("own", [False, True])
def test_cameras_of_two_arms_are_no_pair_and_the_message_names_the_depth(tmp_path: Path, own: bool) -> None:
    """A robot with an RGB-D camera in its head, and one in each hand: their calibrations have no baseline."""
    path, depth = tmp_path / "robot.mcap", np.full((HEIGHT, WIDTH), 1500, np.uint16)
    with recorder(path) as record:
        for camera in ("head", "left_wrist", "right_wrist"):
            record.camera(f"/{camera}/color/camera_info", 10**9, LEFT)
            record.picture(f"/{camera}/color/image_raw", 10**9, picture(1))
            if own or camera == "head":
                topic = f"/{camera}/aligned_depth_to_color"
                record.raw(f"{topic}/image_raw", 10**9, WIDTH, HEIGHT, "16UC1", 2 * WIDTH, depth.tobytes())
                record.camera(f"{topic}/camera_info", 10**9, LEFT)
    message = refused(path)
    assert "the baseline is 0 m" in message
    assert re.search(r"depth = in \[source\].*: .*/head/aligned_depth_to_color/image_raw", message)
    vfoa("add", path, "--set", "depth=/head/aligned_depth_to_color/image_raw")
    named = McapClip(RecordingSettings(recording=path.name, depth="/head/aligned_depth_to_color/image_raw"), tmp_path)
    assert (named._streams.left.name, named._streams.right) == ("/head/color/image_raw", None)


def test_a_recording_without_calibration_takes_a_file(tmp_path: Path) -> None:
    path = tmp_path / "bare.mcap"
    with recorder(path) as record:
        for side in ("left", "right"):
            record.picture(f"/{side}/image_rect", 10**9, picture(1))
    assert "--fx --cx --cy (or --fov-deg), and --baseline" in refused(path)
    matrix = "100 0 31.5 {} 0 100 23.5 0 0 0 1 0"
    write_text(tmp_path / "calib.txt", f"P2: {matrix.format(0)}\nP3: {matrix.format(-12)}\n")
    added = vfoa("add", path, "--calibration", tmp_path / "calib.txt")
    assert added["calibration"] == "as given"
    assert added["rig"]["baseline_m"] == pytest.approx(0.12)
    assert 'calibration = "calib.txt"' in (Path.cwd() / "datasets" / "bare.toml").read_text()


@pytest.mark.parametrize("write", CALIBRATIONS.values(), ids=CALIBRATIONS)
def test_every_calibration_beside_the_images_is_found(tmp_path: Path, write: Callable[[Path], object]) -> None:
    for side in ("left", "right"):
        write_image(tmp_path / side / "1.png", np.full((SIZE[1], SIZE[0], 3), 128, np.uint8))
    write(tmp_path)
    vfoa("add", tmp_path, "--name", "mine")
    (checked,) = vfoa("check", "mine")
    assert checked["problems"] == []
    assert checked["baseline_m"] == pytest.approx(0.1199, abs=1e-4)


def test_two_calibration_files_can_be_given(tmp_path: Path) -> None:
    for side in ("left", "right"):
        write_image(tmp_path / "clip" / side / "1.png", np.full((SIZE[1], SIZE[0], 3), 128, np.uint8))
    left, right = write_ros(tmp_path / "elsewhere", RIG)
    vfoa("add", tmp_path / "clip", "--calibration", left, "--calibration", right, "--name", "mine")
    assert vfoa("check", "mine")[0]["baseline_m"] == pytest.approx(0.1199, abs=1e-4)


def test_a_calibration_is_never_guessed(tmp_path: Path) -> None:
    message = refused(images(tmp_path, "left/{}.png", "right/{}.png"))
    assert "no calibration was found; expected --calibration FILE" in message
    assert "or --fx --cx --cy, and --baseline of a rectified pair, in pixels and metres" in message


def test_both_pairs_of_kitti_are_listed(tmp_path: Path) -> None:
    kitti(kitti(tmp_path), "image_0/{:06d}.png", "image_1/{:06d}.png")
    assert refused(tmp_path).endswith("it can be read in 2 ways; expected --set left=(image_0 | image_2)")
    vfoa("add", tmp_path, "--set", "left=image_0", *NUMBERS, "--name", "gray")
    assert vfoa("check", "gray")[0]["problems"] == []
    vfoa("add", tmp_path, "--set", "left=image_2", "--name", "colour")
    assert vfoa("check", "colour")[0]["baseline_m"] == pytest.approx(0.125)


def test_halves_that_are_alike_both_ways_are_asked_for(tmp_path: Path) -> None:
    for number in (1, 2):
        tile = views(number)[0]
        tiles = np.tile(tile, (2, 2, 1))
        tiles[0, 0] ^= 1  # the halves are alike, not the same
        write_image(tmp_path / f"{number}.png", tiles)
    assert "it can be read in 2 ways; expected --set layout=(" in refused(tmp_path, *NUMBERS)
    vfoa("add", tmp_path, *NUMBERS, "--set", "layout=images_top_bottom", "--name", "mine")
    assert vfoa("check", "mine")[0]["size_px"] == [2 * WIDTH, HEIGHT]


def test_several_calibrations_are_listed(tmp_path: Path) -> None:
    opencv_file(tmp_path)
    shutil.copy(tmp_path / "stereo.yml", tmp_path / "left" / "older.yml")
    assert refused(tmp_path).endswith("it can be read in 2 ways; expected --calibration (stereo.yml | left/older.yml)")
    added = vfoa("add", tmp_path, "--calibration", tmp_path / "stereo.yml", "--name", "mine")
    assert added["calibration"] == "as given"


def test_kitti_s_raw_recordings_keep_their_calibration_above(tmp_path: Path) -> None:
    drive = images(tmp_path / "day" / "drive_1", "image_02/data/{:010d}.png", "image_03/data/{:010d}.png")
    lines = [
        f"P_rect_{camera}: 100 0 31.5 {column} 0 100 23.5 0 0 0 1 0\n" for camera, column in (("02", 0), ("03", -12))
    ]
    write_text(tmp_path / "day" / "calib_cam_to_cam.txt", "".join(lines))
    assert vfoa("add", drive)["calibration"] == "../calib_cam_to_cam.txt"
    assert vfoa("check", "drive_1")[0]["baseline_m"] == pytest.approx(0.12)


def test_a_large_file_that_is_no_picture_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.bag").write_bytes(b"x")

    def fail(path: Path) -> bytes:
        raise AssertionError(path)

    monkeypatch.setattr(Path, "read_bytes", fail)
    assert "a.bag: not a bag of ROS 1" in refused(tmp_path / "a.bag")
