"""A clip of colour and measured depth through a run, its recording, and its report."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from rosbags.typesys import Stores, get_typestore

from harness.record import entities
from harness.run.directory import RunDirectory
from harness.run.table_records import read_records
from harness.sources.recordings.clip import McapClip
from harness.sources.recordings.settings import RecordingSettings
from scripts.measure.stage_outputs import write_coco_panoptic
from tests.command import vfoa
from tests.depth_recordings import DEPTH, Lens, Messages, Shot, messages, write_depth, write_take
from tests.disk import labels_text, moving_picture, write_text
from tests.harness.record.conftest import Columns
from vfoa.errors import VfoaError
from vfoa.types import Instance, Instances

WIDTH, HEIGHT = 64, 48
LENS = Lens(width=WIDTH, height=HEIGHT, fx=60.0, cx=31.5, cy=23.5)
START_NS, STEP_NS = 1_700_000_000_000_000_000, 40_000_000
PERSON, CUP = (slice(8, 44), slice(4, 24)), (slice(20, 32), slice(40, 52))
EXPERIMENT = """
[defaults]
segmentation = { model = "coco_panoptic", root = "masks" }
heads.detector = "person_mask"
head_pose.model = "none"
gaze.model = "none"
reconstruction = { erode_px = 0 }

[[configuration]]
name = "sensor"
stereo.matcher = "sensor"
"""


def shot(number: int) -> Shot:
    """A wall at 4.009 m, a person at 2 m, a cup at 1.5 m; a corner that the sensor did not see."""
    depth = np.full((HEIGHT, WIDTH), 4009, np.uint16)  # 4.009 m are 4008.9998 mm in float32
    depth[PERSON], depth[CUP] = 2000, 1500
    depth[:4, :4] = 0
    colour = moving_picture(number, WIDTH, HEIGHT)
    return Shot(stamp_ns=START_NS + number * STEP_NS, colour=colour, depth_mm=depth, lens=LENS)


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Path:
    """A working directory with a depth clip of three frames, its masks and an experiment."""
    monkeypatch.chdir(tmp_path)
    ids = np.zeros((HEIGHT, WIDTH), np.uint16)
    ids[PERSON], ids[CUP] = 1, 2
    person = Instance(id=1, label="person", category_id=1, is_thing=True, score=0.9)
    cup = Instance(id=2, label="cup", category_id=47, is_thing=True, score=0.9)
    masks = Instances(ids=ids, instances=(person, cup))
    write_coco_panoptic(tmp_path / "masks", [(number, masks) for number in (1, 2, 3)])
    write_text(tmp_path / "depth.toml", EXPERIMENT.replace('"masks"', f'"{(tmp_path / "masks").as_posix()}"'))
    path = write_take(tmp_path, "bag", map(shot, (1, 2, 3)))
    added = vfoa(
        monkeypatch, capsys, "clips", "add", str(path), "--name", "take", "--subject", "ann", "--target", "cup"
    )
    assert added[0] == 0, added
    write_text(tmp_path / "annotations" / "take.csv", labels_text("1,3,ann,cup,"))
    write_text(tmp_path / "depth.toml", 'clips = ["take"]\n' + (tmp_path / "depth.toml").read_text())
    return tmp_path


def test_a_run_places_objects_and_records_the_measured_depth(
    work: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ran = vfoa(monkeypatch, capsys, "run", "depth.toml", "--out", "out", "--workers", "1")
    assert ran[0] == 0, ran
    records = list(read_records(RunDirectory(work / "out")))
    assert records
    for record in records:
        boxes = {target.label: target.box for target in record.targets}
        cup, person = boxes["cup"], boxes["person"]
        assert cup is not None
        assert person is not None
        assert cup.center_m[2] == pytest.approx(1.5, abs=1e-4)
        assert cup.center_m[0] == pytest.approx((45.5 - LENS.cx) * 1.5 / LENS.fx, abs=1e-4)
        assert 2 * cup.half_size_m[0] == pytest.approx(11 * 1.5 / LENS.fx, abs=1e-4)
        assert person.center_m[2] == pytest.approx(2.0, abs=1e-4)
        eyes = record.subjects[0].eye_origin_m
        assert eyes is not None
        assert eyes[2] == pytest.approx(2.0, abs=1e-3)
    columns = Columns(work / "out" / "take.rrd")  # what all configurations of the clip share
    shown = columns.at(entities.MEASURED_DEPTH, "EncodedDepthImage:blob")
    assert len(shown) == 3
    coded = np.asarray(next(iter(shown.values()))[0], np.uint8)
    assert np.array_equal(cv2.imdecode(coded, cv2.IMREAD_UNCHANGED), shot(1).depth_mm)
    recorded = {path for file in (work / "out").glob("*.rrd") for path in Columns(file).paths}
    assert not [path for path in recorded if path.startswith(entities.STEREO)]
    assert (work / "out" / "report.html").is_file()


def test_a_matcher_of_two_views_is_refused_in_one_line(
    work: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("run", "depth.toml", "--out", "out", "--workers", "1", "--set", "stereo.matcher=sgbm")
    code, _, said = vfoa(monkeypatch, capsys, *words)
    assert code != 0
    assert 'expected stereo.matcher = "sensor"' in " ".join(said.split())


def test_a_recording_of_ros_1_in_mcap_is_read(tmp_path: Path) -> None:
    """ROS 1's profile of MCAP: messages serialised as in a bag, definitions as gendeps prints them."""
    store = get_typestore(Stores.ROS1_NOETIC)

    class Ros1Mcap:
        """rosbags' interface of a writer, over mcap's."""

        def __init__(self, writer: McapWriter) -> None:
            self._writer = writer

        def add_connection(self, topic: str, kind: str, **_: object) -> int:
            text, _digest = store.generate_msgdef(kind, ros_version=1)
            name = kind.replace("/msg/", "/")
            schema = self._writer.register_schema(name, "ros1msg", text.encode())
            return self._writer.register_channel(topic, "ros1", schema)

        def write(self, channel: int, log_ns: int, data: bytes) -> None:
            self._writer.add_message(channel, log_ns, bytes(data), log_ns)

    with (tmp_path / "a.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros1")
        write = Messages(Ros1Mcap(writer), is_ros1=True)
        for number in (1, 2):
            write.camera("/camera/color/camera_info", shot(number).stamp_ns, LENS)
            write.image("/camera/color/image_raw", shot(number).stamp_ns, shot(number).colour, "rgb8")
            write_depth(write, shot(number), "png")
        writer.finish()
    frame = McapClip(RecordingSettings(recording="a.mcap"), tmp_path).frame(2)
    assert np.array_equal(frame.left, shot(2).colour)
    assert frame.time_ns == shot(2).stamp_ns
    assert np.nanmin(frame.depth_m) == pytest.approx(1.5)


