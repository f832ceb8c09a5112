"""The worked examples of CONTRIBUTING.md, installed as packages of somebody else's: a method, a metric, a panel."""

from __future__ import annotations

import base64
import csv
import re
import zlib
from pathlib import Path

import pytest
from rerun.chunk import RrdReader

from harness.clips.add import add_clip
from harness.pipeline.settings_reference import setting_keys, settings_tables
from harness.record.composed import find_clips
from harness.report.sinks import composed_sinks
from harness.report.write import rescore
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.run.table_records import read_records
from harness.score.metrics import load_metrics
from harness.score.reference import Reference
from scripts.worked_examples import example
from tests.disk import write_text
from tests.measured import measured_tables, true_labels
from tests.plugins import install
from tests.records import answers, labels, score_run
from tests.repository import REPOSITORY
from vfoa.errors import VfoaError

TRUTH = Reference(labels={"clip": labels("cup", "cup", "can", "cup", "can")})
ANSWERS = answers(["cup", "can", None, "can", "can"])


def _score(tmp_path: Path) -> Path:
    score_run(tmp_path, ANSWERS, TRUTH)
    return tmp_path


def test_a_metric_of_one_file_is_a_column_of_frr_csv_and_of_the_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = example("A metric")
    site = install(
        tmp_path / "site", "my_metric", source, group="vfoa.metrics", name="longest_wrong", cls="LongestWrong"
    )
    monkeypatch.syspath_prepend(str(site))
    run = _score(tmp_path)
    with (run / "frr.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["longest_wrong"]) for row in rows] == [3.0] * len(rows)
    assert "Longest wrong" in (run / "frr.md").read_text(encoding="utf-8")
    page = (run / "report.html").read_text(encoding="utf-8")
    packs = re.findall(r'id="pack-[^"]*"[^>]*>([^<]+)<', page)
    assert any(b"Longest wrong" in zlib.decompress(base64.b64decode(pack)) for pack in packs)


def test_a_metric_with_the_name_of_a_column_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site = install(
        tmp_path / "site", "my_metric", example("A metric"), group="vfoa.metrics", name="frr", cls="LongestWrong"
    )
    monkeypatch.syspath_prepend(str(site))
    assert "frr" in load_metrics()
    with pytest.raises(VfoaError, match="'frr'"):
        _score(tmp_path)


def test_a_panel_of_one_file_is_a_section_of_the_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site = install(
        tmp_path / "site", "my_panel", example("A panel of the report"), group="vfoa.panels", name="rates", cls="draw"
    )
    monkeypatch.syspath_prepend(str(site))
    page = (_score(tmp_path) / "report.html").read_text(encoding="utf-8")
    assert "<summary>Rates as bars</summary>" in page
    assert '<rect width="40.0" height="8"/>' in page


METHOD = """\
clips = ["talk"]
preset = "measured"
[[configuration]]
name = "nearest"
attention.method = "nearest"
[[configuration]]
name = "steady"
attention = { method = "steady", keep = 0.8 }
"""
FRAMES = 80
"""Three seconds: both look elsewhere once."""


def test_a_method_of_one_file_is_run_recorded_and_scored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = example("A method of attention")
    site = install(tmp_path / "site", "my_method", source, group="vfoa.attention", name="steady", cls="Steady")
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.chdir(tmp_path)
    add_clip(measured_tables(tmp_path / "talk", range(1, FRAMES + 1)), name="talk")
    write_text(tmp_path / "annotations" / "talk.csv", true_labels(FRAMES))
    experiment = load_experiment(str(write_text(tmp_path / "method.toml", METHOD)))
    plan = prepare(experiment, sinks=composed_sinks(experiment.configurations))
    directory = run_plan(plan, tmp_path / "run", workers=1, progress=lambda clip: None)

    manifest = directory.read_manifest().plain()
    assert manifest["configurations"]["steady"]["attention"] == {"method": "steady", "keep": 0.8}
    assert manifest["methods"]["steady"] == {"probabilistic": False, "says_nowhere": False, "from_file": False}
    assert "my_method" in plan.deciding_modules

    rates = {row.configuration: row.frr for row in rescore(directory).rows.overall}
    late = 3  # frames until the new target has more than half of the shares: 0.8 ** 4 < 0.5
    assert rates == {"nearest": 1.0, "steady": 1 - late / FRAMES}

    (recorded,) = find_clips(directory.path, "talk", "steady")
    paths = {str(path) for file in recorded.compose().files for path in RrdReader(file).store().schema().entity_paths()}
    assert any(path.startswith("/attention/steady/anna/") for path in paths)


@pytest.mark.parametrize(("method", "said"), [("stedy", "'steady'"), ("steady", "steady.keep")])
def test_a_mistake_in_the_settings_of_a_method_is_one_line(
    method: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = example("A method of attention")
    site = install(tmp_path / "site", "my_method", source, group="vfoa.attention", name="steady", cls="Steady")
    monkeypatch.syspath_prepend(str(site))
    text = METHOD.replace('method = "steady"', f'method = "{method}"').replace("0.8", "1.5")
    with pytest.raises(VfoaError) as error:
        load_experiment(str(write_text(tmp_path / "method.toml", text)), clips=("studio_table",))
    assert said.removeprefix("steady.") in str(error.value)
    assert "method.toml" in str(error.value)
    assert "\n" not in str(error.value)


def test_the_settings_of_a_method_are_in_the_reference(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = example("A method of attention")
    site = install(tmp_path / "site", "my_method", source, group="vfoa.attention", name="steady", cls="Steady")
    monkeypatch.syspath_prepend(str(site))
    (table,) = settings_tables("attention.steady")
    assert [(each.key, each.default) for each in table.settings] == [("attention.keep", "0.9")]
    assert "attention.keep" in setting_keys()


def test_a_method_that_fails_ends_its_configuration_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = example("A method of attention")
    failing = source.replace(
        "        shares = (", "        assert scene.index < 3, 'no third frame'\n        shares = ("
    )
    assert failing != source
    site = install(tmp_path / "site", "my_faulty_method", failing, group="vfoa.attention", name="steady", cls="Steady")
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.chdir(tmp_path)
    add_clip(measured_tables(tmp_path / "talk"), name="talk")
    experiment = load_experiment(str(write_text(tmp_path / "method.toml", METHOD)))
    directory = run_plan(prepare(experiment), tmp_path / "run", workers=1, progress=lambda clip: None)
    (failure,) = directory.read_manifest().failed
    assert (failure.configuration, "no third frame" in failure.error) == ("steady", True)
    assert [record.configuration for record in read_records(directory)] == ["nearest"] * 12


def test_nobody_but_the_methods_asks_for_the_class_of_a_methods_settings() -> None:
    asked = re.compile(r"isinstance\([^)]*(Attention|Bayes|Logit|Nearest|Method)Settings")
    sources = [*(REPOSITORY / "vfoa").rglob("*.py"), *(REPOSITORY / "harness").rglob("*.py")]
    assert [path for path in sources if asked.search(path.read_text(encoding="utf-8"))] == []
