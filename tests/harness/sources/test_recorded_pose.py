"""Recorded pairs whose calibrations are of single cameras: the pose is that of the recording's static transforms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from harness.sources.calibration_files.read import read_cameras
from harness.sources.recordings.clip import BagClip
from harness.sources.recordings.settings import RecordingSettings
from harness.sources.rectification import Rectifier
from tests.calibrations import write_opencv
from tests.depth_recordings import Lens, messages
from tests.disk import HEIGHT, WIDTH, picture
from vfoa.errors import VfoaError

START_NS = 1_700_000_000_000_000_000
LENS = Lens(width=WIDTH, height=HEIGHT, fx=100.0, cx=31.5, cy=23.5, d=(-0.2, 0.05, 0.001, 0.0, 0.0))
TURN = Rotation.from_rotvec([0.01, -0.03, 0.02])
"""x_right = TURN x_left + SHIFT."""
SHIFT = np.array([-0.2, 0.004, 0.002])
BODY = Rotation.from_euler("zyx", [-90, 0, -90], degrees=True)
"""An optical frame in a body's axes, x ahead and z up."""


def _record(
    folder: Path,
    topic: str = "/tf_static",
    *,
    names: tuple[str, str] = ("left", "right"),
    turn: Rotation = TURN,
    shift: np.ndarray = SHIFT,
    image: str = "image_raw",
) -> Path:
    """Two cameras on one body: its frame is the parent of both; that of the left one stands 0.1 m to its left."""
    place = np.array([0.0, 0.1, 0.0])
    of_right = -turn.inv().apply(shift)
    with messages(folder, "bag") as (path, write):
        for side, frame, first in zip(("left", "right"), names, (1, 2), strict=True):
            write.camera(f"/rig/{side}/camera_info", START_NS, LENS, frame)
            write.image(f"/rig/{side}/{image}", START_NS, picture(first), "rgb8", frame)
        write.transform(topic, START_NS, "head", names[0], place, BODY.as_quat())
        write.transform(topic, START_NS, "head", names[1], place + BODY.apply(of_right), (BODY * turn.inv()).as_quat())
    return path


def _open(path: Path, **settings: object) -> BagClip:
    return BagClip(RecordingSettings.model_validate({"recording": path.name, **settings}), path.parent)


def test_the_pair_is_rectified_as_by_a_file_with_this_pose(tmp_path: Path) -> None:
    k = np.array([[100, 0, 31.5], [0, 100, 23.5], [0, 0, 1]], np.float64)
    nodes = {"K1": k, "K2": k, "D1": np.array([LENS.d]), "D2": np.array([LENS.d])}
    nodes |= {"R": TURN.as_matrix(), "T": SHIFT.reshape(3, 1)}
    write_opencv(tmp_path / "stereo.yml", nodes, (WIDTH, HEIGHT))
    cameras = read_cameras([tmp_path / "stereo.yml"], lambda: (WIDTH, HEIGHT))
    expected = Rectifier(cameras)
    clip = _open(_record(tmp_path))
    frame = clip.frame(1)
    left, right = expected.rectify(picture(1), picture(2))
    assert frame.right is not None
    assert frame.rig.baseline_m == pytest.approx(np.linalg.norm(SHIFT))
    np.testing.assert_allclose(frame.left, left, atol=1)
    np.testing.assert_allclose(frame.right, right, atol=1)
    assert any("/tf_static" in note for note in clip.notes)


def test_of_rectified_images_the_baseline_alone_counts(tmp_path: Path) -> None:
    clip = _open(_record(tmp_path, turn=Rotation.identity(), shift=np.array([-0.2, 0, 0]), image="image_rect"))
    frame = clip.frame(1)
    assert frame.rig.baseline_m == pytest.approx(0.2)
    np.testing.assert_array_equal(frame.left, picture(1))


def test_a_given_baseline_counts_before_it(tmp_path: Path) -> None:
    clip = _open(_record(tmp_path), baseline_m=0.3)
    assert clip.frame(1).rig.baseline_m == pytest.approx(0.3)
    assert not any("/tf_static" in note for note in clip.notes)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"topic": "/tf"}, "--baseline METRES"),  # of two arms, which move
        ({"names": ("head_camera", "head_camera")}, "--baseline METRES"),
        ({"image": "image_rect"}, "/tf_static"),  # which are parallel
        ({"shift": np.array([0.2, 0, 0])}, "/tf_static"),
    ],
)
def test_a_pose_that_is_not_known_is_refused(tmp_path: Path, changes: dict[str, object], said: str) -> None:
    path = _record(tmp_path, **changes)  # type: ignore[arg-type]
    with pytest.raises(VfoaError, match=said):
        _open(path).frame(1)
