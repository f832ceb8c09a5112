"""Measurements from tables: what is read, from CSV, and what is refused with its place."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from harness.sources.measured.tables import MeasuredTablesSettings
from tests.adapter_contract import check_contract
from tests.disk import write_text
from tests.measured import ANNA, BEN, OBJECTS_HEADER, PEOPLE_HEADER, measured_tables, open_measured
from vfoa.errors import VfoaError
from vfoa.geometry import unit
from vfoa.types import Scene
from vfoa.validation import parse


def _boxes(scene: Scene, clip: object) -> dict[str, tuple[list[float], list[float]]]:
    names = {number: name for name, number in {**clip.people, **clip.objects}.items()}  # type: ignore[attr-defined]
    return {
        names[target.instance.id]: (target.box.center_m.tolist(), (2 * target.box.half_size_m).tolist())
        for target in scene.targets
        if target.box is not None
    }


def test_people_objects_and_cues_stand_where_the_tables_say(tmp_path: Path) -> None:
    clip = open_measured("measured", measured_tables(tmp_path), objects_file="objects.csv")
    assert (clip.people, clip.objects) == ({"anna": 1, "ben": 2}, {"robot": 3, "cup": 4})
    assert clip.rate_hz == pytest.approx(25)
    scene = clip.scene(12)
    assert _boxes(scene, clip) == {
        "anna": (ANNA.tolist(), [0.18, 0.25, 0.2]),
        "ben": (BEN.tolist(), [0.18, 0.25, 0.2]),
        "robot": ([0.0, 0.0, 0.0], [0.3, 0.3, 0.3]),
        "cup": ([0.05 * 11, 0.4, 0.9], [0.1, 0.1, 0.1]),
    }
    anna, ben = scene.people
    assert anna.view.gaze is not None
    assert anna.view.head_pose is not None
    np.testing.assert_array_equal(anna.view.gaze.direction, unit(-ANNA))
    assert (anna.view.head_pose.sigma_rad, anna.view.gaze.sigma_rad) == (math.radians(5), math.radians(8))
    assert ben.view.gaze is None


def test_a_blank_person_is_a_frame_in_which_nobody_was_seen(tmp_path: Path) -> None:
    (tmp_path / "people.csv").write_text("frame,time_s,person,x_m,y_m,z_m\n1,0.5,anna,0,0,1\n2,0.75,,,,\n")
    clip = open_measured("measured", tmp_path, objects={"lamp": {"center_m": [0, -1, 2]}})
    assert [len(clip.scene(number).people) for number in clip.frames] == [1, 0]
    assert (clip.time_ns(1), clip.time_ns(2)) == (500_000_000, 750_000_000)
    assert _boxes(clip.scene(2), clip) == {"lamp": ([0, -1, 2], [0.1, 0.1, 0.1])}
    check_contract(clip)


def test_an_object_with_a_person_s_name_is_that_person_s_box(tmp_path: Path) -> None:
    (tmp_path / "people.csv").write_text("frame,time_ns,person,x_m,y_m,z_m\n1,0,anna,0,0,1\n")
    (tmp_path / "objects.csv").write_text(f"{OBJECTS_HEADER}\n1,anna,,0,0.5,1,0.5,1.6,0.3\n")
    clip = open_measured("measured", tmp_path, objects_file="objects.csv")
    assert clip.objects == {}
    assert _boxes(clip.scene(1), clip) == {"anna": ([0, 0.5, 1], [0.5, 1.6, 0.3])}
    (target,) = clip.scene(1).targets
    assert target.instance.label == "person"


def test_a_person_s_box_is_there_without_the_head_and_may_be_unknown(tmp_path: Path) -> None:
    (tmp_path / "people.csv").write_text("frame,time_ns,person,x_m,y_m,z_m\n1,0,anna,0,0,1\n2,5,,,,\n")
    (tmp_path / "objects.csv").write_text(f"{OBJECTS_HEADER}\n1,anna,,,,,,,\n2,anna,,0,0.5,1,0.5,1.6,0.3\n")
    clip = open_measured("measured", tmp_path, objects_file="objects.csv")
    assert _boxes(clip.scene(1), clip) == {}
    assert len(clip.scene(1).people) == 1
    assert _boxes(clip.scene(2), clip) == {"anna": ([0, 0.5, 1], [0.5, 1.6, 0.3])}
    check_contract(clip)


@given(turn=st.tuples(*[st.floats(-3, 3)] * 3).filter(any))
def test_a_quaternion_turns_the_box_s_axes_into_the_camera_s(tmp_path: Path, turn: tuple[float, float, float]) -> None:
    rotation = Rotation.from_rotvec(turn)
    quaternion = ",".join(map(repr, map(float, rotation.as_quat())))
    (tmp_path / "people.csv").write_text("frame,time_ns,person,x_m,y_m,z_m\n1,0,anna,0,0,1\n")
    header = "frame,object,x_m,y_m,z_m,size_x_m,size_y_m,size_z_m,qx,qy,qz,qw"
    (tmp_path / "objects.csv").write_text(f"{header}\n,door,0,0,2,1,2,0.1,{quaternion}\n")
    clip = open_measured("measured", tmp_path, objects_file="objects.csv")
    door = clip.scene(1).targets[1].box
    assert door is not None
    np.testing.assert_allclose(door.left_from_box @ [0, 0, 1], rotation.apply([0, 0, 1]), atol=1e-12)


@pytest.mark.parametrize(
    ("people", "objects", "place"),
    [
        ("1,0,anna,0,0,1,0,0,2,,,,,", "", r"people\.csv:2: head_x, .* length 2"),
        ("1,0,anna,0,0,1,0,0,1,-3,,,,", "", r"people.csv:2: head_sigma_deg: .* 0 to 180"),
        ("1,0,anna,0,0,1,0,0,1,200,,,,", "", r"people.csv:2: head_sigma_deg: .* found 200"),
        ("1,0,anna,0,,1,,,,,,,,", "", r"people.csv:2: y_m: found nothing"),
        ("1,,anna,0,0,1,,,,,,,,", "", r"people.csv:2: found no time"),
        ("9223372036854775808,0,anna,0,0,1,,,,,,,,", "", r"people\.csv:2: frame: .*64 bits"),
        ("1,0,anna,0,0,1,,,,,,,,\n1,0,anna,0,0,2,,,,,,,,", "", r"people.csv:3: .* twice"),
        ("1,0,anna,0,0,1,,,,,,,,\n1,9,ben,0,0,2,,,,,,,,", "", r"people.csv:3: frame 1: found two times"),
        ("1,9,anna,0,0,1,,,,,,,,\n2,9,ben,0,0,2,,,,,,,,", "", r"frame 2: its time is not after"),
        ("", "", r"people.csv: no frames"),
        ("1,0,anna,0,0,1,,,,,,,,", "2,cup,cup,0,0,1,,,", r"objects\.csv:2: frame 2: .*people"),
        ("1,0,anna,0,0,1,,,,,,,,", "1,cup,cup,0,0,1,0,1,1", r"objects.csv:2: .*positive half sizes"),
        ("1,0,anna,0,0,1,,,,,,,,", "1,cup,cup,0,0,1,1e155,1,1", r"objects\.csv:2: size_x_m, .*1e\+06"),
        ("1,0,anna,0,0,1e155,,,,,,,,", "", r"people.csv:2: x_m, .*at most 1e\+06"),
        ("1,0,anna,0,0,1,,,,,,,,", "1,cup,cup,,,,,,", r"objects.csv:2: x_m: found nothing"),
        ("1,0,anna,0,0,1,,,,,,,,", ",cup,cup,0,0,1,,,\n,cup,cup,0,0,2,,,", r"objects.csv:3: .* twice"),
    ],
)
def test_a_mistake_is_named_with_its_place(tmp_path: Path, people: str, objects: str, place: str) -> None:
    (tmp_path / "people.csv").write_text(f"{PEOPLE_HEADER}\n{people}\n")
    (tmp_path / "objects.csv").write_text(f"{OBJECTS_HEADER}\n{objects}\n")
    with pytest.raises(VfoaError, match=place):
        open_measured("measured", tmp_path, objects_file="objects.csv")


def test_an_object_has_one_category(tmp_path: Path) -> None:
    (tmp_path / "people.csv").write_text("frame,time_ns,person,x_m,y_m,z_m\n1,0,anna,0,0,1\n2,1,anna,0,0,1\n")
    (tmp_path / "objects.csv").write_text(f"{OBJECTS_HEADER}\n1,it,cup,0,0,1,,,\n2,it,mug,0,0,1,,,\n")
    with pytest.raises(VfoaError, match="'it': found categories 'cup' and 'mug'"):
        open_measured("measured", tmp_path, objects_file="objects.csv")


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"head_size_m": (0.2, 0, 0.2)}, "head_size_m.1"),
        ({"objects": {"cup": {"center_m": (0, 0, 1), "size_m": (1, 1, -1)}}}, "objects.cup.size_m.2"),
    ],
)
def test_an_extent_of_the_manifest_that_is_not_positive_is_named(settings: dict[str, Any], key: str) -> None:
    with pytest.raises(VfoaError, match=rf"source\.{key}: expected greater than 0"):
        parse(MeasuredTablesSettings, settings, "mine.toml", "source")


@pytest.mark.parametrize("sigma", ["3.14159265358979", "3.1416", "3.142"])
def test_half_a_turn_may_be_rounded_up(tmp_path: Path, sigma: str) -> None:
    header = "frame,time_ns,person,x_m,y_m,z_m,head_x,head_y,head_z,head_sigma_rad"
    people = write_text(tmp_path / "people.csv", f"{header}\n1,0,anna,0,0,1,0,0,1,{sigma}\n")
    clip = open_measured("measured", tmp_path)
    assert clip.notes == clip.doubts == ()
    write_text(people, f"{header}\n1,0,anna,0,0,1,0,0,1,3.2\n")
    with pytest.raises(VfoaError, match=r"people\.csv:2: head_sigma_rad: .* 0 to 3\.15, found 3\.2"):
        open_measured("measured", tmp_path)


@pytest.mark.parametrize(
    ("sigmas", "unit", "said"),
    [
        ((0.09, 0.17), "deg", ["found at most 0.17"]),
        ((0.0, 0.0), "deg", ["found 0 alone"]),  # empty cells that a script has filled
        ((0.0, 0.0), "rad", ["found 0 alone"]),
        ((0.09, 0.17), "rad", []),
        ((0.09, 8.0), "deg", []),
        ((0.0, 8.0), "deg", []),
        (("", ""), "deg", []),
    ],
)
def test_claimed_errors_that_are_not_in_degrees_or_all_zero_are_noted(
    tmp_path: Path, sigmas: tuple[float | str, float | str], unit: str, said: list[str]
) -> None:
    rows = [f"{frame},{frame},anna,0,0,1,0,0,1,{sigma}" for frame, sigma in enumerate(sigmas)]
    header = f"frame,time_ns,person,x_m,y_m,z_m,head_x,head_y,head_z,head_sigma_{unit}"
    (tmp_path / "people.csv").write_text("\n".join([header, *rows, ""]))
    found = open_measured("measured", tmp_path).doubts
    assert len(found) == len(said)
    assert all(f"people.csv: head_sigma_{unit}: {what}" in note for note, what in zip(found, said, strict=True))
    write_text(tmp_path / "people.csv", "\n".join([header, *rows]).replace("head", "gaze"))
    assert open_measured("measured", tmp_path, gaze="truth").doubts == ()  # it is no cue


@pytest.mark.parametrize(
    ("cup", "ben", "names"),
    [
        ("1 2 3 4 5 6", "1 2 3 4 5 6", ""),
        ("", "1 2 3 4 5 6", ""),
        ("1", "1 2 3 4 5 6", "cup"),  # where it rests, a blank frame is meant
        ("1 3 5", "1 2 3 4 5 6", "cup"),
        ("1 2", "3 4", ""),
        ("1 2 5", "2 4 6", "ben"),
        ("1 2 5", "2 6", ""),  # a tracker's mistakes
    ],
)
def test_rows_in_single_frames_are_noted(tmp_path: Path, cup: str, ben: str, names: str) -> None:
    seen = [(frame, name) for name, frames in (("anna", "1 2 3 4 5 6"), ("ben", ben)) for frame in frames.split()]
    people = [f"{frame},{frame},{name},0,0,1" for frame, name in sorted(seen)]
    objects = [f"{frame},cup,0,0,2" for frame in cup.split() or [""]]
    write_text(tmp_path / "people.csv", "\n".join(["frame,time_s,person,x_m,y_m,z_m", *people]))
    write_text(tmp_path / "objects.csv", "\n".join(["frame,object,x_m,y_m,z_m", *objects, ",lamp,0,1,2"]))
    clip = open_measured("measured", tmp_path, objects_file="objects.csv")
    assert [note.split(": ")[1] for note in clip.doubts] == names.split()
    assert clip.notes == ()  # a run shows what is in question once
    others = open_measured("measured", tmp_path, objects_file="objects.csv", objects={"cup": {"center_m": [0, 0, 2]}})
    assert not [note for note in others.doubts if ": cup:" in note]
