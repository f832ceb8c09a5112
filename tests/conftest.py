"""Fixtures that say where real clips and weights are, and skip with a reason where they are not."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parent.parent


def _folder(variable: str, name: str) -> Path:
    folder = Path(os.environ.get(variable) or REPOSITORY.parent / "shared" / name)
    if not folder.is_dir():
        pytest.skip(f"needs {variable} or ../shared/{name}: no folder {folder}")
    return folder


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real clips."""
    return _folder("VFOA_DATA", "data")


@pytest.fixture(scope="session")
def shared_models() -> Path:
    """The folder of real weights."""
    return _folder("VFOA_MODELS", "models")
