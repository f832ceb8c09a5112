"""The table of damages, each tried: one clear line, no traceback, nothing lost, nothing half-written."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.command import run_in, vfoa
from tests.harness.damage import project as projects
from tests.harness.damage.sources import DAMAGED, STILL_READ, WHOLE
from tests.harness.damage.table import REFUSED, RUN, RUNS, SURVIVED, Case


@pytest.fixture(scope="module")
def table(whole: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The scores of the project as it is."""
    copied = projects.copy(whole, tmp_path_factory.mktemp("whole") / "project")
    run_in(copied, *RUN)
    return (copied / "out" / "frr.csv").read_text()


@pytest.mark.parametrize("damaged", REFUSED, ids=lambda each: each.name)
def test_damage_is_refused_in_one_line(
    damaged: Case, project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    damaged.damage(project)
    code, _, said = vfoa(monkeypatch, capsys, *damaged.command)
    assert code in (1, 2), said
    assert said.count("\n") == 1, said
    assert [word for word in damaged.says if word not in said] == [], said
    left = {path.name for path in (project / "out").glob("*")}
    assert not {name for name in left if name.startswith(("frr", "frames", "report", "results"))}


@pytest.mark.parametrize("source", WHOLE, ids=lambda each: each.name)
def test_an_undamaged_source_passes(
    source: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    source.damage(tmp_path)
    code, said, complaint = vfoa(monkeypatch, capsys, *source.command)
    assert code == 0, said + complaint
    assert [word for word in source.says if word not in said] == [], said


@pytest.mark.parametrize("damaged", DAMAGED, ids=lambda each: each.name)
def test_a_damaged_source_is_found_by_checking(
    damaged: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    damaged.damage(tmp_path)
    code, said, complaint = vfoa(monkeypatch, capsys, *damaged.command)
    (line,) = [line for line in (said + complaint).splitlines() if line.startswith("mine: ")]
    assert code == 2
    assert [word for word in damaged.says if word not in line] == [], line


@pytest.mark.parametrize("damaged", STILL_READ, ids=lambda each: each.name)
def test_what_is_left_of_a_source_is_used_and_the_loss_is_said(
    damaged: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    damaged.damage(tmp_path)
    code, said, complaint = vfoa(monkeypatch, capsys, *damaged.command)
    assert code == 0, said + complaint
    assert [word for word in damaged.says if word not in said] == [], said


@pytest.mark.parametrize("odd", SURVIVED, ids=lambda each: each.name)
def test_what_is_only_unusual_gives_the_same_table(
    odd: Case, table: str, project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    odd.damage(project)
    code, _, said = vfoa(monkeypatch, capsys, *odd.command)
    assert code == 0, said
    assert (project / "out" / "frr.csv").read_text() == table


@pytest.mark.parametrize("damaged", RUNS, ids=lambda each: each.name)
def test_a_damaged_run_is_refused_and_its_tables_stay(
    damaged: Case, finished_project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    project = finished_project
    damaged.damage(project)
    before = _tables(project)
    code, _, said = vfoa(monkeypatch, capsys, *damaged.command)
    assert code == 2, said
    assert said.count("\n") == 1, said
    assert [word for word in damaged.says if word not in said] == [], said
    assert _tables(project) == before


def _tables(project: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (project / "run").iterdir() if path.is_file()}
