"""OpenFace's table: units, axes and signs, what counts as missing, who is who, and lines that are not OpenFace's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from harness.clips.add import add_clip
from harness.sources import MeasuredClip
from harness.sources.measured.openface import head_direction, read_openface
from tests.disk import write_text
from tests.measured import open_measured, openface_file
from vfoa.errors import VfoaError
from vfoa.geometry import angle_between
from vfoa.types import Person

ANGLES = st.floats(-1.5, 1.5)


def opened(folder: Path, rows: Sequence[Mapping[str, Any]], **kinds: bool) -> MeasuredClip:
    return open_measured("openface", folder, file=openface_file(folder / "faces.csv", rows, **kinds).name)


def row(frame: int, x_mm: float = 0, *, face: int = 0, **cells: float) -> dict[str, float]:
    """A face 1 m away."""
    return {"frame": frame, "face_id": face, "timestamp": frame / 25, "pose_Tx": x_mm, "pose_Tz": 1000, **cells}


def only_person(clip: MeasuredClip, number: int) -> Person:
    (person,) = clip.scene(number).people
    return person


@given(rx=ANGLES, ry=ANGLES, rz=ANGLES)
def test_a_head_points_along_minus_z_of_its_rotation_rx_ry_rz(rx: float, ry: float, rz: float) -> None:
    rotation = Rotation.from_euler("XYZ", [rx, ry, rz]).as_matrix()
    np.testing.assert_allclose(head_direction(rx, ry), rotation @ [0, 0, -1], atol=1e-12)


@given(x=st.floats(-1, 1), y=st.floats(-1, 1))
def test_the_mean_gaze_agrees_with_the_columns_of_angles(
    x: float, y: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """``gaze_angle_x`` is atan2(x, -z) and ``gaze_angle_y`` atan2(y, -z) of the mean gaze."""
    gaze = np.array([np.tan(x), np.tan(y), -1]) / np.linalg.norm([np.tan(x), np.tan(y), -1])
    cells = {f"gaze_{eye}_{axis}": value for eye in "01" for axis, value in zip("xyz", gaze, strict=True)}
    clip = opened(tmp_path_factory.mktemp("faces"), [row(1, **cells)])
    found = only_person(clip, 1).view.gaze
    assert found is not None
    angles = np.arctan2(found.direction[:2], -found.direction[2])
    np.testing.assert_allclose(np.degrees(angles), np.degrees([x, y]), atol=0.05)


GENUINE = """\
frame,face_id,timestamp,confidence,success,pose_Tx,pose_Ty,pose_Tz,pose_Rx,pose_Ry,pose_Rz,AU01_r,AU28_c
1,0,0.000,0.98,1,-59.7,16.9,378.7,-0.028,-0.118,-0.015,1.45,0.0
2,0,0.067,0.98,1,-60.3,16.4,381.2,-0.032,-0.114,-0.015,1.26,0.0
"""
"""Two rows of ``processed/default.csv`` of github.com/EmoInfer/EmoInfer @ f4aa3c00, without most action units."""


def test_the_user_of_a_webcam_who_sits_aside_faces_the_camera(tmp_path: Path) -> None:
    write_text(tmp_path / "faces.csv", GENUINE)
    clip = open_measured("openface", tmp_path, file="faces.csv")
    assert clip.rate_hz == pytest.approx(1 / 0.067)
    for number in clip.frames:
        person = only_person(clip, number)
        assert person.view.head_pose is not None
        assert person.eye_origin_left is not None
        off_rad = angle_between(person.view.head_pose.direction, -person.eye_origin_left)
        assert np.degrees(off_rad) < 3.5  # with rx or ry the other way round, more than 4.5 and 15


WITH_GAZE = """\
frame, timestamp, confidence, success, gaze_0_x, gaze_0_y, gaze_0_z, gaze_1_x, gaze_1_y, gaze_1_z, pose_Tx, pose_Ty, \
pose_Tz, pose_Rx, pose_Ry, pose_Rz, X_36, X_39, X_42, X_45, Y_36, Y_39, Y_42, Y_45, Z_36, Z_39, Z_42, Z_45
1,0,0.883333,1,0.109059,0.062474,-0.99207,-0.124401,0.0663107,-0.990014,16.6573,43.4571,597.876,0.29759,-0.063753,\
-0.0192347,-30.567,-3.64614,35.2282,61.5252,8.3981,10.5156,9.04537,5.54248,598.456,591.757,594.332,603.426
2,0.001,0.883333,1,0.110256,0.0653561,-0.991752,-0.123464,0.0699788,-0.989879,16.2613,43.2594,596.885,0.326858,\
-0.0580382,-0.0220719,-30.7544,-4.09644,34.6655,60.7833,8.42604,10.6319,9.0432,5.45043,596.183,589.549,592.15,600.839
"""
"""Two rows of ``feat/tests/data/OpenFace_Test.csv`` of github.com/cosanlab/py-feat @ d84c8003, with few landmarks."""
MOUTH_MM = np.array([[-6.859, 79.4661, 604.331], [42.6169, 79.3959, 609.636]])
"""Landmarks 48 and 54 of its first row."""


def test_a_genuine_gaze_and_head_agree_with_the_landmarks_beside_them(tmp_path: Path) -> None:
    """Somebody who looks at the camera, with the head down; the stamps are those of a thousand frames per second."""
    write_text(tmp_path / "faces.csv", WITH_GAZE)
    with pytest.raises(VfoaError, match=r"faces\.csv: timestamp: found 1000 frames per second; expected rate_hz in"):
        open_measured("openface", tmp_path, file="faces.csv")
    clip = open_measured("openface", tmp_path, file="faces.csv", rate_hz=30.0)
    person = only_person(clip, 1)
    assert person.view.head_pose is not None
    assert person.view.gaze is not None
    (_, *first), *_ = np.genfromtxt(tmp_path / "faces.csv", delimiter=",", skip_header=1)
    eyes = np.array(first[-12:]).reshape(3, 4).T
    outer, down = eyes[3] - eyes[0], MOUTH_MM.mean(axis=0) - (eyes[0] + eyes[3]) / 2
    out_of_the_face = np.cross(down, outer) / np.linalg.norm(np.cross(down, outer))
    off_deg = [
        np.degrees(angle_between(out_of_the_face, head_direction(rx, ry)))
        for rx, ry in ((0.29759, -0.063753), (0.29759, 0.063753), (-0.29759, -0.063753), (-0.29759, 0.063753))
    ]
    assert np.argmin(off_deg) == 0
    assert off_deg[0] < 13
    np.testing.assert_allclose(person.view.head_pose.direction, head_direction(0.29759, -0.063753))
    assert np.degrees(angle_between(person.view.gaze.direction, -eyes.mean(axis=0))) < 5


@pytest.mark.parametrize("old", [False, True])
def test_places_are_metres_and_eyes_those_of_the_landmarks(tmp_path: Path, old: bool) -> None:
    rows = [row(1, 250, pose_Ty=40, pose_Ry=0.5, eyes_mm=(245, 10, 990)), row(2, 250)]
    clip = opened(tmp_path, rows, old=old)
    person = only_person(clip, 1)
    assert person.eye_origin_left is not None
    assert person.view.head_pose is not None
    np.testing.assert_allclose(person.eye_origin_left, (0.245, 0.01, 0.99))
    np.testing.assert_allclose(person.view.head_pose.direction, (-np.sin(0.5), 0, -np.cos(0.5)))
    assert person.view.gaze is None  # 0, 0, 0: not found
    assert (clip.rate_hz, clip.notes) == (pytest.approx(25), ())


def test_without_3d_landmarks_eyes_are_at_the_head_and_a_note_says_so(tmp_path: Path) -> None:
    clip = opened(tmp_path, [row(1, 250)], points=False)
    np.testing.assert_allclose(only_person(clip, 1).eye_origin_left, (0.25, 0, 1))  # type: ignore[arg-type]
    assert "-3Dfp" in clip.notes[0]


def test_what_openface_did_not_find_is_missing_and_its_frame_stays(tmp_path: Path) -> None:
    rows = [row(1), row(2, success=0), row(3, confidence=0.79), row(4, confidence=0.8), row(7, gaze_0_z=-1)]
    clip = opened(tmp_path, rows)
    assert clip.frames == (1, 2, 3, 4, 5, 6, 7)
    assert [len(clip.scene(number).people) for number in clip.frames] == [1, 0, 0, 1, 0, 0, 1]
    gaze = only_person(clip, 7).view.gaze
    assert gaze is not None  # of the one eye that has one
    np.testing.assert_allclose(gaze.direction, (0, 0, -1))
    assert np.diff([clip.time_ns(number) for number in clip.frames]) == pytest.approx(4e7)


@pytest.mark.parametrize("rows", [[], [row(1, success=0), row(2, confidence=0.5)]])
def test_a_table_without_a_face_that_counts_is_refused(tmp_path: Path, rows: list[dict[str, float]]) -> None:
    with pytest.raises(VfoaError, match=r"faces\.csv: no row .*success 1 .*0\.8"):
        opened(tmp_path, rows)


def test_people_are_told_by_place_and_not_by_the_number_of_the_face(tmp_path: Path) -> None:
    rows = [
        *(row(1, 400, face=0), row(1, -400, face=1)),
        *(row(2, -380, face=0), row(2, 390, face=1)),  # numbers exchanged
        row(3, 380, face=5),  # the left one is hidden
        *(row(4, -370, face=6), row(4, 0, face=7), row(4, 380, face=8)),  # somebody comes
    ]
    clip = opened(tmp_path, rows)
    assert clip.people == {"person_1": 1, "person_2": 2, "person_3": 3}
    places = [
        {person.instance_id: round(person.eye_origin_left[0], 2) for person in clip.scene(number).people}  # type: ignore[index]
        for number in clip.frames
    ]
    assert places == [{1: -0.4, 2: 0.4}, {1: -0.38, 2: 0.39}, {2: 0.38}, {1: -0.37, 2: 0.38, 3: 0.0}]


def test_one_face_in_every_frame_is_one_person_wherever_it_is(tmp_path: Path) -> None:
    assert opened(tmp_path, [row(1, -900), row(2, success=0), row(3, 900)]).people == {"person_1": 1}


def test_stamps_that_do_not_ascend_ask_for_the_rate_which_replaces_them(tmp_path: Path) -> None:
    rows = [row(number, timestamp=0) for number in (1, 2, 3)]
    with pytest.raises(VfoaError, match=r"faces\.csv: timestamp: .*rate_hz in"):
        opened(tmp_path, rows)
    clip = open_measured("openface", tmp_path, file="faces.csv", rate_hz=50.0)
    assert [clip.time_ns(number) for number in clip.frames] == [0, 20_000_000, 40_000_000]


@pytest.mark.parametrize("number", [9_000_000, 10**20])
def test_a_frame_number_far_from_all_others_is_refused(number: int, tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=rf"faces\.csv: frame: .*{number}.*1,000,000"):
        opened(tmp_path, [row(1), {**row(number), "timestamp": 9}])


def test_a_table_that_a_spreadsheet_marked_as_utf_8_is_read(tmp_path: Path) -> None:
    path = openface_file(tmp_path / "faces.csv", [row(1)])
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert open_measured("openface", tmp_path, file="faces.csv").frames == (1,)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("0.98,1,", "0.98,yes,"), r"faces\.csv:2: .*'yes'"),
        (("0.98,1,", "0.98,1,7,"), r"faces\.csv:2: found \d+ cells.* \d+,"),
        (("1000,", "nan,"), r"faces\.csv:2: pose_Tx, pose_Ty, pose_Tz"),
        (("pose_Rx", "pose_rx"), r"faces\.csv:1: .*'pose_Rx'.*-pose"),
    ],
)
def test_a_mistake_is_named_with_its_line(tmp_path: Path, change: tuple[str, str], said: str) -> None:
    path = openface_file(tmp_path / "faces.csv", [row(1)], points=False)
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(VfoaError, match=said):
        read_openface(path)


def test_a_table_is_added_and_a_table_of_one_image_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = openface_file(tmp_path / "talk.csv", [row(1, 400), row(1, -400), row(2, -400), row(2, 400)])
    added = add_clip(path, source={"objects": {"screen": {"center_m": [0, 0, 0]}}})
    assert (added.name, added.adapter, added.frames) == ("talk", "openface", 2)
    assert (added.subjects, added.targets) == (("person_1", "person_2"), ("screen",))
    path.write_text(path.read_text().replace("frame,face_id,timestamp,confidence,success", "face,confidence", 1))
    with pytest.raises(VfoaError, match=r"talk\.csv:1: .*-fdir FOLDER"):
        add_clip(path, name="other")
