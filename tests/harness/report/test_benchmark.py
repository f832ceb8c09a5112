"""Every method on every material at hand."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from harness.cli import app
from harness.report import benchmark, benchmark_tables
from harness.report.benchmark import METHODS, BenchmarkMaterial
from harness.report.benchmark_tables import RULE
from scripts.quoted_figures import tables
from tests.disk import write_text
from tests.measured import EXPERIMENT, measured_tables, true_labels
from vfoa.errors import VfoaError


@pytest.fixture
def talk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with a labelled clip ``talk``; two materials are made of it, two more are not here."""
    measured_tables(tmp_path / "data" / "talk")
    monkeypatch.chdir(tmp_path)
    assert CliRunner().invoke(app, ["clips", "add", str(tmp_path / "data" / "talk")]).exit_code == 0
    write_text(tmp_path / "annotations" / "talk.csv", true_labels())
    write_text(tmp_path / "experiments" / "talk.toml", EXPERIMENT)
    write_text(tmp_path / "experiments" / "gone.toml", EXPERIMENT.replace('"talk"', '"gone"'))
    wide = {"wide": {"cones_cm": [60]}}
    materials = {
        "first": BenchmarkMaterial(title="first", setting="talk", experiment="talk"),
        "second": BenchmarkMaterial(title="second", setting="talk", experiment="talk", methods=wide),
        "third": BenchmarkMaterial(title="third", setting="third", experiment="gone"),
        "fourth": BenchmarkMaterial(title="fourth", setting="fourth", experiment="nowhere"),
    }
    monkeypatch.setattr(benchmark, "MATERIALS", materials)
    monkeypatch.setattr(benchmark_tables, "MATERIALS", materials)
    return tmp_path


def _run(*options: str) -> str:
    return CliRunner().invoke(app, ["run", "benchmark", "--workers", "1", *options], catch_exceptions=False).stdout


def test_one_that_is_interrupted_between_two_materials_says_what_is_kept(
    talk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def made(name: str, *changes: object) -> object:
        if name == "second":
            raise KeyboardInterrupt
        return material_experiment(name, *changes)  # type: ignore[arg-type]

    material_experiment = benchmark.material_experiment
    monkeypatch.setattr(benchmark, "material_experiment", made)
    ended = CliRunner().invoke(app, ["run", "benchmark", "--workers", "1", "--limit", "2"])
    assert ended.exit_code == 130
    (said,) = ended.stderr.splitlines()
    assert str(Path("runs") / "benchmark") in said
    assert (talk / "runs" / "benchmark" / "first" / "frr.csv").is_file()


def _table(path: Path) -> list[dict[str, str]]:
    return [*csv.DictReader(io.StringIO(path.read_text(encoding="utf-8")))]


def test_the_table_has_every_method_on_what_is_here(talk: Path) -> None:
    output = _run()
    rows = _table(talk / "runs" / "benchmark" / "benchmark.csv")
    methods = {name: [row["Method"] for row in rows if row["Material"] == name] for name in ("first", "second")}
    assert [len(each) for each in methods.values()] == [len(METHODS) + 1, len(METHODS) + 2]
    assert methods["first"][0].startswith(RULE)
    assert methods["first"][1:] == list(METHODS)
    assert methods["second"][1:] == [*METHODS, "wide"]
    assert {row["n"] for row in rows} == {"24"}
    assert "third: not run" in " ".join(output.split())
    page = (talk / "runs" / "benchmark" / "benchmark.html").read_text(encoding="utf-8")
    links = {
        address: (talk / "runs" / "benchmark" / address).is_file() for address in re.findall(r'href="([a-z].*?)"', page)
    }
    assert links == {"first/report.html": True, "second/report.html": True, "data:,": False}
    assert "fourth: not run" in " ".join(output.split())


def test_a_row_is_that_of_the_run_in_the_materials_folder(talk: Path) -> None:
    _run("--out", "out")
    rates = _table(talk / "out" / "second" / "frr.csv")
    of_run = {row["configuration"]: row for row in rates if row["subject"] == "(all)"}
    for row in _table(talk / "out" / "benchmark.csv"):
        if row["Material"] == "second" and not row["Method"].startswith(RULE):
            assert float(row["FRR %"]) == pytest.approx(100 * float(of_run[row["Method"]]["frr"]), abs=0.05)
    assert (talk / "out" / "first" / "report.html").is_file()


def test_a_method_is_compared_where_it_has_seen_no_label(talk: Path) -> None:
    """Both materials are one setting, and have the same rates."""
    _run("--out", "out")
    title, found = "Methods in settings that nobody labelled", tables(talk / "out" / "benchmark.md")
    (table,) = (each for each in found if each.title == title)
    rows = {row[0]: dict(zip(table.header, row, strict=True)) for row in table.rows}
    of_run = {row["Method"]: row for row in _table(talk / "out" / "benchmark.csv") if row["Material"] == "second"}
    assert rows["posterior"]["talk"] == f"{of_run['posterior']['Log loss']} / {of_run['posterior']['Balanced %']}"
    assert rows["logit"]["Mean log loss"] == of_run["logit"]["Log loss"]
    assert rows["two_cones"]["Mean log loss"] == "–"
    assert [*rows][-2:] == ["nearest_15", "two_cones"]


def test_answers_of_ones_own_stand_beside_where_they_are(talk: Path) -> None:
    lines = [line.split(",") for line in true_labels().splitlines()[2:]]
    rows = [f"{n},{who},{what}" for a, b, who, what, _ in lines for n in range(int(a), int(b) + 1)]
    write_text(talk / "mine" / "talk.csv", "\n".join(["frame,subject,target", *rows]) + "\n")
    _run("--out", "out", "--set", "theirs.method=answers", "--set", "theirs.file=mine/${CLIP}.csv")
    theirs = [row for row in _table(talk / "out" / "benchmark.csv") if row["Method"] == "theirs"]
    assert [(row["Material"], row["FRR %"]) for row in theirs] == [("first", "100.0"), ("second", "100.0")]
    (talk / "mine" / "talk.csv").unlink()
    output = _run("--out", "again", "--set", "theirs.method=answers", "--set", "theirs.file=mine/${CLIP}.csv")
    assert not [row for row in _table(talk / "again" / "benchmark.csv") if row["Method"] == "theirs"]
    assert "theirs: not in the table: no file" in " ".join(output.split())


def test_without_any_material_there_is_no_table(talk: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        benchmark, "MATERIALS", {"third": BenchmarkMaterial(title="third", setting="third", experiment="gone")}
    )
    assert CliRunner().invoke(app, ["run", "benchmark"]).exit_code == 1
    assert not (talk / "runs").exists()


@pytest.mark.parametrize("options", [("--oracle",), ("--clip", "talk"), ("--set", "cones=3")])
def test_options_that_it_has_not_are_refused(talk: Path, options: tuple[str, ...]) -> None:
    error = CliRunner().invoke(app, ["run", "benchmark", *options]).exception
    assert isinstance(error, VfoaError)
    assert options[0] in str(error)
    assert not (talk / "runs").exists()


def test_the_materials_that_need_no_download_are_complete(monkeypatch: pytest.MonkeyPatch) -> None:
    experiment, left_out = benchmark.material_experiment("rendered", benchmark.MATERIALS["rendered"])
    assert [each.name for each in experiment.configurations] == list(METHODS)
    assert {each.choices["stereo"].name for each in experiment.configurations if each.choices["stereo"]} == {"sgbm"}
    assert (left_out, experiment.published) == ([], None)
