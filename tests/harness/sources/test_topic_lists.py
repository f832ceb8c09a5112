"""What is read of recordings with the topics that cameras, simulators and data sets of other people have."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from harness.sources.recordings.calibration_topics import find_camera
from harness.sources.recordings.image_message import ImageMessage
from harness.sources.recordings.messages import MessageType
from harness.sources.recordings.settings import RecordingSettings
from harness.sources.recordings.streams import Streams, find_streams, unused_pairs
from harness.sources.recordings.topics import Place, Topic
from vfoa.errors import VfoaError

ENCODINGS = ("rgb8", "bgra8", "mono8", "16UC1", "32FC1")


def topic(line: str) -> Topic:
    """``NAME [ENCODING] [COUNT] [@FRAME]``: a calibration, or images, by default in rgb8 and 9 of them."""
    name, *words = line.split()
    frame = next((word[1:] for word in words if word[0] == "@"), name.rpartition("/")[0])
    form = next((word for word in words if word in ENCODINGS), "rgb8")
    count = next((int(word) for word in words if word.isdigit()), 9)
    ros = "CameraInfo" if "camera_info" in name else "CompressedImage" if name.endswith("compressed") else "Image"
    kind = MessageType(message_encoding="cdr", schema_encoding="ros2msg", name=f"sensor_msgs/msg/{ros}", schema=b"")
    header = None if ros == "CameraInfo" else ImageMessage(form=form, data=b"", frame_id=frame)
    return Topic(name, kind, count, [Place(number, 0, number, 0) for number in range(count)], header=header)


def find(lines: Iterable[str], **settings: str) -> Streams:
    return find_streams([*map(topic, lines)], RecordingSettings(recording="a.bag", **settings), "a.bag")


def names(streams: Streams) -> tuple[str | None, ...]:
    return tuple(None if stream is None else stream.name for stream in streams)


TESSE = (
    *("/tesse/depth_cam/mono/image_raw 32FC1 @left_cam", "/tesse/left_cam/rgb/image_raw @left_cam"),
    *("/tesse/seg_cam/camera_info @left_cam", "/tesse/seg_cam/rgb/image_raw @left_cam"),
)
VIODE = ("/cam0/image_raw 9", "/cam1/image_raw 9", "/cam0/segmentation 10", "/cam1/segmentation 10")
CENTER = "/airsim_node/drone_1/front_center"
AIRSIM = tuple(f"{CENTER}/{image} @optical" for image in ("DepthPlanar 32FC1", "Scene", "Segmentation"))
DETECTIONS = tuple(f"/stereo/{side}/{image}" for side in ("left", "right") for image in ("detections", "image_raw"))
ANNOTATED = tuple(
    f"/camera/{image} @color"
    for image in ("aligned_depth_to_color/image_raw 16UC1", "color/image_annotated", "color/image_raw")
)
ISAAC = ("/rgb_left @left", "/rgb_right @right", "/depth_left 32FC1 @left", "/depth_right 32FC1 @right")
YOLO = tuple(
    image.format(side) for image in ("/stereo/{}/image_rect_color", "/yolo/{}/dbg_image") for side in ("left", "right")
)


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (TESSE, ("/tesse/left_cam/rgb/image_raw", None, "/tesse/depth_cam/mono/image_raw")),
        (VIODE, ("/cam0/image_raw", "/cam1/image_raw", None)),
        (AIRSIM, (f"{CENTER}/Scene", None, f"{CENTER}/DepthPlanar")),
        (DETECTIONS, ("/stereo/left/image_raw", "/stereo/right/image_raw", None)),
        (ANNOTATED, ("/camera/color/image_raw", None, "/camera/aligned_depth_to_color/image_raw")),
        (YOLO, ("/stereo/left/image_rect_color", "/stereo/right/image_rect_color", None)),
        (ISAAC, ("/rgb_left", "/rgb_right", "/depth_left")),
    ],
)
def test_what_a_camera_took_is_read_and_not_what_a_program_drew(
    lines: tuple[str, ...], expected: tuple[str | None, ...]
) -> None:
    """Labels of simulators (uHumans2, VIODE, AirSim), overlays of detectors, and depth of both sides (Isaac Sim)."""
    assert names(find(lines)) == expected


def test_what_a_program_drew_is_read_by_its_name_or_alone() -> None:
    drawn = ("/stereo/left/detections", "/stereo/right/detections", None)
    assert names(find(DETECTIONS, left=drawn[0])) == drawn
    assert names(find([line for line in DETECTIONS if "image" not in line])) == drawn


def test_a_camera_that_is_called_as_what_a_program_drew_keeps_its_depth_and_is_noted() -> None:
    images = ("/detection_camera/color/image_raw @c", "/detection_camera/depth/image_raw 16UC1 @d", "/webcam/image_raw")
    assert names(find(images))[0] == "/detection_camera/color/image_raw"
    topics = [*map(topic, YOLO)]
    (note,) = unused_pairs(topics, find_streams(topics, RecordingSettings(recording="a.bag"), "a.bag"))
    assert "/yolo/left/dbg_image" in note


OPENNI = (
    *("rgb/image_raw", "rgb/image_color", "rgb/image_mono mono8", "rgb/image_rect_color", "rgb/image_rect_mono mono8"),
    *("depth/image_raw 16UC1 @depth", "depth/image 32FC1 @depth", "depth_registered/image_raw 16UC1"),
    *("depth_registered/image 32FC1", "ir/image_raw 16UC1 @depth"),
)
RECTIFIED = tuple(f"depth_registered/sw_registered/image_rect{form}" for form in (" 32FC1", "_raw 16UC1"))


def test_of_the_copies_of_one_camera_s_images_the_best_are_read() -> None:
    """As ``rosbag record -a`` keeps those of OpenNI's driver (Kinect, Xtion): rectified, else as they are."""
    every = [f"/xtion/{line}{'' if '@' in line else ' @color'}" for line in OPENNI]
    left, _, depth = names(find(every))
    assert (left, depth) == ("/xtion/rgb/image_color", "/xtion/depth_registered/image_raw")
    left, _, depth = names(find([*every, *(f"/xtion/{line} @color" for line in RECTIFIED)]))
    assert (left, depth) == ("/xtion/rgb/image_rect_color", "/xtion/depth_registered/sw_registered/image_rect_raw")
    left, _, _ = names(find(line.replace("image_color", "image_color 2") for line in every))
    assert left == "/xtion/rgb/image_raw"
    with pytest.raises(VfoaError, match="several colour and depth topics"):
        find([*every[:1], "/xtion/rgb/high_res/image_raw @color", *every[5:]])
    kinect = (f"/kinect2/{size}/{image} @color" for size in ("hd", "qhd") for image in ("image_color", "depth 16UC1"))
    with pytest.raises(VfoaError, match="several colour and depth topics"):  # two sizes
        find(kinect)


