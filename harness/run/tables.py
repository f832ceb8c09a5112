"""The frames of a run as Parquet files, for programs; what is the same for several configurations is stored once.

    scenes/SCENE/CLIP/{frames,instances,objects,people,clouds}.parquet  what was found in the images
    directions/DIRECTIONS/CLIP/{directions,true_people}.parquet         where people look
    answers/CONFIGURATION/CLIP.parquet                                  what they look at

SCENE and DIRECTIONS are digests of all that decides them (:mod:`harness.run.scenes`). Each table begins with the clip
and these names, so that tables can be joined. The rows of a frame keep their order, a row group has 600 frames, and
null means unknown.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields
from functools import cache
from itertools import pairwise, product
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from harness.files.io import opened
from harness.run.directory import Pair, RunDirectory
from harness.run.manifest import RunManifest
from vfoa.errors import VfoaError
from vfoa.types import DirectionFit

if TYPE_CHECKING:
    import pyarrow as pa  # type: ignore[import-untyped]
    from pyarrow.parquet import ParquetFile  # type: ignore[import-untyped]

FORMAT = b"3"
GROUP_FRAMES = 600
"""Most frames of a row group; the row groups of all tables of a clip have the same frames."""


@dataclass(frozen=True, slots=True)
class Column:
    """A column: its type ("?": may be null; ``vec3``: a list of three doubles), and what it means."""

    type: str
    meaning: str


_NAMES = {
    "clip": Column("string", "Name of the clip."),
    "scene": Column("string", "Digest of all that decides the scene, as in the path."),
    "directions": Column("string", "Digest of all that decides the directions, as in the path."),
    "configuration": Column("string", "Name of the configuration."),
}
_FRAME = Column("int64", "Number of the frame in the source.")
_TRACK = Column("int32", "Number of the person in the clip, from 1.")


def _of(*names: str) -> dict[str, Column]:
    """The columns that name a table, and the frame."""
    return {**{name: _NAMES[name] for name in names}, "frame": _FRAME}


TABLES: Mapping[str, Mapping[str, Column]] = {
    "frames": {
        **_of("clip", "scene"),
        "time_ns": Column("int64", "Time of the frame, ns."),
        "masks_from": Column("int64?", "Key frame whose masks were carried to this one; null: found in this one."),
        "masks_age_s": Column("double?", "Seconds from that frame to this one."),
        "has_truth": Column("bool", "Whether stages were measured against ground truth."),
        "disparity_error_px": Column("double?", "Median error of the disparity, px; null: none is known."),
        "disparity_over_2_px": Column("double?", "Share of pixels whose error is above 2 px."),
        "disparity_known": Column("double?", "Share of the pixels with ground truth that have a disparity."),
        "width_px": Column("int32?", "Width of the images; null, as all that follows: the clip has no images."),
        "height_px": Column("int32?", "Height of the images."),
        "fx_px": Column("double?", "Focal length of the left camera, px."),
        "fy_px": Column("double?", "The same along the columns, px."),
        "cx_px": Column("double?", "Principal point of the left camera, px."),
        "cy_px": Column("double?", "The same along the columns, px."),
        "baseline_m": Column("double?", "Distance of the two cameras, m."),
        "cx_right_px": Column("double?", "Principal point of the right camera, px."),
        "has_right": Column("bool", "Whether the frame has a right image."),
        "has_depth": Column("bool", "Whether the frame has a measured depth map."),
    },
    "instances": {
        **_of("clip", "scene"),
        "instance_id": Column("int32", "Number of the object or person in the frame."),
        "name": Column("string", "The manifest's name, or `label#id`; may repeat."),
        "label": Column("string", "Class."),
        "own_name": Column("string?", "The source's own name, as of a drawn shape; null: it has none."),
        "category_id": Column("int32", "The source's number of the class."),
        "is_thing": Column("bool", "Whether it can be counted, as a cup; sky cannot."),
        "score": Column("double", "Score of the segmenter, 0 to 1."),
        "box_px": Column("vec4?", "Box in the left image: u0, v0, u1, v1, px; null: the clip has no images."),
        "points": Column("int32", "Number of 3D points."),
        "center_m": Column("vec3?", "Centre of the 3D box in the left camera's frame, m; null: no box."),
        "half_size_m": Column("vec3?", "Half extents of the 3D box along its axes, m."),
        "axes": Column("vec9?", "Axes of the 3D box, three unit vectors one after the other."),
    },
    "objects": {
        **_of("clip", "scene"),
        "truth_id": Column("int32", "Number of the true object or person."),
        "label": Column("string", "Its class."),
        "instance_id": Column("int32?", "Instance found for it; null: none."),
        "mask_iou": Column("double", "IoU of the masks."),
        "box_iou": Column("double?", "IoU of the 3D boxes, along the camera's axes."),
        "center_error_m": Column("double?", "Distance of the boxes' centres, m."),
    },
    "people": {
        **_of("clip", "scene"),
        "track_id": _TRACK,
        "name": Column("string?", "The manifest's name of the person; null: not known."),
        "instance_id": Column("int32?", "Instance of the person; null: none."),
        "head_box_px": Column("vec4?", "Box of the head in the left image, px; null: the clip has no images."),
        "head_score": Column("double?", "Score of the head's detector."),
        "looked_at": Column(
            "int32?", 'Instance at the point of the image that `attention.method = "answers"` reads; 0: none.'
        ),
    },
    "clouds": {
        **_of("clip", "scene"),
        "instance_id": Column("int32", "Instance whose 3D points these are; one without points has no row."),
        "points": Column("int32", "Number of the points, evenly chosen: one that a method of the run asks for."),
        "points_m": Column("list<float>", "The points in the left camera's frame, m: x, y, z of the first, and so on."),
    },
    "directions": {
        **_of("clip", "scene", "directions"),
        "track_id": _TRACK,
        "eye_origin_m": Column("vec3?", "Point between the eyes in the left camera's frame, m."),
        "gaze": Column("vec3?", "Unit vector of the gaze as measured, in the left camera's frame."),
        "gaze_sigma_rad": Column("double?", "Error that the gaze model claims, rad."),
        "no_gaze": Column("string?", "The gaze model's reason to give none, such as `face_turned_away`."),
        "head": Column("vec3?", "Unit vector of the head's direction as measured."),
        "head_sigma_rad": Column("double?", "Error that the head pose model claims, rad."),
        "head_width_m": Column("double?", "Width of the head's box at the depth of the eyes, m."),
    },
    "true_people": {
        **_of("clip", "scene", "directions"),
        "name": Column("string", "Name of the true person."),
        "head_box_iou": Column("double", "IoU of the head boxes; 0: no head was found."),
        "eye_error_m": Column("double?", "Distance of the eye origins, m."),
        "head_error_deg": Column("double?", "Angle between the directions of the head, deg."),
        "gaze_error_deg": Column("double?", "Angle between the gaze directions, deg."),
    },
    "answers": {
        **_of(*_NAMES),
        "track_id": _TRACK,
        "missing": Column("string?", "Why there is none, such as `no_eyes_3d`; null: there is one."),
        "focus": Column("int32?", "Instance with the most attention; null: nowhere, or no answer."),
        "tied": Column("list<int32>", "Other instances with exactly the same attention."),
        "targets": Column("list<int32>", "Instances, in the order of the three lists of attention."),
        "gaze": Column("list<double?>", "Attention to each target from the gaze, 0 to 1; null: not measured."),
        "head": Column("list<double?>", "Attention to each target from the head, 0 to 1; null: not measured."),
        "total": Column("list<double>", "Attention to each target, 0 to 1."),
        "fit": Column(
            "fit?", "How well the directions fit the posterior (`vfoa.types.DirectionFit`); null: no posterior."
        ),
        "gaze_filtered": Column(
            "vec3?", "Unit vector of the gaze after `gaze_filter`; null too if gazes are not filtered."
        ),
        "head_filtered": Column("vec3?", "The same of the head's direction."),
    },
}
"""The columns of each table."""

SCENE_TABLES = ("frames", "instances", "objects", "people", "clouds")
DIRECTIONS_TABLES = ("directions", "true_people")
"""The tables in a folder of ``scenes/`` and of ``directions/``."""

Row = tuple[Any, ...]


def scene_tables(root: Path, clip: str, scene: str) -> dict[str, Path]:
    """The files of the tables of a scene, in a run's folder."""
    return {table: root / "scenes" / scene / clip / f"{table}.parquet" for table in SCENE_TABLES}


