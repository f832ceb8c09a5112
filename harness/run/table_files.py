"""The files of a run's tables (:mod:`harness.run.tables`): written frame by frame, found in a run, and read.

A row group has 600 frames, the same ones in all tables of a clip. Tables are read as columns of Arrow, or as the rows
of a row group in plain values.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from itertools import chain, pairwise, product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from harness.files.io import opened
from harness.run.directory import Pair, RunDirectory
from harness.run.manifest import RunManifest
from harness.run.tables import LENGTHS, NAMES, TABLES, directions_tables, scene_tables, schema_of
from vfoa.errors import VfoaError
from vfoa.types import DirectionFit, Flags

if TYPE_CHECKING:
    import pyarrow as pa  # type: ignore[import-untyped]
    from pyarrow.parquet import ParquetFile  # type: ignore[import-untyped]

FORMAT = b"4"
GROUP_FRAMES = 600
"""Most frames of a row group; the row groups of all tables of a clip have the same frames."""

Row = tuple[Any, ...]


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
            self._writers = {
                table: files.enter_context(new_parquet(path, schema_of(table), keys)) for table, path in paths.items()
            }
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

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
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


def new_parquet(path: Path, schema: pa.Schema, keys: Mapping[str, str] | None = None) -> Any:
    """A writer of a file with these columns and, in its metadata, keys: a context manager."""
    from pyarrow.parquet import ParquetWriter

    path.parent.mkdir(parents=True, exist_ok=True)
    about = {f"vfoa.{name}": value for name, value in (keys or {}).items()}
    described = schema.with_metadata({"vfoa.format": FORMAT, **about})
    return ParquetWriter(path, described, compression="zstd", write_page_checksum=True)


def write_again(path: Path, table: str, keys: Mapping[str, str]) -> None:
    """Write a table again under other keys. Raises the errors of :func:`open_table`."""
    import pyarrow as pa

    draft = path.with_name(f"{path.name}.again")
    with open_table(path, table) as file, new_parquet(draft, schema_of(table), keys) as writer:
        for group in range(file.num_row_groups):
            part = file.read_row_group(group, use_threads=False).replace_schema_metadata()
            for place, field in enumerate(schema_of(table)):
                if field.name in keys:
                    part = part.set_column(place, field, pa.array([keys[field.name]] * len(part), field.type))
            writer.write_table(part)
    draft.replace(path)


def make_table(table: str, keys: Mapping[str, str], rows: Sequence[Row]) -> pa.Table:
    """Make a table of rows without the columns that name it; a ``ValueError`` says that a number is not finite."""
    import pyarrow as pa

    schema = schema_of(table)
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


def find_tables(
    directory: RunDirectory, clips: Collection[str] | None = None, *, manifest: RunManifest | None = None
) -> Iterator[tuple[Pair, dict[str, Path]]]:
    """Find the files of the tables of every finished (clip, configuration), in the order of the experiment.

    With ``clips``, find those of these clips alone. ``manifest`` is the run's, if it has been read; or, of a run that
    goes on, the part of it on what is complete.

    Raises
    ------
    VfoaError
        If one of the answers is missing or damaged, or the run has no tables: it is of an earlier version, or not
        finished.
    """
    is_part, manifest = manifest is not None, manifest or directory.read_manifest()
    if not (manifest.finished or is_part) or not (directory.path / "answers").is_dir():
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


def open_table(path: Path, table: str) -> AbstractContextManager[ParquetFile]:
    """Open the file of a table, as :func:`open_parquet` does."""
    return open_parquet(path, schema_of(table))


@contextmanager
def open_parquet(path: Path, schema: pa.Schema) -> Iterator[ParquetFile]:
    """Open a file of :func:`new_parquet` with these columns.

    Raises
    ------
    VfoaError
        If it is missing, damaged or of another version, also if that shows in the block.
    """
    import pyarrow as pa
    from pyarrow.parquet import ParquetFile

    try:
        with opened(path) as content, ParquetFile(content, page_checksum_verification=True) as file:
            found = file.schema_arrow
            if (version := (found.metadata or {}).get(b"vfoa.format")) != FORMAT:
                other = f"one of format {version.decode(errors='replace')}" if version else "another file"
                raise VfoaError(
                    f"{path}: expected a table of format {FORMAT.decode()}, found {other}: run the experiment again"
                )
            if not found.equals(schema):
                raise VfoaError(f"{path}: expected the columns {schema.names}, found {found.names} or other types")
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


def read_arrow(path: Path, table: str, columns: Sequence[str], group: int | None = None) -> pa.Table:
    """Read some columns of a table, or of one of its row groups. Raises the errors of :func:`open_table`."""
    with open_table(path, table) as file:
        if group is None:
            part = file.read(columns=[*columns], use_threads=False)
        elif group < file.num_row_groups:
            part = file.read_row_group(group, columns=[*columns], use_threads=False)
        else:
            raise VfoaError(f"{path}: found {file.num_row_groups} row groups; expected those of frames.parquet")
    for name in columns:
        length = LENGTHS.get(TABLES[table][name].type.removesuffix("?"))
        if length and (numbers_of(part.column(name).combine_chunks().value_lengths(), length) != length).any():
            raise VfoaError(f"{path}: {name}: expected lists of {length} numbers")
    return part


def numbers_of(array: pa.Array, null: float) -> NDArray[Any]:
    """The numbers or flags of an array; ``null`` stands for unknown ones.

    ``to_numpy`` and ``fill_null`` of Arrow import pandas, which takes as long as all other imports of ``vfoa score``.
    """
    import pyarrow as pa

    if pa.types.is_boolean(array.type):
        return numbers_of(array.cast(pa.uint8()), null).astype(np.bool_)
    stored = pa.Array.from_buffers(array.type, len(array), [None, array.buffers()[1]], offset=array.offset)
    numbers = np.from_dlpack(stored)
    if array.null_count:
        numbers = numbers.copy()
        numbers[~is_known(array)] = null
    return numbers


def is_known(array: pa.Array) -> Flags:
    """Where an array has a value."""
    return numbers_of(array.is_valid(), 0)


def count_frames(path: Path) -> int:
    """The number of frames of ``frames.parquet``. Raises the errors of :func:`open_table`."""
    with open_table(path, "frames") as file:
        return int(file.metadata.num_rows)


def frames_of(path: Path) -> list[tuple[int, ...]]:
    """The frames of each row group of ``frames.parquet``, in order. Raises the errors of :func:`open_table`."""
    with open_table(path, "frames") as file:
        groups = [file.read_row_group(group, ["frame"], use_threads=False) for group in range(file.num_row_groups)]
    frames = [tuple(group.column("frame").to_pylist()) for group in groups]
    check_ascending(path, chain.from_iterable(frames))
    return frames


def check_ascending(path: Path, frames: Iterable[int]) -> None:
    """Raise a :class:`VfoaError` if a frame of ``frames.parquet`` is not above the one before."""
    for before, frame in pairwise(frames):
        if frame <= before:
            raise VfoaError(f"{path}: expected ascending frames, found frame {frame} after a later one or itself")


def read_columns(path: Path, table: str, group: int) -> list[list[Any]]:
    """Read the columns of a row group as plain values, without those that name the table.

    Lists are tuples, and a fit is a :class:`vfoa.types.DirectionFit`. Raises the errors of :func:`open_table`.
    """
    own = [name for name in TABLES[table] if name not in NAMES]
    part = read_arrow(path, table, own, group)
    return [_values(part.column(name).combine_chunks()) for name in own]


def _values(array: pa.Array) -> list[Any]:
    import pyarrow as pa

    values: list[Any]
    if pa.types.is_list(array.type):
        flat, at = _values(array.flatten()), 0
        values = []
        for length in numbers_of(array.value_lengths(), 0).tolist():
            values.append(tuple(flat[at : at + length]))
            at += length
    elif pa.types.is_struct(array.type):
        names = [field.name for field in array.type]
        columns = [_values(each) for each in array.flatten()]
        values = [DirectionFit(**dict(zip(names, row, strict=True))) for row in zip(*columns, strict=True)]
    elif pa.types.is_string(array.type):
        coded = array.dictionary_encode()
        words = [*coded.dictionary.to_pylist(), None]  # the last for a column of nulls
        values = [words[place] for place in numbers_of(coded.indices, 0).tolist()]
    else:
        values = numbers_of(array, 0).tolist()
    if not array.null_count:
        return values
    return [None if null else value for null, value in zip(array.is_null().to_pylist(), values, strict=True)]
