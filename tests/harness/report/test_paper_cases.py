"""The paper's simulated cases: the values, its statements, and the command that prints them."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.cli import main
from harness.report.formats import to_markdown
from harness.report.paper_cases import CASES, Case, paper_cases

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize(
    ("n_rays", "radius_cm", "expected"),
    [(40, 5, 0.99), (40, 10, 0.95), (40, 20, 0.82), (4, 30, 0.0), (40, 30, 0.19), (40, 40, 0.0)],
)
def test_both_cues_on_the_centre_give_less_as_the_cone_widens(n_rays: int, radius_cm: float, expected: float) -> None:
    (value,) = CASES[0].attention(radius_cm, n_rays)
    assert value.total == pytest.approx(expected, abs=0.005)
    assert value.total == pytest.approx(value.gaze + value.head)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_each_statement_holds(case: Case) -> None:
    radius_cm = 30 if case.name == "between two sizes" else 5
    assert case.holds(case.attention(radius_cm, 40), CASES[0].attention(radius_cm, 40))


def test_a_head_on_a_corner_has_a_quarter_of_its_part() -> None:
    (centred,), (corner,) = (case.attention(5, 40) for case in CASES[:2])
    assert centred.head == pytest.approx(0.39, abs=0.005)
    assert corner.head == pytest.approx(0.1, abs=0.05)


def test_the_table_says_where_a_statement_is_not_reproduced() -> None:
    reproduced = {(row[0], row[3], row[4]): row[-1] for row in paper_cases().rows}
    assert reproduced["both on the middle", "5", "40"] == "yes"
    assert reproduced["both on the middle", "40", "40"] == "no"


def test_the_command_prints_and_writes_the_committed_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["vfoa", "run", "paper_cases", "--out", str(tmp_path)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code in (0, None)
    assert "0.99" in capsys.readouterr().out
    written = (tmp_path / "paper_cases.md").read_text(encoding="utf-8")
    assert written == to_markdown(paper_cases())
    assert written == (ROOT / "reports" / "paper_cases.md").read_text(encoding="utf-8")


def test_other_options_are_refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.argv", ["vfoa", "run", "paper_cases", "--limit", "3", "--oracle"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "run paper_cases: found --limit, --oracle; expected no option but --out" in capsys.readouterr().err
