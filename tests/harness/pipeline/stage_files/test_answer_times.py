"""The frames of another system's answers by time: from the clip's beginning, or since 1970 as the clip's stamps."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.pipeline.stage_files.answer_tables import read_answers
from tests.disk import write_text
from vfoa.errors import VfoaError

START_NS = 1_714_564_803_250_000_000
FRAMES = range(1, 6)


def _frames(folder: Path, *times: str, start_ns: int = START_NS) -> list[int]:
    rows = [f"{time},anna,mug\n" for time in times]
    path = write_text(folder / "answers.csv", "time_s,subject,target\n" + "".join(rows))
    times_ns = [start_ns + n * 100_000_000 for n in range(len(FRAMES))]
    return list(read_answers(path, FRAMES, times_ns, ("mug", "anna"), ("anna",)).by_frame)


def test_times_since_1970_are_those_of_a_clip_with_such_times(tmp_path: Path) -> None:
    assert _frames(tmp_path, "1714564803.25", "1714564803.46") == [1, 3]
    assert _frames(tmp_path, "0", "0.21") == [1, 3]


@pytest.mark.parametrize(
    ("times", "start_ns"), [(("1714564803.25",), 0), (("1714564809.25",), START_NS), (("0", "1714564803.25"), START_NS)]
)
def test_times_of_another_clock_are_refused(tmp_path: Path, times: tuple[str, ...], start_ns: int) -> None:
    with pytest.raises(VfoaError, match=r"answers\.csv:[23]: time_s: found '17"):
        _frames(tmp_path, *times, start_ns=start_ns)
