"""The columns of a run (:mod:`harness.run.columns`), read from its tables, and checked against each other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.run.answers import filtered_cues
from harness.run.columns import (
    NO_ID,
    OF_DISPARITY,
    OF_OBJECT,
    OF_PERSON,
    UNKNOWN,
    LookColumns,
    MeasureColumns,
    PairColumns,
    SceneColumns,
    Words,
)
from harness.run.directory import Pair, RunDirectory
from harness.run.manifest import RunManifest
from harness.run.table_files import check_ascending, find_tables, is_known, numbers_of, read_arrow
from harness.run.tables import DIRECTIONS_TABLES, SCENE_TABLES
from vfoa.errors import VfoaError
from vfoa.types import CUES, Codes, Cue, Flags, Float

_KEPT_SCENES = 8
"""Scenes, and directions of people, that a reader keeps for the next configurations."""


class TableFiles:
    """The files of tables, by the tables' names."""

    def __init__(self, paths: Mapping[str, Path]) -> None:
        self.paths = dict(paths)

    @classmethod
    def of_folder(cls, folder: Path, tables: Iterable[str]) -> TableFiles:
        """Those of a folder."""
        return cls({table: folder / f"{table}.parquet" for table in tables})

    def read(self, table: str, columns: Sequence[str]) -> Any:
        """Columns of a table, as a table of Arrow. Raises as :func:`harness.run.table_files.open_table` does."""
        return read_arrow(self.paths[table], table, columns)


class ColumnReader:
    """Reads the columns of a finished run. What configurations share is read once for those that follow.

    ``paths`` are the files of the tables of each (clip, configuration), in the order of the experiment.

    Raises
    ------
    VfoaError
        If a table is missing, damaged, of another version, or does not fit the others; the message names the file. This
        also holds for what is read later.
    """

    def __init__(self, directory: RunDirectory, manifest: RunManifest) -> None:
        self.words = Words()
        self.paths = dict(find_tables(directory, manifest=manifest))
        self._filtered = {name: filtered_cues(settings) for name, settings in manifest.configurations.items()}
        kept = lru_cache(maxsize=_KEPT_SCENES)
        self._scene = kept(self._read_scene)
        self._looks = kept(self._read_looks)
        self._measures = kept(self._read_measures)

    def read(self, pair: Pair, names_now: Mapping[str, str] | None = None) -> PairColumns:
        """Read a (clip, configuration). ``names_now`` are the present names of renamed targets."""
        paths = self.paths[pair]
        scene = self._scene(paths["frames"].parent, tuple((names_now or {}).items()))
        looks = self._looks(paths["directions"].parent, scene)
        measures = self._measures(paths["directions"].parent, paths["frames"].parent, scene)
        return answer_columns(pair, scene, looks, measures, TableFiles(paths), self.words, self._filtered[pair[1]])

    def _read_scene(self, folder: Path, names_now: tuple[tuple[str, str], ...]) -> SceneColumns:
        return scene_columns(TableFiles.of_folder(folder, SCENE_TABLES), self.words, dict(names_now))

    def _read_looks(self, folder: Path, scene: SceneColumns) -> LookColumns:
        return look_columns(scene, TableFiles.of_folder(folder, DIRECTIONS_TABLES), self.words)

    def _read_measures(self, folder: Path, of_scene: Path, scene: SceneColumns) -> MeasureColumns:
        tables = (
            TableFiles.of_folder(of_scene, SCENE_TABLES).paths | TableFiles.of_folder(folder, DIRECTIONS_TABLES).paths
        )
        return measure_columns(scene, TableFiles(tables), self.words)


_OF_FRAMES = ("frame", "time_ns", "has_truth", "width_px", "height_px", "fx_px", "baseline_m", "has_right")


def scene_columns(tables: TableFiles, words: Words, names_now: Mapping[str, str]) -> SceneColumns:
    """Read the columns of a scene; a :class:`VfoaError` says that its tables do not fit each other."""
    about = tables.read("frames", _OF_FRAMES)
    frames = _numbers(about, "frame")
    check_ascending(tables.paths["frames"], frames.tolist())
    of_instances = ("frame", "instance_id", "name", "box_px", "center_m", "depth_from")
    instances, instance_at = _in_order(tables, "instances", of_instances, frames)
    ids = _numbers(instances, "instance_id")
    of_people = ("frame", "track_id", "name", "instance_id", "head_box_px")
    people, person_at = _in_order(tables, "people", of_people, frames)
    heads_px = _vectors(people, "head_box_px", 4)
    no_border = np.iinfo(np.int32).max
    sizes_px = np.stack([_numbers(about, name, no_border) for name in ("width_px", "height_px")], axis=1)
    return SceneColumns(
        frames=frames,
        times_ns=_numbers(about, "time_ns"),
        has_truth=_flags(about, "has_truth"),
        pixel_metres=np.where(
            _flags(about, "has_right"), _floats(about, "fx_px") * _floats(about, "baseline_m"), np.nan
        ),
        firsts=np.searchsorted(instance_at, np.arange(len(frames) + 1)),
        instance_at=instance_at,
        instance_ids=ids,
        names=_words(instances, "name", words, names_now),
        boxes_px=_vectors(instances, "box_px", 4),
        centers_m=_vectors(instances, "center_m", 3),
        is_held=is_known(_column(instances, "depth_from")),
        person_at=person_at,
        tracks=_numbers(people, "track_id"),
        person_names=_words(people, "name", words),
        bodies=_numbers(people, "instance_id", NO_ID),
        head_heights_px=heads_px[:, 3] - heads_px[:, 1],
        is_cut=np.any([heads_px[:, :2] <= 0, heads_px[:, 2:] >= sizes_px[person_at] - 1], axis=(0, 2)),
    )


