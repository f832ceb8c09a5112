from __future__ import annotations

import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path

import numpy as np
import pytest

from harness.annotate.convert import true_heads
from harness.labels.formats.cvat import CvatVideo
from harness.labels.labels import Labels
from harness.sources import PersonTruth, Truth
from tests.disk import write_text
from tests.exchanges import PlainClip, exchange, row
from vfoa.errors import VfoaError


def _box(frame: int, *, key: int = 0, outside: int = 0, **attributes: str) -> str:
    inner = "".join(f'<attribute name="{name}">{value}</attribute>' for name, value in attributes.items())
    return (
        f'<box frame="{frame}" keyframe="{key}" outside="{outside}" occluded="0" '
        f'xtl="1.0" ytl="2.0" xbr="3.0" ybr="4.0" z_order="0">{inner}</box>'
    )


def _file(path: Path, *tracks: str) -> Path:
    meta = "<meta><task><size>50</size><mode>interpolation</mode></task></meta>"
    body = "".join(tracks)
    return write_text(
        path, f'<?xml version="1.0" encoding="utf-8"?>\n<annotations><version>1.1</version>{meta}{body}</annotations>'
    )


def _track(*shapes: str, label: str = "girl") -> str:
    return f'<track id="7" label="{label}" source="manual">{"".join(shapes)}</track>'


def test_a_label_holds_until_the_next_shape_and_ends_outside(tmp_path: Path) -> None:
    girl = _track(
        _box(0, key=1, target="bird"), _box(3, key=1, target="cup", note="left one"), _box(5, outside=1, target="cup")
    )
    points = '<points frame="9" points="1,2"><attribute name="target">__undefined__</attribute></points>'
    head = _track(_box(0, subject="boy", target="none"), _box(1, target="none"), points, label="head")
    imported = CvatVideo().read(_file(tmp_path / "a.xml", girl, head), exchange())
    assert imported.labels == Labels(
        [row(1, 3, "bird"), row(4, 5, "cup", note="left one"), row(1, 9, "none", "boy"), row(10, 10, "ignore", "boy")]
    )
    assert imported.notes == ()


def test_the_offset_is_in_frames_and_what_lies_outside_is_said(tmp_path: Path) -> None:
    path = _file(tmp_path / "a.xml", _track(_box(99, target="cup"), _box(100, target="bird"), _box(102, target="bird")))
    imported = CvatVideo().read(path, exchange(offset=100))
    assert imported.labels.ranges == (row(1, 3, "bird"),)
    assert imported.notes == (f"{path}: 1 labels are outside of the clip's frames and are left out.",)
    with pytest.raises(VfoaError, match=r"--offset: found 0\.5; expected whole frames"):
        CvatVideo().read(path, exchange(offset=0.5))
    with pytest.raises(VfoaError, match="--fps: this format holds frame numbers"):
        CvatVideo().read(path, exchange(fps=25))


@pytest.mark.parametrize(
    ("track", "message"),
    [
        (
            _track(_box(0, target="bird"), label="gril"),
            "no track is labelled with a subject; found 'gril'",
        ),
        (_track(_box(0, target="brid")), "track '7', frame 0: unknown target 'brid'; did you mean 'bird'"),
        (_track(_box(0, colour="red")), "track '7', frame 0: no attribute 'target'; found colour"),
        (_track(_box(0, target="bird", u_px="x", v_px="")), "frame 0: u_px,v_px: found 'x,'"),
        (_track(_box(0, target="bird")) * 2, "'girl' has two labels in frame 0 of CVAT"),
        (_track("<box/>"), "<box> has the frame ''; expected a number"),
        ("<image/>", "expected CVAT for video 1.1"),
    ],
)
def test_a_mistake_is_one_line_with_its_place(tmp_path: Path, track: str, message: str) -> None:
    path = _file(tmp_path / "a.xml", track)
    with pytest.raises(VfoaError, match=message) as error:
        CvatVideo().read(path, exchange())
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("offset", [1e300, -1e300, float("nan"), float("inf")])
def test_an_offset_beyond_all_clips_is_refused(offset: float) -> None:
    with pytest.raises(VfoaError, match=r"--offset: found .*; expected a number within 1e"):
        exchange(offset=offset)