def directions_tables(root: Path, clip: str, directions: str) -> dict[str, Path]:
    """The files of the tables of directions, in a run's folder."""
    return {table: root / "directions" / directions / clip / f"{table}.parquet" for table in DIRECTIONS_TABLES}


class TableWriter:
    """Writes tables frame by frame. The row groups of all have the same frames.

    Parameters
    ----------
    paths
        The file of each table; their folders are made.
    keys
        The values of the columns that name a table.
    """

    def __init__(self, paths: Mapping[str, Path], keys: Mapping[str, str]) -> None:
        self._keys, self._frames = keys, 0
        self._rows: dict[str, list[Row]] = {table: [] for table in paths}
        with ExitStack() as files:
            self._writers = {table: files.enter_context(_new(path, table, keys)) for table, path in paths.items()}
            self._files = files.pop_all()

    def add(self, rows: Mapping[str, Iterable[Row]]) -> None:
        """Add the rows of the next frame by table, without the columns that name the table.

        Raises
        ------
        ValueError
            If a number is not finite, also in an earlier frame of the row group.
        """
        for table, of_frame in rows.items():
            self._rows[table].extend(of_frame)
        self._frames += 1
        if self._frames == GROUP_FRAMES:
            self._write()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.abandon()

    def close(self) -> None:
        """Write what remains, and close the files. Raises the errors of :meth:`add`."""
        with self._files:
            if self._frames:
                self._write()

    def abandon(self) -> None:
        """Close the files without the frames that are not written yet."""
        self._files.close()

    def _write(self) -> None:
        for table, rows in self._rows.items():
            self._writers[table].write_table(make_table(table, self._keys, rows))
            rows.clear()
        self._frames = 0


