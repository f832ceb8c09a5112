"""Takes of motion capture, whatever program wrote them: axes, who wears which body, bodies that are lost."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from harness.clips.add import add_clip
from harness.clips.check import check_clip
from harness.sources import MeasuredClip
from tests.disk import labels_text
from tests.measured import motive_file, open_measured, pose, qualisys_file, ros_file, vicon_file
from vfoa.errors import VfoaError
from vfoa.geometry import unit
from vfoa.types import Box3D, Scene

WRITERS: Mapping[str, tuple[Callable[[Path, Mapping[str, NDArray[Any]]], Path], str]] = {
    "motive": (motive_file, "take.csv"),
    "qualisys": (qualisys_file, "take.tsv"),
    "ros_poses": (ros_file, "take.bag"),
    "vicon": (vicon_file, "take.csv"),
}
UP = {name: [0.0, 1.0, 0.0] if name == "motive" else [0.0, 0.0, 1.0] for name in WRITERS}
"""In the axes of the room."""
ANGLES = st.floats(-3, 3)

adapters = pytest.mark.parametrize("adapter", WRITERS)


def opened(adapter: str, folder: Path, bodies: Mapping[str, NDArray[Any]], **source: Any) -> MeasuredClip:
    write, name = WRITERS[adapter]
    return open_measured(adapter, folder, file=write(folder / name, bodies).name, **{"heads": {"anna": {}}, **source})


def box_of(scene: Scene, name: str) -> Box3D:
    (box,) = (target.box for target in scene.targets if target.instance.label == name)
    assert box is not None
    return box


@adapters
@given(x=ANGLES, y=ANGLES, z=ANGLES)
def test_a_head_and_its_eyes_move_with_the_body(
    adapter: str, x: float, y: float, z: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The cup lies ahead of the eyes in the room: the eyes see it ahead here, too, and the lamp above them."""
    rotation, place = Rotation.from_euler("xyz", [x, y, z]), np.array([0.3, 1.7, -0.2])
    forward, eyes = np.array([0.6, 0, -0.8]), np.array([0.02, -0.08, -0.1])
    eyes_in_room = place + rotation.apply(eyes)
    bodies = {
        "anna": pose(place, rotation),
        "cup": pose(eyes_in_room + 2 * rotation.apply(forward)),
        "lamp": pose(eyes_in_room + UP[adapter]),
    }
    heads = {"anna": {"forward": [*forward], "eyes_m": [*eyes]}}
    clip = opened(adapter, tmp_path_factory.mktemp("take"), bodies, heads=heads)
    scene = clip.scene(clip.frames[0])
    (anna,) = scene.people
    assert anna.eye_origin_left is not None
    assert anna.view.head_pose is not None
    towards_cup = unit(box_of(scene, "cup").center_m - anna.eye_origin_left)
    np.testing.assert_allclose(towards_cup, anna.view.head_pose.direction, atol=2e-5)
    np.testing.assert_allclose(box_of(scene, "lamp").center_m - anna.eye_origin_left, [0, -1, 0], atol=2e-5)


@adapters
@pytest.mark.parametrize(("up", "place"), [("y", [0.5, -1.6, -2.0]), ("z", [0.5, -2.0, 1.6])])
def test_the_axis_that_is_up_can_be_said(adapter: str, up: str, place: list[float], tmp_path: Path) -> None:
    clip = opened(adapter, tmp_path, {"anna": pose([0.5, 1.6, 2.0])}, up=up)
    (anna,) = clip.scene(clip.frames[0]).people
    assert anna.eye_origin_left is not None
    np.testing.assert_allclose(anna.eye_origin_left, place, atol=1e-9)


@adapters
def test_an_object_has_its_size_along_its_own_axes(adapter: str, tmp_path: Path) -> None:
    turned = Rotation.from_rotvec(np.pi / 2 * np.array(UP[adapter]))
    bodies = {"anna": pose([0, 0, 0]), "table": pose([0, 1, 2], turned), "cup": pose([0, 1, 2])}
    clip = opened(adapter, tmp_path, bodies, sizes_m={"table": [1.6, 0.04, 0.8]})
    scene = clip.scene(clip.frames[0])
    table = box_of(scene, "table")
    extents = [0.8, 0.04, 1.6] if adapter == "motive" else [0.04, 0.8, 1.6]  # the others' z is up
    np.testing.assert_allclose(np.abs(table.left_from_box) @ (2 * table.half_size_m), extents, atol=1e-6)
    np.testing.assert_allclose(2 * box_of(scene, "cup").half_size_m, 0.1)


@adapters
def test_a_lost_body_is_not_measured_in_that_frame(adapter: str, tmp_path: Path) -> None:
    anna, cup = pose([0, 1.6, 0]), pose([0, 0.8, 2])
    anna[1], cup[2] = np.nan, np.nan
    clip = opened(adapter, tmp_path, {"anna": anna, "cup": cup})
    scenes = [clip.scene(number) for number in clip.frames]
    assert [scene.people[0].eye_origin_left is not None for scene in scenes] == [True, False, True]
    assert [scene.targets[1].box is not None for scene in scenes] == [True, True, False]
    assert clip.notes[:2] == ("anna: not tracked in 1 of 3 frames", "cup: not tracked in 1 of 3 frames")


