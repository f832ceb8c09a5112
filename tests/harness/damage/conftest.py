"""The project that is damaged, built once, and a copy of it for every test."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.command import run_in
from tests.harness.damage import project as projects
from tests.harness.damage.table import replaced


@pytest.fixture(scope="package")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return projects.build(tmp_path_factory.mktemp("damage"))


@pytest.fixture
def project(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    copied = projects.copy(whole, tmp_path / "project")
    monkeypatch.chdir(copied)
    return copied


@pytest.fixture(scope="package")
def finished(whole: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project with a finished run in it."""
    copied = projects.copy(whole, tmp_path_factory.mktemp("finished") / "project")
    run_in(copied, "run", "e.toml", "--out", "run", "--workers", "1")
    return copied


@pytest.fixture
def finished_project(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the project with its run, which knows that it has moved."""
    copied = projects.copy(finished, tmp_path / "project")
    replaced("run/manifest.json", str(finished), str(copied))(copied)
    monkeypatch.chdir(copied)
    return copied
