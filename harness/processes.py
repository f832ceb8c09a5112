"""Processes that this program starts: they import nothing that happens to lie in the working directory."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from multiprocessing.context import SpawnContext


def keep_working_directory_out() -> None:
    """Let every Python that is started from here on leave the working directory alone, unless the user said otherwise.

    It would take a file called as a module of the standard library, such as ``signal.py``, for that module.
    """
    os.environ.setdefault("PYTHONSAFEPATH", "1")


def spawning() -> SpawnContext:
    """How processes are started: anew, and safely."""
    import multiprocessing

    keep_working_directory_out()
    return multiprocessing.get_context("spawn")