def _new(path: Path, table: str, keys: Mapping[str, str]) -> Any:
    """A writer of a table's file, which is a context manager."""
    from pyarrow.parquet import ParquetWriter

    path.parent.mkdir(parents=True, exist_ok=True)
    about = {f"vfoa.{name}": value for name, value in keys.items()}
    schema = _schema(table).with_metadata({"vfoa.format": FORMAT, **about})
    return ParquetWriter(path, schema, compression="zstd", write_page_checksum=True)


def write_again(path: Path, table: str, keys: Mapping[str, str]) -> None:
    """Write a table again under other keys. Raises the errors of :func:`open_table`."""
    import pyarrow as pa

    draft = path.with_name(f"{path.name}.again")
    with open_table(path, table) as file, _new(draft, table, keys) as writer:
        for group in range(file.num_row_groups):
            part = file.read_row_group(group, use_threads=False).replace_schema_metadata()
            for place, field in enumerate(_schema(table)):
                if field.name in keys:
                    part = part.set_column(place, field, pa.array([keys[field.name]] * len(part), field.type))
            writer.write_table(part)
    draft.replace(path)


def make_table(table: str, keys: Mapping[str, str], rows: Sequence[Row]) -> pa.Table:
    """Make a table of rows without the columns that name it; a ``ValueError`` says that a number is not finite."""
    import pyarrow as pa

    schema = _schema(table)
    named = [name for name in schema.names if name in keys]
    columns = list(zip(*rows, strict=True)) or [()] * (len(schema.names) - len(named))
    values = [*([keys[name]] * len(rows) for name in named), *columns]
    arrays = [pa.array(each, field.type) for each, field in zip(values, schema, strict=True)]
    for name, array in zip(schema.names, arrays, strict=True):
        _check_finite(name, array)
    return pa.Table.from_arrays(arrays, schema=schema)