def test_the_zip_that_it_exports_is_read_as_it_is(tmp_path: Path) -> None:
    plain = _file(tmp_path / "a.xml", _track(_box(0, target="bird")))
    with zipfile.ZipFile(tmp_path / "task.zip", "w") as archive:
        archive.write(plain, "annotations.xml")
        archive.writestr("images/frame_000000.png", b"")
    zipped = CvatVideo().read(tmp_path / "task.zip", exchange())
    assert zipped.labels.ranges == (row(1, 1, "bird"),)


def test_a_zip_without_annotations_or_with_broken_ones_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "task.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("images/frame_000000.png", b"")
    with pytest.raises(VfoaError, match=r"task\.zip: no annotations\.xml can be read in it"):
        CvatVideo().read(path, exchange())
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("annotations.xml", b"<annotations>" + bytes(range(256)) * 4)
    whole = path.read_bytes()
    for damaged in (whole[:60] + b"\xff" * 30 + whole[90:], whole[40:]):
        path.write_bytes(damaged)
        with pytest.raises(VfoaError, match=r"task\.zip: no annotations\.xml can be read in it"):
            CvatVideo().read(path, exchange())


def test_the_export_of_a_project_is_refused(tmp_path: Path) -> None:
    """Its tasks all count from 0."""
    tracks = [_track(_box(0, target="bird")).replace("<track ", f'<track task_id="{task}" ') for task in (4, 5)]
    with pytest.raises(VfoaError, match=r"found the tasks 4, 5 of a project; expected the export of one task"):
        CvatVideo().read(_file(tmp_path / "a.xml", *tracks), exchange())


def test_boxes_are_heads_where_they_are_known(tmp_path: Path) -> None:
    girl = PersonTruth(name="girl", instance_id=1, head_box_px=np.array([1.0, 2, 3, 4]))
    clip = PlainClip(truths={1: Truth(people=(girl,))})
    path = tmp_path / "a.xml"
    notes = CvatVideo().write(path, Labels([row(1, 2, "bird")]), exchange(clip, heads=true_heads(clip)))
    assert notes == ("1 boxes are the whole image: the subject's head is not known there (--run RUN has heads).",)
    boxes = [
        [box.get(key) for key in ("frame", "keyframe", "outside", "xtl", "ytl", "xbr", "ybr")]
        for box in ElementTree.parse(path).iter("box")
    ]
    assert boxes == [
        ["0", "1", "0", "1.00", "2.00", "3.00", "4.00"],
        ["1", "0", "0", "0.00", "0.00", "64.00", "48.00"],
        ["2", "1", "1", "1.00", "2.00", "3.00", "4.00"],
    ]


def test_tracks_that_are_no_subject_s_are_counted(tmp_path: Path) -> None:
    others = _track("<box frame='0'/>", label="car") * 2 + _track("<box frame='1'/>", label="dog")
    path = _file(tmp_path / "a.xml", _track(_box(0, target="bird")) + others)
    imported = CvatVideo().read(path, exchange())
    assert imported.labels.ranges == (row(1, 1, "bird"),)
    assert imported.notes == (f"{path}: tracks that are no subject's are left out: 2 of 'car', 1 of 'dog'.",)


def test_the_attribute_of_the_target_can_be_named(tmp_path: Path) -> None:
    path = _file(tmp_path / "a.xml", _track(_box(0, looks_at="bird")))
    assert CvatVideo().read(path, exchange(attribute="looks_at")).labels.ranges == (row(1, 1, "bird"),)


def test_frames_far_beyond_the_clip_are_counted_at_once(tmp_path: Path) -> None:
    path = _file(tmp_path / "a.xml", _track(_box(0, target="bird") + _box(10**15, target="cup")))
    imported = CvatVideo().read(path, exchange())
    assert imported.labels.ranges == (row(1, 50, "bird"),)
    assert imported.notes == (f"{path}: {10**15 - 50 + 1} labels are outside of the clip's frames and are left out.",)
