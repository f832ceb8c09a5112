"""Print the Python files of ``harness/``, the studio apart, whose functions ``vfoa run demo --limit 2`` executes.

    python -m tests.trace [ARGUMENTS OF vfoa ...]

A file counts if at least one of its functions is executed. Code that runs on import, such as the body of a class, does
not count. Files come in the order in which they are entered first. The run has one process and one thread.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from types import FrameType
from typing import Any

DEFAULT = ("run", "demo", "--limit", "2", "--workers", "1", "--threads", "1")
_HARNESS = Path(__file__).resolve().parent.parent / "harness"
_ON_IMPORT = ("<module>", "<lambda>", "<genexpr>")


def files_run(arguments: tuple[str, ...]) -> list[Path]:
    """The files that ``vfoa`` with these arguments passes through, relative to ``harness/``."""
    from harness.cli import app

    found: dict[str, None] = {}

    def profile(frame: FrameType, event: str, argument: Any) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename not in found and _is_function(frame):
            found[code.co_filename] = None

    sys.setprofile(profile)
    try:
        app(list(arguments), standalone_mode=False)
    finally:
        sys.setprofile(None)
    paths = (Path(name).resolve() for name in found)
    inside = (path for path in paths if path.is_relative_to(_HARNESS) and path.suffix == ".py")
    return [path.relative_to(_HARNESS) for path in inside if "studio" not in path.relative_to(_HARNESS).parts]


def _is_function(frame: FrameType) -> bool:
    """Whether a frame is a function's, and not that of a module or of a class's body."""
    return frame.f_code.co_name not in _ON_IMPORT and bool(frame.f_code.co_flags & 0x02)  # CO_NEWLOCALS


def main() -> None:
    """Trace a run and print its files."""
    arguments = tuple(sys.argv[1:]) or DEFAULT
    with tempfile.TemporaryDirectory() as folder:
        out = ("--out", str(Path(folder) / "run")) if arguments[0] == "run" and "--out" not in arguments else ()
        files = files_run((*arguments, *out))
    for path in files:
        print(path.as_posix())  # noqa: T201
    print(f"{len(files)} files")  # noqa: T201


if __name__ == "__main__":
    main()