def _check_finite(name: str, array: pa.Array) -> None:
    """Refuse NaN and infinity, also within lists and structs."""
    import pyarrow as pa

    if pa.types.is_list(array.type):
        _check_finite(name, array.flatten())
    elif pa.types.is_struct(array.type):
        for leaf in array.flatten():
            _check_finite(name, leaf)
    elif pa.types.is_floating(array.type) and not np.isfinite(array.drop_null().to_numpy()).all():
        raise ValueError(f"{name}: found a number that is not finite")


_LENGTHS = {"vec3": 3, "vec4": 4, "vec9": 9}


@cache
def _schema(table: str) -> Any:
    import pyarrow as pa

    integers = pa.list_(pa.field("element", pa.int32(), nullable=False))
    doubles = pa.list_(pa.field("element", pa.float64(), nullable=False))
    fit = [pa.field(each.name, pa.float64(), nullable=each.name != "tail") for each in fields(DirectionFit)]
    types = {
        **{name: pa.type_for_alias(name) for name in ("string", "int32", "int64", "double", "bool")},
        "list<int32>": integers,
        "list<double>": doubles,
        "list<float>": pa.list_(pa.field("element", pa.float32(), nullable=False)),
        "list<double?>": pa.list_(pa.float64()),
        **dict.fromkeys(_LENGTHS, doubles),
        "fit": pa.struct(fit),
    }
    return pa.schema(
        pa.field(name, types[column.type.removesuffix("?")], nullable=column.type.endswith("?"))
        for name, column in TABLES[table].items()
    )


def find_tables(
    directory: RunDirectory, clips: Collection[str] | None = None, *, manifest: RunManifest | None = None
) -> Iterator[tuple[Pair, dict[str, Path]]]:
    """Find the files of the tables of every finished (clip, configuration), in the order of the experiment.

    With ``clips``, find those of these clips alone. ``manifest`` is the run's, if it has been read.

    Raises
    ------
    VfoaError
        If one of the answers is missing or damaged, or the run has no tables: it is of an earlier version, or not
        finished.
    """
    manifest = manifest or directory.read_manifest()
    if not manifest.finished or not (directory.path / "answers").is_dir():
        why = "is of an earlier version; run it again" if manifest.finished else "is not finished"
        raise VfoaError(f"{directory.path}: has no tables of frames (answers/): it {why}")
    failed = manifest.failed_pairs
    names = [clip.name for clip in manifest.clips if clips is None or clip.name in clips]
    for clip, configuration in product(names, manifest.configurations):
        if (clip, configuration) not in failed:
            yield (clip, configuration), answer_tables(directory, (clip, configuration))


def answer_tables(directory: RunDirectory, pair: Pair) -> dict[str, Path]:
    """The files of the tables of a finished (clip, configuration). Raises the errors of :func:`find_tables`."""
    path = directory.answers(pair)
    with open_table(path, "answers") as file:
        about = {key.decode(): value.decode() for key, value in file.schema_arrow.metadata.items()}
    if missing := [name for name in ("scene", "directions") if f"vfoa.{name}" not in about]:
        raise VfoaError(f"{path}: expected its {' and '.join(missing)} in the file's metadata, found none")
    return {
        **scene_tables(directory.path, pair[0], about["vfoa.scene"]),
        **directions_tables(directory.path, pair[0], about["vfoa.directions"]),
        "answers": path,
    }


@contextmanager
def open_table(path: Path, table: str) -> Iterator[ParquetFile]:
    """Open the file of a table.

    Raises
    ------
    VfoaError
        If it is missing, damaged or of another version, also if that shows in the block.
    """
    import pyarrow as pa
    from pyarrow.parquet import ParquetFile

    try:
        with opened(path) as content, ParquetFile(content, page_checksum_verification=True) as file:
            found, expected = file.schema_arrow, _schema(table)
            if (version := (found.metadata or {}).get(b"vfoa.format")) != FORMAT:
                it = f"one of format {version.decode(errors='replace')}" if version else "another file"
                raise VfoaError(
                    f"{path}: expected a table of format {FORMAT.decode()}, found {it}: run the experiment again"
                )
            if not found.equals(expected):
                raise VfoaError(f"{path}: expected the columns {expected.names}, found {found.names} or other types")
            yield file
    except (ValueError, pa.ArrowException, OSError) as error:
        raise VfoaError(f"{path}: damaged: {' '.join(str(error).split())}") from None


