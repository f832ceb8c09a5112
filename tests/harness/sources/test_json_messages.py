"""Foxglove's messages in JSON, in the forms in which people's scripts write them with ``mcap.writer``."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.writer import Writer
from numpy.typing import NDArray

from harness.sources.recordings.clip import McapClip
from harness.sources.recordings.messages import message_type, transforms_in
from harness.sources.recordings.settings import RecordingSettings
from tests.adapter_contract import check_contract
from tests.depth_recordings import CODERS, Encoder
from tests.disk import HEIGHT, WIDTH, moving_picture, picture
from tests.harness.sources.numbered_recording import LEFT, RIGHT, open_clip, stamp
from vfoa.errors import VfoaError

Fields = dict[str, Any]
Message = tuple[str, str, int, Fields]
"""Topic, type of Foxglove, log time in ns, fields."""

K = [100.0, 0, 31.5, 0, 100.0, 23.5, 0, 0, 1]
CAMERA = {"fx_px": 100, "cx_px": 31.5, "cy_px": 23.5, "baseline_m": 0.1}


def write(path: Path, messages: Iterable[Message], schema_encoding: str = "jsonschema") -> Path:
    with path.open("wb") as file:
        writer, channels = Writer(file), dict[str, int]()
        writer.start(profile="", library="a script")
        for topic, name, log_ns, fields in messages:
            if topic not in channels:
                schema = writer.register_schema(f"foxglove.{name}", schema_encoding, b'{"type": "object"}')
                channels[topic] = writer.register_channel(topic, "json", schema)
            writer.add_message(channels[topic], log_ns, json.dumps(fields).encode(), log_ns)
        writer.finish()
    return path


def text(data: bytes) -> str:
    return base64.b64encode(data).decode()


def png(image: NDArray[Any]) -> str:
    done, coded = cv2.imencode(".png", image)
    assert done
    return text(coded.tobytes())


def times(number: int, seconds: str = "sec", rest: str = "nsec") -> Fields:
    return {"timestamp": dict(zip((seconds, rest), divmod(stamp(number), 10**9), strict=True))}


def pair(number: int, head: Fields) -> Iterable[Message]:
    for side, shown in (("left", number), ("right", 1000 + number)):
        data = png(picture(shown)[..., ::-1])
        yield f"/{side}", "CompressedImage", stamp(number) + 5, {**head, "data": data, "format": "png"}


@pytest.mark.parametrize(("seconds", "rest"), [("sec", "nsec"), ("sec", "nanosec"), ("seconds", "nanos")])
def test_seconds_and_nanoseconds_have_several_names(seconds: str, rest: str, tmp_path: Path) -> None:
    messages = [message for n in (1, 2) for message in pair(n, times(n, seconds, rest))]
    clip = open_clip(write(tmp_path / "a.mcap", messages), camera=CAMERA)
    assert [clip.time_ns(n) for n in clip.frames] == [stamp(1), stamp(2)]
    assert np.array_equal(clip.frame(2).left, picture(2))
    assert np.array_equal(clip.frame(2).right, picture(1002))


def test_whole_seconds_may_be_floating_point_numbers(tmp_path: Path) -> None:
    head = {"timestamp": {"sec": stamp(1) // 1e9, "nsec": 7.0}}
    clip = open_clip(write(tmp_path / "a.mcap", pair(1, head)), camera=CAMERA)
    assert clip.time_ns(1) == stamp(1)


@pytest.mark.parametrize(
    "written", [1700000000.04, "1700000000.04", "2023-11-14T22:13:20Z", {"sec": 1.5, "nsec": 0}, {"sec": 1}, None]
)
def test_another_time_is_refused_and_that_of_recording_may_be_taken(written: object, tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", pair(1, {"timestamp": written}))
    with pytest.raises(VfoaError, match=r"/left: not a foxglove.CompressedImage in json: .* expected whole sec and"):
        open_clip(path, camera=CAMERA)
    assert open_clip(path, camera=CAMERA, stamps="log").time_ns(1) == stamp(1) + 5


def test_images_may_have_nothing_but_their_data(tmp_path: Path) -> None:
    messages = [(topic, name, log_ns, {"data": fields["data"]}) for topic, name, log_ns, fields in pair(1, {})]
    path = write(tmp_path / "a.mcap", messages, schema_encoding="")
    with pytest.raises(VfoaError, match=r'/left: 1 image without time stamp; expected .*stamps = "log"'):
        open_clip(path, camera=CAMERA)
    assert np.array_equal(open_clip(path, camera=CAMERA, stamps="log").frame(1).right, picture(1001))


@pytest.mark.parametrize("is_upper", [True, False])
def test_calibrations_have_matrices_in_either_case(is_upper: bool, tmp_path: Path) -> None:
    messages = list(pair(1, times(1)))
    for side, camera in (("left", LEFT), ("right", RIGHT)):
        matrices = {"K": camera.k, "D": [], "R": list(camera.r), "P": camera.p}
        named = matrices if is_upper else {name.lower(): value for name, value in matrices.items()}
        fields = {**times(1), "frame_id": side, "width": WIDTH, "height": HEIGHT, "distortion_model": "plumb_bob"}
        messages.append((f"/{side}/calibration", "CameraCalibration", stamp(1), fields | named))
    rig = open_clip(write(tmp_path / "a.mcap", messages)).frame(1).rig
    assert (rig.fx_px, rig.cx_px, rig.cx_right_px, rig.baseline_m) == (100.0, 31.5, 30.0, pytest.approx(0.12))


def colour_and_depth(depth: Fields, depth_type: str) -> Iterable[Message]:
    for n in (1, 2):
        head = {**times(n), "frame_id": "camera"}
        image = {"data": png(moving_picture(n)[..., ::-1]), "format": "png"}
        yield "/camera/color", "CompressedImage", stamp(n), head | image
        yield "/camera/calibration", "CameraCalibration", stamp(n), {**head, "width": WIDTH, "height": HEIGHT, "K": K}
        yield "/camera/depth", depth_type, stamp(n), head | depth


def test_colour_and_depth_with_a_camera_of_k_alone(tmp_path: Path) -> None:
    depth_mm = np.arange(WIDTH * HEIGHT, dtype=np.uint16).reshape(HEIGHT, WIDTH) + 300
    raw = {"width": WIDTH, "height": HEIGHT, "step": 2 * WIDTH, "encoding": "16UC1"}
    forms: tuple[tuple[Fields, str], ...] = (
        (raw | {"data": text(depth_mm.tobytes())}, "RawImage"),
        (raw | {"data": list(depth_mm.tobytes())}, "RawImage"),
        ({"data": png(depth_mm), "format": "png"}, "CompressedImage"),
    )
    for number, (fields, name) in enumerate(forms):
        clip = open_clip(write(tmp_path / f"{number}.mcap", colour_and_depth(fields, name)))
        frame = clip.frame(2)
        assert np.array_equal(frame.left, moving_picture(2))
        assert frame.depth_m is not None
        np.testing.assert_allclose(frame.depth_m, depth_mm / 1000, rtol=1e-6)
        assert (frame.rig.fx_px, frame.rig.cx_px) == (100.0, 31.5)


def test_a_packet_of_a_video_is_read(tmp_path: Path) -> None:
    coder, options = CODERS["h264"]
    images = [moving_picture(n, 128, 96) for n in range(1, 9)]
    packets = Encoder(coder, 128, 96, options).packets(images)
    messages = [
        (f"/{side}", "CompressedVideo", stamp(1 + at), {**times(1 + at), "format": "h264", "data": text(data)})
        for at, data, _ in sorted(packets)
        for side in ("left", "right")
    ]
    clip = open_clip(write(tmp_path / "a.mcap", messages), camera=CAMERA)
    assert len(clip.frames) == 8
    errors = [np.abs(clip.frame(6).left.astype(int) - image).mean() for image in images]
    assert int(np.argmin(errors)) == 5


@pytest.mark.parametrize("data", ["data:image/png;base64,iVBORw0KGgo=", "a", [300], None, {}])
def test_data_that_are_not_base64_are_refused(data: object, tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", [(f"/{side}", "CompressedImage", 1, times(1) | {"data": data}) for side in "lr"])
    with pytest.raises(VfoaError, match=r"/l: not a foxglove\.CompressedImage in json: "):
        open_clip(path, camera=CAMERA, left="/l", right="/r")


def test_the_contract_holds(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", [message for n in (1, 2, 3) for message in pair(n, times(n))])
    settings = RecordingSettings.model_validate({"recording": path.name, "camera": CAMERA})
    check_contract(McapClip(settings, tmp_path))


@pytest.mark.parametrize("are_together", [True, False])
def test_transforms_are_those_of_the_message(are_together: bool) -> None:
    step: Fields = {**times(1), "parent_frame_id": "rig", "child_frame_id": "camera"}
    step |= {"translation": {"x": 1, "y": 2, "z": 3}, "rotation": {"x": 0, "y": 0, "z": 1, "w": 1}}
    name = "foxglove.FrameTransforms" if are_together else "foxglove.FrameTransform"
    kind = message_type("json", "jsonschema", name, b"{}")
    data = json.dumps({"transforms": [step]} if are_together else step).encode()
    ((parent, child, motion),) = transforms_in(kind, data, "x")
    assert (parent, child) == ("rig", "camera")
    np.testing.assert_allclose(motion, [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], atol=1e-12)
