"""``vfoa export-table`` and ``vfoa plan`` on a finished run, and comparisons of exported tables."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from harness.cli import app
from harness.run.results import to_line
from tests.disk import write_text
from tests.records import answers
from vfoa.errors import VfoaError

LOOK, LOOKS = 50, 6
CLIPS = tuple(f"clip{number}" for number in range(7))


@pytest.fixture(autouse=True)
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A working directory with clips of one subject that looks at a cup and a can in turn."""
    for clip in CLIPS:
        write_text(
            tmp_path / "datasets" / f"{clip}.toml",
            f'name = "{clip}"\nadapter = "studio"\nlicence = "MIT"\n[subjects.girl]\ncategory = "person"\n'
            '[targets.cup]\ncategory = "cup"\n[targets.can]\ncategory = "can"\n',
        )
        rows = (f"{LOOK * k + 1},{LOOK * (k + 1)},girl,{_target(k)},\n" for k in range(LOOKS))
        write_text(
            tmp_path / "annotations" / f"{clip}.csv",
            "# vfoa annotations 1\nfirst_frame,last_frame,subject,target,note\n" + "".join(rows),
        )
    monkeypatch.chdir(tmp_path)


def _target(look: int) -> str:
    return "can" if look % 2 else "cup"


def _run(folder: Path, shares: dict[str, float]) -> Path:
    """A finished run whose configurations are right in about these shares of each look."""
    rng = np.random.default_rng(1)
    frames = range(LOOK * LOOKS)
    records = []
    for clip in CLIPS:
        for name, share in shares.items():
            until = LOOK * np.clip(share + 0.1 * rng.standard_normal(LOOKS), 0, 1)
            said = [_target(k // LOOK) if k % LOOK < until[k // LOOK] else None for k in frames]
            records += answers(said, clip=clip, configuration=name)
    write_text(folder / "results.jsonl", "".join(map(to_line, records)))
    numbers = [frame + 1 for frame in frames]
    entries = [{"name": clip, "manifest": "", "notes": [], "frames": numbers, "licence": "MIT"} for clip in CLIPS]
    about = {"experiment": "small", "notes": ["Ours."], "clips": entries, "versions": {"vfoa": "1"}}
    configurations = {name: {"gaze": {"model": "simulated", "seed": 7}} for name in shares}
    write_text(folder / "manifest.json", json.dumps({**about, "configurations": configurations, "finished": "now"}))
    return folder


def _say(*arguments: object) -> str:
    done = CliRunner().invoke(app, list(map(str, arguments)), catch_exceptions=False)
    assert done.exit_code == 0
    return done.stdout


def test_exported_tables_are_compared_as_the_runs_are(tmp_path: Path) -> None:
    first, second = _run(tmp_path / "a", {"one": 0.5}), _run(tmp_path / "b", {"one": 0.7, "two": 0.6})
    for run in (first, second):
        _say("export-table", run, "--to", "json", "--out", f"{run}.json")
    of_runs = json.loads(_say("compare", first, second, "--json"))
    for one, two in ((f"{first}.json", f"{second}.json"), (first, f"{second}.json")):
        of_tables = json.loads(_say("compare", one, two, "--json"))
        for found, expected in zip(of_tables, of_runs, strict=True):
            names = ("reference", "configuration", "sentence")
            assert {k: v for k, v in found.items() if k not in names} == {
                k: v for k, v in expected.items() if k not in names
            }
    assert of_runs[0]["unit"] == "clip"


def test_the_data_sheet_says_what_the_numbers_are_of(tmp_path: Path) -> None:
    run = _run(tmp_path / "a", {"one": 0.5, "two": 0.6})
    table = json.loads(_say("export-table", run, "--to", "json"))
    sheet = table["sheet"]
    assert (sheet["experiment"], sheet["subjects"], sheet["pairs"]) == ("small", len(CLIPS), len(CLIPS) * LOOK * LOOKS)
    assert sheet["seeds"] == {"one": {"gaze": 7}, "two": {"gaze": 7}}
    assert [clip["scored"] for clip in sheet["clips"]] == [LOOK * LOOKS] * len(CLIPS)
    assert len(table["digest"]) == 64
    text = _say("export-table", run, "--to", "csv")
    rows = list(csv.DictReader(io.StringIO("".join(line for line in text.splitlines(True) if line[0] != "#"))))
    assert rows == table["rows"]
    for name in ("csv", "tex", "md"):
        assert table["digest"] in _say("export-table", run, "--to", name)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace('"truth"', '"verity"', 1), "unknown key 'frames.0.verity'"),
        (lambda text: text.replace("vfoa table 1", "vfoa table 9", 1), "expected 'vfoa table 1'"),
        (lambda text: text.replace("Ours.", "Mine.", 1), "digest: not that of the content"),
        (lambda text: text[:-20], "not JSON"),
    ],
)
def test_a_changed_table_is_refused(tmp_path: Path, change, said: str) -> None:  # type: ignore[no-untyped-def]
    run = _run(tmp_path / "a", {"one": 0.5})
    path = tmp_path / "a.json"
    write_text(path, change(_say("export-table", run, "--to", "json")))
    error = CliRunner().invoke(app, ["compare", str(path), str(run)]).exception
    assert isinstance(error, VfoaError)
    assert said in str(error)


def test_runs_with_other_labels_are_not_compared(tmp_path: Path) -> None:
    run = _run(tmp_path / "a", {"one": 0.5})
    _say("export-table", run, "--to", "json", "--out", tmp_path / "before.json")
    labels = tmp_path / "annotations" / "clip3.csv"
    write_text(labels, labels.read_text().replace("1,50,girl,cup", "1,50,girl,can"))
    error = CliRunner().invoke(app, ["compare", str(tmp_path / "before.json"), str(run)]).exception
    assert isinstance(error, VfoaError)
    assert "clip3: frame 1: girl looks at 'cup' in one and at 'can' in the other" in str(error)


def test_a_plan_asks_for_more_clips_the_smaller_the_difference(tmp_path: Path) -> None:
    run = _run(tmp_path / "a", {"one": 0.5, "two": 0.52})
    (small,), (large,) = (json.loads(_say("plan", run, "--points", points, "--json")) for points in (2, 20))
    assert small["clips"]["needed"] > large["clips"]["needed"] == 6
    assert small["clips_longer"]["needed"] <= small["clips"]["needed"]
    assert "Clips needed to see a difference of 2 points" in _say("plan", run, "--points", 2)
