"""Measurements for who develops vfoa: ``python -m scripts.measure NAME ...``; ``NAME --help`` prints the options.

The measurements that a user needs on another machine are ``vfoa bench``.
"""

from __future__ import annotations

import sys
from importlib import import_module

NAMES = (
    "again",
    "coverage",
    "cut_faces",
    "demo_seeds",
    "gaze_filter",
    "hours",
    "many_clips",
    "overhead",
    "posterior",
    "presets",
    "recording_size",
    "settings_left_out",
    "small_faces",
    "turned_faces",
)


def main() -> None:
    """Run one measurement."""
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name not in NAMES:
        sys.exit(f"measure: no {name!r}; expected one of: {', '.join(NAMES)}")
    sys.argv[:2] = [f"scripts.measure {name}"]
    import_module(f"scripts.measure.{name}").main()


if __name__ == "__main__":
    main()
