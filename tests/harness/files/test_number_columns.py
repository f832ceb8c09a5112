from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from harness.files.tables import TableColumns
from vfoa.errors import VfoaError

CELLS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.text("0123456789+-.eE", max_size=6),
    st.sampled_from(["", "nan", "NA", "inf", "1_0", "1e999", "true", "1\n2", "²"]),
)


def _column(*cells: str) -> TableColumns:
    return TableColumns(path=Path("t.csv"), lines=tuple(range(2, 2 + len(cells))), cells={"x": cells})


@given(st.lists(CELLS, min_size=1, max_size=5))
@example(["1", "+.5", "2.e-3", ""])
@example(["1", "1_0"])
@example(["1", "1e999"])
@example(["1", "."])
def test_a_column_holds_what_each_of_its_cells_does(cells: list[str]) -> None:
    alone: list[float | None] = []
    for cell in cells:
        try:
            # beside a word, cells are read one by one
            alone.append(float(_column(cell, "NA").numbers("x")[0]))
        except VfoaError:
            alone.append(None)
    if None in alone:
        with pytest.raises(VfoaError, match=rf"^t\.csv:{2 + alone.index(None)}: x: expected a finite number"):
            _column(*cells).numbers("x")
    else:
        assert list(map(repr, _column(*cells).numbers("x").tolist())) == list(map(repr, alone))
    assert all(number is None or math.isnan(number) or math.isfinite(number) for number in alone)
