from __future__ import annotations

import math
import shutil
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.run import table_files
from harness.run.directory import Pair, RunDirectory
from harness.run.records import FrameRecord
from harness.run.table_columns import ColumnReader
from harness.run.table_files import is_known, numbers_of, read_table
from harness.run.table_records import read_records
from harness.run.tables import TABLES
from tests.drawn_records import records
from tests.record_tables import write_tables
from tests.records import frame_record, subject_record, target_record, write_manifest
from vfoa.errors import VfoaError
from vfoa.types import DirectionFit

CUP, CAN = target_record(1, "cup"), target_record(2, "can", center=None)
GIRL = subject_record("girl", totals={1: 0.25, 2: 0.5}, focus=2)


def _run(folder: Path, by_pair: dict[Pair, list[FrameRecord]], **settings: dict[str, object]) -> RunDirectory:
    """A finished run with the tables of these records; ``settings`` are those of its configurations."""
    directory = RunDirectory(folder)
    clips = [{"name": clip, "frames": []} for clip in dict.fromkeys(clip for clip, _ in by_pair)]
    configurations = {name: settings.get(name, {}) for _, name in by_pair}
    write_manifest(directory, {"clips": clips, "configurations": configurations, "failed": [], "finished": "now"})
    write_tables(directory, by_pair)
    return directory


def _paired(*each: FrameRecord) -> dict[Pair, list[FrameRecord]]:
    by_pair: dict[Pair, list[FrameRecord]] = {}
    for record in each:
        by_pair.setdefault((record.clip, record.configuration), []).append(record)
    return by_pair


def _files(directory: RunDirectory) -> list[str]:
    return sorted(path.relative_to(directory.path).as_posix() for path in directory.path.rglob("*") if path.is_file())


@given(drawn=st.lists(records(), min_size=1, max_size=4, unique_by=lambda record: record.frame))
def test_what_is_written_is_read_back_exactly(
    drawn: list[FrameRecord], tmp_path_factory: pytest.TempPathFactory
) -> None:
    written = [replace(each, clip="alley", configuration="one") for each in sorted(drawn, key=lambda each: each.frame)]
    directory = _run(tmp_path_factory.mktemp("run"), _paired(*written))
    assert list(read_records(directory)) == written


def test_row_groups_have_the_same_frames_in_all_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table_files, "GROUP_FRAMES", 2)
    people = ((), (), (GIRL,), (), (GIRL, replace(GIRL, track_id=2)))
    written = [frame_record([CUP, CAN], each, frame=frame) for frame, each in enumerate(people, start=1)]
    directory = _run(tmp_path, _paired(*written))
    assert {pq.read_metadata(path).num_row_groups for path in tmp_path.rglob("*.parquet")} == {3}
    assert list(read_records(directory)) == written


def test_records_come_by_clip_and_configuration_as_the_experiment_has_them(tmp_path: Path) -> None:
    written = [
        frame_record([CUP, CAN], [GIRL], frame=frame, clip=clip, configuration=configuration)
        for clip in ("b", "a")
        for configuration in ("two", "one")
        for frame in (1, 2)
    ]
    directory = _run(tmp_path, _paired(*written))
    assert list(read_records(directory)) == written
    assert read_table(directory, "answers").column("configuration").to_pylist() == ["two", "two", "one", "one"] * 2
    assert read_table(directory, "frames").num_rows == 4


def test_what_configurations_share_is_stored_once(tmp_path: Path) -> None:
    seen = frame_record([CUP, CAN], [GIRL])
    other_gaze = replace(seen, configuration="gaze", subjects=(replace(GIRL, gaze=(1.0, 0.0, 0.0)),))
    other_scene = replace(seen, configuration="scene", targets=(CAN,), subjects=())
    cones = replace(seen, configuration="cones", subjects=(replace(GIRL, focus=1),))
    written = [seen, cones, other_gaze, other_scene]
    directory = _run(tmp_path, _paired(*written), gaze={"gaze": {"seed": 1}}, scene={"stereo": {"matcher": "bm"}})
    assert [len(list((tmp_path / place).iterdir())) for place in ("scenes", "directions", "answers")] == [2, 3, 4]
    assert list(read_records(directory)) == written
    assert read_table(directory, "instances").column("name").to_pylist() == ["cup", "can", "can"]


