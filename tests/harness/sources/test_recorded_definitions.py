"""Recordings without the definitions of their messages, compressed by rosbag2, or in large chunks."""

from __future__ import annotations

import shutil
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from harness.sources.foreign import refuse_foreign
from harness.sources.recordings import containers
from harness.sources.recordings.clip import McapClip
from harness.sources.recordings.messages import message_type, picture, stamp_ns
from tests.disk import picture as pixels
from tests.harness.sources.numbered_recording import open_clip, pairs, stamp
from tests.recordings import HEADER, write_pairs
from vfoa.errors import VfoaError

Definition = Callable[[str, bytes], tuple[str, bytes]]
"""The language and the text of a definition, of its type's name and its full text."""


def _rewritten(
    folder: Path,
    definition: Definition = lambda _, text: ("ros2msg", text),
    pack: Callable[[bytes], bytes] = bytes,
    **options: Any,
) -> Path:
    """A recording of pairs, with other definitions or packed messages."""
    whole, path = write_pairs(folder / "whole" / "a.mcap", pairs()), folder / "a.mcap"
    with whole.open("rb") as source, path.open("wb") as file:
        writer, channels = Writer(file, **options), dict[str, int]()
        writer.start("ros2")
        for schema, channel, message in make_reader(source).iter_messages():
            assert schema is not None
            if channel.topic not in channels:
                number = writer.register_schema(schema.name, *definition(schema.name, schema.data))
                channels[channel.topic] = writer.register_channel(channel.topic, "cdr", number)
            writer.add_message(channels[channel.topic], message.log_time, pack(message.data), message.publish_time)
        writer.finish()
    return path


def _check_whole(clip: McapClip) -> None:
    assert (list(clip.frames), clip.notes) == ([1, 2, 3, 4, 5], ())
    for number in clip.frames:
        frame = clip.frame(number)
        assert frame.time_ns == stamp(number)
        np.testing.assert_array_equal(frame.left, pixels(number))
        assert frame.rig.baseline_m == pytest.approx(0.12)


DEFINITIONS: dict[str, Definition] = {
    "empty": lambda _, __: ("", b""),
    "empty, with its language": lambda _, __: ("ros2msg", b""),
    "the name": lambda name, _: ("ros2msg", name.encode()),
    "ROS 1's name": lambda name, _: ("ros2msg", name.replace("/msg/", "/").encode() + b"\n"),
    "a comment": lambda _, __: ("ros2msg", b"# not available here\n"),
    "without a language": lambda _, text: ("", text),
    "without the types that it needs": lambda _, text: ("ros2msg", text.partition(b"=====")[0]),
    "without the header's type": lambda _, text: ("ros2msg", text.replace(HEADER.encode(), b"")),
}


@pytest.mark.parametrize("definition", DEFINITIONS)
def test_the_standard_definitions_complete_those_of_a_recording(tmp_path: Path, definition: str) -> None:
    _check_whole(open_clip(_rewritten(tmp_path, DEFINITIONS[definition])))


EDITS: dict[str, Callable[[str], str]] = {
    "a field at the end": lambda text: text.replace("uint8[] data", "uint8[] data\nfloat32 exposure_ms"),
    "a field before the others": lambda text: text.replace("uint32 height", "uint64 serial\nuint32 height"),
    "a wider field": lambda text: text.replace("uint32 step", "uint64 step"),
}


def _joined(folder: Path, edit: Callable[[str], str], ours: frozenset[int]) -> Path:
    """A recording of five pairs; the left images of all but ``ours`` are of a definition with other fields."""
    whole, path = write_pairs(folder / "whole" / "a.mcap", pairs()), folder / "a.mcap"
    seen = dict[str, int]()
    with whole.open("rb") as source, path.open("wb") as file:
        writer, channels = Writer(file), dict[tuple[str, bool], int]()
        writer.start("ros2")
        for schema, channel, message in make_reader(source).iter_messages():
            assert schema is not None
            number = seen[channel.topic] = seen.get(channel.topic, 0) + 1
            other = channel.topic == "/stereo/left/image_raw" and number not in ours
            text = edit(schema.data.decode()) if other else schema.data.decode()
            data = message.data
            if other:
                standard, store = get_typestore(Stores.LATEST), get_typestore(Stores.EMPTY)
                store.register(get_types_from_msg(text, schema.name))
                image = standard.deserialize_cdr(data, schema.name)
                added = {"exposure_ms": 2.5, "serial": 77}
                names = [name for name, _ in store.fielddefs[schema.name][1]]
                values = {name: added[name] if name in added else getattr(image, name) for name in names}
                data = bytes(store.serialize_cdr(store.types[schema.name](**values), schema.name))
            if (channel.topic, other) not in channels:
                number = writer.register_schema(schema.name, "ros2msg", text.encode())
                channels[channel.topic, other] = writer.register_channel(channel.topic, "cdr", number)
            writer.add_message(channels[channel.topic, other], message.log_time, data, message.publish_time)
        writer.finish()
    return path


