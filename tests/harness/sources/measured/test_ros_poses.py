"""Poses that ROS recorded: topics and coordinate frames as bodies, times and rates that differ, what is refused."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer
from scipy.spatial.transform import Rotation

from harness.clips.add import add_clip
from harness.clips.check import check_clip
from harness.clips.manifest import load_manifest
from harness.report.write import rescore
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.sources import MeasuredClip
from tests.depth_recordings import FORMATS, Format, Lens, Messages, Shot, messages, write_take
from tests.disk import labels_text, picture, write_text
from tests.measured import EXPERIMENT, open_measured
from tests.recordings import HEADER
from vfoa.errors import VfoaError
from vfoa.geometry import angle_between
from vfoa.types import Float, Scene

START_NS = 1_700_000_000_000_000_000
STEP_NS = 10_000_000
STILL = [0.0, 0.0, 0.0, 1.0]
POSE_STAMPED = """std_msgs/Header header
geometry_msgs/Pose pose
================================================================================
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w"""
FACE = {"forward": [1, 0, 0]}
"""The axes of a head in ROS: x ahead, y to its left, z up (REP 103)."""


def record(folder: Path, fill: Callable[[Messages], None], kind: Format = "bag") -> Path:
    with messages(folder, kind) as (path, write):
        fill(write)
    return path


def opened(path: Path, **source: object) -> MeasuredClip:
    return open_measured("ros_poses", path.parent, **{"file": path.name, "heads": {"anna": FACE}, **source})


def center(scene: Scene, name: str) -> Float | None:
    (box,) = (target.box for target in scene.targets if target.instance.label == name)
    return None if box is None else box.center_m


def eyes(scene: Scene) -> Float | None:
    return scene.people[0].eye_origin_left


def left_from_ros(place: Sequence[float]) -> list[float]:
    """The axes of a clip, whose x is that of the room, for z up."""
    x, y, z = place
    return [x, -z, y]


def vrpn(write: Messages, name: str, stamp_ns: int, place: Sequence[float], turn: Sequence[float] = STILL) -> None:
    write.pose(f"/vrpn_client_node/{name}/pose", stamp_ns, "world", place, turn)


@pytest.mark.parametrize("kind", FORMATS)
def test_topics_of_drivers_are_bodies(kind: Format, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Anna turns to her left, and wears her marker 0.2 m above her eyes; vicon_bridge has names of its own."""
    monkeypatch.chdir(tmp_path)
    turn = Rotation.from_euler("z", 90, degrees=True).as_quat()

    def fill(write: Messages) -> None:
        for stamp_ns in range(START_NS, START_NS + 5 * STEP_NS, STEP_NS):
            vrpn(write, "anna", stamp_ns, [1, 2, 1.8], turn)
            write.moved("/vicon/cup/cup", stamp_ns, "/world", "vicon/cup/cup", [1, 4, 0.9], STILL)
            write.transform("/tf", stamp_ns, "world", "anna", [1, 2, 1.8], turn)
            write.transform("/tf", stamp_ns, "world", "vicon/cup/cup", [1, 4, 0.9], STILL)

    path = record(tmp_path, fill, kind)
    head = {**FACE, "eyes_m": [0, 0, -0.2]}
    clip = opened(path, heads={"anna": head}, sizes_m={"cup": [0.1, 0.2, 0.3]})
    assert ([*clip.people], [*clip.objects], [*clip.frames]) == (["anna"], ["cup"], [1, 2, 3, 4, 5])
    assert [clip.time_ns(number) for number in clip.frames] == [START_NS + STEP_NS * step for step in range(5)]
    scene = clip.scene(3)
    (anna,) = scene.people
    np.testing.assert_allclose(eyes(scene), left_from_ros([1, 2, 1.6]), atol=1e-9)
    assert anna.view.head_pose is not None
    np.testing.assert_allclose(anna.view.head_pose.direction, left_from_ros([0, 1, 0]), atol=1e-9)
    np.testing.assert_allclose(center(scene, "cup"), left_from_ros([1, 4, 0.9]), atol=1e-9)
    (cup,) = (target.box for target in scene.targets if target.instance.label == "cup")
    assert cup is not None
    np.testing.assert_allclose(np.abs(cup.left_from_box) @ (2 * cup.half_size_m), [0.1, 0.3, 0.2], atol=1e-9)
    added = add_clip(path, source={"heads": {"anna": head}})
    check = check_clip(added.name)
    assert (added.adapter, check.frames, check.problems, check.notes) == ("ros_poses", 5, (), ())


