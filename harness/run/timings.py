"""The time that each stage took in each frame: rows of text while a run goes on, one Parquet file at its end.

It is not a result: it differs from run to run. Texts are in ``partial/``, one of the scene and one of the answers for
each (clip, configuration).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Self

from harness.run.directory import Pair, RunDirectory
from harness.run.table_files import new_parquet, open_parquet
from vfoa.errors import VfoaError, reported_as

if TYPE_CHECKING:
    import pyarrow as pa  # type: ignore[import-untyped]

    from harness.pipeline.perception import SharedFrame


def time_rows(pair: Pair, frame: int, timings: Mapping[str, float]) -> bytes:
    """The rows of a frame, from seconds by stage."""
    prefix = f"{pair[0]},{pair[1]},{frame}"
    return "".join(f"{prefix},{stage},{1e3 * seconds:.3f}\n" for stage, seconds in timings.items()).encode()


class SceneTimes:
    """Writes the time of each stage of a scene, for each configuration, in a ``with`` block: CSV files in ``partial/``.

    They get their names at the end.
    """

    def __init__(self, directory: RunDirectory, pairs: Iterable[Pair]) -> None:
        self._pairs = {pair: directory.partial(pair, "scene.csv") for pair in pairs}
        self._files = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as files:
            self._open = {}
            for pair, path in self._pairs.items():
                path.parent.mkdir(parents=True, exist_ok=True)
                self._open[pair[1]] = pair, files.enter_context(open(_draft_of(path), "wb"))
            self._files = files.pop_all()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._files.close()
        if kind is None:
            for path in self._pairs.values():
                _draft_of(path).replace(path)

    def write(self, shared: SharedFrame) -> None:
        """Write one frame."""
        for name, (pair, file) in self._open.items():
            followed = shared.by_configuration[name]
            if not isinstance(followed, VfoaError):
                file.write(time_rows(pair, shared.index, followed.timings))
                file.flush()


def _draft_of(path: Path) -> Path:
    return path.with_name(f"{path.name}.partial")


def _schema() -> pa.Schema:
    """The columns of ``timings.parquet``: milliseconds by clip, configuration, frame and stage."""
    import pyarrow as pa

    words, number = pa.string(), pa.int64()
    types = {"clip": words, "configuration": words, "frame": number, "stage": words, "ms": pa.float32()}
    return pa.schema([pa.field(name, type_, nullable=False) for name, type_ in types.items()])


def join_timings(directory: RunDirectory, pairs: Iterable[Pair]) -> None:
    """Make ``timings.parquet`` from the texts of finished pairs, which are kept: a row group for each text."""
    draft, schema = directory.timings.with_name(f"{directory.timings.name}.partial"), _schema()
    with new_parquet(draft, schema) as writer:
        for pair in pairs:
            for suffix in ("scene.csv", "csv"):  # without the first, a scene of a finished run was attended again
                text = directory.partial(pair, suffix)
                if text.is_file() and text.stat().st_size:
                    writer.write_table(_parsed(text, schema))
    draft.replace(directory.timings)


def _parsed(text: Path, schema: pa.Schema) -> pa.Table:
    from pyarrow import csv

    with reported_as(f"{text}: not the times of stages"):
        table = csv.read_csv(
            text,
            read_options=csv.ReadOptions(use_threads=False, column_names=schema.names),
            convert_options=csv.ConvertOptions(column_types=schema, null_values=[]),
        )
    return table.cast(schema)


def read_timings(directory: RunDirectory, columns: Sequence[str] | None = None) -> pa.Table:
    """Read the times of a finished run, or some of their columns; no rows if it has no file of them.

    Runs of earlier versions have none.

    Raises
    ------
    VfoaError
        If the file is damaged, of another version, or another file.
    """
    if not directory.timings.is_file():
        return _schema().empty_table().select(columns or _schema().names)
    with open_parquet(directory.timings, _schema()) as file:
        return file.read(columns, use_threads=False).replace_schema_metadata()
