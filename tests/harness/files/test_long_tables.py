from __future__ import annotations

from pathlib import Path

import pytest

from harness.files import dialects
from harness.files.tables import read_columns


def test_equal_cells_of_a_table_are_held_once(tmp_path: Path) -> None:
    columns = _columns(tmp_path, 100)
    assert [len({id(cell) for cell in cells}) for cells in columns.values()] == [2, 1, 100]


def test_of_very_many_different_cells_only_the_first_are_remembered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dialects, "_MOST_SHARED", 10)
    columns = _columns(tmp_path, 100)
    assert columns == {
        "person": ("anna", "ben") * 50,
        "size": ("0.25",) * 100,
        "x": tuple(f"{place / 8:.4f}" for place in range(100)),
    }


def _columns(folder: Path, rows: int) -> dict[str, tuple[str, ...]]:
    path = folder / "people.csv"
    lines = [f"{('anna', 'ben')[place % 2]},0.25,{place / 8:.4f}" for place in range(rows)]
    path.write_text("\n".join(["person,size,x", *lines]))
    return dict(read_columns(path, None, ()).cells)