def test_configurations_of_equal_settings_keep_what_each_has_seen(tmp_path: Path) -> None:
    first = [frame_record([CUP], frame=1), frame_record([CUP, CAN], [GIRL], frame=2)]
    second = [replace(first[0], configuration="two"), replace(first[1], configuration="two", targets=(CAN, CUP))]
    third = [replace(each, configuration="three") for each in second]
    directory = _run(tmp_path, _paired(*first, *second, *third))
    assert list(read_records(directory)) == [*first, *second, *third]
    assert len(list((tmp_path / "scenes").iterdir())) == 2
    assert [name for name in _files(directory) if not name.endswith((".parquet", ".json"))] == []


def test_tables_of_an_earlier_attempt_are_replaced(tmp_path: Path) -> None:
    _run(tmp_path, _paired(frame_record([CUP], configuration="one"), frame_record([CUP], configuration="two")))
    directory = _run(tmp_path, _paired(frame_record([CAN], configuration="two")))
    assert read_table(directory, "instances").column("name").to_pylist() == ["can"]
    assert not (tmp_path / "answers" / "one").exists()


def test_equal_records_give_equal_files(tmp_path: Path) -> None:
    for name in ("a", "b"):
        _run(tmp_path / name, _paired(frame_record([CUP, CAN], [GIRL])))
    first, second = (RunDirectory(tmp_path / name) for name in ("a", "b"))
    assert _files(first) == _files(second)
    assert [(first.path / each).read_bytes() for each in _files(first)] == [
        (second.path / each).read_bytes() for each in _files(second)
    ]


@pytest.mark.parametrize("number", [math.nan, math.inf])
@pytest.mark.parametrize(
    "change",
    [
        lambda number: {"gaze_sigma_rad": number},
        lambda number: {"gaze": (0.0, number, 0.0)},
        lambda number: {"attention": (replace(GIRL.attention[0], head=number),)},
        lambda number: {"fit": DirectionFit(tail=0.5, implied_share=number)},
    ],
)
def test_a_number_that_is_not_finite_is_refused(tmp_path: Path, number: float, change) -> None:
    record = frame_record([CUP, CAN], [replace(GIRL, **change(number))])
    with pytest.raises(ValueError, match="not finite"):
        _run(tmp_path, _paired(record))


def _rewritten(path: Path, change) -> None:
    """Write a table again after a change to it."""
    table = change(pq.read_table(path))
    pq.write_table(table, path, compression="zstd", write_page_checksum=True)


def _with_column(name: str, values: Iterable[object]):
    def change(table: pa.Table) -> pa.Table:
        place = table.schema.get_field_index(name)
        field = table.schema.field(place)
        return table.set_column(place, field, pa.array(list(values), field.type))

    return change


@pytest.mark.parametrize(
    ("place", "damage", "expected"),
    [
        ("answers", Path.unlink, "no such file"),
        ("instances", Path.unlink, "no such file"),
        ("instances", lambda path: path.write_bytes(path.read_bytes()[:-20]), "damaged: "),
        ("answers", lambda path: path.write_bytes(b""), "damaged: "),
        ("people", lambda path: _rewritten(path, lambda table: table.drop_columns("name")), "expected the columns"),
        (
            "frames",
            lambda path: _rewritten(path, lambda table: table.replace_schema_metadata()),
            "of format 4, found another file",
        ),
        ("frames", lambda path: _rewritten(path, _with_column("frame", [2, 1])), "found frame 1 after a later one"),
        ("instances", lambda path: pq.ParquetWriter(path, pq.read_schema(path)).close(), "found 0 row groups"),
        ("people", lambda path: _rewritten(path, _with_column("frame", [1, 3])), "frame 3 is not in this part"),
        ("answers", lambda path: _rewritten(path, _with_column("track_id", [1, 7])), "frame 2: expected the tracks of"),
        ("answers", lambda path: _rewritten(path, lambda table: table.slice(0, 1)), "frame 2: expected the tracks of"),
        ("answers", lambda path: _rewritten(path, _with_column("focus", [1, 9])), r"attends to instances \[9\]"),
        ("answers", lambda path: _rewritten(path, _with_column("total", [[0.5], [0.5]])), "shorter"),
        ("directions", lambda path: _rewritten(path, _with_column("gaze", [None, [1.0]])), "gaze: expected lists of 3"),
    ],
)
def test_a_damaged_table_is_one_line_with_the_file(tmp_path: Path, place: str, damage, expected: str) -> None:
    directory = _run(tmp_path, _paired(*(frame_record([CUP, CAN], [GIRL], frame=frame) for frame in (1, 2))))
    ((_, paths),) = table_files.find_tables(directory)
    damage(paths[place])
    with pytest.raises(VfoaError, match=expected) as caught:
        list(read_records(directory))
    assert str(paths[place]) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("column", "values"), [("focus", [1, 9]), ("targets", [[1], [9]])])
