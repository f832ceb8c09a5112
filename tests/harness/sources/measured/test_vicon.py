"""Vicon Tracker's CSV: names, other sections, and exports that cannot be read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.sources.measured.vicon import ViconClip
from tests.disk import write_text
from tests.measured import pose, refusal, vicon_file
from vfoa.errors import VfoaError

ANNA = {"anna": pose([0.5, 0, 1.6])}


def test_names_are_those_of_objects_unless_segments_differ(tmp_path: Path) -> None:
    path = vicon_file(tmp_path / "take.csv", {"anna": ANNA["anna"], "robot": ANNA["anna"]})
    path.write_text(
        path.read_text().replace("robot:robot", "robot:head").replace("Global Angle (Quaternion) anna", "anna")
    )
    assert [*ViconClip.read(path).poses] == ["anna", "robot:head"]


def test_another_section_ends_the_frames_and_a_last_comma_does_not_count(tmp_path: Path) -> None:
    path = vicon_file(tmp_path / "take.csv", ANNA, rate="50")
    path.write_text(path.read_text().replace("1600.000000\n", "1600.000000,\n") + "\nMarkers\n50\n,,anna:1,,\n")
    take = ViconClip.read(path)
    assert ([*take.numbers], [*take.times_ns]) == ([1, 2, 3], [0, 20_000_000, 40_000_000])


@pytest.mark.parametrize("title", ["Trajectories", "Joints"])
def test_other_data_of_vicon_are_named(title: str, tmp_path: Path) -> None:
    text = f"{title}\n100\n,,anna:LFHD,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n1,0,1,2,3\n"
    path = write_text(tmp_path / "walk.csv", text)
    with pytest.raises(VfoaError, match=rf"walk\.csv: found {title} of Vicon; expected Objects"):
        ViconClip.recognise(path, {})
    assert ViconClip.recognise(tmp_path, {}) == ()


def test_zeros_are_a_lost_object(tmp_path: Path) -> None:
    poses = ANNA["anna"].copy()
    poses[1] = 0
    take = ViconClip.read(vicon_file(tmp_path / "take.csv", {"anna": poses}))
    assert np.isnan(take.poses["anna"].places_m[:, 0]).tolist() == [False, True, False]


@pytest.mark.parametrize(
    ("before", "after", "found"),
    [
        ("Objects", "Things", ":1: found 'Things'"),
        ("\n100\n", "\nfast\n", ":2: found 'fast'; expected a number of frames per second"),
        ("RX,RY,RZ,RW,", "RX,RY,RZ,", ":4: anna: found RX,RY,RZ,TX,TY,TZ; expected RX,RY,RZ,RW,TX,TY,TZ"),
        ("Frame,", "Number,", ":4: found other lines above the frames; expected Vicon Tracker's"),
        ("RX,", "X,", ":4: no object"),
        (",mm,mm,mm", ",m,m,m", ":5: anna: found the unit 'm'; expected mm"),
        ("\n2,0,0.000000", "\n2,0,0.300000", ":7: anna: found a quaternion of length 1.04"),
        ("\n2,0,0.000000", "\n2,0,left", ":7: could not convert string to float: 'left'"),
        ("\n2,0,0.000000", "\n2,0", ":7: found 8 cells; expected 9"),
        ("\n2,0,", "\nlast,0,", ":7: could not convert string to float: 'last'"),
    ],
)
def test_a_damaged_file_is_named_with_its_line(before: str, after: str, found: str, tmp_path: Path) -> None:
    path = vicon_file(tmp_path / "take.csv", ANNA)
    assert refusal(ViconClip.read, path, before, after).startswith(f"{path}{found}")
