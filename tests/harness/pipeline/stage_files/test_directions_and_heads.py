"""Outputs of other programs: every format is read strictly, and a run from files is the run that wrote them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.pipeline.stage_files.directions import FileGaze, FileGazeSettings, FileHeadPose, FileHeadPoseSettings
from harness.pipeline.stage_files.heads import FileHeads, FileHeadsSettings, HeadTable, read_heads
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.run.table_records import read_records
from scripts.measure.mirror import frame_of
from scripts.measure.stage_outputs import write_gazes, write_head_poses, write_heads
from tests.disk import write_text
from tests.stage_outputs import save_stage_outputs
from vfoa.errors import VfoaError
from vfoa.geometry import pixel_ray
from vfoa.types import Gaze, Head, HeadPose, Instances

DEFAULTS = """
clips = ["studio_table"]
[[configuration]]
name = "cones"
"""
STUDIO = f"""{DEFAULTS}
stereo = {{ matcher = "bm", min_depth_m = 0.8, wls = false }}
segmentation.model = "truth"
heads.detector = "truth"
head_pose.model = "simulated"
gaze.model = "simulated"
"""
FILES = f"""{DEFAULTS}
stereo = {{ matcher = "files", root = "${{VFOA_OUT}}/${{CLIP}}", pattern = "disparity/frame_%04d.npy", partial = true }}
segmentation = {{ model = "coco_panoptic", root = "${{VFOA_OUT}}/${{CLIP}}", stuff = "all", partial = true }}
heads = {{ detector = "files", root = "${{VFOA_OUT}}/${{CLIP}}" }}
head_pose = {{ model = "files", root = "${{VFOA_OUT}}/${{CLIP}}" }}
gaze = {{ model = "files", root = "${{VFOA_OUT}}/${{CLIP}}" }}
"""

HEADS = "frame,subject,u0_px,v0_px,u1_px,v1_px\n"
FRAME = frame_of(np.zeros((48, 64, 3), np.uint8))
NOBODY = Instances(ids=np.zeros((48, 64), np.uint16), instances=())
LEFT, RIGHT = np.array([4.0, 4, 16, 20]), np.array([40.0, 8, 60, 30])


class AnyClip(NamedTuple):
    """A clip of which only the frame numbers are known."""

    frames: tuple[int, ...] = (FRAME.index, 70, 71)


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The outputs of two frames of STUDIO, in a folder that FILES names by a variable."""
    (configuration,) = load_experiment(str(write_text(tmp_path / "studio.toml", STUDIO))).configurations
    write_text(tmp_path / "files.toml", FILES)
    monkeypatch.setenv("VFOA_OUT", str(tmp_path / "out"))
    return save_stage_outputs(tmp_path / "out" / "studio_table", "studio_table", configuration, (1, 2))


def _run(experiment: Path, limit: int) -> RunDirectory:
    plan = prepare(load_experiment(str(experiment)), limit=limit)
    return run_plan(plan, experiment.with_suffix(".run"), workers=1, progress=lambda clip: None)


def test_a_run_from_files_is_the_run_that_computed_them(files: Path, tmp_path: Path) -> None:
    computed, read = (_run(tmp_path / f"{name}.toml", 2).read_manifest().run_id for name in ("studio", "files"))
    assert computed != read
    records = [list(read_records(RunDirectory(tmp_path / f"{name}.run"))) for name in ("files", "studio")]
    assert len(records[0]) == 2
    assert records[0] == records[1]


def test_a_frame_without_a_file_is_told_when_it_is_read(files: Path, tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"no annotation for frame 3|frame_0003"):
        _run(tmp_path / "files.toml", 3)


def test_a_finished_run_is_not_taken_over_when_a_file_has_changed(files: Path, tmp_path: Path) -> None:
    finished = _run(tmp_path / "files.toml", 1).read_manifest().finished
    assert _run(tmp_path / "files.toml", 1).read_manifest().finished == finished
    table = files / "gaze.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:-1]))
    with pytest.raises(VfoaError, match=r"\(different: stage_outputs_sha256 of"):
        _run(tmp_path / "files.toml", 1)


numbers = st.floats(-1e6, 1e6, allow_nan=False)
angles = st.floats(-math.pi, math.pi)