def test_bodies_have_their_own_rates_and_times(tmp_path: Path) -> None:
    """x is the time, s: anna at 100 Hz, lost for 0.1 s, the cup 3 ms later at 25 Hz, the table once."""

    def fill(write: Messages) -> None:
        for step in range(100):
            after_ns = step * STEP_NS
            if not 40 <= step < 50:
                vrpn(write, "anna", START_NS + after_ns, [after_ns / 1e9, 0, 1.6])
            if step % 4 == 0:
                vrpn(write, "cup", START_NS + after_ns + 3_000_000, [after_ns / 1e9 + 0.003, 1, 1])
        vrpn(write, "table", START_NS, [2, 0, 0.7])

    clip = opened(record(tmp_path, fill))
    assert len(clip.frames) == 90 + 3  # of the cup alone: 0.403, 0.443 and 0.483 s
    seen = 0
    for number in clip.frames:
        scene, time_s = clip.scene(number), (clip.time_ns(number) - START_NS) / 1e9
        at_eyes, at_cup, at_table = eyes(scene), center(scene, "cup"), center(scene, "table")
        assert (at_eyes is None) == (0.41 < time_s < 0.49)  # 0.403 s is within 15 ms of 0.39 s
        assert at_eyes is None or at_eyes[0] == pytest.approx(time_s, abs=0.0131)
        seen += at_cup is not None
        assert at_cup is None or at_cup[0] == pytest.approx(time_s, abs=0.03)
        np.testing.assert_allclose(at_table, left_from_ros([2, 0, 0.7]), atol=1e-9)
    assert seen >= 92
    assert clip.notes[:2] == ("table: sent once: taken to be at rest", "anna: not tracked in 2 of 93 frames")


def test_trackers_of_their_own_share_frames_at_their_rate(tmp_path: Path) -> None:
    """Of 100 Hz each, started 4 and 7 ms apart, and sent over a network: 1 ms is the standard deviation."""
    noise_ms = np.random.default_rng(0).normal(size=(100, 3))

    def fill(write: Messages) -> None:
        for step in range(100):
            for name, after_ms in zip(("anna", "cup", "lamp"), [0, 4, 7] + noise_ms[step], strict=True):
                time_s = step / 100 + after_ms / 1000
                vrpn(write, name, START_NS + round(1e9 * time_s), [time_s, 0, 1])

    clip = opened(record(tmp_path, fill))
    assert 98 <= len(clip.frames) <= 105
    assert not any("not tracked" in note for note in clip.notes)
    for number in clip.frames:
        scene, time_s = clip.scene(number), (clip.time_ns(number) - START_NS) / 1e9
        for place in (eyes(scene), center(scene, "cup"), center(scene, "lamp")):
            assert place is not None
            assert place[0] == pytest.approx(time_s, abs=0.011)


@pytest.mark.parametrize("kind", FORMATS)
def test_a_clock_that_was_set_back_while_recording_is_noted(kind: Format, tmp_path: Path) -> None:
    """Poses of two times are mixed by their stamps; the log has the order in which they were measured."""

    def fill(write: Messages) -> None:
        for step in range(20):
            stamp_ns = START_NS + (step - 8 * (step >= 10)) * STEP_NS
            for name in ("anna", "cup"):
                place = [step, 0, 1]
                write.pose(f"/{name}/pose", stamp_ns, "world", place, STILL, log_ns=START_NS + step * STEP_NS)

    path = record(tmp_path, fill, kind)
    (note,) = (note for note in opened(path).notes if "set back" in note)
    assert "/anna/pose: 7 messages " in note
    assert "by up to 0.07 s" in note
    clip = opened(path, stamps="log")
    assert [center(clip.scene(number), "cup")[0] for number in clip.frames] == [*range(20)]
    assert not any("set back" in note for note in clip.notes)


