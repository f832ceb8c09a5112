from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.pipeline.frame_measures import DisparityMeasure, FrameMeasures, PersonMeasure, TargetMeasure
from harness.run.records import AttentionRecord, BoxRecord, FrameRecord, SubjectRecord, TargetRecord
from harness.run.results import read_results, to_line
from tests.records import frame_record, subject_record, target_record
from vfoa.errors import VfoaError

RECORD = frame_record([target_record(1, "cup")], [subject_record("girl", totals={1: 0.25}, focus=1)])

numbers = st.floats(allow_nan=False, allow_infinity=False)
vectors = st.tuples(numbers, numbers, numbers)
boxes_px = st.tuples(numbers, numbers, numbers, numbers)
ids = st.integers(1, 2**16 - 1)


measures = st.builds(
    FrameMeasures,
    disparity=st.none()
    | st.builds(DisparityMeasure, error_px=st.none() | numbers, over_2_px=st.none() | numbers, known=numbers),
    targets=st.lists(
        st.builds(
            TargetMeasure,
            truth_id=ids,
            label=st.text(),
            instance_id=st.none() | ids,
            mask_iou=numbers,
            box_iou=st.none() | numbers,
            center_error_m=st.none() | numbers,
        ),
        max_size=2,
    ).map(tuple),
    people=st.lists(
        st.builds(
            PersonMeasure,
            name=st.text(),
            head_box_iou=numbers,
            eye_error_m=st.none() | numbers,
            head_error_deg=st.none() | numbers,
            gaze_error_deg=st.none() | numbers,
        ),
        max_size=2,
    ).map(tuple),
)


@st.composite
def records(draw: st.DrawFn) -> FrameRecord:
    instances = draw(st.lists(ids, unique=True, min_size=1, max_size=4))
    boxes = st.builds(BoxRecord, center_m=vectors, half_size_m=vectors, axes=st.tuples(vectors, vectors, vectors))
    targets = [
        draw(
            st.builds(
                TargetRecord,
                instance_id=st.just(instance),
                name=st.text(),
                label=st.text(),
                score=numbers,
                box_px=boxes_px,
                points=st.integers(0, 10**6),
                box=st.none() | boxes,
            )
        )
        for instance in instances
    ]
    values = st.builds(
        AttentionRecord,
        instance_id=st.sampled_from(instances),
        gaze=st.none() | numbers,
        head=st.none() | numbers,
        total=numbers,
    )
    subjects = st.builds(
        SubjectRecord,
        track_id=ids,
        name=st.none() | st.text(),
        instance_id=st.none() | ids,
        head_box_px=boxes_px,
        eye_origin_m=st.none() | vectors,
        gaze=st.none() | vectors,
        gaze_sigma_rad=st.none() | numbers,
        head=st.none() | vectors,
        missing=st.none() | st.sampled_from(["no_eyes_3d", "no_direction"]),
        attention=st.lists(values, max_size=3).map(tuple),
        focus=st.none() | st.sampled_from(instances),
        tied=st.lists(ids, max_size=2).map(tuple),
    )
    return FrameRecord(
        clip=draw(st.text()),
        configuration=draw(st.text()),
        frame=draw(st.integers(-(2**62), 2**62)),
        time_ns=draw(st.integers(0, 2**62)),
        targets=tuple(targets),
        subjects=tuple(draw(st.lists(subjects, max_size=2))),
        measures=draw(st.none() | measures),
    )


def _write(path: Path, *lines: str) -> Path:
    path.write_text("".join(lines), encoding="utf-8")
    return path


@given(record=records())
def test_what_is_written_is_read_back_exactly(record: FrameRecord, tmp_path_factory: pytest.TempPathFactory) -> None:
    line = to_line(record)
    path = _write(tmp_path_factory.mktemp("results") / "results.jsonl", line)
    assert list(read_results(path)) == [record]
    assert line.endswith("\n")
    assert line.count("\n") == 1
    assert json.loads(line)["version"] == 1


def test_records_are_read_in_the_order_of_the_file(tmp_path: Path) -> None:
    written = [replace(RECORD, frame=frame) for frame in (3, 1, 2)]
    assert list(read_results(_write(tmp_path / "results.jsonl", *map(to_line, written)))) == written


def test_an_empty_file_holds_no_frames(tmp_path: Path) -> None:
    assert list(read_results(_write(tmp_path / "results.jsonl"))) == []


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
        (to_line(RECORD), "frame 1 of clip 'clip' under 'one' is on line 1 already"),
    ],
)
def test_a_wrong_line_is_one_error_with_file_and_line(tmp_path: Path, second: str, expected: str) -> None:
    path = _write(tmp_path / "results.jsonl", to_line(RECORD), second)
    with pytest.raises(VfoaError, match=expected) as caught:
        list(read_results(path))
    assert str(caught.value).startswith(f"{path}:2: ")
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_one_error(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"results\.jsonl: no such file"):
        list(read_results(tmp_path / "results.jsonl"))


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
