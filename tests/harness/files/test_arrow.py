"""PyArrow makes arrays without pandas, and converts to pandas and from it as ever."""

from __future__ import annotations

import subprocess
import sys

import pytest

CODE = """
import sys
{made}
print("pyarrow" in sys.modules, "pandas" in sys.modules)
import pyarrow as pa
table = pa.table({{"a": [1, 2]}})
frame = table.to_pandas()
print("pandas" in sys.modules, pa.Table.from_pandas(frame, preserve_index=False).equals(table))
print(pa.array(frame["a"].where(frame["a"] > 1)).null_count)
"""


@pytest.mark.parametrize(
    "made",
    [
        "from harness.run.table_files import make_table; make_table('frames', {'clip': 'a', 'scene': 'b'}, ())",
        "import harness.record.layer_file, rerun; rerun.Points3D([[1, 2, 3]])",
    ],
    ids=["tables", "recordings"],
)
def test_arrays_are_made_without_pandas_and_what_needs_it_imports_it(made: str) -> None:
    """In a process of its own: other tests import pandas."""
    command = [sys.executable, "-c", CODE.format(made=made)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "False", "True", "True", "1"]