def test_messages_that_arrive_late_are_of_one_frame(tmp_path: Path) -> None:
    """The cup is sent 4 ms after anna in the same frames, and recorded before her."""

    def fill(write: Messages) -> None:
        for step in range(10):
            vrpn(write, "cup", START_NS + step * STEP_NS + 4_000_000, [step, 0, 1])
            vrpn(write, "anna", START_NS + step * STEP_NS, [step, 0, 1.6])

    clip = opened(record(tmp_path, fill))
    assert len(clip.frames) == 10
    for step, scene in enumerate(map(clip.scene, clip.frames)):
        at_eyes, at_cup = eyes(scene), center(scene, "cup")
        assert at_eyes is not None
        assert at_cup is not None
        assert (at_eyes[0], at_cup[0]) == (step, step)


def humans(write: Messages) -> None:
    """A camera on a robot that drives along x, 1.2 m high, sees a face 2 m ahead of it that looks back.

    A cup is fixed to the map. Optical axes: z ahead, x right; the frames of ROS4HRI: the face's x ahead, the gaze's z.
    """
    optical = Rotation.from_euler("xyz", [-90, 0, -90], degrees=True).as_quat()
    back = (Rotation.from_quat(optical).inv() * Rotation.from_euler("z", 180, degrees=True)).as_quat()
    gaze = Rotation.from_euler("xyz", [-90, 0, -90], degrees=True).as_quat()
    write.transform("/tf_static", START_NS, "base_link", "camera_optical", [0, 0, 1.2], optical)
    write.transform("/tf_static", START_NS, "map", "cup", [3, 1, 0.8], STILL)
    write.transform("/tf_static", START_NS, "map", "base_link", [9, 9, 0], STILL)  # a default: the robot moves
    for step in range(20):
        stamp_ns = START_NS + step * STEP_NS
        write.transform("/tf", stamp_ns, "map", "base_link", [step / 100, 0, 0], STILL)
        write.transform("/tf", stamp_ns + 2_000_000, "/camera_optical", "/face_ab", [0, 0, 2], back)
        write.transform("/tf", stamp_ns + 2_000_000, "face_ab", "gaze_ab", [0, 0, 0], gaze)


@pytest.mark.parametrize(("body", "forward"), [("face_ab", [1, 0, 0]), ("gaze_ab", [0, 0, 1])])
def test_frames_of_tf_are_bodies_in_one_frame(body: str, forward: list[float], tmp_path: Path) -> None:
    heads = {"anna": {"body": body, "forward": forward}}
    clip = opened(record(tmp_path, humans), heads=heads, bodies=["base_link", "cup"])
    assert (len(clip.frames), [*clip.objects]) == (20, ["base_link", "cup"])
    assert not any("eyes" in note for note in clip.notes)  # a face's origin is between them
    for step, scene in enumerate(map(clip.scene, clip.frames)):
        (anna,) = scene.people
        assert anna.view.head_pose is not None
        np.testing.assert_allclose(eyes(scene), left_from_ros([2 + step / 100, 0, 1.2]), atol=1e-9)
        np.testing.assert_allclose(anna.view.head_pose.direction, left_from_ros([-1, 0, 0]), atol=1e-9)
        np.testing.assert_allclose(center(scene, "cup"), left_from_ros([3, 1, 0.8]), atol=1e-9)
        np.testing.assert_allclose(center(scene, "base_link"), left_from_ros([step / 100, 0, 0]), atol=1e-9)


def test_another_frame_can_be_that_of_the_clip(tmp_path: Path) -> None:
    """In that of the robot, the face is at rest, and the cup moves."""
    heads = {"anna": {**FACE, "body": "face_ab"}}
    clip = opened(record(tmp_path, humans), heads=heads, bodies=["cup"], frame="base_link")
    for step, scene in enumerate(map(clip.scene, clip.frames)):
        np.testing.assert_allclose(eyes(scene), left_from_ros([2, 0, 1.2]), atol=1e-9)
        np.testing.assert_allclose(center(scene, "cup"), left_from_ros([3 - step / 100, 1, 0.8]), atol=1e-9)


