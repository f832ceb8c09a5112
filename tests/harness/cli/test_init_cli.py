from __future__ import annotations

import csv
import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from harness.cli import app
from harness.clips.manifest import load_manifest
from harness.files.folders import names
from tests.command import vfoa
from vfoa.errors import VfoaError


def test_a_working_directory_has_the_folders_that_are_searched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for _ in range(2):  # a second time changes nothing
        result = CliRunner().invoke(app, ["init", str(tmp_path / "mine")])
        assert result.exit_code == 0
        assert result.stdout.splitlines()[-1] == f"next: cd {tmp_path / 'mine'} && vfoa run"
    monkeypatch.chdir(tmp_path / "mine")
    for kind in ("datasets", "annotations", "experiments"):
        assert (Path.cwd() / kind).is_dir()
    (Path("experiments") / "mine.toml").touch()
    assert "mine" in names("experiments")


def test_what_it_leaves_prints_a_table_at_once_and_keeps_what_is_edited(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VFOA_MODELS", str(tmp_path))  # no weights
    assert vfoa(monkeypatch, capsys, "init", ".")[0] == 0
    for path in [path for path in tmp_path.rglob("*") if path.is_file()]:  # as macOS leaves on a shared disk
        path.with_name(f"._{path.name}").write_bytes(b"\0\5\26\7\0\2\0\0Mac OS X")
    assert vfoa(monkeypatch, capsys, "clips", "check")[0] == 0
    example, rendered = (load_manifest(name).labels(None) for name in ("example", "studio_talk"))
    assert example is not None
    assert rendered is not None
    assert list(example.labelled([1, 2])) == list(rendered.labelled([1, 2]))
    opened, talk = (load_manifest(name).open_images() for name in ("example", "studio_talk"))
    assert (opened.frame(1).rig, opened.rate_hz) == (talk.frame(1).rig, talk.rate_hz)

    code, said, err = vfoa(monkeypatch, capsys, "run", "--recording", "none", "--workers", "1")
    assert "vfoa view" not in said  # there is nothing to view
    assert said.rstrip().endswith("--recording light.")
    rows = list(csv.DictReader((tmp_path / "runs" / "first" / "frr.csv").read_text().splitlines()))
    assert (code, err, len(rows) > 3) == (0, "", True)
    assert {row["n"] for row in rows if row["subject"] == "(all)"} == {"4"}

    Path("experiments/first.toml").write_text("# mine\n")
    assert vfoa(monkeypatch, capsys, "init", ".")[0] == 0
    assert Path("experiments/first.toml").read_text() == "# mine\n"
    Path("experiments/second.toml").touch()
    assert vfoa(monkeypatch, capsys, "run")[0] == 2  # which of the two?


def test_a_file_in_the_way_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "datasets").touch()
    result = CliRunner().invoke(app, ["init", str(tmp_path)])
    assert isinstance(result.exception, VfoaError)
    assert "datasets: found a file" in str(result.exception)


def test_a_folder_whose_name_is_no_text_is_shown_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = vfoa(monkeypatch, capsys, "init", f"{tmp_path}/caf\udce9")
    assert (code, err) == (0, "")
    assert f"{tmp_path}/caf\\udce9 && vfoa run" in out
    assert os.listdir(os.fsencode(tmp_path)) == [b"caf\xe9"]
