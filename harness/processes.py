"""Child processes of this program: they import nothing from the working directory."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from multiprocessing.context import SpawnContext


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
