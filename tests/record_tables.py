"""Write records of frames as the tables of a run, for tests of what reads them."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

from harness.pipeline.measures import FrameMeasures
from harness.run.answers import answer_rows, filtered_cues
from harness.run.columns import PairColumns, Words
from harness.run.directory import Pair, RunDirectory
from harness.run.records import FrameRecord
from harness.run.scene_identity import key_of
from harness.run.scenes import FolderWriter, remove_unused
from harness.run.table_columns import TableFiles, answer_columns, look_columns, measure_columns, scene_columns
from harness.run.table_files import Row, TableWriter, make_table
from harness.run.tables import TABLES


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredRecord(FrameRecord):
    """A record with measures of its frame, which the tables hold as well."""

    measures: FrameMeasures


def measured(record: FrameRecord, measures: FrameMeasures) -> MeasuredRecord:
    """The record with measures."""
    return MeasuredRecord(**{each.name: getattr(record, each.name) for each in fields(FrameRecord)}, measures=measures)


def _measures(record: FrameRecord) -> FrameMeasures | None:
    return record.measures if isinstance(record, MeasuredRecord) else None


class MemoryTables(TableFiles):
    """Tables of records that are in no file."""

    def __init__(self, rows: Mapping[str, list[Row]]) -> None:
        super().__init__({table: Path(f"{table}.parquet") for table in rows})
        keys = dict.fromkeys(("clip", "scene", "directions", "configuration"), "")
        self._made = {table: make_table(table, keys, of_table) for table, of_table in rows.items()}

    def read(self, table: str, columns: Sequence[str]) -> Any:
        return self._made[table].select(columns)


SizePx = tuple[int, int] | tuple[None, None]
"""Width and height of images; None: the clip has none."""


def columns_of(records: Sequence[FrameRecord], words: Words, size_px: SizePx = (None, None)) -> PairColumns:
    """The columns of one configuration on one clip, from its records in any order."""
    rows: dict[str, list[Row]] = {table: [] for table in TABLES if table != "clouds"}
    for record in sorted(records, key=lambda record: record.frame):
        for table, of_frame in (_scene_rows(record, size_px) | _directions_rows(record, ())).items():
            rows[table] += of_frame
        rows["answers"] += answer_rows(record, ())
    tables = MemoryTables(rows)
    scene = scene_columns(tables, words, {})
    looks, measures = look_columns(scene, tables, words), measure_columns(scene, tables, words)
    pair = records[0].clip, records[0].configuration
    return answer_columns(pair, scene, looks, measures, tables, words, ())


SCENE = ("stereo", "segmentation", "heads", "drawn", "reconstruction", "tracking")
DIRECTIONS = ("head_pose", "gaze")
"""Tables of a configuration that decide a scene, and those that with the scene decide the directions."""


def write_tables(directory: RunDirectory, by_pair: Mapping[Pair, Sequence[FrameRecord]]) -> None:
    """Write the tables of a run, whose manifest is there; those of an earlier attempt are replaced.

    What records lack, such as the rig, is null, or 0.
    """
    configurations = directory.read_manifest().configurations
    shutil.rmtree(directory.path / "answers", ignore_errors=True)
    for pair, records in by_pair.items():
        settings = configurations[pair[1]]
        keys = {"clip": pair[0], "scene": key_of({name: settings.get(name) for name in SCENE})}
        scene = FolderWriter(directory, keys, {})
        keys["directions"] = key_of({name: settings.get(name) for name in ("scene", *DIRECTIONS)} | keys)
        directions = FolderWriter(directory, keys, {})
        filtered = filtered_cues(settings)
        for record in records:
            scene.add(_scene_rows(record))
            directions.add(_directions_rows(record, filtered))
        final = {"scene": (found := scene.finish()), "directions": directions.finish(scene=found)}
        with TableWriter(
            {"answers": directory.answers(pair)}, {"clip": pair[0], **final, "configuration": pair[1]}
        ) as table:
            for record in records:
                table.add({"answers": answer_rows(record, filtered)})
    remove_unused(directory)


def _scene_rows(record: FrameRecord, size_px: SizePx = (None, None)) -> dict[str, Iterable[Row]]:
    measures, frame = _measures(record), record.frame
    disparity = measures.disparity if measures else None
    about = (frame, record.time_ns, record.masks_from, record.masks_age_s, measures is not None)
    return {
        "frames": [(*about, *(astuple(disparity) if disparity else (None,) * 3), *size_px, *(None,) * 6, False, False)],
        "instances": [
            (
                *(frame, each.instance_id, each.name, each.label, None, 0, True, each.score, each.box_px, each.points),
                *((each.box.center_m, each.box.half_size_m, sum(each.box.axes, ())) if each.box else (None,) * 3),
                each.depth_from,
            )
            for each in record.targets
        ],
        "objects": [(frame, *astuple(each)) for each in (measures.targets if measures else ())],
        "people": [(frame, s.track_id, s.name, s.instance_id, s.head_box_px, None, None) for s in record.subjects],
    }


def _directions_rows(record: FrameRecord, filtered: Sequence[str]) -> dict[str, Iterable[Row]]:
    def raw(cue: str, direction: object) -> object:
        return None if cue in filtered else direction

    measures = _measures(record)
    return {
        "directions": [
            (
                *(record.frame, each.track_id, each.eye_origin_m, raw("gaze", each.gaze), each.gaze_sigma_rad),
                *(each.no_gaze, raw("head", each.head), None, each.head_width_m, each.depth_from),
            )
            for each in record.subjects
        ],
        "true_people": [(record.frame, *astuple(each)) for each in (measures.people if measures else ())],
    }
