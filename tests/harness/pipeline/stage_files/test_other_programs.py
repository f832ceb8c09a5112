"""Tables of OpenFace and gaze3d as stage outputs: signs, units, boxes, frames, and other files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from harness.pipeline.stage_files.directions import FileGaze, FileGazeSettings, FileHeadPose, FileHeadPoseSettings
from harness.pipeline.stage_files.heads import FileHeads, FileHeadsSettings
from harness.pipeline.stage_files.other_programs import GAZE3D, check_program, parts_in
from scripts.measure.mirror import frame_of
from tests.disk import write_text
from tests.measured import openface_file
from vfoa.errors import VfoaError
from vfoa.geometry import left_from_crop, pixel_ray
from vfoa.types import Float, Head, Instances, StereoFrame

FRAME = frame_of(np.zeros((480, 640, 3), np.uint8))
NOBODY = Instances(ids=np.zeros((480, 640), np.uint16), instances=())


class AnyClip(NamedTuple):
    """A clip of which only the frame numbers are known: its second frame is FRAME."""

    frames: tuple[int, ...] = (-7, FRAME.index)


def seen(path: Path, frame: StereoFrame = FRAME) -> tuple[Head, ...]:
    settings = FileHeadsSettings(root=str(path.parent), file=path.name)
    return FileHeads(settings, AnyClip()).detect(frame, NOBODY)  # type: ignore[arg-type]


def gaze_of(path: Path, head: Head) -> Float | None:
    settings = FileGazeSettings(root=str(path.parent), file=path.name, heads=path.name)
    found = FileGaze(settings, AnyClip()).estimate(FRAME, head, None)  # type: ignore[arg-type]
    return None if found is None else found.direction


def head_of(path: Path, head: Head) -> Float | None:
    settings = FileHeadPoseSettings(root=str(path.parent), file=path.name, heads=path.name)
    found = FileHeadPose(settings, AnyClip()).estimate(FRAME, head)  # type: ignore[arg-type]
    return None if found is None else found.direction


def openface(folder: Path, *rows: dict[str, Any]) -> Path:
    return openface_file(folder / "faces.csv", rows)


def gaze3d(folder: Path, *rows: Sequence[float]) -> Path:
    """A table as pandas writes it, with floats for boxes, people and frames."""
    lines = [",".join(map(str, map(float, row))) for row in rows]
    return write_text(folder / "film_video_predicted_gaze.csv", "\n".join([",".join(GAZE3D), *lines]) + "\n")


def test_the_nth_frame_of_openface_is_the_nth_of_the_clip_and_directions_are_in_the_camera_frame(
    tmp_path: Path,
) -> None:
    looks = {"gaze_0_x": -0.6, "gaze_0_z": -0.8, "gaze_1_x": -0.6, "gaze_1_z": -0.8}
    path = openface(
        tmp_path,
        {"frame": 1, "box_px": (300, 200, 360, 280)},
        {"frame": 2, "box_px": (100, 200, 160, 280), "pose_Rx": 0.2, **looks},
        {"frame": 2, "box_px": (400, 200, 460, 280), "pose_Ry": 0.3},
    )
    left, right = seen(path)
    assert (left.score, right.score) == (0.98, 0.98)
    np.testing.assert_allclose(left.face_box_px, (100, 180, 160, 280))  # type: ignore[arg-type]
    assert left.box_px[1] < 180
    np.testing.assert_allclose(gaze_of(path, left), (-0.6, 0, -0.8))  # type: ignore[arg-type]
    np.testing.assert_allclose(head_of(path, left), (0, np.sin(0.2), -np.cos(0.2)))  # type: ignore[arg-type]
    np.testing.assert_allclose(head_of(path, right), (-np.sin(0.3), 0, -np.cos(0.3)))  # type: ignore[arg-type]
    assert gaze_of(path, right) is None  # 0, 0, 0
    assert parts_in(path, "openface") == {"heads", "head_pose", "gaze"}


def test_openfaces_landmarks_are_a_heads_eyes_nose_and_mouth(tmp_path: Path) -> None:
    path = openface(tmp_path, {"frame": 2, "box_px": (0, 0, 67, 67)})  # point n is at n, n
    (head,) = seen(path)
    expected = [[mean, mean] for mean in (38.5, 44.5, 30, 48, 54)]
    np.testing.assert_allclose(head.landmarks_px, expected)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("gaze", "expected"),
    [
        ((0, 0, -1), (0, 0, -1)),
        ((0.6, 0, -0.8), (-0.6, 0, -0.8)),  # to the image's left
        ((0, 0.6, -0.8), (0, -0.6, -0.8)),  # up
        ((0, 0, 1), (0, 0, 1)),  # away from the camera
    ],
)
@pytest.mark.parametrize("box", [(299.5, 219.5, 339.5, 259.5), (20, 30, 60, 90)])
def test_gaze3d_looks_as_its_network_saw_the_head_wherever_that_is(
    tmp_path: Path,
    box: tuple[float, float, float, float],
    gaze: tuple[float, float, float],
    expected: tuple[float, float, float],
) -> None:
    path = gaze3d(tmp_path, (*box, 3, 2, *gaze))
    (head,) = seen(path)
    np.testing.assert_allclose(head.box_px, box)
    direction = gaze_of(path, head)
    assert direction is not None
    ray = pixel_ray((box[0] + box[2]) / 2, (box[1] + box[3]) / 2, FRAME.rig)
    np.testing.assert_allclose(direction @ left_from_crop(ray), expected, atol=1e-9)
    assert parts_in(path, "gaze3d") == {"heads", "gaze"}


def test_a_part_that_a_table_lacks_and_a_frame_that_the_clip_lacks_are_named(tmp_path: Path) -> None:
    path = gaze3d(tmp_path, (1, 1, 9, 9, 1, 2, 0, 0, -1))
    (head,) = seen(path)
    with pytest.raises(VfoaError, match=r"predicted_gaze\.csv:1: gaze3d "):
        head_of(path, head)
    late = gaze3d(tmp_path, (1, 1, 9, 9, 1, 2, 0, 0, -1), (1, 1, 9, 9, 1, 3, 0, 0, -1))
    with pytest.raises(VfoaError, match=r"predicted_gaze\.csv:3: frame 3: .*1 to 2"):
        seen(late)
    bare = openface_file(tmp_path / "bare.csv", [{"frame": 2}], points=False)
    with pytest.raises(VfoaError, match=r"bare\.csv:1: .*x_0 to y_67; .*-2Dfp"):
        seen(bare)


def test_the_table_of_another_program_is_refused(tmp_path: Path) -> None:
    path = gaze3d(tmp_path, (1, 1, 9, 9, 1, 2, 0, 0, -1))
    with pytest.raises(VfoaError, match="csv:1: a table of gaze3d"):
        check_program(path, "openface")
    other = write_text(tmp_path / "other.csv", "frame,subject\n")
    with pytest.raises(VfoaError, match=r"other\.csv:1: another table.*gaze3d"):
        check_program(other, "gaze3d")
    with pytest.raises(VfoaError, match=r"none\.csv: no such file.*gaze3d"):
        check_program(tmp_path / "none.csv", "gaze3d")
