"""The folder for stage outputs, copies of remote files and other data that can be computed or fetched again."""

from __future__ import annotations

import os
from pathlib import Path

import platformdirs

VARIABLE = "VFOA_CACHE"


def cache_root() -> Path:
    """``$VFOA_CACHE``, or the cache folder of the platform."""
    return Path(os.environ.get(VARIABLE) or _of_platform())


def _of_platform() -> str:
    return platformdirs.user_cache_dir("vfoa")
