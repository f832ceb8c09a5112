from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

from harness.run.records import FrameRecord
from harness.run.results import read_lines, to_line
from tests.drawn_records import records
from tests.records import frame_record, subject_record, target_record
from vfoa.errors import VfoaError

RECORD = frame_record([target_record(1, "cup")], [subject_record("girl", totals={1: 0.25}, focus=1)])


def _write(path: Path, *lines: str) -> Path:
    path.write_text("".join(lines), encoding="utf-8")
    return path


@given(record=records())
def test_what_is_written_is_read_back_exactly(record: FrameRecord, tmp_path_factory: pytest.TempPathFactory) -> None:
    line = to_line(record)
    path = _write(tmp_path_factory.mktemp("results") / "clip__one.jsonl", line)
    assert list(read_lines(path)) == [record]
    assert line.endswith("\n")
    assert line.count("\n") == 1
    assert json.loads(line)["version"] == 1


def test_records_are_read_in_the_order_of_the_file(tmp_path: Path) -> None:
    written = [replace(RECORD, frame=frame) for frame in (3, 1, 2)]
    assert list(read_lines(_write(tmp_path / "clip__one.jsonl", *map(to_line, written)))) == written


def test_an_empty_file_holds_no_frames(tmp_path: Path) -> None:
    assert list(read_lines(_write(tmp_path / "clip__one.jsonl"))) == []


@pytest.mark.parametrize(
    ("second", "expected"),
    [
        (to_line(RECORD)[:-40], "cut short"),
        (to_line(replace(RECORD, frame=2)).rstrip("\n"), "cut short"),
        (to_line(RECORD)[:-40] + "\n", "not a frame's record"),
        ("\n", "expected a record that begins with"),
        ("[]\n", "expected a record that begins with"),
        (to_line(RECORD).replace('"version":1', '"version":2'), "expected a record that begins with"),
        (to_line(RECORD).replace('"version":1,', ""), "expected a record that begins with"),
        (to_line(RECORD).replace('"frame":1', '"frame":"1"'), r"Expected `int`, got `str` - at `\$\.frame`"),
        (to_line(replace(RECORD, frame=2)).replace('"time_ns"', '"time"'), "missing required field `time_ns`"),
        (to_line(replace(RECORD, frame=2)).replace('"focus":1', '"focus":7'), r"attends to instances \[7\]"),
    ],
)
def test_a_wrong_line_is_one_error_with_file_and_line(tmp_path: Path, second: str, expected: str) -> None:
    path = _write(tmp_path / "clip__one.jsonl", to_line(RECORD), second)
    with pytest.raises(VfoaError, match=expected) as caught:
        list(read_lines(path))
    assert str(caught.value).startswith(f"{path}:2: ")
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_one_error(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"clip__one\.jsonl: no such file"):
        list(read_lines(tmp_path / "clip__one.jsonl"))


@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_a_number_that_json_does_not_have_is_refused_when_written(number: float) -> None:
    with pytest.raises(ValueError, match="would not survive"):
        to_line(replace(RECORD, subjects=(replace(RECORD.subjects[0], gaze_sigma_rad=number),)))


def test_numbers_of_numpy_are_written_as_numbers() -> None:
    subject = replace(RECORD.subjects[0], gaze_sigma_rad=np.float64(0.1), focus=np.int64(1))  # type: ignore[arg-type]
    plain = replace(RECORD.subjects[0], gaze_sigma_rad=0.1, focus=1)
    assert to_line(replace(RECORD, subjects=(subject,))) == to_line(replace(RECORD, subjects=(plain,)))


def test_what_is_no_plain_value_is_refused() -> None:
    with pytest.raises(TypeError, match="expected plain numbers"):
        to_line(replace(RECORD, subjects=(replace(RECORD.subjects[0], gaze=np.zeros(3)),)))  # type: ignore[arg-type]


def test_a_record_names_each_instance_once() -> None:
    with pytest.raises(ValueError, match="distinct instance ids"):
        frame_record([target_record(1, "cup"), target_record(1, "can")])