def test_columns_of_answers_that_are_no_targets_are_refused(tmp_path: Path, column: str, values: list[object]) -> None:
    directory = _run(tmp_path, _paired(*(frame_record([CUP, CAN], [GIRL], frame=frame) for frame in (1, 2))))
    ((pair, paths),) = table_files.find_tables(directory)
    reader = ColumnReader(directory, directory.read_manifest())
    assert len(reader.read(pair, {}).focus) == 2
    _rewritten(paths["answers"], _with_column(column, values))
    with pytest.raises(VfoaError, match=r"instances\.parquet") as caught:
        ColumnReader(directory, directory.read_manifest()).read(pair, {})
    assert str(paths["answers"]) in str(caught.value)


def test_a_flipped_bit_is_an_error_or_without_effect(tmp_path: Path) -> None:
    written = [frame_record([CUP, CAN], [GIRL], frame=frame) for frame in range(1, 40)]
    directory = _run(tmp_path, _paired(*written))
    ((_, paths),) = table_files.find_tables(directory)
    whole, chance = paths["answers"].read_bytes(), np.random.default_rng(4)
    found = 0
    for _ in range(100):
        place, bit = int(chance.integers(len(whole))), int(chance.integers(8))
        damaged = bytearray(whole)
        damaged[place] ^= 1 << bit
        paths["answers"].write_bytes(damaged)
        try:
            assert list(read_records(directory)) == written
        except VfoaError:
            found += 1
    assert found > 10


def test_a_run_of_an_earlier_version_is_one_line(tmp_path: Path) -> None:
    directory = _run(tmp_path, _paired(frame_record([CUP, CAN], [GIRL])))
    shutil.rmtree(tmp_path / "answers")
    with pytest.raises(VfoaError, match="has no tables of frames"):
        list(read_records(directory))


def test_every_table_has_its_columns(tmp_path: Path) -> None:
    directory = _run(tmp_path, _paired(frame_record([CUP, CAN], [GIRL])))
    assert {name: read_table(directory, name).schema.names for name in TABLES} == {
        name: list(columns) for name, columns in TABLES.items()
    }


@pytest.mark.parametrize(
    ("values", "kind", "numbers"),
    [
        ([], pa.int64(), []),
        ([], pa.bool_(), []),
        ([3, None, -1], pa.int32(), [3, 7, -1]),
        ([None, None], pa.float64(), [7.0, 7.0]),
        ([0.5, None, 1.5], pa.float32(), [0.5, 7.0, 1.5]),
        ([True, False] * 9, pa.bool_(), [True, False] * 9),
        ([True, None, False], pa.bool_(), [True, True, False]),
    ],
)
def test_numbers_and_flags_of_a_column_are_those_that_were_written(
    values: list[float | None], kind: pa.DataType, numbers: list[float]
) -> None:
    array = pa.array(values, kind)
    for first in range(len(values) + 1):
        found = numbers_of(array[first:], 7)
        assert (found.tolist(), found.dtype) == (numbers[first:], kind.to_pandas_dtype())
        assert is_known(array[first:]).tolist() == [value is not None for value in values[first:]]


def test_a_number_that_a_column_cannot_hold_stands_for_no_unknown_one() -> None:
    with pytest.raises(OverflowError):
        numbers_of(pa.array([1, None], pa.int32()), 2**31)
