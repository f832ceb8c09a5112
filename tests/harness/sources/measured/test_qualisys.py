"""QTM's TSV: the order of the matrix, files without times, and exports that cannot be read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from harness.clips.add import add_clip
from harness.sources.measured.qualisys import QualisysClip
from tests.measured import pose, qualisys_file, refusal
from vfoa.errors import VfoaError

ANNA = {"anna": pose([0.5, 0, 1.6])}
_ABOVE = "NO_OF_FRAMES\t1\nFREQUENCY\t100\nDATA_INCLUDED\t6D\nBODY_NAMES\tPSVH\n"
_COLUMNS = (
    "Frame Time PSVH_X Y Z Roll Pitch Yaw Residual Rot[0] Rot[1] Rot[2] Rot[3] Rot[4] Rot[5] Rot[6] Rot[7] Rot[8]"
)
_ROW = (
    "1 0.00000 -194.91974 2.24150 0.99661 -0.65630 0.09391 0.05772 4.98536 "
    "1.00000 0.00099 -0.00165 -0.00101 0.99993 -0.01145 0.00164 0.01145 0.99993"
)
GENUINE = "".join([_ABOVE, *(f"{line} \n".replace(" ", "\t").replace("_", " ") for line in (_COLUMNS, _ROW))])
"""The first frame of a file that QTM wrote."""


def test_the_matrix_goes_down_its_columns(tmp_path: Path) -> None:
    """QTM's angles of the same row, in its standard definition: about x, then the new y, then the new z."""
    path = tmp_path / "take.tsv"
    path.write_text(GENUINE)
    poses = QualisysClip.read(path).poses["PSVH"]
    by_angles = Rotation.from_euler("XYZ", [-0.65630, 0.09391, 0.05772], degrees=True).as_matrix()
    np.testing.assert_allclose(poses.rotations[0], by_angles, atol=2e-5)
    np.testing.assert_allclose(poses.places_m[0], [-0.19491974, 0.0022415, 0.00099661])


def test_a_matrix_of_zeros_is_a_lost_body(tmp_path: Path) -> None:
    path = tmp_path / "take.tsv"
    *above, row = GENUINE.splitlines()
    lost = "\t".join(["2", "0.01000", *["0.00000"] * 16, ""])
    path.write_text("\n".join([*above, row, lost]) + "\n")
    assert np.isnan(QualisysClip.read(path).poses["PSVH"].places_m).tolist() == [[False] * 3, [True] * 3]


def test_without_times_the_frequency_counts(tmp_path: Path) -> None:
    take = QualisysClip.read(qualisys_file(tmp_path / "take.tsv", ANNA, times=False, FREQUENCY="50"), every=2)
    assert ([*take.numbers], [*take.times_ns]) == ([1, 3], [0, 40_000_000])


def test_markers_alone_are_refused(tmp_path: Path) -> None:
    with pytest.raises(VfoaError) as refused:
        add_clip(qualisys_file(tmp_path / "take.tsv", ANNA, DATA_INCLUDED="3D"))
    assert "DATA_INCLUDED: found '3D'; expected 6D" in str(refused.value)


@pytest.mark.parametrize(
    ("before", "after", "found"),
    [
        ("Rot[0]", "R[0]", ": no line with the names of columns"),
        ("anna X", "X", ": no rigid body"),
        ("\tRot[5]", "\tR", ": anna: no column 'Rot[5]'"),
        ("\n2\t0.01000\t", "\n2\t0.01000\tleft", ":7: could not convert string to float: 'left500.00000'"),
        ("\n2\t0.01000\t500.00000\t", "\n2\t0.01000\t", ":7: found 18 cells; expected 19"),
        ("\n2\t0.01000\t", "\n2\t\t", ":7: Time: found nothing"),
        ("\t0.40000\t1.00000\t", "\t0.40000\t-1.00000\t", ":6: anna: Rot[0] to Rot[8]: expected a rotation"),
    ],
)
def test_a_damaged_file_is_named_with_its_line(before: str, after: str, found: str, tmp_path: Path) -> None:
    path = qualisys_file(tmp_path / "take.tsv", ANNA)
    assert refusal(QualisysClip.read, path, before, after).startswith(f"{path}{found}")


def test_a_file_without_times_and_frequency_is_refused(tmp_path: Path) -> None:
    with pytest.raises(VfoaError) as refused:
        QualisysClip.read(qualisys_file(tmp_path / "take.tsv", ANNA, times=False, FREQUENCY="EXT"))
    assert "FREQUENCY: found 'EXT'" in str(refused.value)