@adapters
def test_every_nth_frame_keeps_its_number_and_time(adapter: str, tmp_path: Path) -> None:
    clip = opened(adapter, tmp_path, {"anna": pose([0, 1.6, 0])}, every=2)
    assert clip.frames in {(0, 2), (1, 3)}
    first_ns, last_ns = (clip.time_ns(number) for number in clip.frames)
    assert last_ns - first_ns == 20_000_000
    assert first_ns == (10_000_000 if adapter == "ros_poses" else 0)


@adapters
def test_a_file_is_added_with_who_wears_what(adapter: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write, name = WRITERS[adapter]
    path = write(tmp_path / name, {"cap": pose([0, 1.6, 0]), "cup": pose([0, 1.2, 1])})
    with pytest.raises(VfoaError) as refused:
        add_clip(path)
    assert "of: cap, cup; say --set 'heads={anna={body=\"NAME\"}}'" in str(refused.value)
    added = add_clip(path, source={"heads": {"anna": {"body": "cap", "eyes_m": [0, -0.1, 0.1]}}})
    check = check_clip(added.name)
    assert (check.frames, check.problems, check.notes) == (3, (), ())


@adapters
@pytest.mark.parametrize("source", [{"heads": {"anna": {"body": "cap"}}}, {"sizes_m": {"anna": [1, 1, 1]}}])
def test_names_of_no_body_are_refused(adapter: str, source: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(VfoaError) as refused:
        opened(adapter, tmp_path, {"anna": pose([0, 1.6, 0]), "cup": pose([0, 1, 1])}, **source)
    assert "no rigid body" in str(refused.value)


@adapters
def test_of_several_bodies_each_frame_has_the_first_that_is_known(adapter: str, tmp_path: Path) -> None:
    """A face that is found again has a new name: none of them is an object."""
    first, second = pose([1, 0, 0]), pose([2, 0, 0])
    first[1:], second[2:] = np.nan, np.nan
    source = {"heads": {"anna": {"body": ["face_a", "face_b"]}}}
    clip = opened(adapter, tmp_path, {"face_a": first, "face_b": second, "cup": pose([3, 0, 0])}, **source)
    eyes = [person.eye_origin_left for number in clip.frames for person in clip.scene(number).people]
    assert [None if place is None else round(place[0], 9) for place in eyes][:2] == [1.0, 2.0]
    assert [*clip.objects] == ["cup"]
    assert [note for note in clip.notes if "tracked" in note] == ["anna: not tracked in 1 of 3 frames"]


@adapters
def test_a_body_is_worn_by_one_person(adapter: str, tmp_path: Path) -> None:
    with pytest.raises(VfoaError) as refused:
        opened(adapter, tmp_path, {"cap": pose([0, 1.6, 0])}, heads={"anna": {"body": "cap"}, "ben": {"body": "cap"}})
    assert "anna and ben both wear 'cap'" in str(refused.value)


@adapters
@pytest.mark.parametrize(("forward", "noted"), [([1, 0, 0], 0), ([0, 0, 1], 1)])
def test_labels_say_where_the_face_is_on_the_body(
    adapter: str, forward: list[float], noted: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Anna's face is at x of her body, and turns from the cup to the lamp."""
    monkeypatch.chdir(tmp_path)
    places = {"cup": np.array([2.0, 0.5, 0.3]), "lamp": np.array([1.0, -1.5, 1.0])}
    looks = [places["cup"]] * 10 + [places["lamp"]] * 10
    turns = [Rotation.align_vectors([unit(place)], [[1, 0, 0]])[0].as_quat() for place in looks]
    bodies = {"anna": np.array([[*turn, 0, 0, 0] for turn in turns])}
    bodies |= {name: pose(place, frames=20) for name, place in places.items()}
    write, name = WRITERS[adapter]
    added = add_clip(write(tmp_path / name, bodies), source={"heads": {"anna": {"forward": forward}}})
    first = opened(adapter, tmp_path, bodies).frames[0]
    rows = [f"{first},{first + 9},anna,cup,", f"{first + 10},{first + 19},anna,lamp,"]
    (tmp_path / "annotations" / f"{added.name}.csv").write_text(labels_text(*rows))
    notes = [note for note in check_clip(added.name).notes if "face" in note]
    assert len(notes) == noted
    assert all("anna: with the labels, the face points along [1.0, 0.0, 0.0]" in note for note in notes)


@pytest.mark.parametrize("adapter", [name for name in WRITERS if name != "ros_poses"])
def test_two_bodies_of_one_name_are_refused(adapter: str, tmp_path: Path) -> None:
    write, name = WRITERS[adapter]
    path = write(tmp_path / name, {"anna": pose([0, 0, 2]), "cup": pose([1, 0, 2])})
    path.write_text(path.read_text(encoding="utf-8").replace("cup", "anna"), encoding="utf-8")
    with pytest.raises(VfoaError) as refused:
        add_clip(path, source={"heads": {"anna": {}}})
    assert "two bodies have the name 'anna'; expected one" in str(refused.value)
