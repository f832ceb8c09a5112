from __future__ import annotations

from pathlib import Path

import pytest

from harness.report.stages import stage_times
from vfoa.errors import VfoaError

HEADER = "clip,configuration,frame,stage,ms\n"


def _written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "timings.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_stage_has_its_median_over_clips_and_frames(tmp_path: Path) -> None:
    rows = [
        ("a", "one", 1, 9.0),
        ("a", "one", 2, 1.0),
        ("b", "one", 1, 2.0),
        ("a", "two", 1, 4.0),
        ("a", "two", 2, 5.0),
    ]
    text = "".join(f"{clip},{name},{frame},head_pose,{ms}\n" for clip, name, frame, ms in rows)
    table = stage_times(_written(tmp_path, f"{HEADER}{text}a,two,1,gaze,7\n")).table()
    assert table.columns == ("Stage", "one", "two")
    assert table.rows == (("head pose", "2.0", "4.5"), ("gaze", "–", "7.0"))


def test_no_timings_no_rows(tmp_path: Path) -> None:
    assert stage_times(tmp_path / "timings.csv").ms == {}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n", "expected the columns clip,"),
        (f"{HEADER}a,one,1,gaze,fast\n", ":2: not a stage"),
        (f"{HEADER}a,one\n", ":2: not a stage"),
    ],
)
def test_other_files_are_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(VfoaError, match=message) as caught:
        stage_times(_written(tmp_path, text))
    assert "\n" not in str(caught.value)
