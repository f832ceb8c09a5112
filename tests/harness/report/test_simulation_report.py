from __future__ import annotations

import csv
from dataclasses import replace

import cv2
import pytest
from typer.testing import CliRunner

from harness.cli import app
from harness.report.simulation import statements_table, write_simulation
from vfoa.simulation import simulate, statements


@pytest.fixture(scope="module")
def few():
    return simulate(n_rays=(4, 40), radii_cm=(5, 10, 20, 30, 40))


@pytest.fixture(scope="module")
def written(few, tmp_path_factory):
    """The folder that the rows are written to."""
    folder = tmp_path_factory.mktemp("simulation")
    write_simulation(folder, few, statements(few))
    return folder


def test_every_row_every_statement_and_every_figure_is_written(few, written):
    with (written / "attention.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["total"]) for row in rows] == pytest.approx([row.total for row in few], abs=1e-6)
    page = (written / "simulation.md").read_text()
    assert all(each.claim in page for each in statements(few))
    for name in ("curves", "tuning", "settings"):
        assert f"({name}.svg)" in page
        assert "</svg>" in (written / f"{name}.svg").read_text()
        assert cv2.imread(str(written / f"{name}.png")).std() > 0


def test_equal_rows_give_equal_bytes(few, written, tmp_path):
    write_simulation(tmp_path, few, statements(few))
    one, other = ({path.name: path.read_bytes() for path in folder.iterdir()} for folder in (written, tmp_path))
    assert one == other


def test_a_statement_that_does_not_hold_says_no(few):

    first, *_ = statements(few)
    assert statements_table([replace(first, holds=False)]).rows[0][-1] == "no"


def test_the_verb_prints_the_statements_and_writes_the_files(few, tmp_path, monkeypatch):
    monkeypatch.setattr("vfoa.simulation.simulate", lambda: few)
    result = CliRunner().invoke(app, ["simulate", "--out", str(tmp_path / "sim")], env={"COLUMNS": "200"})
    assert result.exit_code == 0, result.output
    assert "gaze and head on different objects" in result.output
    assert (tmp_path / "sim" / "simulation.md").is_file()
    written = (tmp_path / "sim" / "simulation.md").stat().st_mtime_ns
    result = CliRunner().invoke(app, ["simulate", "--out", str(tmp_path / "sim")])
    assert "has files already; expected --replace, or another --out" in str(result.exception)
    assert (tmp_path / "sim" / "simulation.md").stat().st_mtime_ns == written
