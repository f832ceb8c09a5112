"""Files that are no source are named for what they are, where they are added and where a manifest opens them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from mcap.writer import Writer

from harness.sources.foreign import refuse_foreign
from harness.sources.media.video import Video
from harness.sources.recordings.clip import McapClip, open_container
from tests.disk import write_text
from vfoa.errors import VfoaError

MESSAGE = {"timestamp": {"sec": 1, "nsec": 0}, "frame_id": "left", "data": "", "format": "jpeg"}
POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n"


@pytest.mark.parametrize("name", ["a.mcap", "a.bag", "a.db3", "a.mp4", "a.mkv"])
def test_a_pointer_of_git_lfs_is_named(name: str, tmp_path: Path) -> None:
    path = write_text(tmp_path / name, POINTER)
    with pytest.raises(VfoaError, match=rf"{name}: a pointer of Git LFS"):
        refuse_foreign(path)


@pytest.mark.parametrize("name", ["a.mcap", "a.bag", "a.db3"])
@pytest.mark.parametrize("is_folder", [False, True])
def test_a_recording_that_is_a_pointer_of_git_lfs_is_named(name: str, is_folder: bool, tmp_path: Path) -> None:
    path = write_text(tmp_path / "split" / name, POINTER)
    with pytest.raises(VfoaError, match=rf"{name}: a pointer of Git LFS"):
        open_container(path.parent if is_folder else path)


def test_a_film_that_is_a_pointer_of_git_lfs_is_named(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"a\.mp4: a pointer of Git LFS"):
        Video(write_text(tmp_path / "a.mp4", POINTER))


@pytest.mark.parametrize("name", ["zed.svo", "ZED.SVO"])
def test_a_recording_of_the_zed_is_named(name: str, tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=rf"{name}: a recording of the ZED's SDK.*svo_export\.py"):
        refuse_foreign(write_text(tmp_path / name, ""))


@pytest.mark.parametrize(
    ("name", "instead"),
    [
        ("a.tak", "CSV of its rigid bodies"),
        ("A.QTM", "TSV of its 6DOF data"),
        *((name, "rigid bodies") for name in ("a.c3d", "a.trc", "a.bvh")),
    ],
)
def test_motion_capture_that_is_not_exported_is_named(name: str, instead: str, tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=rf"{name}: .*, which is not read; expected .*{instead}"):
        refuse_foreign(write_text(tmp_path / name, ""))


def test_a_recording_of_rerun_is_named(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"run\.rrd: a recording of Rerun, which is not read; expected what it"):
        refuse_foreign(write_text(tmp_path / "run.rrd", "RRF2"))


@pytest.mark.parametrize(("name", "kind"), [("a.mcap", "MCAP"), ("a.BAG", "a bag of ROS 1"), ("a.db3", "a database")])
def test_a_file_that_does_not_begin_as_a_recording_is_named(name: str, kind: str, tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=rf"{name}: not {kind}.*: it starts with b'hello'; expected b'[^']*'$"):
        refuse_foreign(write_text(tmp_path / name, "hello"))
    with pytest.raises(VfoaError, match=rf"{name}: not {kind}.*: it starts with b''; .*: copy it again"):
        refuse_foreign(write_text(tmp_path / name, ""))


@pytest.mark.parametrize("text", ['{"fx": 100}', "[]", "3", "{"])
def test_other_json_passes(text: str, tmp_path: Path) -> None:
    refuse_foreign(write_text(tmp_path / "a.json", text))


def test_a_recording_in_another_encoding_says_in_what_its_images_are(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for topic in ("/left", "/right"):
            schema = writer.register_schema("foxglove.CompressedImage", "flatbuffer", b"")
            channel = writer.register_channel(topic, "flatbuffer", schema)
            writer.add_message(channel, log_time=1, publish_time=1, data=json.dumps(MESSAGE).encode())
        writer.finish()
    with pytest.raises(VfoaError, match=r"a\.mcap: .*\(flatbuffer\), .*protobuf"):
        McapClip(McapClip.Settings.model_validate({"recording": "a.mcap"}), tmp_path)