def look_columns(scene: SceneColumns, tables: TableFiles, words: Words) -> LookColumns:
    """Read where the people of a scene look; a :class:`VfoaError` says that the tables do not fit each other."""
    names = ("frame", "track_id", "eye_origin_m", "gaze", "head", "no_gaze", "head_width_m", "depth_from")
    table = _of_people(scene, tables, "directions", names)
    eyes_m, gaze, head = (_vectors(table, name, 3) for name in ("eye_origin_m", "gaze", "head"))
    return LookColumns(
        eyes_m=eyes_m,
        gaze=gaze,
        head=head,
        no_gaze=_words(table, "no_gaze", words),
        head_widths_m=_floats(table, "head_width_m"),
        is_held=is_known(_column(table, "depth_from")),
    )


_ANSWERS = ("frame", "track_id", "missing", "focus", "targets", "gaze", "head", "total", "fit")


def answer_columns(
    pair: Pair,
    scene: SceneColumns,
    looks: LookColumns,
    measures: MeasureColumns,
    tables: TableFiles,
    words: Words,
    filtered: Sequence[Cue],
) -> PairColumns:
    """Read the answers of a (clip, configuration), of which some cues are filtered.

    Raises
    ------
    VfoaError
        If the table does not fit that of people, or somebody attends to what is not there.
    """
    columns = (*_ANSWERS, *(f"{cue}_filtered" for cue in filtered))
    table = _of_people(scene, tables, "answers", columns)
    after = {"gaze": looks.gaze, "head": looks.head}
    after |= {cue: _vectors(table, f"{cue}_filtered", 3) for cue in filtered}
    attending = np.repeat(np.arange(len(table)), _lengths(table, "targets"))
    gaze, head, total = (numbers_of(_flat(table, name), np.nan) for name in (*CUES, "total"))
    focused = _numbers(table, "focus", NO_ID)
    focus = _find(scene, scene.person_at, focused)
    attended = _find(scene, scene.person_at[attending], numbers_of(_flat(table, "targets"), 0))
    if (attended == UNKNOWN).any() or ((focus == UNKNOWN) & (focused != NO_ID)).any():
        raise VfoaError(
            f"{tables.paths['answers']}: somebody attends to what is not in the frame by {tables.paths['instances']}; "
            "expected both tables as the run wrote them"
        )
    return PairColumns(
        clip=pair[0],
        configuration=pair[1],
        words=words,
        scene=scene,
        measures=measures,
        looks=replace(looks, gaze=after["gaze"], head=after["head"]) if filtered else looks,
        missing=_words(table, "missing", words),
        focus=focus,
        attending=attending,
        attended=attended,
        gaze=gaze,
        head=head,
        total=total,
        fits=np.stack([numbers_of(each, np.nan) for each in _column(table, "fit").flatten()], axis=1),
    )


def measure_columns(scene: SceneColumns, tables: TableFiles, words: Words) -> MeasureColumns:
    """Read the measures of a scene and of where its people look; none without ground truth."""
    if not scene.has_truth.any():
        return MeasureColumns()
    about = tables.read("frames", [f"disparity_{name}" for name in OF_DISPARITY])
    disparities = np.stack([_floats(about, f"disparity_{name}") for name in OF_DISPARITY], axis=1)
    of_objects = ("frame", "truth_id", "label", "instance_id", *OF_OBJECT)
    objects, at = _in_order(tables, "objects", of_objects, scene.frames)
    people, _ = _in_order(tables, "true_people", ("frame", *OF_PERSON), scene.frames)
    truth_ids, labels = _numbers(objects, "truth_id"), _words(objects, "label", words)
    _, first = np.unique(truth_ids, return_index=True)
    rows = _find(scene, at, _numbers(objects, "instance_id", NO_ID))
    found = np.flatnonzero(rows != UNKNOWN)
    _, first_found = np.unique(truth_ids[found], return_index=True)
    return MeasureColumns(
        frames=int(np.count_nonzero(scene.has_truth)),
        disparities=disparities[~np.isnan(disparities[:, OF_DISPARITY.index("known")])],
        objects=np.stack([_floats(objects, name) for name in OF_OBJECT], axis=1),
        people=np.stack([_floats(people, name) for name in OF_PERSON], axis=1),
        truth_ids=truth_ids,
        labels={int(truth_ids[row]): str(words.word(labels[row])) for row in np.sort(first)},
        names={int(truth_ids[row]): str(words.word(scene.names[rows[row]])) for row in found[np.sort(first_found)]},
    )