@given(
    corner=st.tuples(numbers, numbers),
    size=st.tuples(st.floats(1, 1e4), st.floats(1, 1e4)),
    score=st.floats(0, 1),
    landmarks=st.none() | st.lists(numbers, min_size=10, max_size=10),
    instance=st.none() | st.integers(1, 65535),
)
def test_heads_are_read_back_to_the_last_bit(
    tmp_path: Path,
    corner: tuple[float, float],
    size: tuple[float, float],
    score: float,
    landmarks: list[float] | None,
    instance: int | None,
) -> None:
    box = np.array([*corner, corner[0] + size[0], corner[1] + size[1]])
    head = Head(
        box_px=box,
        score=score,
        face_box_px=None if landmarks is None else box,
        landmarks_px=None if landmarks is None else np.array(landmarks).reshape(5, 2),
        instance_id=instance,
    )
    write_heads(tmp_path / "heads.csv", [(70, "anna, the first", head)])
    found = read_heads(tmp_path / "heads.csv", AnyClip()).of(70)["anna, the first"]  # type: ignore[arg-type]
    assert np.array_equal(found.box_px, head.box_px)
    assert (found.score, found.instance_id) == (head.score, head.instance_id)
    for name in ("face_box_px", "landmarks_px"):
        one, other = getattr(found, name), getattr(head, name)
        assert (one is None and other is None) or np.array_equal(one, other)


@given(
    vector=st.tuples(*[st.floats(-9, 9)] * 3).filter(lambda v: math.hypot(*v) > 1e-3),
    model=st.none() | st.tuples(angles, angles, angles),
    sigma=st.none() | st.floats(0, 3),
)
def test_directions_are_read_back_to_the_last_bit(
    tmp_path: Path, vector: tuple[float, float, float], model: tuple[float, float, float] | None, sigma: float | None
) -> None:
    _heads(tmp_path)
    gaze = Gaze(direction=np.array(vector), sigma_rad=sigma)
    yaw, pitch, roll = model or (math.nan,) * 3
    pose = HeadPose(direction=np.array(vector), yaw_rad=yaw, pitch_rad=pitch, roll_rad=roll, sigma_rad=sigma)
    write_gazes(tmp_path / "gaze.csv", [(FRAME.index, "ben", gaze)])
    write_head_poses(tmp_path / "head_pose.csv", [(FRAME.index, "ben", pose)])
    head = Head(box_px=RIGHT, score=0.5)
    found_gaze, found_pose = _gaze(tmp_path).estimate(FRAME, head, None), _pose(tmp_path).estimate(FRAME, head)
    assert found_gaze is not None
    assert found_pose is not None
    assert np.array_equal(found_gaze.direction, gaze.direction)
    assert np.array_equal(found_pose.direction, pose.direction)
    assert found_gaze.sigma_rad == found_pose.sigma_rad == sigma
    assert [found_pose.yaw_rad, found_pose.pitch_rad, found_pose.roll_rad] == pytest.approx(
        [yaw, pitch, roll], abs=0, rel=0, nan_ok=True
    )


def test_a_direction_goes_to_the_head_whose_box_overlaps_its_subjects_most(tmp_path: Path) -> None:
    _heads(tmp_path)
    write_text(tmp_path / "gaze.csv", f"frame,subject,x,y,z\n{FRAME.index},ben,1,0,0\n{FRAME.index},anna,0,1,0\n")
    gaze = _gaze(tmp_path)
    for box, direction in ((RIGHT + 1, (1, 0, 0)), (LEFT - 1, (0, 1, 0))):
        found = gaze.estimate(FRAME, Head(box_px=box, score=1.0), None)
        assert found is not None
        assert found.direction.tolist() == list(direction)
    assert gaze.estimate(FRAME, Head(box_px=LEFT + 17, score=1.0), None) is None


def test_angles_of_zero_look_into_the_camera_and_positive_ones_to_the_images_left_and_up(tmp_path: Path) -> None:
    _heads(tmp_path)
    ray = pixel_ray(50, 19, FRAME.rig)  # the middle of ben's box
    pose, gaze = "frame,subject,yaw_deg,pitch_deg,roll_deg\n", "frame,subject,theta_deg,phi_deg,sigma_deg\n"
    key = f"{FRAME.index},ben"
    head = Head(box_px=RIGHT, score=1.0)

    def directions(yaw: float, pitch: float) -> list[np.ndarray]:
        write_text(tmp_path / "head_pose.csv", f"{pose}{key},{yaw},{pitch},0\n")
        write_text(tmp_path / "gaze.csv", f"{gaze}{key},{yaw},{pitch},180\n")
        found = [_pose(tmp_path).estimate(FRAME, head), _gaze(tmp_path).estimate(FRAME, head, None)]
        assert found[1] is not None
        assert found[1].sigma_rad == pytest.approx(math.pi)
        return [each.direction for each in found if each is not None]

    for straight, left, up in zip(directions(0, 0), directions(20, 0), directions(0, 20), strict=True):
        assert straight == pytest.approx(-ray)
        assert left[0] < straight[0]
        assert up[1] < straight[1]
        assert left @ straight == pytest.approx(math.cos(math.radians(20)))
        assert up @ straight == pytest.approx(math.cos(math.radians(20)))