CARLA = tuple(
    f"/carla/ego_vehicle/{camera}/image {form} @ego_vehicle/{camera}"
    for camera, form in (
        *(("rgb_front", "bgra8"), ("rgb_view", "bgra8"), ("depth_front", "32FC1")),
        *(("semantic_segmentation_front", "bgra8"), ("instance_segmentation_front", "bgra8")),
    )
)


def test_of_several_colour_cameras_the_one_with_the_words_of_the_depth_is_read() -> None:
    left, _, depth = names(find(CARLA))
    assert (left, depth) == ("/carla/ego_vehicle/rgb_front/image", "/carla/ego_vehicle/depth_front/image")
    with pytest.raises(VfoaError, match="several colour and depth topics"):
        find(line.replace("depth_front/", "depth/") for line in CARLA)
    with pytest.raises(VfoaError, match="several colour and depth topics"):  # two cameras, one called as any camera
        find(
            f"/sim/{name}/{image}" for name in ("camera", "camera2") for image in ("image_raw", "depth/image_raw 32FC1")
        )


def test_the_calibration_beside_the_image_is_its_own() -> None:
    lines = (
        *("/front_stereo_camera/left/image_rect_color", "/front_stereo_camera/left/camera_info"),
        *("/front_stereo_camera/left/camera_info_rect", "/front_stereo_camera/right/camera_info_rect"),
    )
    topics = [*map(topic, lines)]
    assert find_camera(topics, topics[:1], None, "a.bag").name == "/front_stereo_camera/left/camera_info_rect"
    with pytest.raises(VfoaError, match="no single calibration topic belongs to /tesse/left_cam/rgb/image_raw"):
        find_camera([*map(topic, TESSE)], [find(TESSE).left], None, "a.bag")
