"""Idiap's tracker: signs by what people are labelled to look at, and lines that are not the tracker's."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.sources.measured.idiap import IdiapClip, head_direction
from tests.measured import idiap_file, open_measured
from vfoa.errors import VfoaError
from vfoa.geometry import angle_between

PLACES = st.tuples(st.floats(-2, 2), st.floats(-1, 1), st.floats(0.3, 4)).map(np.array)


@given(place=PLACES)
def test_without_angles_a_head_looks_into_the_camera(place: np.ndarray) -> None:
    assert angle_between(head_direction(place, 0.0, 0.0), -place) < 1e-7


@given(place=PLACES, tilt=st.floats(-1.2, 1.2), pan=st.floats(-1.5, 1.5))
def test_tilt_turns_up_and_pan_to_the_image_s_left(place: np.ndarray, tilt: float, pan: float) -> None:
    found = head_direction(place, tilt, pan)
    assert np.linalg.norm(found) == pytest.approx(1)
    right = np.cross([0, 1, 0], place)
    assert np.sign(found @ right) == -np.sign(round(pan, 9)) or abs(pan) < 1e-6
    down = np.cross(place, right)
    assert np.sign(found @ down) == -np.sign(round(tilt, 9)) or abs(tilt) < 1e-6


def test_both_of_one_time_are_in_one_frame(tmp_path: Path) -> None:
    clip = open_measured(
        "idiap_vfoa", tmp_path, file=idiap_file(tmp_path, 4).name, objects={"robot": {"center_m": [0, 0, 0]}}
    )
    assert clip.frames == (0, 1, 2, 3)
    assert (clip.people, clip.objects) == ({"1": 1, "2": 2}, {"robot": 3})
    assert all(len(clip.scene(number).people) == 2 for number in clip.frames)


@pytest.mark.parametrize(
    ("line", "place"),
    [
        ("1700000000000000000,1,0,0,0", r"tracker.csv:3: found"),
        ("1700000000000000000,1,0,0,0,0,0,0.1,0.1,1,0,0,up", r"tracker.csv:3: could not convert"),
        ("1700000000000000000,1,0,0,0,0,0,0,0,0,0,0,0", r"tracker.csv:3: expected a finite place"),
        ("1700000000000000000,1,0,0,0,0,0,0.1,0.1,1,0,0,0", r"tracker.csv:3: person '1': occurs twice"),
    ],
)
def test_a_mistake_is_named_with_its_line(tmp_path: Path, line: str, place: str) -> None:
    path = idiap_file(tmp_path, 1)
    path.write_text(path.read_text() + line + "\n")
    with pytest.raises(VfoaError, match=place):
        open_measured("idiap_vfoa", tmp_path, file=path.name)


def test_the_real_heads_point_at_what_they_are_labelled_to_look_at(shared_data: Path) -> None:
    folder = shared_data / "idiap_vfoa"
    (found,) = IdiapClip.recognise(folder, {})
    clip = open_measured("idiap_vfoa", found.root, **found.source)
    with (folder / "labels.csv").open() as file:
        labels = {(int(row["time_ns"]), row["person"]): row["looks_at"] for row in csv.DictReader(file)}
    right = [_nearest(clip, number, person) == labels[clip.time_ns(number), person]
             for number in clip.frames for person in ("1", "2")]  # fmt: skip
    assert (len(right), round(np.mean(right), 2)) == (1060, 0.77)


def _nearest(clip: object, number: int, person: str) -> str:
    """The target nearest in angle to the head's direction."""
    scene = clip.scene(number)  # type: ignore[attr-defined]
    who = clip.people[person]  # type: ignore[attr-defined]
    head = next(each for each in scene.people if each.instance_id == who)
    angles = {
        target.instance.label: float(
            angle_between(head.view.head_pose.direction, target.box.center_m - head.eye_origin_left)
        )
        for target in scene.targets
        if target.instance.id != who
    }
    return {"robot": "robot", "person": "other person"}[min(angles, key=angles.__getitem__)]