def _find(scene: SceneColumns, at: Codes, ids: NDArray[np.int64]) -> Codes:
    """The rows of the instances with these ids in frames at these places; :data:`UNKNOWN` where there is none."""
    keys, wanted = _key(scene.instance_at, scene.instance_ids), _key(at, ids)
    order = np.append(np.argsort(keys, kind="stable"), UNKNOWN)
    rows = order[np.searchsorted(keys[order[:-1]], wanted)]
    return np.where((rows != UNKNOWN) & (np.append(keys, 0)[rows] == wanted) & (ids != NO_ID), rows, UNKNOWN)


def _key(at: Codes, ids: NDArray[np.int64]) -> NDArray[np.int64]:
    """One number for a frame and an id of 32 bits."""
    return at.astype(np.int64) * 2**32 + ids + 2**31


def _in_order(tables: TableFiles, name: str, columns: Sequence[str], frames: NDArray[np.int64]) -> tuple[Any, Codes]:
    """Read columns of a table: its rows in the order of the frames, and the place of each one's frame."""
    table = tables.read(name, columns)
    numbers = _numbers(table, "frame")
    at = np.searchsorted(frames, numbers)
    is_there = np.append(frames, 0)[at] == numbers
    is_there &= at < len(frames)
    if not is_there.all():
        raise VfoaError(f"{tables.paths[name]}: frame {numbers[~is_there][0]} is not in frames.parquet")
    if (np.diff(at) >= 0).all():
        return table, at
    order = np.argsort(at, kind="stable")
    return table.take(order), at[order]


def _of_people(scene: SceneColumns, tables: TableFiles, name: str, columns: Sequence[str]) -> Any:
    """Read columns of a table that has a row for each of the scene's people, in their order."""
    table, at = _in_order(tables, name, columns, scene.frames)
    tracks = _numbers(table, "track_id")
    known = min(len(tracks), len(scene.tracks))
    differs = (at[:known] != scene.person_at[:known]) | (tracks[:known] != scene.tracks[:known])
    if differs.any() or len(tracks) != len(scene.tracks):
        first = int(np.argmax(differs)) if differs.any() else known
        places = [places[first] for places in (at, scene.person_at) if first < len(places)]
        number = scene.frames[min(places)]
        raise VfoaError(f"{tables.paths[name]}: frame {number}: expected the tracks of people, a row for each of them")
    return table


def _column(table: Any, name: str) -> Any:
    return table.column(name).combine_chunks()


def _numbers(table: Any, name: str, null: int = 0) -> NDArray[np.int64]:
    """Whole numbers; ``null`` stands for unknown ones."""
    column = _column(table, name)
    numbers = np.asarray(numbers_of(column, 0), dtype=np.int64)
    return np.where(is_known(column), numbers, null) if column.null_count else numbers


def _flags(table: Any, name: str) -> Flags:
    return numbers_of(_column(table, name), 0)


def _floats(table: Any, name: str) -> Float:
    """Numbers; NaN stands for unknown ones."""
    return np.asarray(numbers_of(_column(table, name), np.nan), dtype=np.float64)


def _lengths(table: Any, name: str) -> NDArray[np.int64]:
    return np.asarray(numbers_of(_column(table, name).value_lengths(), 0), dtype=np.int64)


def _flat(table: Any, name: str) -> Any:
    return _column(table, name).flatten()


def _vectors(table: Any, name: str, length: int) -> Float:
    """Vectors (n, length); NaN stands for unknown ones."""
    column = _column(table, name)
    vectors = np.full((len(table), length), np.nan)
    vectors[is_known(column)] = numbers_of(column.flatten(), np.nan).reshape(-1, length)
    return vectors


def _words(table: Any, name: str, words: Words, names_now: Mapping[str, str] | None = None) -> Codes:
    """Codes of words, with their present ones."""
    coded = _column(table, name).dictionary_encode()
    known = [(names_now or {}).get(word, word) for word in coded.dictionary.to_pylist()]
    return np.append(words.codes(known), UNKNOWN)[numbers_of(coded.indices, len(known))]