def test_a_face_is_where_angles_are_seen(tmp_path: Path) -> None:
    columns = "frame,subject,u0_px,v0_px,u1_px,v1_px,face_u0_px,face_v0_px,face_u1_px,face_v1_px"
    write_text(tmp_path / "heads.csv", f"{columns}\n{FRAME.index},ben,40,8,60,30,46,20,56,30\n")
    write_text(tmp_path / "gaze.csv", f"frame,subject,theta_deg,phi_deg\n{FRAME.index},ben,0,0\n")
    found = _gaze(tmp_path).estimate(FRAME, Head(box_px=RIGHT, score=1.0), None)
    assert found is not None
    assert found.direction == pytest.approx(-pixel_ray(51, 25, FRAME.rig))


def test_frames_may_be_the_names_of_images(tmp_path: Path) -> None:
    """As a script that runs on the exported images has them."""
    rows = [f"out/left/{n:05d}.png,{name},{n},2,{n + 9},4\n" for n in (70, 71) for name in ("anna", "ben")]
    clip = _written(tmp_path / "heads.csv", HEADS + "".join(rows))
    found = read_heads(tmp_path / "heads.csv", clip)
    assert {name: head.box_px[0] for name, head in found.of(70).items()} == {"anna": 70, "ben": 70}
    assert [head.box_px[0] for head in found.of(71).values()] == [71, 71]
    write_text(tmp_path / "gaze.csv", "frame,subject,theta_deg,phi_deg\n00070.png,anna,0,0\n")
    gaze = FileGaze(FileGazeSettings(root=str(tmp_path)), clip)
    head = Head(box_px=np.array([70.0, 2, 79, 4]), score=1.0)
    estimates = [gaze.estimate(replace(FRAME, index=number), head, None) for number in (70, 71)]
    assert [estimate is not None for estimate in estimates] == [True, False]


def test_pictures_that_ffmpeg_counts_from_1_are_the_frames_of_a_film(tmp_path: Path) -> None:
    rows = [f"{n:04d}.png,ben,{n},2,{n + 9},4\n" for n in (2, 3)]
    table = HeadTable(write_text(tmp_path / "heads.csv", HEADS + "".join(rows)), range(3))
    assert [[head.box_px[0] for head in table.of(frame).values()] for frame in range(3)] == [[], [2], [3]]


def test_heads_come_in_the_order_of_their_rows_and_a_frame_without_rows_has_none(tmp_path: Path) -> None:
    _heads(tmp_path)
    heads = FileHeads(FileHeadsSettings(root=str(tmp_path)), AnyClip())  # type: ignore[arg-type]
    found = heads.detect(FRAME, NOBODY)
    assert [each.box_px.tolist() for each in found] == [RIGHT.tolist(), LEFT.tolist()]
    assert [each.score for each in found] == [1.0, 1.0]
    empty = FileHeads(FileHeadsSettings(root=str(tmp_path), file="none.csv"), _written(tmp_path / "none.csv", HEADS))
    assert empty.detect(FRAME, NOBODY) == ()


@pytest.mark.parametrize(
    ("factor", "moved_px", "is_taken"),
    [(1, 0, True), (3, 0, False), (1, -FRAME.rig.width_px, False), (1, 0.4 * FRAME.rig.width_px, True)],
)
def test_heads_of_larger_pictures_or_of_two_views_are_refused(
    factor: float, moved_px: float, is_taken: bool, tmp_path: Path
) -> None:
    width, height = FRAME.rig.width_px, FRAME.rig.height_px
    left = np.array([0.5 * width, 0.4 * height, 0.7 * width, 0.6 * height])
    boxes = {"left": factor * left, "right": factor * left + [moved_px, 0, moved_px, 0]}
    rows = (f"{FRAME.index},{name},{','.join(map(str, box.tolist()))}\n" for name, box in boxes.items())
    clip = _written(tmp_path / "heads.csv", HEADS + "".join(rows))
    detector = FileHeads(FileHeadsSettings(root=str(tmp_path)), clip)
    if is_taken:
        assert len(detector.detect(FRAME, NOBODY)) == 2
    else:
        with pytest.raises(VfoaError, match=rf"heads\.csv:[23]: .* of 2 heads outside .* {width} x {height}"):
            detector.detect(FRAME, NOBODY)


