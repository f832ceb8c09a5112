"""What tests of runs on object storage share."""

from __future__ import annotations

import uuid
from collections.abc import Iterator

import fsspec
import pytest


@pytest.fixture
def address() -> Iterator[str]:
    """An empty folder on a storage in memory."""
    name = f"/{uuid.uuid4().hex}"
    yield f"memory:/{name}"
    storage = fsspec.filesystem("memory")
    if storage.exists(name):
        storage.rm(name, recursive=True)
