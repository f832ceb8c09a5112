"""The worked examples of CONTRIBUTING.md, installed as packages of somebody else's: a metric and a panel."""

from __future__ import annotations

import base64
import csv
import re
import zlib
from pathlib import Path

import pytest

from harness.run.results import to_line
from harness.score.metrics import load_metrics
from harness.score.outcomes import Reference
from scripts.worked_examples import example
from tests.plugins import install
from tests.records import answers, labels, score_run
from vfoa.errors import VfoaError

TRUTH = Reference(labels={"clip": labels("cup", "cup", "can", "cup", "can")})
ANSWERS = answers(["cup", "can", None, "can", "can"])


def _score(tmp_path: Path) -> Path:
    results = tmp_path / "results.jsonl"
    results.write_text("".join(map(to_line, ANSWERS)), encoding="utf-8")
    score_run(results, TRUTH)
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