@pytest.mark.parametrize("swapped", [0, 2, 3])
def test_eyes_that_are_left_and_right_in_the_image_are_refused(swapped: int, tmp_path: Path) -> None:
    eyes = np.array([[10.0, 12], [18, 12], [14, 16], [11, 20], [17, 20]])  # the person's own right one first
    others = eyes[[1, 0, 2, 4, 3]]  # as MTCNN names them
    rows = [
        (70, f"p{number}", Head(box_px=LEFT, score=1.0, landmarks_px=others if number < swapped else eyes))
        for number in range(5)
    ]
    write_heads(tmp_path / "heads.csv", rows)
    if swapped < 3:
        FileHeads(FileHeadsSettings(root=str(tmp_path)), AnyClip())  # type: ignore[arg-type]
        return
    with pytest.raises(VfoaError, match=r"heads\.csv:2: right_eye_u_px: .* 3 of 5 faces"):
        FileHeads(FileHeadsSettings(root=str(tmp_path)), AnyClip())  # type: ignore[arg-type]


@pytest.mark.parametrize("part", ["face_box_px", "landmarks_px"])
def test_faces_in_other_pixels_than_their_heads_are_refused(part: str, tmp_path: Path) -> None:
    """Such as landmarks in shares of the image, or in pixels of the head's crop."""
    u0, v0, u1, v1 = RIGHT
    middle = np.array([(u0 + u1) / 2, (v0 + v1) / 2])
    face = np.array([*(middle - 3), *(middle + 3)])
    points = middle + np.array([[-2.0, -1], [2, -1], [0, 0], [-1, 2], [1, 2]])
    own = {"face_box_px": face, "landmarks_px": points}[part]
    for moved in (own, own / 64):
        head = Head(box_px=RIGHT, score=1.0, **{part: moved})
        write_heads(tmp_path / "heads.csv", [(70, f"p{number}", head) for number in range(5)])
        if moved is own:
            FileHeads(FileHeadsSettings(root=str(tmp_path)), AnyClip())  # type: ignore[arg-type]
        else:
            with pytest.raises(VfoaError, match=r"heads\.csv:2: .*outside of the head's box in 5 of 5 faces"):
                FileHeads(FileHeadsSettings(root=str(tmp_path)), AnyClip())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", r"heads\.csv:1: .*frame,subject"),
        ("frame,subject,u0px\n", r"heads\.csv:1: .*'u0px'.*'u0_px'"),
        ("frame,u0_px\n", r"heads\.csv:1: no column 'subject'"),
        ("frame,subject,frame\n", r"heads\.csv:1: .*'frame' .*twice"),
        (HEADS + "70,a,1,2,3\n", r"heads\.csv:2: found 5 cells; expected 6"),
        (HEADS + "\n69,a,1,2,3,4\n", r"heads\.csv:3: frame 69: not in the clip"),
        (HEADS + "7.5,a,1,2,3,4\n", r"heads\.csv:2: frame: .*found '7\.5'"),
        (HEADS + "70,,1,2,3,4\n", r"heads\.csv:2: subject: found nothing"),
        (HEADS + "70,a,1,2,3,4\n70,a,1,2,3,4\n", r"heads\.csv:3: frame 70, subject 'a': .*:2"),
        (HEADS + "70,a,1,2,x,4\n", r"heads\.csv:2: u1_px: .*found 'x'"),
        (HEADS + "70,a,1,2,nan,4\n", r"heads\.csv:2: u1_px: found 'nan'"),
        (HEADS + "70,a,1,2,1e999,4\n", r"heads\.csv:2: u1_px: .*finite"),
        (HEADS + "70,a,1,2,,4\n", r"heads\.csv:2: u1_px: found nothing"),
        (HEADS + "70,a,,,,\n", r"heads\.csv:2: no box"),
        (HEADS + "70,a,3,2,1,4\n", r"heads\.csv:2: u0_px, v0_px, u1_px, v1_px"),
        (HEADS + "70,a,0.1,0.2,0.3,0.4\n70,b,0,0.2,0.3,1\n", r"heads\.csv: u0_px, .* from 0 to 1; expected pixels"),
        (HEADS + '70,"a,1,2,3,4\n', r"heads\.csv:2: not CSV"),
        (
            "frame,subject,u0_px,v0_px,u1_px,v1_px,instance_id\n70,a,1,2,3,4,0\n",
            r":2: instance_id: expected 1 to 65535",
        ),
    ],
)
def test_a_mistake_in_the_heads_is_one_line_with_its_place(text: str, line: str, tmp_path: Path) -> None:
    clip = _written(tmp_path / "heads.csv", text)
    with pytest.raises(VfoaError, match=line) as error:
        FileHeads(FileHeadsSettings(root=str(tmp_path)), clip)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("x,y,z\n70,cleo,0,0,1\n", r"gaze\.csv:2: .*'cleo' .*70 of .*heads\.csv"),
        ("x,y,z\n70,anna,0,0,2\n", r"gaze\.csv:2: x, y, z: .*length 2"),
        ("x,y,z\n70,anna,,,\n", r"gaze\.csv:2: no direction"),
        ("theta_rad,phi_rad\n70,anna,0.3,-12\n", r"gaze\.csv:2: theta_rad, phi_rad: .* -12"),
        ("theta_deg,phi_deg\n70,anna,3,\n", r"gaze\.csv:2: phi_deg: found nothing"),
        ("x,y,z,theta_deg,phi_deg\n70,anna,0,0,1,3,4\n", r"gaze\.csv:2: .*x, y, z and theta, phi"),
        ("theta_deg,phi_deg,theta_rad,phi_rad\n70,anna,1,1,1,1\n", r"gaze\.csv:2: theta: .*radians"),
        ("x,y,z,sigma_deg\n70,anna,0,0,1,-1\n", r"gaze\.csv:2: sigma: "),
        ("x,y,z,yaw_deg\n", r"gaze\.csv:1: no column 'yaw_deg' here"),
    ],
)
def test_a_mistake_in_the_gazes_is_found_before_the_first_frame(text: str, line: str, tmp_path: Path) -> None:
    _heads(tmp_path)
    write_text(tmp_path / "gaze.csv", f"frame,subject,{text}")
    with pytest.raises(VfoaError, match=line) as error:
        _gaze(tmp_path)
    assert "\n" not in str(error.value)


