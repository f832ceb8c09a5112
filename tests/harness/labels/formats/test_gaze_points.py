"""VideoAttentionTarget and ChildPlay: points in the image, named by what is seen there."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.annotate.bodies import RunBodies
from harness.labels.formats.childplay import ChildPlay
from harness.labels.formats.video_attention_target import VideoAttentionTarget
from harness.labels.labels import Label, Labels, ranges_of
from tests.disk import write_text
from tests.exchanges import FRAMES, PlainClip, exchange, labels_of, row, staged
from tests.records import frame_record, subject_record, target_record
from vfoa.errors import VfoaError

HEAD = "clip,frame,person_id,bbox_x,bbox_y,bbox_width,bbox_height,gaze_class,gaze_x,gaze_y,is_child\n"


def _names(labels: Labels, frames: list[int], but: tuple[str, ...] = ()) -> Labels:
    """The targets of the labels without points and notes, with equal neighbours joined."""

    def name(frame: int, subject: str) -> Label | None:
        label = labels.at(frame, subject)
        return None if label is None or label.target in but else Label(target=label.target)

    return Labels(row for who in labels.subjects for row in ranges_of(who, ((n, name(n, who)) for n in frames)))


@given(frames=FRAMES, offset=st.integers(0, 500), data=st.data())
@pytest.mark.parametrize(("chosen", "name"), [(VideoAttentionTarget, "out"), (ChildPlay, "out.csv")])
def test_what_is_exported_is_imported_again(
    chosen: type[ChildPlay],
    name: str,
    tmp_path_factory: pytest.TempPathFactory,
    frames: list[int],
    offset: int,
    data: st.DataObject,
) -> None:
    clip, bodies = staged(frames)
    labels = data.draw(labels_of(frames, notes=False, points=False, suggested=False))
    path, where = tmp_path_factory.mktemp("points") / name, exchange(clip, bodies=bodies, offset=offset)
    said = chosen().write(path, labels, where)
    assert any("Names of targets are left out" in each for each in said)
    again = chosen().read(path, where)
    lost = ("ignore",) if chosen is VideoAttentionTarget else ()  # a frame that is not judged has no line there
    assert _names(again.labels, frames, lost) == _names(labels, frames, lost)


def test_a_point_that_is_the_same_in_a_whole_range_is_kept(tmp_path: Path) -> None:
    clip, bodies = staged()
    labels = Labels([row(1, 2, "cup", point_px=(3.0, 21.0)), row(3, 4, "none"), row(5, 6, "boy")])
    ChildPlay().write(tmp_path / "a.csv", labels, exchange(clip, bodies=bodies))
    found = ChildPlay().read(tmp_path / "a.csv", exchange(clip, bodies=bodies)).labels.ranges
    assert found[:2] == labels.ranges[:2]
    moving = write_text(tmp_path / "girl.txt", "001.jpg,1,1,2,2,3,21\n002.jpg,1,1,2,2,4,22\n")
    (one,) = VideoAttentionTarget().read(moving, exchange(clip, bodies=bodies)).labels.ranges
    assert one == row(1, 2, "cup")


def test_a_folder_of_people_as_the_data_set_has_it(tmp_path: Path) -> None:
    clip, bodies = staged()
    write_text(tmp_path / "c" / "s00.txt", "00000101.jpg,31,2,40,12,5,5\n00000102.jpg,31,2,40,12,-1,-1\n")
    write_text(tmp_path / "c" / "s01.txt", "00000101.jpg,50,2,60,12,45,20\n00000160.jpg,50,2,60,12,-1,-1\n")
    renamed = {"s00": "girl", "s01": "boy"}
    found = VideoAttentionTarget().read(tmp_path / "c", exchange(clip, bodies=bodies, offset=100, renamed=renamed))
    assert found.labels == Labels(
        [
            row(1, 1, "bird", point_px=(5.0, 5.0)),
            row(2, 2, "none"),
            row(1, 1, "ignore", "boy", note="looks at nothing that has a name"),
        ]
    )
    assert found.notes == (
        f"{tmp_path / 'c'}: 1 labels are outside of the clip's frames and are left out.",
        f"{tmp_path / 'c'}: 1 points lie on nothing that has a name and are ignored (--target NAME names them).",
    )


def test_a_point_beside_the_image_is_moved_to_its_edge(tmp_path: Path) -> None:
    """As the authors' loader does it; only -1, -1 is out of the image."""
    clip, bodies = staged()
    path = write_text(tmp_path / "girl.txt", "1.jpg,1,1,2,2,5,-1\n2.jpg,1,1,2,2,-1,-1\n3.jpg,1,1,2,2,70,50\n")
    found = VideoAttentionTarget().read(path, exchange(clip, bodies=bodies, unnamed="cup")).labels
    assert found.ranges == (
        row(1, 1, "cup", point_px=(5.0, 0.0)),
        row(2, 2, "none"),
        row(3, 3, "cup", point_px=(63.0, 47.0)),
    )