def test_frames_that_move_are_the_bodies_unless_they_are_named(tmp_path: Path) -> None:
    """The gaze has the ID of the face that is a head: it is a part of that person."""
    path = record(tmp_path, humans)
    heads = {"anna": {**FACE, "body": "face_ab"}}
    assert [*opened(path, heads=heads).objects] == ["base_link"]
    assert [*opened(path, heads=heads, bodies=["gaze_ab", "cup"]).objects] == ["gaze_ab", "cup"]
    robot = opened(path, heads={"robot": {**FACE, "body": "base_link"}})
    assert [*robot.objects] == ["face_ab", "gaze_ab"]


@pytest.mark.parametrize("kind", FORMATS)
def test_where_a_robot_says_it_is_is_a_body_if_it_is_named(kind: Format, tmp_path: Path) -> None:
    """Odometry, which most often is on /tf as well, does not displace the other bodies."""

    def fill(write: Messages) -> None:
        for step in range(3):
            stamp_ns = START_NS + step * STEP_NS
            vrpn(write, "anna", stamp_ns, [1, 2, 1.8])
            write.transform("/tf", stamp_ns, "world", "base_link", [step, 0, 0], STILL)
            write.pose("/robot/odom", stamp_ns, "world", [step, 1, 0], STILL, kind="Odometry")
            write.pose("/amcl_pose", stamp_ns, "world", [step, 2, 0], STILL, kind="PoseWithCovarianceStamped")

    path = record(tmp_path, fill, kind)
    assert [*opened(path).objects] == []
    clip = opened(path, bodies=["odom", "amcl_pose"])
    for step, scene in enumerate(map(clip.scene, clip.frames)):
        for name, y in (("odom", 1), ("amcl_pose", 2)):
            np.testing.assert_allclose(center(scene, name), left_from_ros([step, y, 0]), atol=1e-9)


def test_without_other_poses_estimates_are_the_bodies(tmp_path: Path) -> None:
    def fill(write: Messages) -> None:
        for step in range(3):
            for name in ("anna", "robot"):
                topic, stamp_ns = f"/{name}/pose", START_NS + step * STEP_NS
                write.pose(topic, stamp_ns, "map", [step, 0, 0], STILL, kind="PoseWithCovarianceStamped")

    clip = opened(record(tmp_path, fill))
    assert ([*clip.people], [*clip.objects], len(clip.frames)) == (["anna"], ["robot"], 3)


def test_bodies_of_one_name_have_their_full_names(tmp_path: Path) -> None:
    def fill(write: Messages) -> None:
        for stamp_ns in (START_NS, START_NS + STEP_NS):
            for topic in ("/left/cup/pose", "/right/cup/pose", "/anna/pose"):
                write.pose(topic, stamp_ns, "world", [0, 0, 1], STILL)

    assert [*opened(record(tmp_path, fill)).objects] == ["left/cup/pose", "right/cup/pose"]


def test_times_of_the_log_can_be_chosen(tmp_path: Path) -> None:
    def fill(write: Messages) -> None:
        for step in range(3):
            write.pose("/anna/pose", 0, "world", [step, 0, 1.6], STILL, log_ns=START_NS + step * STEP_NS)

    path = record(tmp_path, fill)
    with pytest.raises(VfoaError) as refused:
        opened(path)
    assert f"{path}: /anna/pose: a pose without time stamp" in str(refused.value)
    clip = opened(path, stamps="log")
    assert [clip.time_ns(number) for number in clip.frames] == [START_NS + STEP_NS * step for step in range(3)]


