"""Ground truth of idiap/vfoa: codes by frame; what does not fit is named."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from harness.labels.formats.exchange import Exchange
from harness.labels.formats.idiap_vfoa import IdiapGroundTruth
from harness.labels.labels import Labels, timeline_of
from harness.sources import MeasuredClip
from tests.exchanges import row
from tests.measured import idiap_file, open_measured
from vfoa.errors import VfoaError

CODES = {"Person 1": [0, 0, 1, 1, 2, 2], "Person 2": [1] * 6}
EXPECTED = Labels(
    [
        row(0, 1, "none", "1"),
        row(2, 3, "robot", "1"),
        row(4, 5, "2", "1"),
        row(0, 5, "robot", "2"),
    ]
)


def _exchange(folder: Path, subjects: tuple[str, ...] = ("1", "2")) -> Exchange:
    clip: MeasuredClip = open_measured("idiap_vfoa", folder, file=idiap_file(folder).name)
    return Exchange(timeline=timeline_of(clip), rate_hz=clip.rate_hz, subjects=subjects, targets=("robot",))


@pytest.mark.parametrize("columns", [(), (1,)])
def test_the_arrays_hold_a_code_for_each_frame(tmp_path: Path, columns: tuple[int, ...]) -> None:
    arrays = {name: np.reshape(codes, (6, *columns)).astype(np.uint32) for name, codes in CODES.items()}
    np.savez(tmp_path / "a_gt.npz", **arrays)
    assert IdiapGroundTruth().read(tmp_path / "a_gt.npz", _exchange(tmp_path)).labels == EXPECTED


def test_the_genuine_arrays_say_what_the_table_says(shared_data: Path) -> None:
    """The table is of the same conversation, in words."""
    folder = shared_data / "idiap_vfoa"
    clip = open_measured("idiap_vfoa", folder, file="heads.csv")
    exchange = Exchange(timeline=timeline_of(clip), rate_hz=clip.rate_hz, subjects=("1", "2"), targets=("robot",))
    labels = IdiapGroundTruth().read(folder / "gt_first_half.npz", exchange).labels
    frame_at = {clip.time_ns(number): number for number in clip.frames}
    other = {"unfocused": "none", "robot": "robot"}
    with (folder / "labels.csv").open() as table:
        said = {(frame_at[int(row["time_ns"])], row["person"]): row["looks_at"] for row in csv.DictReader(table)}
    for (frame, person), meaning in said.items():
        label = labels.at(frame, person)
        assert label is not None
        assert label.target == other.get(meaning, {"1": "2", "2": "1"}[person])
    assert len(said) == 1060


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"Person 1": [0, 1]}, r"Person 1: found 2 labels; expected 6"),
        ({"Person 1": [0, 1, 2, 3, 0, 0]}, r"Person 1: frame 3: found the code 3"),
        ({"Person 9": [0] * 6}, r"unknown subject '9'"),
        ({"Person 1": [[0] * 6]}, r"Person 1: found int64 of \(1, 6\)"),
    ],
)
def test_what_does_not_fit_is_named(tmp_path: Path, arrays: dict[str, object], message: str) -> None:
    np.savez(tmp_path / "a_gt.npz", **arrays)  # type: ignore[arg-type]
    with pytest.raises(VfoaError, match=message):
        IdiapGroundTruth().read(tmp_path / "a_gt.npz", _exchange(tmp_path))


def test_the_other_person_has_to_be_one(tmp_path: Path) -> None:
    np.savez(tmp_path / "a_gt.npz", **CODES)
    with pytest.raises(VfoaError, match="'other person' of '1': found 2 "):
        IdiapGroundTruth().read(tmp_path / "a_gt.npz", _exchange(tmp_path, ("1", "2", "3")))


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "a_gt.npz").write_bytes(b"PK\x03\x04 cut")
    with pytest.raises(VfoaError, match=r"a_gt.npz: not a \.npz file"):
        IdiapGroundTruth().read(tmp_path / "a_gt.npz", _exchange(tmp_path))