def test_claimed_errors_in_radians_that_are_called_degrees_are_refused(tmp_path: Path) -> None:
    people = [f"p{number}" for number in range(24)]
    write_heads(tmp_path / "heads.csv", [(70, name, Head(box_px=RIGHT, score=1.0)) for name in people])
    for sigma in (0.19, 11.0):
        rows = [f"70,{name},0,0,-1,{sigma}" for name in people]
        write_text(tmp_path / "gaze.csv", "\n".join(["frame,subject,x,y,z,sigma_deg", *rows]) + "\n")
        if sigma > 1:
            _gaze(tmp_path)
        else:
            with pytest.raises(VfoaError, match=r"gaze\.csv: sigma_deg: found at most 0\.19 in 24 rows"):
                _gaze(tmp_path)


@pytest.mark.parametrize(("unit", "most"), [("deg", 0.8), ("deg", 25.0), ("rad", 0.8)])
def test_radians_that_are_called_degrees_are_refused(unit: str, most: float, tmp_path: Path) -> None:
    people = [f"p{number}" for number in range(24)]
    write_heads(tmp_path / "heads.csv", [(70, name, Head(box_px=RIGHT, score=1.0)) for name in people])
    angles = np.linspace(-most, most, len(people))
    rows = [f"70,{name},{angle},{-angle / 2}" for name, angle in zip(people, angles, strict=True)]
    write_text(tmp_path / "gaze.csv", "\n".join([f"frame,subject,theta_{unit},phi_{unit}", *rows]) + "\n")
    if (unit, most) == ("deg", 0.8):
        with pytest.raises(VfoaError, match=r"gaze\.csv: theta_deg, phi_deg: found at most 0\.8 in 24 rows"):
            _gaze(tmp_path)
    else:
        _gaze(tmp_path)


def _heads(root: Path) -> None:
    """Ben at the right and Anna at the left, in two frames."""
    boxes = {"ben": RIGHT, "anna": LEFT}
    rows = [(frame, name, Head(box_px=box, score=1.0)) for frame in (FRAME.index, 70) for name, box in boxes.items()]
    write_heads(root / "heads.csv", rows)


def _gaze(root: Path) -> FileGaze:
    return FileGaze(FileGazeSettings(root=str(root)), AnyClip())  # type: ignore[arg-type]


def _pose(root: Path) -> FileHeadPose:
    return FileHeadPose(FileHeadPoseSettings(root=str(root)), AnyClip())  # type: ignore[arg-type]


def _written(path: Path, text: str) -> AnyClip:
    write_text(path, text)
    return AnyClip()
