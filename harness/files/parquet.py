"""Tables of other programs in Parquet, as those in CSV (:mod:`harness.files.tables`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from harness.files.tables import TableColumns
from vfoa.errors import VfoaError


def read_parquet_columns(path: Path) -> TableColumns:
    """Read the columns of a table, its cells as text; its first row has the number 1.

    Raises
    ------
    VfoaError
        If the file is missing or damaged.
    """
    import pyarrow as pa  # type: ignore[import-untyped]
    from pyarrow.parquet import ParquetFile  # type: ignore[import-untyped]

    try:
        with ParquetFile(path) as file:
            table = file.read(use_threads=False)
    except FileNotFoundError:
        raise VfoaError(f"{path}: no such file; expected a table") from None
    except (ValueError, pa.ArrowException, OSError) as error:
        raise VfoaError(f"{path}: damaged: {' '.join(str(error).split())}") from None
    cells = {
        name: tuple(map(_text, column.to_pylist()))
        for name, column in zip(table.column_names, table.columns, strict=True)
    }
    return TableColumns(path=path, lines=tuple(range(1, table.num_rows + 1)), cells=cells)


def _text(value: Any) -> str:
    """A cell; blank for a null and for NaN."""
    return "" if value is None or value != value else str(value)