@pytest.mark.parametrize("kind", ["bag", "db3"])
def test_a_damaged_bag_is_one_line_or_a_note(tmp_path: Path, kind: str) -> None:
    """Whatever byte is wrong, there are frames with right pixels, or one line."""
    with messages(tmp_path, kind) as (path, write):  # type: ignore[arg-type]
        for number in range(1, 9):
            write.camera("/camera/color/camera_info", shot(number).stamp_ns, LENS)
            write.image("/camera/color/image_raw", shot(number).stamp_ns, shot(number).colour, "rgb8")
            write.image(DEPTH, shot(number).stamp_ns, shot(number).depth_mm, "16UC1")
    file = path if path.is_file() else next(path.glob("*.db3"))
    whole = file.read_bytes()
    for share in (0.02, 0.3, 0.6, 0.9, 0.999):
        for damaged in (whole[: int(share * len(whole))], _flipped(whole, int(share * len(whole)))):
            file.write_bytes(damaged)
            try:
                clip = McapClip(RecordingSettings(recording=file.name), file.parent)
                for number in clip.frames:
                    clip.frame(number)
            except VfoaError as error:
                assert "\n" not in str(error)  # noqa: PT017  # a damage that nothing shows is no error


def _flipped(data: bytes, at: int) -> bytes:
    return data[:at] + bytes([data[at] ^ 255]) + data[at + 1 :]
