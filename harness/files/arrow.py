"""PyArrow without pandas, which it would import as soon as it makes an array."""

from __future__ import annotations

import sys
from functools import cache


class _Hidden:
    """A finder that says of pandas that it is not installed."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> None:
        """Raise an error for pandas; leave other modules to the next finder."""
        if name == "pandas":
            raise ModuleNotFoundError(f"{name} is hidden from PyArrow", name=name)


@cache
def leave_pandas_out() -> None:
    """Let PyArrow make arrays without pandas: to import it takes a quarter of a short run.

    ``pyarrow.array``, also called by Rerun, looks once whether its argument can be one of pandas. What needs pandas,
    such as ``to_pandas``, imports it later all the same.
    """
    if "pandas" in sys.modules:
        return
    import pyarrow as pa  # type: ignore[import-untyped]

    sys.meta_path.insert(0, _Hidden)
    try:
        pa.array([])
    finally:
        sys.meta_path.remove(_Hidden)
