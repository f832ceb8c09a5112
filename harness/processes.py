"""The process of this program, and its child processes, which import nothing from the working directory."""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from multiprocessing.context import SpawnContext


def main() -> None:
    """Run the command line; Ctrl-C ends it without a traceback, also while it is still imported."""
    try:
        import_module("harness.cli").main()
    except KeyboardInterrupt:
        raise SystemExit(130) from None


def keep_working_directory_out() -> None:
    """Keep the working directory out of the import path of child processes, unless the user set ``PYTHONSAFEPATH``.

    Otherwise a file named like a module of the standard library, such as ``signal.py``, would be imported in its place.
    """
    os.environ.setdefault("PYTHONSAFEPATH", "1")


def spawning() -> SpawnContext:
    """The context that starts processes: spawned, and without the working directory in their path."""
    import multiprocessing

    keep_working_directory_out()
    return multiprocessing.get_context("spawn")