def test_a_row_that_has_no_point_though_its_class_has_is_not_judged(tmp_path: Path) -> None:
    rows = ["v_1-9,1,girl,1,2,3,4,inside_visible,-1,-1,1", "v_1-9,2,girl,1,2,3,4,inside_ambiguous,-1,-1,True"]
    clip, bodies = staged()
    path = write_text(tmp_path / "a.csv", HEAD + "\n".join(rows) + "\n")
    assert ChildPlay().read(path, exchange(clip, bodies=bodies, unnamed="cup")).labels.ranges == (
        row(1, 1, "ignore", note="inside_visible without a point"),
        row(2, 2, "ignore", note="inside_ambiguous"),
    )


def test_classes_of_gaze_that_are_no_target_are_ignored_under_their_name(tmp_path: Path) -> None:
    rows = [
        "v_1-9,1,girl,1,2,3,4,inside_visible,5,5,1",
        "v_1-9,2,girl,1,2,3,4,gaze_shift,-1,-1,1",
        "v_1-9,3,girl,1,2,3,4,outside_frame,-1,-1,1",
        "v_1-9,4,girl,1,2,3,4,inside_visible,45,45,1",
    ]
    path = write_text(tmp_path / "a.csv", HEAD + "\n".join(rows) + "\n")
    clip, bodies = staged()
    found = ChildPlay().read(path, exchange(clip, bodies=bodies, unnamed="cup")).labels
    assert found.ranges == (
        row(1, 1, "bird", point_px=(5.0, 5.0)),
        row(2, 2, "ignore", note="gaze_shift"),
        row(3, 3, "none"),
        row(4, 4, "cup", point_px=(45.0, 45.0)),
    )
    ChildPlay().write(tmp_path / "b.csv", found, exchange(clip, bodies=bodies))
    classes = [line.split(",")[7] for line in (tmp_path / "b.csv").read_text().splitlines()[1:]]
    assert classes == ["inside_visible", "gaze_shift", "outside_frame", "inside_visible"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("001.jpg,1,1,2,2,3\n", r"girl\.txt:1: found '001\.jpg,1,1,2,2,3'; expected IMAGE_NUMBER\.jpg and six numbers"),
        ("001.jpg,1,1,2,2,3,x\n", r"girl\.txt:1: u_px,v_px: found '3,x'; expected two numbers"),
        ("001.jpg,1,1,2,2,,\n", r"girl\.txt:1: no gaze point; expected two numbers"),
        ("001.jpg,1,1,2,2,nan,1\n", r"girl\.txt:1: u_px,v_px: found 'nan,1'; expected two numbers"),
        ("image.jpg,1,1,2,2,3,4\n", r"girl\.txt:1: .*expected IMAGE_NUMBER\.jpg and six numbers"),
        ("1.jpg,1,1,2,2,-1,-1\n01.jpg,1,1,2,2,-1,-1\n", r"girl\.txt:2: 'girl' has two labels in frame 1"),
    ],
)
def test_a_mistake_is_one_line_with_its_place(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(VfoaError, match=message):
        VideoAttentionTarget().read(write_text(tmp_path / "girl.txt", text), exchange())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD.replace("gaze_x", "gx"), r"no header with the columns clip, frame, person_id"),
        (HEAD + "a,1,gril,1,2,3,4,outside_frame,-1,-1,1\n", r"a\.csv:2: unknown subject 'gril'; did you mean 'girl'"),
        (HEAD + "a,one,girl,1,2,3,4,outside_frame,-1,-1,1\n", r"a\.csv:2: frame: found 'one'; expected a number"),
        (
            HEAD + "a,1,girl,1,2,3,4,outside_frame,-1,-1,1\nb,1,girl,1,2,3,4,x,1,1,1\n",
            r"a\.csv:3: found the clips 'a', 'b'",
        ),
    ],
)
def test_a_mistake_in_childplay_is_one_line_with_its_place(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(VfoaError, match=message):
        ChildPlay().read(write_text(tmp_path / "a.csv", text), exchange())


def test_nothing_is_written_where_heads_are_not_known(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match="needs heads and targets in the image, and none are known; expected --run RUN"):
        ChildPlay().write(tmp_path / "a.csv", Labels([row(1, 2, "bird")]), exchange(PlainClip()))
    assert not (tmp_path / "a.csv").exists()


def test_a_run_knows_heads_and_boxes() -> None:
    boxes = {"bird": (0.0, 0.0, 9.0, 9.0), "cup": (2.0, 2.0, 4.0, 4.0), "girl": (0.0, 0.0, 60.0, 40.0)}
    targets = [target_record(number, name, box_px=box) for number, (name, box) in enumerate(boxes.items())]
    record = frame_record(targets, [subject_record("girl")])
    bodies = RunBodies(records={1: record})
    assert bodies.head_box(1, "girl") == (0.0, 0.0, 5.0, 5.0)
    assert (bodies.head_box(2, "girl"), bodies.head_box(1, "boy")) == (None, None)
    assert bodies.target_at(1, (3.0, 3.0), but="girl") == "cup"  # the smaller box is in front
    assert bodies.target_at(1, (8.0, 8.0), but="girl") == "bird"
    assert bodies.target_at(1, (50.0, 30.0), but="girl") is None
    assert bodies.point_of(1, "bird") == (4.5, 4.5)
    assert bodies.point_of(2, "bird") is None
