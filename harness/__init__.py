"""The evaluation harness around :mod:`vfoa`: clips, runs, recordings, scores, reports and the command line.

    import harness

    run = harness.run_experiment("demo", limit=20)      # or harness.load_run("runs/demo")
    print(run.frr[["clip", "configuration", "frr", "interval_low", "interval_high"]])
    print(run.failures)

Modules are imported when a name of theirs is first used; this one imports none of them: the command starts at once.
"""

from __future__ import annotations

import os
import sys

# Two views of 8K side by side have as many pixels; a file of a few kB can claim a thousand times more. OpenCV reads the
# variable on import.
os.environ["OPENCV_IO_MAX_IMAGE_PIXELS"] = str(2**26)

_HOMES = {
    "IncompleteRunWarning": "harness.api",
    "RunResults": "harness.api",
    "compare_runs": "harness.api",
    "load_run": "harness.api",
    "read_rig": "harness.api",
    "run_experiment": "harness.api",
}
"""The module of each public name; ``__init__.pyi`` tells type checkers the same."""

__all__ = ["IncompleteRunWarning", "RunResults", "compare_runs", "load_run", "read_rig", "run_experiment"]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'harness' has no attribute {name!r}")
    if sys.platform == "win32":
        from harness.processes import NOT_ON_WINDOWS

        raise ImportError(f"harness: {NOT_ON_WINDOWS}")
    from importlib import import_module

    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
