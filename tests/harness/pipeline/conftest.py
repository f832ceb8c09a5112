"""A site on this machine, and an empty folder of weights, for tests that fetch networks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.web import Site, serve


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The only folder of weights; it does not exist yet."""
    monkeypatch.delenv("VFOA_MODELS", raising=False)
    monkeypatch.setattr("vfoa.weights.platformdirs.user_cache_dir", lambda name: str(tmp_path / "cache"))
    for name in ("HTTP_PROXY", "ALL_PROXY", "http_proxy", "all_proxy"):
        monkeypatch.delenv(name, raising=False)
    return tmp_path / "cache" / "models"


@pytest.fixture
def site() -> Iterator[Site]:
    with serve() as found:
        yield found