def test_a_recording_with_images_stays_one_of_images(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    lens = Lens(width=64, height=48, fx=100.0, cx=31.5, cy=23.5)
    shot = Shot(stamp_ns=START_NS, colour=picture(1), depth_mm=np.full((48, 64), 1500, np.uint16), lens=lens)
    path = write_take(tmp_path, "mcap", [shot])
    with messages(tmp_path / "poses", "mcap") as (poses, write):
        vrpn(write, "anna", START_NS, [0, 0, 1])
    poses_file = next(poses.glob("*.mcap"))
    poses_file.rename(path / poses_file.name.replace("take", "z"))
    assert add_clip(path).adapter == "mcap"


def test_a_cut_recording_is_read_as_far_as_it_goes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)

    pose = {"position": {"x": 0, "y": 0, "z": 1.6}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
    path = tmp_path / "cut.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1024)
        schema = writer.register_msgdef("geometry_msgs/msg/PoseStamped", POSE_STAMPED + HEADER)
        for step in range(100):
            stamp_ns = START_NS + step * STEP_NS
            header = {"stamp": dict(zip(("sec", "nanosec"), divmod(stamp_ns, 10**9), strict=True)), "frame_id": "world"}
            writer.write_message("/anna/pose", schema, {"header": header, "pose": pose}, log_time=stamp_ns)
        writer.finish()
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    added = add_clip(path, source={"heads": {"anna": FACE}})
    check = check_clip(added.name)
    assert (added.adapter, check.problems) == ("ros_poses", ())
    assert any("cut.mcap: cut at byte" in note for note in check.notes)


def test_recordings_of_their_own_in_one_folder_are_noted(tmp_path: Path) -> None:
    for name, start_ns in (("a", START_NS), ("b", START_NS + 3600 * 10**9)):
        with messages(tmp_path, "bag", name) as (_, write):
            for step in range(3):
                vrpn(write, "anna", start_ns + step * STEP_NS, [0, 0, 1.6])
    (note,) = (note for note in opened(tmp_path).notes if "separate recordings" in note)
    assert note.startswith("a.bag, b.bag: 3600 s lie between them")


def test_clocks_that_differ_are_noted(tmp_path: Path) -> None:
    """The cup's computer is an hour ahead."""

    def fill(write: Messages) -> None:
        for step in range(3):
            stamp_ns = START_NS + step * STEP_NS
            vrpn(write, "anna", stamp_ns, [0, 0, 1.6])
            write.pose("/cup/pose", stamp_ns + 3600 * 10**9, "world", [1, 0, 1], STILL, log_ns=stamp_ns)

    path = record(tmp_path, fill)
    assert any(note.startswith("cup begins 3599.980 s after anna ends") for note in opened(path).notes)
    clip = opened(path, stamps="log")
    assert (len(clip.frames), [note for note in clip.notes if "begins" in note]) == (3, [])


def test_poses_without_names_say_what_to_record(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        poses = POSE_STAMPED.replace("geometry_msgs/Pose pose", "geometry_msgs/Pose[] poses")
        schema = writer.register_msgdef("geometry_msgs/msg/PoseArray", f"{poses}{HEADER}")
        message = {"header": {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": "map"}, "poses": []}
        writer.write_message("/people", schema, message, START_NS, START_NS)
        writer.finish()
    with pytest.raises(VfoaError, match=r"a\.mcap: no image topics; found /people .*expected .*PoseStamped.*PoseArray"):
        add_clip(tmp_path / "a.mcap")


def test_a_genuine_robot_stands_where_its_localisation_says(shared_data: Path) -> None:
    """Its program dates transforms ahead of /amcl_pose: the robot drives some cm meanwhile."""
    path = shared_data / "mcap" / "no_image_topics.mcap"
    clip = opened(path, heads={"robot": {"body": "base_link", **FACE}}, bodies=["rplidar_link"])
    assert [*clip.objects] == ["rplidar_link"]
    times_ns = np.array([clip.time_ns(number) for number in clip.frames])
    apart_m, apart_rad = [], []
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        said = [message for *_, message in reader.iter_decoded_messages(topics=["/amcl_pose"])]
    for message in said:
        header, pose = message.header, message.pose.pose
        near = np.abs(times_ns - (header.stamp.sec * 10**9 + header.stamp.nanosec)).argmin()
        (robot,) = clip.scene(clip.frames[near]).people
        if robot.eye_origin_left is not None and robot.view.head_pose is not None:
            place = left_from_ros([pose.position.x, pose.position.y, 0])
            apart_m.append(np.linalg.norm(robot.eye_origin_left[[0, 2]] - np.array(place)[[0, 2]]))
            yaw = 2 * np.arctan2(pose.orientation.z, pose.orientation.w)
            ahead = left_from_ros([np.cos(yaw), np.sin(yaw), 0])
            apart_rad.append(angle_between(robot.view.head_pose.direction, ahead))
    assert len(apart_m) > 120
    assert np.median(apart_m) < 0.05
    assert np.median(apart_rad) < 0.03


def test_a_genuine_localisation_is_read_as_it_was_said(shared_data: Path) -> None:
    path = shared_data / "mcap" / "no_image_topics.mcap"
    clip = opened(path, heads={"robot": {"body": "amcl_pose", **FACE}}, bodies=[], frame="map")
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        said = [message for *_, message in reader.iter_decoded_messages(topics=["/amcl_pose"])]
    assert len(clip.frames) == len(said) > 100
    for scene, message in zip(map(clip.scene, clip.frames), said, strict=True):
        place = message.pose.pose.position
        np.testing.assert_allclose(eyes(scene), left_from_ros([place.x, place.y, place.z]), atol=1e-9)


def _pose(topic: str, frame: str, turn: Sequence[float] = STILL, x: float = 0.0) -> Callable[[Messages], None]:
    return lambda write: write.pose(topic, START_NS + STEP_NS, frame, [x, 0, 1], turn)


def _transform(parent: str, child: str) -> Callable[[Messages], None]:
    return lambda write: write.transform("/tf", START_NS, parent, child, [0, 0, 1], STILL)


@pytest.mark.parametrize(
    ("more", "source", "found"),
    [
        ([_pose("/anna/pose", "world", [0, 0, 0, 2])], {}, "/anna/pose: message 2: found a quaternion of length 2;"),
        ([_pose("/anna/pose", "world", x=np.inf)], {}, "/anna/pose: message 2: found an infinite number"),
        ([_pose("/anna/pose", "map")], {}, "/anna/pose: found poses in the frames 'world', 'map'; expected one"),
        ([_pose("/goal", "map")], {}, "anna is in the frame 'world', goal in 'map'; expected transforms between both"),
        ([_transform("map", "world"), _transform("world", "map")], {}, "/tf: map: found a loop of frames: "),
        ([], {"frame": "wrold"}, "frame: no coordinate frame 'wrold'; did you mean 'world'?"),
        ([], {"bodies": ["ana"]}, "bodies: no rigid body 'ana'; did you mean 'anna'?"),
        ([], {"heads": {"ben": {}}}, "heads: no rigid body 'ben'; expected one of: anna"),
        (
            [],
            {"heads": {}},
            "a recording without images: heads: found none; expected who wears which rigid body",
        ),
        ([_pose("/=a/pose", "world")], {}, "/=a/pose: found the name '=a'; expected text"),
    ],
)
def test_mistakes_are_named_with_their_topic(
    more: list[Callable[[Messages], None]], source: dict[str, object], found: str, tmp_path: Path
) -> None:
    def fill(write: Messages) -> None:
        _pose("/anna/pose", "world")(write)
        for each in more:
            each(write)

    path = record(tmp_path, fill)
    with pytest.raises(VfoaError) as refused:
        opened(path, **source)
    assert str(refused.value).startswith(f"{path}: {found}")


def test_a_recording_runs_to_a_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Anna looks at the cup in the first half, at the lamp in the second."""
    monkeypatch.chdir(tmp_path)
    places = {"cup": [2.0, 1.0, 1.6], "lamp": [2.0, -1.0, 1.6]}

    def fill(write: Messages) -> None:
        for step in range(20):
            stamp_ns = START_NS + step * 10 * STEP_NS
            angle = np.arctan2(places["cup" if step < 10 else "lamp"][1], 2.0)
            vrpn(write, "anna", stamp_ns, [0, 0, 1.6], Rotation.from_euler("z", angle).as_quat())
            for name, place in places.items():
                vrpn(write, name, stamp_ns, place)

    added = add_clip(record(tmp_path, fill, "mcap"), name="talk", source={"heads": {"anna": FACE}})
    assert [*load_manifest(added.name).targets] == ["cup", "lamp"]
    write_text(tmp_path / "annotations" / "talk.csv", labels_text("1,10,anna,cup,", "11,20,anna,lamp,"))
    write_text(tmp_path / "talk.toml", EXPERIMENT)
    directory = run_plan(prepare(load_experiment("talk.toml")), tmp_path / "run", workers=1, progress=lambda clip: None)
    scores = {(row.configuration, row.n): row.correct for row in rescore(directory).rows}
    assert scores["cones", 20] == 20
