"""A take of Motive: axes, units, who wears which body, bodies that are lost, and exports that cannot be read."""

from __future__ import annotations

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
from harness.sources.measured.motive import read_take
from tests.measured import motive_file, open_measured
from vfoa.errors import VfoaError
from vfoa.geometry import unit

ANGLES = st.floats(-3, 3)
UP = [0.0, 1.0, 0.0]
"""Of the room, in Motive's axes."""


def pose(place: list[float], rotation: Rotation | None = None) -> NDArray[Any]:
    """A pose in three frames."""
    quaternion = Rotation.identity().as_quat() if rotation is None else rotation.as_quat()
    return np.tile([*quaternion, *place], (3, 1))


def opened(folder: Path, bodies: dict[str, NDArray[Any]], *, kind: str = "Rigid Body", **source: Any) -> MeasuredClip:
    said = {name: source.pop(name) for name in list(source) if name[0].isupper()}
    path = motive_file(folder / "take.csv", bodies, kind=kind, **said)
    return open_measured("motive", folder, file=path.name, **{"heads": {"anna": {}}, **source})


@given(x=ANGLES, y=ANGLES, z=ANGLES)
def test_a_head_and_its_eyes_move_with_the_body(
    x: float, y: float, z: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The cup lies ahead of the eyes in Motive's axes: the eyes see it ahead here, and up is up."""
    rotation, place = Rotation.from_euler("xyz", [x, y, z]), np.array([0.3, 1.7, -0.2])
    forward, eyes = np.array([0.6, 0, -0.8]), np.array([0.02, -0.08, -0.1])
    eyes_in_room = place + rotation.apply(eyes)
    bodies = {
        "anna": pose([*place], rotation),
        "cup": pose([*(eyes_in_room + 2 * rotation.apply(forward))]),
        "lamp": pose([*(eyes_in_room + UP)]),
    }
    folder = tmp_path_factory.mktemp("take")
    clip = opened(folder, bodies, heads={"anna": {"forward": [*forward], "eyes_m": [*eyes]}})
    scene = clip.scene(1)
    (anna,) = scene.people
    assert anna.eye_origin_left is not None
    assert anna.view.head_pose is not None
    of = {target.instance.label: target.box for target in scene.targets}
    cup, lamp = of["cup"], of["lamp"]
    assert cup is not None
    assert lamp is not None
    np.testing.assert_allclose(unit(cup.center_m - anna.eye_origin_left), anna.view.head_pose.direction, atol=1e-5)
    np.testing.assert_allclose(lamp.center_m - anna.eye_origin_left, [0, -1, 0], atol=1e-5)


def test_z_may_be_up(tmp_path: Path) -> None:
    bodies = {"anna": pose([0, 0, 1.6]), "cup": pose([0, 2, 1.1])}
    (anna,) = opened(tmp_path, bodies, up="z").scene(0).people
    assert anna.eye_origin_left is not None
    np.testing.assert_allclose(anna.eye_origin_left, [0, -1.6, 0], atol=1e-9)
    boxes = [target.box for target in opened(tmp_path, bodies, up="z").scene(0).targets]
    assert any(box is not None and np.allclose(box.center_m, [0, -1.1, 2]) for box in boxes)


@pytest.mark.parametrize(("units", "metre"), [("Meters", 1), ("Centimeters", 100), ("Millimeters", 1000)])
def test_lengths_are_in_the_units_of_the_first_line(units: str, metre: int, tmp_path: Path) -> None:
    (anna,) = opened(tmp_path, {"anna": pose([0.5 * metre, 0, 0])}, Length_Units=units).scene(0).people
    assert anna.eye_origin_left is not None
    np.testing.assert_allclose(anna.eye_origin_left, [0.5, 0, 0])


def test_an_object_has_its_size_along_its_own_axes(tmp_path: Path) -> None:
    turned = Rotation.from_euler("y", 90, degrees=True)
    bodies = {"anna": pose([0, 1.6, 0]), "table": pose([0, 0.7, 2], turned), "cup": pose([0, 0.8, 2])}
    scene = opened(tmp_path, bodies, sizes_m={"table": [1.6, 0.04, 0.8]}).scene(0)
    table, cup = (next(each.box for each in scene.targets if each.instance.label == name) for name in ("table", "cup"))
    assert table is not None
    assert cup is not None
    np.testing.assert_allclose(np.abs(table.left_from_box @ (2 * table.half_size_m)), [0.8, 0.04, 1.6], atol=1e-6)
    np.testing.assert_allclose(2 * cup.half_size_m, 0.1)


def test_a_lost_body_is_not_measured_in_that_frame(tmp_path: Path) -> None:
    anna, cup = pose([0, 1.6, 0]), pose([0, 0.8, 2])
    anna[1], cup[2] = np.nan, np.nan
    clip = opened(tmp_path, {"anna": anna, "cup": cup})
    eyes = [clip.scene(number).people[0].eye_origin_left for number in clip.frames]
    boxes = [next(each.box for each in clip.scene(number).targets if each.instance.id == 2) for number in clip.frames]
    assert [eye is not None for eye in eyes] == [True, False, True]
    assert [box is not None for box in boxes] == [True, True, False]
    assert [note for note in clip.notes if "1 of 3" in note] == [
        "anna: not tracked in 1 of 3 frames",
        "cup: not tracked in 1 of 3 frames",
    ]


def test_a_bone_of_a_skeleton_may_be_a_head_and_others_are_no_objects(tmp_path: Path) -> None:
    bodies = {"Anna:Head": pose([0, 1.6, 0]), "Anna:Hip": pose([0, 1, 0])}
    clip = opened(tmp_path, bodies, kind="Bone", heads={"anna": {"body": "Anna:Head"}})
    assert (clip.people, clip.objects) == ({"anna": 1}, {})


def test_every_nth_frame_keeps_its_number_and_time(tmp_path: Path) -> None:
    clip = opened(tmp_path, {"anna": pose([0, 1.6, 0])}, every=2)
    assert clip.frames == (0, 2)
    assert clip.time_ns(2) == 20_000_000


def test_a_file_is_added_with_who_wears_what(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = motive_file(tmp_path / "take.csv", {"cap": pose([0, 1.6, 0]), "cup": pose([0, 1.2, 1])})
    with pytest.raises(VfoaError) as refused:
        add_clip(path)
    assert "of: cap, cup; say --set 'heads={anna={body=\"NAME\"}}'" in str(refused.value)
    added = add_clip(path, source={"heads": {"anna": {"body": "cap", "eyes_m": [0, -0.1, 0.1]}}})
    check = check_clip(added.name)
    assert (check.frames, check.problems, check.notes) == (3, (), ())


@pytest.mark.parametrize(
    ("said", "found"),
    [
        ({"Rotation_Type": "XYZ"}, "take.csv:1: Rotation Type: found 'XYZ'"),
        ({"Coordinate_Space": "Local"}, "take.csv:1: Coordinate Space: found 'Local'"),
        ({"Length_Units": "Inches"}, "take.csv:1: Length Units: expected one of: Centimeters, Meters, Millimeters"),
    ],
)
def test_exports_that_cannot_be_read_are_named(said: dict[str, str], found: str, tmp_path: Path) -> None:
    with pytest.raises(VfoaError) as refused:
        opened(tmp_path, {"anna": pose([0, 1.6, 0])}, **said)
    assert found in str(refused.value)


def damaged(text: str) -> list[tuple[str, str]]:
    """Contents with one mistake, and what is said of each."""
    first, *rest = text.splitlines()
    return [
        (text.replace("Rigid Body", "Marker"), "no rigid body"),
        (text.replace("\nFrame", "\nNumber"), "no line that begins with Frame"),
        ("\n".join([first.replace("Format Version", "Version"), *rest]), ":1: no 'Format Version'"),
        (text.replace("\n1,0.010000,0.000000", "\n1,0.010000,0.300000"), ":9: anna: found a quaternion of length 1.04"),
        (text.replace("\n2,0.020000,0.000000", "\n2,0.020000,left"), ":10: could not convert string to float: 'left'"),
        (text.replace("\n2,0.020000,0.000000", "\n2,0.020000"), ":10: found 12 cells; expected 13"),
    ]


@pytest.mark.parametrize("number", range(6))
def test_a_damaged_file_is_named_with_its_line(number: int, tmp_path: Path) -> None:
    path = motive_file(tmp_path / "take.csv", {"anna": pose([0, 1.6, 0])})
    content, found = damaged(path.read_text())[number]
    path.write_text(content)
    with pytest.raises(VfoaError) as refused:
        read_take(path)
    assert str(refused.value).startswith(f"{path}")
    assert found in str(refused.value)


@pytest.mark.parametrize("source", [{"heads": {"anna": {"body": "cap"}}}, {"sizes_m": {"anna": [1, 1, 1]}}])
def test_names_of_no_body_are_refused(source: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(VfoaError) as refused:
        opened(tmp_path, {"anna": pose([0, 1.6, 0]), "cup": pose([0, 1, 1])}, **source)
    assert "no rigid body" in str(refused.value)