def read_table(directory: RunDirectory, table: str) -> pa.Table:
    """Read one table (:data:`TABLES`) of all clips and configurations of a finished run.

    Raises
    ------
    VfoaError
        If a file is missing, damaged or of another version; the message names it.
    """
    import pyarrow as pa

    parts = []
    for path in dict.fromkeys(paths[table] for _, paths in find_tables(directory)):
        with open_table(path, table) as file:
            parts.append(file.read(use_threads=False).replace_schema_metadata())
    return pa.concat_tables(parts)


def read_arrow(path: Path, table: str, columns: Sequence[str]) -> pa.Table:
    """Read some columns of a table. Raises the errors of :func:`open_table`."""
    with open_table(path, table) as file:
        return file.read(columns=list(columns), use_threads=False)


def count_rows(path: Path, table: str) -> int:
    """The number of rows of a table. Raises the errors of :func:`open_table`."""
    with open_table(path, table) as file:
        return int(file.metadata.num_rows)


def read_numbers(path: Path, table: str) -> list[tuple[int, ...]]:
    """Read the numbers of the frames of each row group. Raises the errors of :func:`open_table`."""
    with open_table(path, table) as file:
        groups = [file.read_row_group(group, ["frame"], use_threads=False) for group in range(file.num_row_groups)]
    return [tuple(group.column("frame").to_pylist()) for group in groups]


def check_ascending(path: Path, frames: Iterable[int]) -> None:
    """Raise a :class:`VfoaError` if a frame of ``frames.parquet`` is not above the one before."""
    for before, frame in pairwise(frames):
        if frame <= before:
            raise VfoaError(f"{path}: expected ascending frames, found frame {frame} after a later one or itself")


def read_columns(path: Path, table: str, group: int) -> list[list[Any]]:
    """Read the columns of a row group as plain values, without those that name the table.

    Lists are tuples, and a fit is a :class:`vfoa.types.DirectionFit`. Raises the errors of :func:`open_table`.
    """
    own = {name: column for name, column in TABLES[table].items() if name not in _NAMES}
    with open_table(path, table) as file:
        if group >= file.num_row_groups:
            raise VfoaError(f"{path}: found {file.num_row_groups} row groups; expected those of frames.parquet")
        part = file.read_row_group(group, columns=list(own), use_threads=False)
    columns = [_values(part.column(name).combine_chunks()) for name in own]
    for (name, column), values in zip(own.items(), columns, strict=True):
        length = _LENGTHS.get(column.type.removesuffix("?"))
        if length and any(value is not None and len(value) != length for value in values):
            raise VfoaError(f"{path}: {name}: expected lists of {length} numbers")
    return columns


def _values(array: pa.Array) -> list[Any]:
    import pyarrow as pa

    values: list[Any]
    if pa.types.is_list(array.type):
        flat, at = _values(array.flatten()), 0
        values = []
        for length in array.value_lengths().fill_null(0).to_numpy().tolist():
            values.append(tuple(flat[at : at + length]))
            at += length
    elif pa.types.is_struct(array.type):
        names = [field.name for field in array.type]
        columns = [_values(each) for each in array.flatten()]
        values = [DirectionFit(**dict(zip(names, row, strict=True))) for row in zip(*columns, strict=True)]
    elif pa.types.is_string(array.type):
        coded = array.dictionary_encode()
        words = [*coded.dictionary.to_pylist(), None]  # the last for a column of nulls
        values = [words[place] for place in coded.indices.fill_null(0).to_numpy().tolist()]
    else:
        values = (array.fill_null(0) if array.null_count else array).to_numpy(zero_copy_only=False).tolist()
    if not array.null_count:
        return values
    return [None if null else value for null, value in zip(array.is_null().to_pylist(), values, strict=True)]
