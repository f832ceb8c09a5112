from __future__ import annotations

import math
import sys
from pathlib import Path

import pytest
import rerun as rr

from tests import same_run
from tests.disk import write_text


def _run(folder: Path, *, rate: str = "0.5", value: float = 1.0, still: float = 2.0) -> Path:
    """The files of a run with one table and one recording of two frames."""
    folder.mkdir(parents=True)
    write_text(folder / "manifest.json", "{}")
    write_text(folder / "frr.csv", f"clip,frr\nalley,{rate}\n")
    recording = rr.RecordingStream("test", recording_id=str(folder))
    recording.save(folder / "alley.rrd")
    recording.log("/still", rr.Scalars([still, math.nan]), static=True)
    times = [rr.TimeColumn("frame", sequence=(1, 2))]
    recording.send_columns("/moving", indexes=times, columns=rr.Scalars.columns(scalars=[value, 2 * value]))
    recording.disconnect()
    return folder


def _compare(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: Path) -> tuple[int, str]:
    monkeypatch.setattr(sys, "argv", ["same_run", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        same_run.main()
    return int(ended.value.code or 0), capsys.readouterr().out


def test_equal_runs_are_the_same(tmp_path, monkeypatch, capsys) -> None:
    before, after = _run(tmp_path / "before" / "demo"), _run(tmp_path / "after" / "demo")
    assert _compare(monkeypatch, capsys, before, after) == (0, "the same\n")
    assert _compare(monkeypatch, capsys, before.parent, after.parent) == (0, "the same\n")


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"rate": "0.6"}, "frr.csv: line 2 differs"),
        ({"rate": "0.5\nalley,0.5"}, "frr.csv: line 3 differs"),
        ({"value": 1.5}, "alley.rrd: 2 of 5 values differ, such as Scalars:scalars of /moving, frame 1"),
        ({"still": 2.5}, "alley.rrd: 1 of 5 values differ, such as Scalars:scalars of /still, static"),
    ],
)
def test_a_difference_is_named(tmp_path, monkeypatch, capsys, changed, expected) -> None:
    before, after = _run(tmp_path / "before"), _run(tmp_path / "after", **changed)
    assert _compare(monkeypatch, capsys, before, after) == (1, f"{after}: {expected}\n")


def test_a_file_or_a_run_of_one_side_alone_is_a_difference(tmp_path, monkeypatch, capsys) -> None:
    before, after = _run(tmp_path / "before" / "demo"), _run(tmp_path / "after" / "demo")
    (after / "alley.rrd").unlink()
    write_text(after / "measures.csv", "clip\n")
    code, said = _compare(monkeypatch, capsys, before, after)
    assert code == 1
    assert said.splitlines() == [
        f"{after}: alley.rrd: only in {before}",
        f"{after}: measures.csv: only in {after}",
    ]
    (before / "manifest.json").unlink()
    nothing = f"{tmp_path / 'none'}: expected a run or a folder of runs, found none\n"
    assert _compare(monkeypatch, capsys, tmp_path / "none", before.parent) == (1, nothing)
    assert _compare(monkeypatch, capsys, before.parent, after.parent) == (1, "demo: not a run in both folders\n")


def test_a_run_without_its_data_is_left_out_and_named(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(same_run, "RUNS", {"one": ("no_such_clip",)})
    code, said = _compare(monkeypatch, capsys, Path("--make"), tmp_path)
    assert code == 1
    assert said.startswith("one: left out: ")
    assert "no_such_clip" in said
    assert list(tmp_path.iterdir()) == []
