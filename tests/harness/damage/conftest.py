"""The project that is damaged, built once, and a copy of it for every test."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.harness.damage import project as projects


@pytest.fixture(scope="package")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return projects.build(tmp_path_factory.mktemp("damage"))


@pytest.fixture
def project(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    copied = projects.copy(whole, tmp_path / "project")
    monkeypatch.chdir(copied)
    return copied
