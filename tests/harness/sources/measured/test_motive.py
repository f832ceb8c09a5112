"""Motive's CSV: units, bones, and exports that cannot be read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.sources.measured.motive import MotiveClip
from tests.measured import motive_file, open_measured, pose, refusal
from vfoa.errors import VfoaError

ANNA = {"anna": pose([0.5, 1.6, 0])}


@pytest.mark.parametrize(("units", "metre"), [("Meters", 1), ("Centimeters", 100), ("Millimeters", 1000)])
def test_lengths_are_in_the_units_of_the_first_line(units: str, metre: int, tmp_path: Path) -> None:
    poses = {"anna": ANNA["anna"] * [1, 1, 1, 1, metre, metre, metre]}
    take = MotiveClip.read(motive_file(tmp_path / "take.csv", poses, Length_Units=units))
    np.testing.assert_allclose(take.poses["anna"].places_m[0], [0.5, 1.6, 0])


def test_a_bone_of_a_skeleton_may_be_a_head_and_others_are_no_objects(tmp_path: Path) -> None:
    path = motive_file(tmp_path / "take.csv", {"Anna:Head": ANNA["anna"], "Anna:Hip": ANNA["anna"]}, kind="Bone")
    clip = open_measured("motive", tmp_path, file=path.name, heads={"anna": {"body": "Anna:Head"}})
    assert (clip.people, clip.objects) == ({"anna": 1}, {})


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
        MotiveClip.read(motive_file(tmp_path / "take.csv", ANNA, kind="Rigid Body", **said))
    assert found in str(refused.value)


@pytest.mark.parametrize(
    ("before", "after", "found"),
    [
        ("Rigid Body", "Marker", ": no rigid body"),
        ("\nFrame", "\nNumber", ": no line that begins with Frame"),
        ("Format Version", "Version", ":1: no 'Format Version'"),
        ("\n1,0.010000,0.000000", "\n1,0.010000,0.300000", ":9: anna: found a quaternion of length 1.04"),
        ("\n1,0.010000,0.000000", "\n1.5,0.010000,0.000000", ":9: Frame: expected a whole number"),
        ("\n2,0.020000,0.000000", "\n1,0.020000,0.000000", ":10: Frame: found 1 after 1"),
        ("\n2,0.020000,0.000000", "\n2,,0.000000", ":10: Time: found nothing"),
        ("\n2,0.020000,0.000000", "\n2,1e300,0.000000", ":10: Time: found 1e+300"),
        ("\n2,0.020000,0.000000", "\n2,0.020000,left", ":10: could not convert string to float: 'left'"),
        ("\n2,0.020000,0.000000", "\n2,0.020000,inf", ":10: found an infinite number"),
        ("\n2,0.020000,0.000000", "\n2,0.020000", ":10: found 12 cells; expected 13"),
    ],
)
def test_a_damaged_file_is_named_with_its_line(before: str, after: str, found: str, tmp_path: Path) -> None:
    path = motive_file(tmp_path / "take.csv", ANNA)
    assert refusal(MotiveClip.read, path, before, after).startswith(f"{path}{found}")