@pytest.mark.parametrize("edit", EDITS)
@pytest.mark.parametrize("ours", [frozenset({1}), frozenset({1, 2, 4, 5})])
def test_two_definitions_of_a_type_with_other_fields_are_not_mixed(
    edit: str, ours: frozenset[int], tmp_path: Path
) -> None:
    clip = open_clip(_joined(tmp_path, EDITS[edit], ours))
    kept = ours if len(ours) > 2 else frozenset(range(1, 6)) - ours
    for number, source in zip(clip.frames, sorted(kept), strict=True):
        np.testing.assert_array_equal(clip.frame(number).left, pixels(source))
    of = "sensor_msgs/msg/Image"
    left_out = f"{5 - len(kept)} messages of {of} are left out, {len(kept)} of {of} with other fields are read"
    assert [note.endswith(f"/stereo/left/image_raw: {left_out}") for note in clip.notes].count(True) == 1


def test_the_standard_definition_of_ros_1_has_a_sequence_number() -> None:
    kind = message_type("ros1", "", "sensor_msgs/Image", b"")
    head = struct.pack("<IIII", 41, 7, 9, 3) + b"cam"
    data = head + struct.pack("<III", 1, 2, 5) + b"mono8" + struct.pack("<BII", 0, 2, 2) + bytes([3, 4])
    assert stamp_ns(kind, data, "x") == 7_000_000_009
    image = picture(kind, data, "x")
    assert (image.frame_id, image.form, image.size_px, image.data) == ("cam", "mono8", (2, 1), bytes([3, 4]))


def test_a_type_that_no_standard_defines_is_named() -> None:
    kind = message_type("cdr", "", "ffmpeg_image_transport_msgs/msg/FFMPEGPacket", b"")
    with pytest.raises(VfoaError, match=r"definition of .*/FFMPEGPacket"):
        picture(kind, bytes([0, 1, 0, 0]), "x")


def test_messages_that_rosbag2_compressed_are_read_without_metadata(tmp_path: Path) -> None:
    _check_whole(open_clip(_rewritten(tmp_path, pack=zstandard.compress)))


@pytest.mark.parametrize("given", ["file", "folder"])
def test_a_file_that_rosbag2_compressed_says_how_to_unpack_it(tmp_path: Path, given: str) -> None:
    folder = tmp_path / "my recording"
    folder.mkdir()
    packed = folder / "a.mcap.zstd"
    whole = _rewritten(tmp_path)
    packed.write_bytes(zstandard.compress(whole.read_bytes()))
    with pytest.raises(VfoaError, match=r"a\.mcap\.zstd: .*metadata\.yaml") as error:
        refuse_foreign(packed if given == "file" else folder)
    command = str(error.value).rpartition("unpacked: ")[2]
    assert command == f"zstd -d '{packed}' -o '{folder / 'a.mcap'}'"
    if shutil.which("zstd"):
        subprocess.run(command, shell=True, check=True, capture_output=True)
        _check_whole(open_clip(folder / "a.mcap"))


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.ZSTD, CompressionType.LZ4])
def test_a_chunk_of_a_whole_recording_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compression: CompressionType
) -> None:
    path = _rewritten(tmp_path, compression=compression, chunk_size=2**30)
    monkeypatch.setattr(containers, "MOST_BYTES", 1000)
    _check_whole(open_clip(path))


def test_a_chunk_above_the_limit_is_not_called_damaged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = _rewritten(tmp_path, chunk_size=2**30)
    monkeypatch.setattr(containers, "MOST_BYTES", 1000)
    monkeypatch.setattr(containers, "_MOST_CHUNK_BYTES", 2000)
    with pytest.raises(VfoaError, match=r"not read: it claims \d+ bytes.*2000") as error:
        open_clip(path)
    assert "damaged" not in str(error.value)
