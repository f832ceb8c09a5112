"""Recordings of the ZED's SDK, written in the layout that others found in files of a ZED 2i and a ZED X."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from harness.clips.add import recognise
from harness.sources.foreign import refuse_foreign
from harness.sources.recordings.clip import McapClip
from harness.sources.recordings.settings import RecordingSettings
from harness.sources.stereo_folder import StereoFolderClip, StereoFolderSettings
from tests.adapter_contract import check_contract
from tests.calibrations import RIG, SIZE, write_zed
from tests.depth_recordings import CODERS, Encoder
from tests.disk import moving_picture
from tests.zed import SERIAL, message, stamp, strips, write_svo2
from vfoa.errors import VfoaError

WIDTH, HEIGHT = SIZE
COUNT = 4
VIEWS = [(moving_picture(number, WIDTH, HEIGHT), moving_picture(50 + number, WIDTH, HEIGHT)) for number in range(COUNT)]
BOTH = [np.ascontiguousarray(np.hstack(pair)) for pair in VIEWS]
FORMS = ("h264", "h265", "strips")


def contents(form: str, images: Sequence[NDArray[np.uint8]]) -> list[bytes]:
    if form == "strips":
        return [strips(image) for image in images]
    coder, options = CODERS[form]
    packets = Encoder(coder, images[0].shape[1], images[0].shape[0], options).packets(images)
    return [data for _, data, _ in packets]


def write_form(path: Path, form: str) -> Path:
    return write_svo2(path, [message(content) for content in contents(form, BOTH)])


def open_clip(path: Path, **settings: object) -> McapClip:
    return McapClip(RecordingSettings.model_validate({"recording": path.name, **settings}), path.parent)


@pytest.mark.parametrize("form", FORMS)
def test_both_views_are_rectified_by_the_camera_s_own_calibration(tmp_path: Path, form: str) -> None:
    """The reference is the same views as files, with the same calibration."""
    for side, pictures in zip(("left", "right"), zip(*VIEWS, strict=True), strict=True):
        (tmp_path / side).mkdir()
        for number, image in enumerate(pictures, 1):
            cv2.imwrite(str(tmp_path / side / f"{number}.png"), image[..., ::-1])
    conf = write_zed(tmp_path / f"SN{SERIAL}.conf", RIG).name
    source = {"left": "left/%d.png", "right": "right/%d.png", "calibration": conf}
    files = StereoFolderClip(StereoFolderSettings.model_validate(source), tmp_path)
    clip = open_clip(write_form(tmp_path / "a.svo2", form), calibration=conf)
    assert list(clip.frames) == list(files.frames)
    assert (clip.rate_hz, clip.notes) == (25.0, ())
    for number in (*clip.frames, 2):
        found, expected = clip.frame(number), files.frame(number)
        assert found.time_ns == clip.time_ns(number) == stamp(number - 1)
        assert found.right is not None
        assert expected.right is not None
        assert found.rig == expected.rig
        for image, other in ((found.left, expected.left), (found.right, expected.right)):
            assert np.abs(image.astype(int) - other).mean() < 4
    check_contract(pickle.loads(pickle.dumps(clip)))


def test_a_recording_is_added_with_the_calibration_beside_it(tmp_path: Path) -> None:
    path = write_form(tmp_path / "HD720_SN38486288_18-52-52.svo2", "strips")
    with pytest.raises(VfoaError, match=rf"no SN{SERIAL}\.conf beside it; .*\?SN={SERIAL}$"):
        recognise(path, None, {})
    given = recognise(path, None, {"calibration": "other.conf"}).recognised
    assert given.source == {"recording": path.name, "calibration": "other.conf"}
    write_zed(tmp_path / f"SN{SERIAL}.conf", RIG)
    refuse_foreign(path)
    adapter, found = recognise(path, None, {})
    assert (adapter, found.calibration) == ("mcap", f"SN{SERIAL}.conf")
    assert len(McapClip(RecordingSettings.model_validate(found.source), found.root).frames) == COUNT


def test_seconds_count_from_the_first_image_and_not_from_notes_of_another_clock(tmp_path: Path) -> None:
    conf = write_zed(tmp_path / f"SN{SERIAL}.conf", RIG).name
    path = write_form(tmp_path / "a.svo2", "h264")
    part = open_clip(path, calibration=conf, start_s=0.07, end_s=0.1)
    assert [part.time_ns(number) for number in part.frames] == [stamp(2)]
    cut = tmp_path / "cut.svo2"
    cut.write_bytes(path.read_bytes()[:-200])  # without the index at its end
    part = open_clip(cut, calibration=conf, start_s=0.07)
    assert [part.time_ns(number) for number in part.frames] == [stamp(2), stamp(3)]


def test_of_several_cameras_one_is_named(tmp_path: Path) -> None:
    conf = write_zed(tmp_path / f"SN{SERIAL}.conf", RIG).name
    path = write_svo2(tmp_path / "a.svo2", [message(strips(BOTH[0]))], cameras=(SERIAL, 12))
    with pytest.raises(VfoaError, match=r"2 cameras; expected both = .*Camera_SN12/side_by_side"):
        open_clip(path, calibration=conf)
    assert len(open_clip(path, calibration=conf, both="Camera_SN12/side_by_side").frames) == 1
    with pytest.raises(VfoaError, match=r"no left topic '/left'"):
        open_clip(path, calibration=conf, left="/left", right="/right")


@pytest.mark.parametrize(
    ("damaged", "said"),
    [
        (lambda content: b"\1", "side_by_side in zed_sdk_encoded"),
        (lambda content: message(content)[:5000], "bytes of content; expected"),
        (lambda content: message(b"PNG" * 20), "neither a packet of H.264 or H.265 nor strips in JPEG"),
        (lambda content: message(content[:9000].ljust(400_000, b"\0")), "strip 1: truncated JPEG"),
    ],
    ids=["one byte", "cut", "other content", "cut strip"],
)
def test_damage_is_told(tmp_path: Path, damaged: Callable[[bytes], bytes], said: str) -> None:
    conf = write_zed(tmp_path / f"SN{SERIAL}.conf", RIG).name
    content = strips(BOTH[0])
    path = write_svo2(tmp_path / "a.svo2", [message(content), damaged(content)])
    with pytest.raises(VfoaError, match=rf"a\.svo2: .*Camera_SN{SERIAL}/side_by_side: .*{said}"):
        open_clip(path, calibration=conf).frame(2)
